using System.Collections.Generic;

namespace Terraport
{
    /// <summary>A landing of the whole group. Never changed: another one comes with the next event.</summary>
    public sealed class GroupGathering
    {
        private static readonly uint[] Nobody = new uint[0];

        internal GroupGathering() { Ready = Degraded = Missing = Nobody; }

        /// <summary>Rises from landing to landing of the group.</summary>
        public uint Number { get; internal set; }

        /// <summary>Number of the member who asked for it.</summary>
        public uint Guide { get; internal set; }

        /// <summary>Where, metres, scene frame.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>What the guide asks everybody to load, metres.</summary>
        public double RadiusM { get; internal set; }

        /// <summary>What may be shown first where time is short, metres; null where nothing may.</summary>
        public double? InnerRadiusM { get; internal set; }

        /// <summary>Milliseconds that the others wait at most, as of when it was told; null where nobody waits.</summary>
        public int? LeftMs { get; internal set; }

        /// <summary>Whether the barrier is open: all have arrived, or nobody waits any more.</summary>
        public bool IsOver { get; internal set; }

        /// <summary>Members that show their landing; empty before it is over.</summary>
        public IReadOnlyList<uint> Ready { get; internal set; }

        /// <summary>Members that show the inner part alone.</summary>
        public IReadOnlyList<uint> Degraded { get; internal set; }

        /// <summary>Members that declined, or said nothing in time.</summary>
        public IReadOnlyList<uint> Missing { get; internal set; }

        /// <summary>The same, and over.</summary>
        internal GroupGathering Over(uint[] ready, uint[] degraded, uint[] missing)
        {
            return new GroupGathering {
                Number = Number,
                Guide = Guide,
                Position = Position,
                RadiusM = RadiusM,
                InnerRadiusM = InnerRadiusM,
                LeftMs = null,
                IsOver = true,
                Ready = ready,
                Degraded = degraded,
                Missing = missing,
            };
        }
    }
}
