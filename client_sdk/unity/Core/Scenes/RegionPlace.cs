namespace Terraport
{
    /// <summary>Where a region is seen best.</summary>
    public sealed class RegionPlace
    {
        internal RegionPlace() {}

        /// <summary>On the ground, metres, scene frame.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>Where to look, degrees clockwise from north.</summary>
        public double HeadingDeg { get; internal set; }

        /// <summary>Of a landing that shows the region, metres.</summary>
        public double RadiusM { get; internal set; }
    }
}
