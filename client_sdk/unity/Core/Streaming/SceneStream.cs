using System;
using System.Collections.Generic;
using Terraport.Disk;
using Terraport.Sessions;

namespace Terraport
{
    /// <summary>
    /// A session and its connection, pumped by whoever made it: no thread, no task, no timer of its own, so that it runs where
    /// there are no threads. <see cref="ThreadedStream"/> is the same on a thread of its own.
    /// </summary>
    public sealed class SceneStream : ISceneStream
    {
        /// <summary>Picks that wait for an answer at most; more are refused here. A server answers far fewer at a time.</summary>
        public const int MaxPicks = 64;

        /// <summary>Events that wait to be taken, beyond which nothing is received until some are.</summary>
        public const int MaxWaitingEvents = 8192;

        private readonly ClientSession session;
        private readonly string streamUrl;
        private readonly Link link;
        // Null without a folder on disk.
        private readonly DiskShelf shelf;
        // False while the disk is read: what was kept is offered with the first hello.
        private bool isBegun;
        private readonly Func<double> clockMs;
        private readonly Queue<StreamEvent> events = new Queue<StreamEvent>();
        // When each landing that is not over was asked for, by its number.
        private readonly Dictionary<int, double> requestedMs = new Dictionary<int, double>();
        private bool isClosed;
        private string endedCode;
        private string endedMessage;

        /// <summary>Open a stream; it connects with the first <see cref="Pump"/>s.</summary>
        /// <param name="options">Copied at once, but for the budgets.</param>
        /// <param name="transports">Where connections come from; null for <see cref="WebSocketTransport"/>.</param>
        /// <param name="changed">Called from any thread when there may be something to pump; may be null.</param>
        /// <param name="clockMs">Another clock than <see cref="StreamClock"/>; monotonic milliseconds.</param>
        /// <exception cref="TerraportException">invalid_url.</exception>
        /// <exception cref="ArgumentException">An option that the protocol does not allow.</exception>
        public SceneStream(StreamOptions options, ITransportFactory transports = null, Action changed = null, Func<double> clockMs = null)
        {
            this.clockMs = clockMs ?? (() => StreamClock.NowMs);
            session = new ClientSession(new SessionOptions {
                Client = options.Client ?? ClientVersion.Text,
                Budgets = options.Budgets,
                CreditBytes = options.CreditBytes,
                ReleaseFactor = options.ReleaseFactor,
                CacheBytes = options.CacheBytes,
            });
            streamUrl = SceneUrl.Parse(options.SceneUrl).StreamUrl;
            link = new Link(session,
                new LinkSettings {
                    Url = new Uri(streamUrl),
                    Token = options.Token,
                    TokenProvider = options.TokenProvider,
                    Transports = transports ?? new WebSocketTransportFactory(),
                    OnEvent = Publish,
                    Changed = changed,
                });
            if (string.IsNullOrEmpty(options.DiskFolder) || options.DiskBytes <= 0)
            {
                Begin();
                return;
            }
            var disk = new DiskCache(options.DiskFolder, SceneUrl.Parse(options.SceneUrl).HttpUrl, options.DiskBytes);
            shelf = new DiskShelf(disk, options.CacheBytes, session.Pool, changed);
        }

        /// <inheritdoc/>
        public StreamStats Stats => session.Stats;

        /// <summary>When something is due by itself, on the stream's clock; infinite where only a message or a command is waited for.</summary>
        public double DueMs => isClosed ? double.PositiveInfinity : link.DueMs;

        /// <inheritdoc/>
        public int Land(Vec3 position, double radiusM, LandOptions options = null) { return Land(position, radiusM, options, clockMs()); }

        /// <inheritdoc/>
        public void Aim(Vec3 position, double radiusM, double? coarseRadiusM = null)
        {
            session.Aim(position, radiusM, coarseRadiusM);
            Flush();
        }

        /// <inheritdoc/>
        public int Pick(Vec3 origin, Vec3? direction = null)
        {
            int request = session.Pick(origin, direction);
            // Nobody would answer any more, or not before many others: refused here, as an event like any other.
            if (endedCode != null)
                session.RefusePicks(endedCode, endedMessage);
            else if (session.OpenPicks > MaxPicks)
                session.RefusePick(request, "too_many", MaxPicks + " picks wait for an answer already");
            Flush();
            return request;
        }

        /// <inheritdoc/>
        public int JoinGroup(string group, GroupRole role, string ownName = null)
        {
            // Before anything changes: after an exception the stream is as it was.
            ClientSession.JoinOf(0, group, role, ownName);
            session.Leave();
            // Where several processes serve, the address says where the group lives (wire protocol, 16.6). Always, so that there
            // is one way; the seat is asked for with the next welcome.
            if (!isClosed) link.MoveTo(new Uri(streamUrl + "?group=" + group), clockMs());
            int request = session.Join(group, role, ownName);
            Flush();
            return request;
        }

        /// <inheritdoc/>
        public void LeaveGroup()
        {
            session.Leave();
            Flush();
        }

        /// <inheritdoc/>
        public int Gather(Vec3 position, double radiusM, double? innerRadiusM = null, int? deadlineMs = null)
        {
            int request = session.Gather(position, radiusM, innerRadiusM, deadlineMs);
            Flush();
            return request;
        }

        /// <inheritdoc/>
        public void Arrive(uint gathering, GroupArrival how)
        {
            session.Arrive(gathering, how);
            Flush();
        }

        /// <inheritdoc/>
        public void Pump() { PumpOnce(); }

        /// <inheritdoc/>
        public bool TryNextEvent(out StreamEvent next)
        {
            bool hasEvent = events.Count > 0;
            next = hasEvent ? events.Dequeue() : default(StreamEvent);
            return hasEvent;
        }

        /// <inheritdoc/>
        public bool TryPin(uint segment, out PinnedPayload payload) { return session.Cache.TryPin(segment, out payload); }

        /// <inheritdoc/>
        public void Reconnect(string token = null)
        {
            if (isClosed) return;
            endedCode = null;
            // Whoever cannot wait begins without what is kept.
            isBegun = true;
            link.Reconnect(token, clockMs());
        }

        /// <inheritdoc/>
        public void Close()
        {
            if (isClosed) return;
            // Goodbye first; then what waits is refused, and memory goes back. Pinned payloads outlive the stream.
            link.Leave(clockMs());
            isClosed = true;
            endedCode = "closed";
            endedMessage = "the stream was closed here";
            session.RefusePicks(endedCode, endedMessage);
            Flush();
            session.Free();
            if (shelf != null) shelf.Close();
        }

        /// <inheritdoc/>
        public void Dispose() { Close(); }

        /// <summary>As <see cref="Pump"/>; whether there is more to do at once.</summary>
        /// <remarks>
        /// Backpressure: with too many events untaken nothing is received, the transport's queue fills, and TCP slows the server down.
        /// </remarks>
        internal bool PumpOnce()
        {
            if (!isClosed && !isBegun) TakeRestored();
            return !isClosed && isBegun && link.Pump(clockMs(), events.Count < MaxWaitingEvents);
        }

        /// <summary>As <see cref="Land(Vec3, double, LandOptions)"/>, asked for at a moment of the stream's clock.</summary>
        internal int Land(Vec3 position, double radiusM, LandOptions options, double atMs)
        {
            int number = session.Land(position, radiusM, options);
            // A number all the same: the caller's code need not know that it came too late.
            if (isClosed) return number;
            requestedMs[number] = atMs;
            Flush();
            return number;
        }

        private void Begin()
        {
            isBegun = true;
            link.Start(clockMs());
        }

        /// <summary>Hold what the disk had, and connect; nothing while it is being read.</summary>
        private void TakeRestored()
        {
            List<KeyValuePair<SegmentFacts, PayloadBuffer>> restored = shelf.TakeRestored();
            if (restored == null) return;
            // Used last comes last, and so is the most recently used in memory too.
            for (int at = restored.Count - 1; at >= 0; at--) session.Restore(restored[at].Key, restored[at].Value);
            Begin();
        }

        /// <summary>Keep what came on disk, and note what a landing shows as used.</summary>
        private void Keep(StreamEvent next)
        {
            PinnedPayload payload;
            if (next.Kind == StreamEventKind.Arrived && session.Cache.TryPin(next.Facts.Segment, out payload)) shelf.Put(payload);
            if (next.Kind != StreamEventKind.Ready) return;
            foreach (uint segment in next.Segments)
            {
                SegmentFacts facts;
                if (session.Cache.TryGetFacts(segment, out facts)) shelf.Use(facts);
            }
        }

        private void Flush() { link.Flush(clockMs()); }

        /// <summary>Queue an event, with what only the stream knows of it.</summary>
        private void Publish(StreamEvent next)
        {
            if (next.Kind == StreamEventKind.Ready)
            {
                double startedMs;
                // Here, since only the stream has the clock, and the moment of the call.
                next.ReadyAtMs = clockMs();
                bool wasRequested = requestedMs.TryGetValue(next.Landing.Value, out startedMs);
                next.ElapsedMs = wasRequested ? Math.Max(0, next.ReadyAtMs - startedMs) : 0;
            }
            bool isOver =
                next.Kind == StreamEventKind.Ready || next.Kind == StreamEventKind.Superseded || next.Kind == StreamEventKind.Refused;
            if (isOver && next.Landing.HasValue) requestedMs.Remove(next.Landing.Value);
            // From now on picks are refused at once, until a reconnect.
            if (next.Kind == StreamEventKind.Link && next.Link.Phase == LinkPhase.Closed)
            {
                endedCode = next.Link.Code;
                endedMessage = next.Link.Message;
            }
            if (shelf != null) Keep(next);
            events.Enqueue(next);
        }
    }
}
