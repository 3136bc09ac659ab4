using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>Where the ground that is shown was met, in Unity's world.</summary>
    public struct GroundHit
    {
        /// <summary>Where.</summary>
        public Vector3 Point;

        /// <summary>Of the face's front; unit where the scene's object is not scaled.</summary>
        public Vector3 Normal;

        /// <summary>Along the ray, or from the point that was asked about.</summary>
        public float Distance;

        /// <summary>Segment of the face; null for the base.</summary>
        public uint? Segment;
    }
}
