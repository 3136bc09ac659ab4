namespace Terraport
{
    /// <summary>A region with a name, and where to stand to see it: "take me to the stockpile".</summary>
    public sealed class Place
    {
        internal Place() {}

        /// <summary>What people call it; several regions may have one name.</summary>
        public string Label { get; internal set; }

        /// <summary>Number of the piece of ground, the same in every version.</summary>
        public long? StableId { get; internal set; }

        /// <summary>Its number in this version, as picks have it.</summary>
        public int Region { get; internal set; }

        /// <summary>True area, square metres.</summary>
        public double? AreaM2 { get; internal set; }

        /// <summary>Metres, scene frame: on the ground where <see cref="IsView"/>, else the region's middle.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>Where to look, degrees clockwise from north; null where nobody chose.</summary>
        public double? HeadingDeg { get; internal set; }

        /// <summary>Of a landing that shows the region, metres.</summary>
        public double RadiusM { get; internal set; }

        /// <summary>Whether the position was chosen for its view.</summary>
        public bool IsView { get; internal set; }
    }
}
