namespace Terraport
{
    /// <summary>Where a ray met the ground that is shown.</summary>
    public struct GroundPoint
    {
        /// <summary>Metres, scene frame.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>Unit, of the face's front; scene frame.</summary>
        public Vec3 Normal { get; internal set; }

        /// <summary>Along the ray, in lengths of its direction.</summary>
        public double At { get; internal set; }

        /// <summary>Segment of the face; null for the base.</summary>
        public uint? Segment { get; internal set; }
    }
}
