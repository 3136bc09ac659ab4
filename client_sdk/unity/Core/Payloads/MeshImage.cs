namespace Terraport
{
    /// <summary>The image file of a mesh, its header checked. The buffer is reused: only the first Length bytes count.</summary>
    public sealed class MeshImage
    {
        /// <summary>The file as it is.</summary>
        public byte[] Bytes { get; internal set; }

        /// <summary>Bytes of the file; 0 where the mesh has no image.</summary>
        public int Length { get; internal set; }

        /// <summary>"image/jpeg", "image/png", "image/webp" or "image/ktx2", by the file's first bytes.</summary>
        public string MediaType { get; internal set; }

        /// <summary>Pixels, by the file's header: a power of two.</summary>
        public int Width { get; internal set; }

        /// <summary>Pixels, by the file's header: a power of two.</summary>
        public int Height { get; internal set; }
    }
}
