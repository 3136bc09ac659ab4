using System;

namespace Terraport
{
    /// <summary>The image file of a mesh, its header checked. The buffer is reused: only the first Length bytes count.</summary>
    public sealed class MeshImage
    {
        /// <summary>Bytes of a file at most: what 4096 x 4096 pixels take uncompressed.</summary>
        internal const int MaxBytes = 1 << 26;

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

        /// <summary>What a GPU keeps of a texel: 4 (ETC1S), 8 (UASTC) or 32 (whatever GPUs cannot read).</summary>
        public int TexelBits { get; internal set; }

        /// <summary>Bytes of its texture on a GPU with all mips (wire protocol, section 6.2); 0 where there is none.</summary>
        public long GpuBytes
        {
            get {
                if (MediaType == null) return 0;
                long total = 0;
                long w = Width, h = Height;
                for (;;)
                {
                    // Compressed forms keep blocks of 4 x 4 texels, also of smaller levels.
                    total += TexelBits == 32 ? w * h * 4 : (w + 3) / 4 * ((h + 3) / 4) * 2 * TexelBits;
                    if (w <= 1 && h <= 1) return total;
                    w = Math.Max(w / 2, 1);
                    h = Math.Max(h / 2, 1);
                }
            }
        }

        /// <summary>A copy of an image file whose header was checked.</summary>
        internal void Set(byte[] bytes, int start, int length, ImageHeader header)
        {
            Bytes = Grow.To(Bytes, length);
            Buffer.BlockCopy(bytes, start, Bytes, 0, length);
            Length = length;
            MediaType = header.MediaType;
            Width = (int)header.Width;
            Height = (int)header.Height;
            TexelBits = header.TexelBits;
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
