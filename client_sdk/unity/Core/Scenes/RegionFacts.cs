namespace Terraport
{
    /// <summary>One row of regions.json, with the label of labels.json. What the scene does not say is null.</summary>
    public sealed class RegionFacts
    {
        internal RegionFacts() {}

        /// <summary>Position in the list: the number in payloads. Belongs to one scene version.</summary>
        public int Id { get; internal set; }

        /// <summary>Number of the piece of ground, the same in every version.</summary>
        public long? StableId { get; internal set; }

        /// <summary>What people call it; labels.json wins over the build's own.</summary>
        public string Label { get; internal set; }

        /// <summary>True area, square metres.</summary>
        public double? AreaM2 { get; internal set; }

        /// <summary>sRGB, 0 to 255 each, as x, y, z.</summary>
        public Vec3? MeanColour { get; internal set; }

        /// <summary>Mean slope, degrees; 0 is level.</summary>
        public double? SlopeDeg { get; internal set; }

        /// <summary>Centroid of the region's surface, metres, scene frame.</summary>
        public Vec3? Centroid { get; internal set; }

        /// <summary>Where it is seen best.</summary>
        public RegionPlace Place { get; internal set; }
    }
}
