using System;
using System.Collections.Generic;
using System.Threading;
using Terraport.Sessions;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// A <see cref="SceneStream"/> on a thread of its own: hashing, message reading and copying cost the caller's frames
    /// nothing. Commands return at once.
    /// </summary>
    public sealed class ThreadedStream : ISceneStream
    {
        // The thread looks again after this long even if nobody woke it.
        private const int LongestSleepMs = 1000;

        // Guards commands, events, stats, the newest aim and isOver. `stream` itself belongs to the thread alone, TryPin apart.
        private readonly object gate = new object();
        private readonly Queue<Action> commands = new Queue<Action>();
        private readonly Queue<StreamEvent> events = new Queue<StreamEvent>();
        private readonly AutoResetEvent wake = new AutoResetEvent(false);
        private readonly SceneStream stream;
        // One delegate, so that the command can be told from the others.
        private readonly Action close;
        private StreamStats stats;
        // The newest aim, which is no command of its own: it may come with every frame, and must allocate nothing.
        private Vec3 aimPosition;
        private double aimRadiusM;
        private double? aimCoarseRadiusM;
        private bool hasAim;
        // Counted here as the stream counts them there, so that a number can be returned before the command has run.
        private int landings;
        private int requests;
        private bool isClosed;
        // Set with the command that closes: nothing is queued behind it.
        private bool isOver;

        /// <summary>Open a stream; it connects at once.</summary>
        /// <param name="options">As of <see cref="SceneStream"/>.</param>
        /// <param name="transports">Where connections come from; null for <see cref="WebSocketTransport"/>.</param>
        /// <exception cref="TerraportException">invalid_url.</exception>
        /// <exception cref="ArgumentException">An option that the protocol does not allow.</exception>
        public ThreadedStream(StreamOptions options, ITransportFactory transports = null)
        {
            stream = new SceneStream(options, transports, Wake);
            close = stream.Close;
            var thread = new Thread(Run) { Name = "terraport stream", IsBackground = true };
            thread.Start();
        }

        /// <inheritdoc/>
        public StreamStats Stats
        {
            get {
                lock (gate) return stats;
            }
        }

        /// <inheritdoc/>
        public int Land(Vec3 position, double radiusM, LandOptions options = null)
        {
            LandOptions copy = options == null ? null : options.Copy();
            // On the caller's thread, so that a bad number throws where it was passed.
            WireCodec.Check(new LandingState(0, position, radiusM, copy).Message(0, double.PositiveInfinity));
            // The wait in the queue counts: the user's clock starts with the call.
            double atMs = StreamClock.NowMs;
            landings++;
            // A landing ends the aims before it.
            lock (gate) hasAim = false;
            Command(() => stream.Land(position, radiusM, copy, atMs));
            return landings;
        }

        /// <inheritdoc/>
        public void Aim(Vec3 position, double radiusM, double? coarseRadiusM = null)
        {
            AimState.Check(position, radiusM, coarseRadiusM);
            lock (gate)
            {
                aimPosition = position;
                aimRadiusM = radiusM;
                aimCoarseRadiusM = coarseRadiusM;
                hasAim = true;
            }
            Wake();
        }

        /// <inheritdoc/>
        public int Pick(Vec3 origin, Vec3? direction = null)
        {
            WireCodec.Check(new PickMessage { Origin = origin, Direction = direction });
            requests++;
            Command(() => stream.Pick(origin, direction));
            return requests;
        }

        /// <inheritdoc/>
        public int JoinGroup(string group, GroupRole role, string ownName = null)
        {
            ClientSession.JoinOf(0, group, role, ownName);
            requests++;
            Command(() => stream.JoinGroup(group, role, ownName));
            return requests;
        }

        /// <inheritdoc/>
        public void LeaveGroup() { Command(stream.LeaveGroup); }

        /// <inheritdoc/>
        public int Gather(Vec3 position, double radiusM, double? innerRadiusM = null, int? deadlineMs = null)
        {
            ClientSession.GatherOf(0, position, radiusM, innerRadiusM, deadlineMs);
            requests++;
            Command(() => stream.Gather(position, radiusM, innerRadiusM, deadlineMs));
            return requests;
        }

        /// <inheritdoc/>
        public void Arrive(uint gathering, GroupArrival how)
        {
            ClientSession.ArrivedOf(gathering, how);
            Command(() => stream.Arrive(gathering, how));
        }

        /// <summary>Does nothing: the stream's own thread pumps.</summary>
        public void Pump() {}

        /// <inheritdoc/>
        public bool TryNextEvent(out StreamEvent next)
        {
            bool wasFull;
            lock (gate)
            {
                if (events.Count == 0)
                {
                    next = default(StreamEvent);
                    return false;
                }
                // The thread sleeps while the queue is full; the first free slot wakes it.
                wasFull = events.Count >= SceneStream.MaxWaitingEvents;
                next = events.Dequeue();
            }
            if (wasFull) Wake();
            return true;
        }

        /// <inheritdoc/>
        public bool TryPin(uint segment, out PinnedPayload payload) { return stream.TryPin(segment, out payload); }

        /// <inheritdoc/>
        public void Reconnect(string token = null) { Command(() => stream.Reconnect(token)); }

        /// <inheritdoc/>
        public void Close()
        {
            if (isClosed) return;
            Command(close);
            isClosed = true;
        }

        /// <inheritdoc/>
        public void Dispose() { Close(); }

        private void Command(Action command)
        {
            lock (gate)
            {
                if (isOver) return;
                commands.Enqueue(command);
                if (command == close) isOver = true;
            }
            Wake();
        }

        private void Wake() { wake.Set(); }

        private void Run()
        {
            try
            {
                Work();
            }
            catch (Exception error)
            {
                // A mistake of ours, of a project's own transport, or no memory: a thread that dies in silence looks like a slow line.
                Break(error);
            }
        }

        /// <summary>The thread's loop: commands, one pump, events handed over; asleep while there is none of them.</summary>
        private void Work()
        {
            bool isLast;
            do
            {
                isLast = RunCommands();
                // More to receive, and room for events: go on at once. A full queue sleeps until an event is taken.
                bool hasMore = !isLast && stream.PumpOnce();
                bool isFull = HandOver(isLast);
                if (!isLast && !hasMore && !isFull)
                    wake.WaitOne(SleepMs());
                else if (isFull)
                    wake.WaitOne(LongestSleepMs);
            }
            while (!isLast);
        }

        /// <summary>Tell that the stream is over, for good: its state may be half of one and half of another.</summary>
        private void Break(Exception error)
        {
            var state = new LinkState { Phase = LinkPhase.Closed, Code = "internal", Message = "the stream broke: " + error.Message };
            lock (gate)
            {
                isOver = true;
                commands.Clear();
                events.Enqueue(new StreamEvent { Kind = StreamEventKind.Link, Link = state });
            }
            try
            {
                stream.Close(); // The connection at least.
            }
            catch (Exception)
            {
                // What is broken may break again.
            }
        }

        /// <summary>Carry out what was asked for, in order, and the newest aim behind it; whether the stream is closed by now.</summary>
        private bool RunCommands()
        {
            for (;;)
            {
                Action command = null;
                Vec3 position;
                double radiusM;
                double? coarseRadiusM;
                lock (gate)
                {
                    if (commands.Count > 0)
                        command = commands.Dequeue();
                    else if (!hasAim)
                        return false;
                    else
                        hasAim = false;
                    // Copied under the lock: a newer aim may be written while this one is sent.
                    position = aimPosition;
                    radiusM = aimRadiusM;
                    coarseRadiusM = aimCoarseRadiusM;
                }
                if (command == null)
                    stream.Aim(position, radiusM, coarseRadiusM);
                else
                    command();
                if (command == close) return true;
            }
        }

        /// <summary>Hand the stream's events over, as many as may wait; whether some are left.</summary>
        private bool HandOver(bool handsOverAll)
        {
            lock (gate)
            {
                // A new object each time: what a caller read before does not change under its eyes.
                stats = stream.Stats;
                StreamEvent next;
                // Closing hands everything over, whatever the bound: nobody would pump the rest later.
                while (handsOverAll || events.Count < SceneStream.MaxWaitingEvents)
                {
                    if (!stream.TryNextEvent(out next)) return false;
                    events.Enqueue(next);
                }
                return true;
            }
        }

        private int SleepMs()
        {
            double untilDueMs = stream.DueMs - StreamClock.NowMs;
            // Rounded up: a wake a fraction of a millisecond early would only sleep again.
            return untilDueMs >= LongestSleepMs ? LongestSleepMs : (int)Math.Max(1, Math.Ceiling(untilDueMs));
        }
    }
}
