using System.Collections.Generic;

namespace Terraport
{
    /// <summary>The plan of a landing: what comes and what is here already, to be shown; and what is kept beside it.</summary>
    public sealed class PlanFacts
    {
        /// <summary>Landing number of the client; the same over reconnects.</summary>
        public int Landing { get; set; }

        /// <summary>Centre of the landing, metres, scene frame.</summary>
        public Vec3 Position { get; set; }

        /// <summary>Radius asked for, metres.</summary>
        public double RadiusM { get; set; }

        /// <summary>Radius within which everything comes, metres: less than asked for where a budget cut it.</summary>
        public double EffectiveRadiusM { get; set; }

        /// <summary>How far the coarser level reaches beyond it, metres; null where there is none of it.</summary>
        public double? CoarseRadiusM { get; set; }

        /// <summary>What will be sent, in that order: nearest first.</summary>
        public IReadOnlyList<SegmentFacts> Load { get; set; }

        /// <summary>Ids within the radius that are held already.</summary>
        public IReadOnlyList<uint> Keep { get; set; }

        /// <summary>Ids held beyond the radius: kept ready for a hop back, not shown.</summary>
        public IReadOnlyList<uint> Nearby { get; set; }

        /// <summary>Payload bytes of <see cref="Load"/>.</summary>
        public long LoadBytes { get; set; }

        /// <summary>Payload bytes of load and keep.</summary>
        public long TotalBytes { get; set; }

        /// <summary>Triangles of load and keep.</summary>
        public long TotalTriangles { get; set; }

        /// <summary>Segments within the radius that a budget left out.</summary>
        public long OmittedSegments { get; set; }

        /// <summary>Which budget left them out; null where none did.</summary>
        public string OmittedBy { get; set; }
    }
}
