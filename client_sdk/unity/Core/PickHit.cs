using System.Collections.Generic;

namespace Terraport
{
    /// <summary>What a pick met at full detail, whatever is loaded.</summary>
    public sealed class PickHit
    {
        /// <summary>Where the ray meets full detail, metres, scene frame.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>Normal there: length 1, outwards, scene frame.</summary>
        public Vec3 Normal { get; internal set; }

        /// <summary>Id of the segment that was met, loaded here or not.</summary>
        public uint Segment { get; internal set; }

        /// <summary>Region id in this scene version; null without regions.</summary>
        public uint? Region { get; internal set; }

        /// <summary>Number of the region, the same in every version; null where it has none.</summary>
        public uint? StableId { get; internal set; }

        /// <summary>Label of the region; null without one.</summary>
        public string Label { get; internal set; }

        /// <summary>Height in the survey's own vertical reference, metres.</summary>
        public double HeightM { get; internal set; }

        /// <summary>Values of the survey's attributes, by name.</summary>
        public IReadOnlyDictionary<string, double> Attributes { get; internal set; }
    }
}
