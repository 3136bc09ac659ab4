using System;

namespace Terraport
{
    /// <summary>The image file of a mesh, its header checked. The buffer is reused: only the first Length bytes count.</summary>
    public sealed class MeshImage
    {
        /// <summary>The file as it is, in a buffer of the mesh: valid until the next decode into it.</summary>
        public byte[] Bytes { get; internal set; }

        /// <summary>Bytes of the file; 0 where the mesh has no image.</summary>
        public int Length { get; internal set; }

        /// <summary>"image/jpeg", "image/png", "image/webp" or "image/ktx2", by the file's first bytes.</summary>
        public string MediaType { get; internal set; }

        /// <summary>Pixels, by the file's header: a power of two.</summary>
        public int Width { get; internal set; }

        /// <summary>Pixels, by the file's header: a power of two.</summary>
        public int Height { get; internal set; }

        /// <summary>A copy of an image file whose header was checked.</summary>
        internal void Set(byte[] bytes, int start, int length, ImageHeader header)
        {
            Bytes = Grow.To(Bytes, length);
            Buffer.BlockCopy(bytes, start, Bytes, 0, length);
            Length = length;
            MediaType = header.MediaType;
            Width = (int)header.Width;
            Height = (int)header.Height;
        }

        /// <summary>No image; the buffer stays.</summary>
        internal void Clear()
        {
            Length = 0;
            MediaType = null;
            Width = 0;
            Height = 0;
        }
    }
}
