using System;

namespace Terraport
{
    /// <summary>
    /// What an image file says of itself, read without decoding it: nobody may hand an image library fifty bytes that claim
    /// 65535 x 65535 pixels. JPEG (ITU-T T.81, annex B), PNG (ISO 15948, 5.2 and 11.2.2), WebP (RFC 9649, 2.3 to 2.7), KTX2
    /// (Khronos KTX File Format 2.0, section 3).
    /// </summary>
    internal struct ImageHeader
    {
        private const int UncompressedBits = 32;
        private const int BasisLz = 1; // The scheme of ETC1S; UASTC has others.
        private static readonly byte[] JpegStart = { 0xFF, 0xD8, 0xFF };
        private static readonly byte[] PngStart = { 0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A };
        private static readonly byte[] KtxStart = { 0xAB, 0x4B, 0x54, 0x58, 0x20, 0x32, 0x30, 0xBB, 0x0D, 0x0A, 0x1A, 0x0A };

        private byte[] bytes;
        private int start;
        private int length;

        /// <summary>One of the four types, by the first bytes.</summary>
        internal string MediaType;

        /// <summary>Pixels.</summary>
        internal uint Width;

        /// <summary>Pixels.</summary>
        internal uint Height;

        /// <summary>What a GPU keeps of a texel: 4 (ETC1S), 8 (UASTC) or 32 (whatever GPUs cannot read).</summary>
        internal int TexelBits;

        /// <summary>Read a header; safe on hostile bytes. Sides are not checked.</summary>
        /// <exception cref="PayloadException">The first bytes are of no known type, or the header is cut short.</exception>
        internal static ImageHeader Read(ArraySegment<byte> file)
        {
            var header = new ImageHeader { bytes = file.Array, start = file.Offset, length = file.Count, TexelBits = UncompressedBits };
            if (header.StartsWith(JpegStart))
            {
                header.MediaType = "image/jpeg";
                header.ReadJpeg();
            }
            else if (header.StartsWith(PngStart))
            {
                header.MediaType = "image/png";
                if (!header.HasAscii(12, "IHDR")) throw new PayloadException("PNG does not start with IHDR");
                // IHDR is the first chunk: length (8), type (12), width (16), height (20).
                header.Width = header.BigEndian(16, 4);
                header.Height = header.BigEndian(20, 4);
            }
            else if (header.StartsWith(KtxStart))
            {
                header.MediaType = "image/ktx2";
                // Behind the identifier (12 bytes): vkFormat, typeSize, the two sides, depth, layers, faces, levels, scheme.
                header.Width = header.LittleEndian(20, 4);
                header.Height = header.LittleEndian(24, 4);
                header.TexelBits = header.LittleEndian(44, 4) == BasisLz ? 4 : 8;
            }
            else if (file.Count >= 12 && header.HasAscii(0, "RIFF") && header.HasAscii(8, "WEBP"))
            {
                header.MediaType = "image/webp";
                header.ReadWebp();
            }
            else
            {
                throw new PayloadException("image of unknown type, expected JPEG, PNG, WebP or KTX2 by its first bytes");
            }
            return header;
        }

        /// <summary>Check the sides: powers of two, none above a bound.</summary>
        internal void CheckSides(uint maxSide)
        {
            if (!IsSide(Width, maxSide) || !IsSide(Height, maxSide))
                throw new PayloadException("image of " + Width + " x " + Height + " pixels, expected powers of two, at most " + maxSide);
        }

        private static bool IsSide(uint side, uint maxSide) { return side >= 1 && side <= maxSide && (side & (side - 1)) == 0; }

        /// <summary>Walk the markers to the first frame header (SOFn), which has the sides; never past the first scan.</summary>
        private void ReadJpeg()
        {
            int at = 2;
            // Each round moves on by a byte or more.
            while (at <= length - 4)
            {
                if (At(at) != 0xFF) throw new PayloadException("JPEG without a marker at " + at);
                byte marker = At(at + 1);
                if (marker == 0xFF)
                {
                    at++; // A fill byte.
                }
                else if (marker == 0x01 || (marker >= 0xD0 && marker <= 0xD7))
                {
                    at += 2; // TEM and the restarts have no length.
                }
                else if (marker == 0xD9 || marker == 0xDA)
                {
                    break;
                }
                else if (marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC)
                {
                    Height = BigEndian(at + 5, 2); // DHT, JPG and DAC lie between the frames.
                    Width = BigEndian(at + 7, 2);
                    return;
                }
                else
                {
                    uint size = BigEndian(at + 2, 2);
                    at += 2 + (int)(size < 2 ? 2 : size);
                }
            }
            throw new PayloadException("JPEG without a frame header before its first scan");
        }

        /// <summary>The sides by the first chunk: lossy, lossless, or extended.</summary>
        private void ReadWebp()
        {
            if (HasAscii(12, "VP8 "))
            {
                // 14 bits each; the two above them ask for scaling, which decoders do not carry out.
                Width = LittleEndian(26, 2) & 0x3FFF;
                Height = LittleEndian(28, 2) & 0x3FFF;
            }
            else if (HasAscii(12, "VP8L"))
            {
                uint bits = LittleEndian(21, 4);
                Width = (bits & 0x3FFF) + 1;
                Height = ((bits >> 14) & 0x3FFF) + 1;
            }
            else if (HasAscii(12, "VP8X"))
            {
                Width = LittleEndian(24, 3) + 1;
                Height = LittleEndian(27, 3) + 1;
            }
            else
            {
                throw new PayloadException("WebP without VP8, VP8L or VP8X as its first chunk");
            }
        }

        private bool StartsWith(byte[] expected)
        {
            if (length < expected.Length) return false;
            for (int at = 0; at < expected.Length; at++)
            {
                if (bytes[start + at] != expected[at]) return false;
            }
            return true;
        }

        private bool HasAscii(int at, string letters)
        {
            for (int index = 0; index < letters.Length; index++)
            {
                if (At(at + index) != letters[index]) return false;
            }
            return true;
        }

        private uint BigEndian(int at, int size)
        {
            uint value = 0;
            for (int index = 0; index < size; index++)
            {
                value = (value << 8) | At(at + index);
            }
            return value;
        }

        private uint LittleEndian(int at, int size)
        {
            uint value = 0;
            for (int index = size - 1; index >= 0; index--)
            {
                value = (value << 8) | At(at + index);
            }
            return value;
        }

        /// <summary>A byte of the file; refuses what lies beyond its end, so that callers need no checks of their own.</summary>
        private byte At(int at)
        {
            if (at >= length) throw new PayloadException("image header cut short after " + length + " bytes");
            return bytes[start + at];
        }
    }
}
