using System;
using System.Collections.Generic;
using Terraport.Sessions;

namespace Terraport.Tests
{
    /// <summary>A stream that holds what a test gives it: payloads by segment, and what was asked of it.</summary>
    internal sealed class FakeStream : ISceneStream
    {
        private readonly Dictionary<uint, byte[]> payloads = new Dictionary<uint, byte[]>();
        private readonly PayloadPool pool = new PayloadPool();

        public StreamStats Stats => new StreamStats();

        /// <summary>Landings asked for.</summary>
        internal int Landings { get; private set; }

        /// <summary>Aims asked for.</summary>
        internal int Aims { get; private set; }

        /// <summary>Payloads handed out.</summary>
        internal int Pins { get; private set; }

        internal void Hold(uint segment, byte[] payload) { payloads[segment] = payload; }

        internal void Drop(uint segment) { payloads.Remove(segment); }

        /// <summary>The ring of the newest landing, and of the newest aim.</summary>
        internal double? LandedRingM { get; private set; }

        internal double? AimedRingM { get; private set; }

        public int Land(Vec3 position, double radiusM, LandOptions options = null)
        {
            LandedRingM = options == null ? null : options.CoarseRadiusM;
            return ++Landings;
        }

        public void Aim(Vec3 position, double radiusM, double? coarseRadiusM = null)
        {
            AimedRingM = coarseRadiusM;
            Aims++;
        }

        public int Pick(Vec3 origin, Vec3? direction = null) { throw new NotSupportedException(); }

        /// <summary>What was said of group landings, in order.</summary>
        internal List<string> Arrivals { get; } = new List<string>();

        public int JoinGroup(string group, GroupRole role, string ownName = null) { return 1; }

        public void LeaveGroup() {}

        public int Gather(Vec3 position, double radiusM, double? innerRadiusM = null, int? deadlineMs = null) { return 1; }

        public void Arrive(uint gathering, GroupArrival how) { Arrivals.Add(gathering + " " + how); }

        public void Pump() {}

        public bool TryNextEvent(out StreamEvent next)
        {
            next = default(StreamEvent);
            return false;
        }

        public bool TryPin(uint segment, out PinnedPayload payload)
        {
            payload = default(PinnedPayload);
            byte[] bytes;
            if (!payloads.TryGetValue(segment, out bytes))
            {
                return false;
            }
            // A buffer a pin: rented with one user, so that disposing of the pin gives it back.
            PayloadBuffer buffer = pool.Rent(bytes.Length);
            Buffer.BlockCopy(bytes, 0, buffer.Data, 0, bytes.Length);
            payload = new PinnedPayload(buffer, default(SegmentFacts));
            Pins++;
            return true;
        }

        public void Reconnect(string token = null) {}

        public void Close() {}

        public void Dispose() {}
    }
}
