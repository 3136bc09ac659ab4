using System;
using System.Collections.Generic;
using Terraport.Sessions;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// The connection of a session: opened, kept, lost, opened again. The state is the session's; here are the transport and
    /// what is due when. Section numbers are those of spec/wire-protocol.md.
    /// </summary>
    internal sealed class Link
    {
        // Between two aims: a hand moves faster, but ten plans a second are enough to prefetch by.
        private const double AimPeriodMs = 100;

        // One attempt: TCP, TLS, WebSocket handshake and welcome.
        private const double ConnectMs = 10000;

        // A connection that lived this long, or readied a landing, begins the waits anew when it is lost.
        private const double StableMs = 10000;

        // Silence of a server that owes an answer: without it a dead line is noticed by TCP after minutes only.
        private const double SilenceMs = 30000;

        // What one pump takes at most, so that a frame of the engine that pumps stays short: it is hashed at once.
        private const int MaxPumpBytes = 4 * 1024 * 1024;

        // What the session has to say and may not yet, beyond which nothing is received: else a server that sends wrong bytes
        // without end would fill the memory with what is to be told of them.
        private const int MaxUnsentMessages = 256;

        private const double Never = double.PositiveInfinity;

        private readonly ClientSession session;
        private readonly LinkSettings settings;
        private readonly Outgoing outgoing;
        // Spreads the waits of many clients; not for secrets.
        private readonly Random random = new Random();
        private readonly Access access;
        // Null between two connections. Every connection has a transport of its own.
        private ITransport transport;
        // Whether hello has been put into the session's outbox on this connection.
        private bool isGreeted;
        // By any connection: a service that never knew the token needs no second attempt with another.
        private bool wasEverWelcomed;
        private bool offersInHello = true;
        private bool isClosed;
        private int attempt;
        private string refusalCode;
        private string refusalMessage;
        private double serverWaitMs = -1;
        // Times on the caller's clock, milliseconds; Never where nothing is due.
        private double retryAtMs = Never;
        private double connectedMs;
        private double welcomedMs = Never;
        private double lastReceivedMs;
        private double awaitsSinceMs = Never;
        private double nextAimMs;

        internal Link(ClientSession session, LinkSettings settings)
        {
            this.session = session;
            this.settings = settings;
            access = new Access(settings.Token, settings.TokenProvider);
            outgoing = new Outgoing();
        }

        /// <summary>When something is due by itself, whatever the transport does; never where nothing is.</summary>
        internal double DueMs
        {
            get {
                if (transport == null) return retryAtMs;
                double due = welcomedMs == Never ? connectedMs + ConnectMs : Never;
                if (session.HasAim) due = Math.Min(due, nextAimMs);
                if (awaitsSinceMs != Never && welcomedMs != Never) due = Math.Min(due, SilentSinceMs + SilenceMs);
                return Math.Min(due, outgoing.DueMs);
            }
        }

        // A server is silent since its last message, but not from before it owed an answer or had said welcome.
        private double SilentSinceMs => Math.Max(lastReceivedMs, Math.Max(awaitsSinceMs, welcomedMs));

        /// <summary>Begin the first attempt to connect; the rest happens in <see cref="Pump"/>.</summary>
        internal void Start(double nowMs) { Connect(nowMs); }

        /// <summary>Do what is due; whether received messages are left for another time.</summary>
        /// <param name="nowMs">Now.</param>
        /// <param name="mayReceive">False where nobody takes the events.</param>
        internal bool Pump(double nowMs, bool mayReceive)
        {
            // Order within a pump: connect, greet, receive, judge the connection, send. Judging comes behind receiving, so that what a
            // server said last still counts; sending comes last, so that answers to what was received leave in the same pump.
            if (isClosed) return false;
            if (transport == null)
            {
                if (nowMs >= retryAtMs) Connect(nowMs);
                return false;
            }
            // Asked before the messages are taken: what came before the end must not be lost.
            ITransport pumped = transport;
            TransportState state = pumped.State;
            if (!isGreeted && (state == TransportState.Open || state == TransportState.Closed)) Greet(state, nowMs);
            bool hasMore = true;
            bool isBlocked = session.UnsentMessages >= MaxUnsentMessages;
            if (mayReceive && !isBlocked)
                hasMore = Receive(nowMs);
            else
                // Not looked at is not silent: nobody takes the events, or the session is full.
                lastReceivedMs = nowMs;
            // A message just taken has ended this connection by a violation.
            if (transport != pumped) return false;
            if (state == TransportState.Closed && !hasMore)
                OnLost(transport.CloseCode, transport.CloseReason, nowMs);
            else if (welcomedMs == Never && nowMs - connectedMs > ConnectMs)
                Abort(CloseCodes.Timeout, "no welcome in time", nowMs);
            else if (awaitsSinceMs != Never && welcomedMs != Never && nowMs - SilentSinceMs > SilenceMs)
            {
                Abort(CloseCodes.Timeout, "the server is silent", nowMs);
            }
            Flush(nowMs);
            return hasMore && mayReceive && !isBlocked;
        }

        /// <summary>Send what the session has to say; to be called after every command.</summary>
        internal void Flush(double nowMs)
        {
            Report(nowMs);
            if (transport == null || !isGreeted) return;
            // The session is asked only when all before has left: a slow line sends the newest aim, not every one.
            if (outgoing.Waiting.Count == 0)
            {
                if (session.HasAim && nowMs >= nextAimMs)
                {
                    nextAimMs = nowMs + AimPeriodMs;
                    session.FlushAim();
                }
                session.TakeMessages(outgoing.Waiting);
            }
            outgoing.Send(transport, nowMs);
            if (!session.AwaitsAnswer)
                awaitsSinceMs = Never;
            else if (awaitsSinceMs == Never)
                awaitsSinceMs = nowMs;
        }

        /// <summary>Connect now, unless there is a connection already; another token makes a new one in any case.</summary>
        internal void Reconnect(string newToken, double nowMs)
        {
            if (isClosed) return;
            // The same token again is no reason to cut a connection that works.
            bool isNewer = access.Replace(newToken);
            if (transport != null && !isNewer) return;
            Detach(Closes.Normal, "");
            attempt = 0;
            serverWaitMs = -1;
            Connect(nowMs);
        }

        /// <summary>Connect to that address from now on, and now, unless it was closed for good.</summary>
        internal void MoveTo(Uri url, double nowMs)
        {
            settings.Url = url;
            if (isClosed || (transport == null && retryAtMs == Never)) return;
            // What is to be said to the old one, a goodbye to its group for instance.
            Flush(nowMs);
            Detach(Closes.Normal, "");
            Report(nowMs);
            attempt = 0;
            Connect(nowMs);
        }

        /// <summary>Say goodbye and do not connect again.</summary>
        internal void Leave(double nowMs)
        {
            if (isClosed) return;
            session.Bye();
            Flush(nowMs);
            isClosed = true;
            Detach(Closes.Normal, "");
        }

        private void Connect(double nowMs)
        {
            attempt++;
            retryAtMs = Never;
            refusalCode = null;
            refusalMessage = null;
            isGreeted = false;
            connectedMs = nowMs;
            welcomedMs = Never;
            awaitsSinceMs = Never;
            outgoing.Begin(nowMs);
            PublishLink(new LinkState { Phase = LinkPhase.Connecting, Attempt = attempt });
            string token;
            try
            {
                token = access.Show();
            }
            catch (Exception error)
            {
                // It asked a server of its own, perhaps, over the line that is down: as temporary as that.
                OnLost(Closes.Abnormal, "the token's function failed: " + error.Message, nowMs);
                return;
            }
            transport = settings.Transports.Create();
            transport.Changed = settings.Changed;
            transport.Open(settings.Url, new[] { WireLimits.Subprotocol }, token);
        }

        private void Greet(TransportState state, double nowMs)
        {
            isGreeted = true;
            lastReceivedMs = nowMs;
            session.Connected(offersInHello);
            if (state == TransportState.Open) Flush(nowMs);
        }

        /// <summary>Take received messages; whether some are left.</summary>
        private bool Receive(double nowMs)
        {
            int bytes = 0;
            ITransport pumped = transport;
            TransportMessage message;
            while (bytes < MaxPumpBytes && session.UnsentMessages < MaxUnsentMessages)
            {
                // Looked at in each round: taking a message may end the connection, or begin another.
                if (transport != pumped || !pumped.TryReceive(out message)) return false;
                bytes += message.Bytes.Count;
                lastReceivedMs = nowMs;
                Take(message, nowMs);
                // What it has to say (credit above all) leaves before the next message is looked at.
                Flush(nowMs);
            }
            return true;
        }

        private void Take(TransportMessage message, double nowMs)
        {
            string violation = null;
            try
            {
                session.Receive(message.Bytes, message.IsText);
            }
            catch (ProtocolViolationException error)
            {
                violation = error.Message;
            }
            // The buffer goes back whatever happens: it belongs to the transport.
            finally
            {
                message.Release();
            }
            if (violation == null) return;
            // Events up to the violation are good, and are told before the end is.
            Report(nowMs);
            refusalCode = "malformed";
            refusalMessage = "the server broke the protocol: " + violation;
            Abort(CloseCodes.Malformed, "malformed", nowMs);
        }

        /// <summary>Hand the session's events on, and take what concerns the connection itself.</summary>
        private void Report(double nowMs)
        {
            StreamEvent next;
            while (session.TryNextEvent(out next))
            {
                if (next.Kind == StreamEventKind.Opened)
                {
                    welcomedMs = nowMs;
                    wasEverWelcomed = true;
                    outgoing.Allow(session.Limits.MaxMessagesPerS, nowMs);
                    PublishLink(new LinkState { Phase = LinkPhase.Open });
                }
                else if (next.Kind == StreamEventKind.Ready)
                {
                    attempt = 0;
                }
                else if (next.Kind == StreamEventKind.Refused && next.IsFatal)
                {
                    refusalCode = next.Code;
                    refusalMessage = next.Message;
                }
                else if (next.Kind == StreamEventKind.Notice && next.ReconnectAfterMs.HasValue)
                {
                    serverWaitMs = next.ReconnectAfterMs.Value;
                }
                settings.OnEvent(next);
            }
        }

        /// <summary>Close from this side, without waiting for the other: its answer may never come.</summary>
        private void Abort(int closeCode, string reason, double nowMs)
        {
            transport.Close(closeCode, reason);
            OnLost(closeCode, reason, nowMs);
        }

        private void OnLost(int closeCode, string reason, double nowMs)
        {
            double livedMs = welcomedMs == Never ? 0 : nowMs - welcomedMs;
            bool wasWelcomed = welcomedMs != Never;
            // First, since it makes the session note the loss: what it then reports belongs before the link's own event.
            Detach(Closes.Normal, "");
            Report(nowMs);
            if (refusalCode == "too_large" && !wasWelcomed && offersInHello)
            {
                // Once: offer nothing in hello from now on, since the server found that too large.
                offersInHello = false;
                Connect(nowMs);
                return;
            }
            // Only a connection that served resets the waits: a server that accepts and closes at once is not hammered.
            if (livedMs >= StableMs) attempt = 0;
            var state = new LinkState {
                CloseCode = closeCode,
                Code = refusalCode ?? Closes.ErrorOf(closeCode),
                Message = refusalMessage ?? (string.IsNullOrEmpty(reason) ? TextOf(closeCode) : reason),
            };
            // For good: with this token, or at all, it would be refused again. Picks would wait for ever.
            AfterClose after = Closes.After(closeCode);
            bool isRenewed = after == AfterClose.Token && wasEverWelcomed && access.HasNewer();
            if (after != AfterClose.Again && !isRenewed)
            {
                state.Phase = LinkPhase.Closed;
                session.RefusePicks(state.Code, state.Message);
                Report(nowMs);
            }
            else
            {
                state.Phase = LinkPhase.Waiting;
                state.Attempt = attempt + 1;
                state.RetryInMs = serverWaitMs >= 0 ? serverWaitMs : Backoff.WaitMs(Math.Max(0, attempt - 1), random.NextDouble());
                serverWaitMs = -1;
                retryAtMs = nowMs + state.RetryInMs;
            }
            PublishLink(state);
        }

        /// <summary>Part from the transport and from everything that was timed for it.</summary>
        private void Detach(int closeCode, string reason)
        {
            retryAtMs = Never;
            awaitsSinceMs = Never;
            if (transport == null) return;
            // Detached before it is closed: its last change notices must not pump a connection that is gone.
            ITransport detached = transport;
            transport = null;
            outgoing.Waiting.Clear();
            detached.Changed = null;
            detached.Close(closeCode, reason);
            TransportMessage message;
            // What it still holds is of no use: hand its buffers back unread.
            while (detached.TryReceive(out message)) message.Release();
            detached.Dispose();
            session.ConnectionLost();
        }

        private void PublishLink(LinkState state) { settings.OnEvent(new StreamEvent { Kind = StreamEventKind.Link, Link = state }); }

        private static string TextOf(int closeCode)
        {
            return closeCode == Closes.Abnormal ? "no connection to the server" : "the connection was closed with " + closeCode;
        }
    }
}
