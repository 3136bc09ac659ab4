using System.Collections.Generic;

namespace Terraport
{
    /// <summary>What a pick met, at full detail, whatever is loaded.</summary>
    public sealed class PickHit
    {
        /// <summary>Where the ray meets full detail, metres, scene frame.</summary>
        public Vec3 Position { get; set; }

        /// <summary>Normal there: length 1, outwards, scene frame.</summary>
        public Vec3 Normal { get; set; }

        /// <summary>Id of the segment that was met, loaded here or not.</summary>
        public uint Segment { get; set; }

        /// <summary>Region id of this scene version; null without regions.</summary>
        public uint? Region { get; set; }

        /// <summary>Number of the piece of ground, the same in every version; null where regions have none.</summary>
        public long? StableId { get; set; }

        /// <summary>What people call the region; null without a label.</summary>
        public string Label { get; set; }

        /// <summary>Height in the survey's own vertical reference, metres.</summary>
        public double HeightM { get; set; }

        /// <summary>Values of the survey's attributes, by name.</summary>
        public IReadOnlyDictionary<string, double> Attributes { get; set; }
    }
}
