namespace Terraport.Unity
{
    /// <summary>
    /// The one place where the scene's frame becomes Unity's, and back.
    ///
    /// Scene: metres, right-handed, x east, y up, z south. Unity: metres, left-handed, Y up; here X east, Y up, Z north. So
    /// (X, Y, Z) = (x, y, -z): a reflection, which turns the winding of each triangle round, so two of its corners are exchanged. Texture
    /// coordinates of a payload count from the image's upper left corner, Unity's from the lower left. Negating is exact in float32.
    /// </summary>
    internal static class Axes
    {
        /// <summary>A position or direction of the scene, in Unity's axes. Its own inverse.</summary>
        internal static Vec3 Turn(Vec3 vector) { return new Vec3(vector.X, vector.Y, -vector.Z); }

        /// <summary>The Z of Unity for a z of the scene, and the other way round.</summary>
        internal static float TurnZ(float z) { return -z; }

        /// <summary>Unity's V for a V that counts downwards.</summary>
        internal static float TurnV(float v) { return 1f - v; }

        /// <summary>The corner of a face that comes n-th in Unity, of its three in the scene.</summary>
        internal static int TurnCorner(int n) { return n == 0 ? 0 : 3 - n; }
    }
}
