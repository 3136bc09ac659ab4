using System;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>State of the connection.</summary>
    public enum LinkPhase
    {
        /// <summary>An attempt is under way.</summary>
        Connecting,

        /// <summary>The service has answered.</summary>
        Open,

        /// <summary>Lost; another attempt follows.</summary>
        Waiting,

        /// <summary>Closed for good: another attempt would fail as well.</summary>
        Closed,
    }

    /// <summary>State of the connection, and the reason for it.</summary>
    public struct LinkState
    {
        /// <summary>The state.</summary>
        public LinkPhase Phase { get; internal set; }

        /// <summary>While waiting: number of the next attempt.</summary>
        public int Attempt { get; internal set; }

        /// <summary>While waiting: milliseconds until it, counted from the event.</summary>
        public double RetryInMs { get; internal set; }

        /// <summary>WebSocket close code; 0 where there is none.</summary>
        public int CloseCode { get; internal set; }

        /// <summary>Error code of the protocol, or "closed"; null while all is well.</summary>
        public string Code { get; internal set; }

        /// <summary>The reason for people; null while all is well.</summary>
        public string Message { get; internal set; }
    }

    /// <summary>The connection of a session: opened, lost, opened again. Polled from the thread that owns the session.</summary>
    internal sealed class Link
    {
        // Ten aims a second are enough to prefetch by. One attempt: TCP, TLS, handshake, welcome. A connection that lived so long resets the
        // waits. Silence of a service that owes an answer: without it a dead connection is noticed by TCP after minutes.
        private const double AimPeriodMs = 100, ConnectMs = 10000, StableMs = 10000, SilenceMs = 30000;
        private const double FirstWaitMs = 500, LongestWaitMs = 30000;

        // Of the service's message rate, averaged over 10 s, so much is used: the clocks of the two sides differ.
        private const double RateShare = 0.8, RateWindowS = 10;

        // What one pump takes at most, so that a frame stays short.
        private const int MaxPumpBytes = 4 << 20;

        private readonly SessionCore session;
        private readonly SceneUrl url;
        private readonly Func<Uri, string, ITransport> connect;
        private readonly Action<LinkState> report;
        private readonly Random random = new Random();
        private Func<string> token;
        private ITransport transport;
        private string groupOfUrl, tokenShown, refusalCode, refusalMessage;
        private double nowMs, connectedAtMs, heardAtMs, welcomedAtMs = -1, sentAtMs, retryAtMs, aimedAtMs, sendRoom;
        private int attempt;
        private bool wasWelcomed;
        private double? serverWaitMs;

        /// <param name="session">Its state; this is the only one that sends and receives for it.</param>
        /// <param name="url">The scene.</param>
        /// <param name="token">Returns the present token; null for none.</param>
        /// <param name="connect">Begins a connection to an address with a token.</param>
        /// <param name="report">Takes the states of the connection.</param>
        internal Link(
            SessionCore session, SceneUrl url, Func<string> token, Func<Uri, string, ITransport> connect, Action<LinkState> report)
        {
            this.session = session;
            this.url = url;
            this.token = token;
            this.connect = connect;
            this.report = report;
        }

        /// <summary>Connections that the service welcomed.</summary>
        internal int Connections { get; private set; }

        /// <summary>Connect now, perhaps with another token: cuts a wait short, and opens what was closed for good.</summary>
        internal void Reconnect(string newToken)
        {
            bool isOther = newToken != null && newToken != tokenShown;
            if (newToken != null) token = () => newToken;
            if (transport == null || isOther) Restart();
        }

        /// <summary>Connect again at once, whatever the present connection does.</summary>
        internal void Restart()
        {
            Detach();
            retryAtMs = 0;
            attempt = 0;
        }

        /// <summary>Close for good, with a goodbye where the connection is open.</summary>
        internal void Close()
        {
            session.Bye();
            if (session.HasMessages && transport != null) session.TakeMessages().ForEach(transport.Send);
            Detach();
            retryAtMs = double.PositiveInfinity;
        }

        /// <summary>Refusals by the service, as the session reports them.</summary>
        internal void NoteRefusal(string code, string message)
        {
            refusalCode = code;
            refusalMessage = message;
        }

        /// <summary>A landing was whole: the waits are reset.</summary>
        internal void NoteSuccess() { attempt = 0; }

        /// <summary>The service goes away: connect again after so long.</summary>
        internal void NoteDraining(double? waitMs) { serverWaitMs = waitMs; }

        /// <summary>The service has answered.</summary>
        internal void NoteWelcome()
        {
            Connections++;
            wasWelcomed = true;
            welcomedAtMs = nowMs;
            sendRoom = session.MaxMessagesPerS * RateShare * RateWindowS;
            report(new LinkState { Phase = LinkPhase.Open });
        }

        /// <summary>Once per frame: connect when it is due, receive, send.</summary>
        internal void Pump(double timeMs)
        {
            double passedS = Math.Max(0, timeMs - nowMs) / 1000;
            nowMs = timeMs;
            if (transport == null)
            {
                if (nowMs >= retryAtMs) Connect();
                return;
            }
            double rate = session.MaxMessagesPerS * RateShare;
            sendRoom = Math.Min(sendRoom + passedS * rate, Math.Max(1, rate * RateWindowS));
            if (!TryReceive()) return;
            if (transport.State == TransportState.Closed)
            {
                OnLost(transport.CloseCode, transport.CloseReason);
                return;
            }
            if (transport.State == TransportState.Open) Send();
            bool isLate = welcomedAtMs < 0 && nowMs - connectedAtMs > ConnectMs;
            if (isLate || (session.IsWaiting && nowMs - Math.Max(heardAtMs, sentAtMs) > SilenceMs))
                Abort(CloseCodes.Timeout, isLate ? "no answer" : "silence");
            else if (session.NeedsGroupUrl)
                Connect();
        }

        private void Connect()
        {
            Detach();
            welcomedAtMs = -1;
            connectedAtMs = nowMs;
            refusalCode = refusalMessage = null;
            groupOfUrl = session.Group.Name;
            var address = new Uri(url.StreamUrl + (groupOfUrl == null ? "" : "?group=" + Uri.EscapeDataString(groupOfUrl)));
            report(new LinkState { Phase = LinkPhase.Connecting });
            try
            {
                tokenShown = token();
                transport = connect(address, tokenShown);
            }
            catch (Exception error)
            {
                // A project's own function for tokens, or the platform: tried again like any failure.
                OnLost(CloseCodes.Abnormal, error.Message);
                return;
            }
            session.Connected(groupOfUrl);
        }

        private bool TryReceive()
        {
            int bytes = 0;
            while (bytes < MaxPumpBytes && transport.TryReceive(out ArraySegment<byte> message))
            {
                heardAtMs = nowMs;
                bytes += message.Count;
                ITransport from = transport;
                try
                {
                    session.Receive(message);
                }
                catch (WireException error)
                {
                    NoteRefusal("malformed", "the server broke the protocol: " + error.Message);
                    Abort(CloseCodes.Malformed, "malformed");
                }
                from.Release(message);
                // Closed by a listener, or by us.
                if (transport != from) return false;
            }
            return true;
        }

        private void Send()
        {
            if (session.HasAim && nowMs - aimedAtMs >= AimPeriodMs)
            {
                aimedAtMs = nowMs;
                session.FlushAim();
            }
            if (!session.HasMessages || (sendRoom < 1 && session.IsOpen)) return;
            foreach (byte[] message in session.TakeMessages())
            {
                transport.Send(message);
                sendRoom--;
            }
            sentAtMs = nowMs;
        }

        /// <summary>Close from this side, without waiting for the other.</summary>
        private void Abort(int code, string reason)
        {
            transport.Close(code, reason);
            OnLost(code, reason);
        }

        private void OnLost(int closeCode, string reason)
        {
            // A service that accepts and closes at once is not asked again and again.
            if (welcomedAtMs >= 0 && nowMs - welcomedAtMs >= StableMs) attempt = 0;
            Detach();
            string code = refusalCode ?? CloseCodes.ErrorOf(closeCode);
            string words = string.IsNullOrEmpty(reason) ? "the connection was closed with " + closeCode : reason;
            var state = new LinkState { CloseCode = closeCode, Code = code, Message = refusalMessage ?? words };
            if (!CloseCodes.IsTemporary(closeCode) && !HasNewerToken(closeCode))
            {
                retryAtMs = double.PositiveInfinity;
                state.Phase = LinkPhase.Closed;
                session.RefusePicks(code);
            }
            else
            {
                double doubledMs = FirstWaitMs * (1 << Math.Min(attempt, 16));
                state.Phase = LinkPhase.Waiting;
                state.RetryInMs = serverWaitMs ?? Math.Min(doubledMs, LongestWaitMs) * (0.5 + 0.5 * random.NextDouble());
                state.Attempt = ++attempt;
                serverWaitMs = null;
                retryAtMs = nowMs + state.RetryInMs;
            }
            report(state);
        }

        /// <summary>The token ran out, and there is another one by now: only after a welcome, since a service that never knew it says so once.</summary>
        private bool HasNewerToken(int closeCode)
        {
            if (closeCode != CloseCodes.Unauthorised || !wasWelcomed) return false;
            try
            {
                return token() != tokenShown;
            }
            catch (Exception)
            {
                return true; // Not known: the next attempt asks again.
            }
        }

        private void Detach()
        {
            if (transport == null) return;
            ITransport ended = transport;
            transport = null;
            ended.Dispose();
            session.Lost();
        }
    }
}
