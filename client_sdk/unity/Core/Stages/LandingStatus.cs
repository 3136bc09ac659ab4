using System.Collections.Generic;

namespace Terraport
{
    /// <summary>What a user interface is told of the newest landing.</summary>
    public struct LandingStatus
    {
        /// <summary>Number of the newest landing; 0 before the first.</summary>
        public int Landing;

        /// <summary>Where it stands.</summary>
        public LandingPhase Phase;

        /// <summary>Centre of the landing, metres, scene frame.</summary>
        public Vec3 Position;

        /// <summary>Radius asked for, metres.</summary>
        public double RadiusM;

        /// <summary>0 to 1: bytes that came and were made drawable, of those that must.</summary>
        public double Fraction;

        /// <summary>Its plan; null before it came.</summary>
        public PlanFacts Plan;

        /// <summary>Milliseconds from Land until every byte was here and verified; null until then.</summary>
        public double? ReadyMs;

        /// <summary>Milliseconds from Land until all of it was drawable; null until then.</summary>
        public double? PresentableMs;

        /// <summary>Payload bytes that came for it.</summary>
        public long PayloadBytes;

        /// <summary>What its full set lacks: told by the server, or not decodable. Ascending.</summary>
        public IReadOnlyList<uint> Missing;

        /// <summary>Why it was refused; else null.</summary>
        public string Refusal;
    }
}
