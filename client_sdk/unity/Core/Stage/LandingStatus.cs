using System.Collections.Generic;

namespace Terraport
{
    /// <summary>State of the newest landing.</summary>
    public enum LandingPhase
    {
        /// <summary>There was no landing.</summary>
        Idle,

        /// <summary>Requested; the plan has not come.</summary>
        Planning,

        /// <summary>Payload is received, decoded and uploaded.</summary>
        Streaming,

        /// <summary>The inner part can be shown, after the deadline.</summary>
        DegradedPresentable,

        /// <summary>All of it can be shown.</summary>
        Presentable,

        /// <summary>All of it is shown.</summary>
        Shown,

        /// <summary>The service refused it; what is shown stays.</summary>
        Refused,
    }

    /// <summary>The newest landing, for a display.</summary>
    public struct LandingStatus
    {
        /// <summary>Number of the newest landing; 0 before the first.</summary>
        public int Landing { get; internal set; }

        /// <summary>Its state.</summary>
        public LandingPhase Phase { get; internal set; }

        /// <summary>Centre, metres, scene frame.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>Radius, metres.</summary>
        public double RadiusM { get; internal set; }

        /// <summary>0 to 1: bytes that are here and made drawable, of those that must be.</summary>
        public double Fraction { get; internal set; }

        /// <summary>Its plan; null before it came.</summary>
        public PlanFacts Plan { get; internal set; }

        /// <summary>Milliseconds from Land until every byte was here and verified; null until then.</summary>
        public double? ReadyMs { get; internal set; }

        /// <summary>Ids of segments that could not be delivered or drawn, ascending.</summary>
        public IReadOnlyList<uint> Missing { get; internal set; }

        /// <summary>Why it was refused; else null.</summary>
        public string Refusal { get; internal set; }
    }

    /// <summary>The plan of a landing.</summary>
    public sealed class PlanFacts
    {
        /// <summary>Number of the landing.</summary>
        public int Landing { get; internal set; }

        /// <summary>Centre, metres, scene frame.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>Radius asked for, metres.</summary>
        public double RadiusM { get; internal set; }

        /// <summary>Everything nearer is shown, metres: less than asked for where a budget cut it.</summary>
        public double EffectiveRadiusM { get; internal set; }

        /// <summary>Segments that are shown, of them those of the coarser level, and those that are sent.</summary>
        public int Segments { get; internal set; }

        /// <summary>Segments of the coarser level.</summary>
        public int CoarserSegments { get; internal set; }

        /// <summary>Segments that are sent.</summary>
        public int LoadSegments { get; internal set; }

        /// <summary>Payload bytes that are sent.</summary>
        public long LoadBytes { get; internal set; }

        /// <summary>Payload bytes of all segments.</summary>
        public long TotalBytes { get; internal set; }

        /// <summary>Triangles of all segments.</summary>
        public long TotalTriangles { get; internal set; }

        /// <summary>Segments that a budget left out.</summary>
        public long OmittedSegments { get; internal set; }

        /// <summary>The budget that left them out; null where none did.</summary>
        public string OmittedBy { get; internal set; }
    }

    /// <summary>What has changed on the screen.</summary>
    public sealed class SceneSwap
    {
        /// <summary>Number of the landing that is shown; 0 where a base came.</summary>
        public int Landing { get; internal set; }

        /// <summary>Only the inner part is shown; the rest follows.</summary>
        public bool IsDegraded { get; internal set; }

        /// <summary>The base of another version is drawn.</summary>
        public bool IsNewBase { get; internal set; }

        /// <summary>Ids of the segments that are shown, ascending: from the scene's segment count on those of the coarser level.</summary>
        public IReadOnlyList<uint> Segments { get; internal set; }

        /// <summary>Base faces that are hidden.</summary>
        public int HiddenBaseFaces { get; internal set; }
    }

    /// <summary>Counts of a visit.</summary>
    public struct StreamStats
    {
        /// <summary>Payload bytes received, on all connections.</summary>
        public long PayloadBytes { get; internal set; }

        /// <summary>Those of them that were here already; 0 with a right server.</summary>
        public long RepeatedBytes { get; internal set; }

        /// <summary>Payload bytes in memory.</summary>
        public long HeldBytes { get; internal set; }

        /// <summary>Segments in memory.</summary>
        public int HeldSegments { get; internal set; }
    }
}
