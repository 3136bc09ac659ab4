namespace Terraport
{
    /// <summary>Where a ray met the ground that is shown.</summary>
    internal struct GroundPoint
    {
        /// <summary>Metres, scene frame.</summary>
        internal Vec3 Position;

        /// <summary>Unit normal of the face's front, scene frame.</summary>
        internal Vec3 Normal;

        /// <summary>Along the ray, in lengths of its direction.</summary>
        internal double At;

        /// <summary>Segment of the face; null for the base.</summary>
        internal uint? Segment;
    }
}
