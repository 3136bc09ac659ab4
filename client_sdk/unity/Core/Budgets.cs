namespace Terraport
{
    /// <summary>Hard bounds of every landing, sent with each hello; null does not bound. The server cuts the farthest segments.</summary>
    public sealed class Budgets
    {
        /// <summary>Most triangles shown.</summary>
        public long? MaxTriangles { get; set; }

        /// <summary>Most payload bytes of what is shown, compressed as they travel.</summary>
        public long? MaxBytes { get; set; }

        /// <summary>Most segments shown.</summary>
        public long? MaxSegments { get; set; }

        /// <summary>Most bytes of a landing on the client's GPU, textures with their mips.</summary>
        public long? MaxGpuBytes { get; set; }

        /// <summary>Bytes of a vertex in the client's buffers; null is 24.</summary>
        public int? GpuVertexBytes { get; set; }

        /// <summary>Bytes of a triangle's three indices in them; null is 6.</summary>
        public int? GpuFaceBytes { get; set; }

        /// <summary>
        /// Of a device's share of the GPU, what is for segments that an aim brings ahead: an eighth.
        /// </summary>
        public static long SpareOf(long maxGpuBytes) { return maxGpuBytes / 8; }

        /// <summary>
        /// Of a device's share, what one landing may take. There are two while one replaces the other, and the base, whose
        /// list of faces is there twice: so all of it together never exceeds the share.
        /// </summary>
        public static long LandingOf(long maxGpuBytes, SegmentMesh ground)
        {
            long lists = (ground.HasShortIndices ? 6L : 12L) * ground.FaceCount;
            long left = maxGpuBytes - SpareOf(maxGpuBytes) - ground.GpuBytes - lists;
            return left > 0 ? left / 2 : 0;
        }
    }
}
