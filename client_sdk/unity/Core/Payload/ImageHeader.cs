using System;

namespace Terraport
{
    /// <summary>
    /// What an image file says of itself, read without decoding it: an image library must not be given fifty bytes that claim 65535 x 65535
    /// pixels. JPEG (ITU-T T.81, annex B), PNG (ISO 15948, 11.2.2), WebP (RFC 9649, 2.3 to 2.7), KTX2 (KTX File Format 2.0, section 3).
    /// </summary>
    internal struct ImageHeader
    {
        private const uint BasisLz = 1; // The scheme of ETC1S; UASTC has others.

        private ArraySegment<byte> file;

        /// <summary>One of the four types, by the first bytes.</summary>
        internal string MediaType;

        /// <summary>Pixels.</summary>
        internal uint Width, Height;

        /// <summary>Bits of a texel on a graphics card: 4 (ETC1S), 8 (UASTC) or 32 (formats that cards cannot read).</summary>
        internal int TexelBits;

        /// <summary>Read a header; safe on hostile bytes. Sides are not checked.</summary>
        /// <exception cref="PayloadException">The first bytes are of no known type, or the header is cut short.</exception>
        internal static ImageHeader Read(ArraySegment<byte> file)
        {
            var header = new ImageHeader { file = file, TexelBits = 32 };
            if (header.StartsWith(0, "\u00ff\u00d8\u00ff"))
            {
                header.MediaType = "image/jpeg";
                header.ReadJpeg();
            }
            else if (header.StartsWith(0, "\u0089PNG\r\n\u001a\n"))
            {
                if (!header.StartsWith(12, "IHDR")) throw new PayloadException("got a PNG that does not start with IHDR");
                header.MediaType = "image/png";
                header.Width = header.BigEndian(16, 4);
                header.Height = header.BigEndian(20, 4);
            }
            else if (header.StartsWith(0, "\u00abKTX 20\u00bb\r\n\u001a\n"))
            {
                header.MediaType = "image/ktx2";
                header.Width = header.LittleEndian(20, 4);
                header.Height = header.LittleEndian(24, 4);
                header.TexelBits = header.LittleEndian(44, 4) == BasisLz ? 4 : 8;
            }
            else if (header.StartsWith(0, "RIFF") && header.StartsWith(8, "WEBP"))
            {
                header.MediaType = "image/webp";
                header.ReadWebp();
            }
            else
            {
                throw new PayloadException("got an image of unknown type, expected JPEG, PNG, WebP or KTX2 by its first bytes");
            }
            return header;
        }

        /// <summary>Check the sides: powers of two, at most <paramref name="maxSide"/>.</summary>
        internal void CheckSides(uint maxSide)
        {
            if (!IsSide(Width, maxSide) || !IsSide(Height, maxSide))
                throw new PayloadException(
                    "got an image of " + Width + " x " + Height + " pixels, expected powers of two up to " + maxSide);
        }

        private static bool IsSide(uint side, uint maxSide) { return side >= 1 && side <= maxSide && (side & (side - 1)) == 0; }

        /// <summary>Walk the markers to the first frame header (SOFn), which has the sides; never past the first scan.</summary>
        private void ReadJpeg()
        {
            for (int at = 2; at <= file.Count - 4;)
            {
                byte marker = At(at + 1);
                if (At(at) != 0xFF) throw new PayloadException("got a JPEG without a marker at " + at);
                bool isFrame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
                if (isFrame)
                {
                    Height = BigEndian(at + 5, 2);
                    Width = BigEndian(at + 7, 2);
                    return;
                }
                if (marker == 0xD9 || marker == 0xDA) break;
                if (marker == 0xFF)
                    at++; // A fill byte.
                else if (marker == 0x01 || (marker >= 0xD0 && marker <= 0xD7))
                    at += 2; // TEM and the restarts have no length.
                else
                    at += 2 + (int)Math.Max(BigEndian(at + 2, 2), 2);
            }
            throw new PayloadException("got a JPEG without a frame header before its first scan");
        }

        /// <summary>Read the sides from the first chunk: lossy, lossless, or extended.</summary>
        private void ReadWebp()
        {
            if (StartsWith(12, "VP8 "))
            {
                // 14 bits each; the two above them ask for scaling, which decoders do not carry out.
                Width = LittleEndian(26, 2) & 0x3FFF;
                Height = LittleEndian(28, 2) & 0x3FFF;
            }
            else if (StartsWith(12, "VP8L"))
            {
                uint bits = LittleEndian(21, 4);
                Width = (bits & 0x3FFF) + 1;
                Height = (bits >> 14 & 0x3FFF) + 1;
            }
            else if (StartsWith(12, "VP8X"))
            {
                Width = LittleEndian(24, 3) + 1;
                Height = LittleEndian(27, 3) + 1;
            }
            else
            {
                throw new PayloadException("got a WebP without VP8, VP8L or VP8X as its first chunk");
            }
        }

        /// <summary>Whether these bytes, each a character, are at a place.</summary>
        private bool StartsWith(int at, string bytes)
        {
            for (int index = 0; index < bytes.Length; index++)
            {
                if (at + index >= file.Count || At(at + index) != bytes[index]) return false;
            }
            return true;
        }

        private uint BigEndian(int at, int size)
        {
            uint value = 0;
            for (int index = 0; index < size; index++) value = value << 8 | At(at + index);
            return value;
        }

        private uint LittleEndian(int at, int size)
        {
            uint value = 0;
            for (int index = size - 1; index >= 0; index--) value = value << 8 | At(at + index);
            return value;
        }

        /// <summary>A byte of the file; refuses what is beyond its end, so that callers need no checks.</summary>
        private byte At(int at)
        {
            if (at >= file.Count) throw new PayloadException("got an image header that is cut short after " + file.Count + " bytes");
            return file.Array[file.Offset + at];
        }
    }
}
