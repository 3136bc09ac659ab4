using System;
using System.IO;
using System.IO.Compression;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// The stream of a segment (segment format 2): inflated into a buffer that is used again, then taken plane by plane. Callers compare
    /// the length of all planes with the stream's before they take those of differences.
    /// </summary>
    internal sealed class SegmentPlanes
    {
        // Of a stream, 16 million vertices; of the shortest gzip; what DEFLATE makes of a byte at most.
        private const int MaxBytes = 1 << 28, MinPackedBytes = 18, MaxExpansion = 1032;

        /// <summary>The stream: only the first <see cref="Length"/> count.</summary>
        internal byte[] Bytes { get; private set; } = Array.Empty<byte>();

        internal int Length { get; private set; }

        /// <summary>Where the next plane starts.</summary>
        internal int At { get; private set; }

        /// <summary>Inflate a gzip stream, whose checksum is verified; its head is taken.</summary>
        /// <exception cref="PayloadException">It is damaged, cut off or too long, or shorter than the head.</exception>
        internal void Inflate(byte[] packed, int start, int count, int headBytes)
        {
            // What the last four bytes state is believed as far as these bytes can carry it: memory is reserved for no more.
            long stated = count < MinPackedBytes ? 0 : LittleEndian.ReadU32(packed, start + count - 4);
            if (stated < headBytes || stated > Math.Min(MaxBytes, (long)count * MaxExpansion))
            {
                throw new PayloadException(
                    count + " bytes of planes that state a length of " + stated + ", expected " + headBytes + " or more");
            }
            Bytes = Grow.To(Bytes, (int)stated);
            Length = 0;
            At = headBytes;
            try
            {
                using (var stream = new GZipStream(new MemoryStream(packed, start, count, false), CompressionMode.Decompress))
                {
                    for (int got = -1; got != 0 && Length < stated; Length += got)
                    {
                        got = stream.Read(Bytes, Length, (int)stated - Length);
                    }
                    // zlib compares the checksum where it meets the end, to which this reads (Mono and IL2CPP ask it to, inflateInit2 with 31).
                    // Of a stream without its last bytes it says nothing: then what stands for the length is something else.
                    if (Length != stated || stream.ReadByte() >= 0)
                    {
                        throw new PayloadException("planes are cut off or too long, expected " + stated + " bytes");
                    }
                }
            }
            catch (Exception error) when (error is IOException || error is InvalidDataException)
            {
                throw new PayloadException("planes are damaged (" + error.Message + ")");
            }
        }

        /// <summary>Take a plane: where it starts.</summary>
        /// <exception cref="PayloadException">The stream ends before the plane does.</exception>
        internal int Take(long count)
        {
            if (count > Length - At) throw new PayloadException("a plane of " + count + " bytes, expected at most " + (Length - At));
            At += (int)count;
            return At - (int)count;
        }

        /// <summary>How many bits of a plane are 1.</summary>
        internal int CountBits(int start, int count)
        {
            int total = 0;
            for (int left = count; left > 0; left -= 8, start++)
            {
                // The last byte may have bits that belong to nothing.
                for (int bits = left < 8 ? Bytes[start] & ((1 << left) - 1) : Bytes[start]; bits != 0; bits &= bits - 1) total++;
            }
            return total;
        }

        /// <summary>Take a plane of differences of two bytes; its values go to every <paramref name="stride"/>-th entry.</summary>
        internal void Shorts(int count, ushort[] target, int first, int stride)
        {
            byte[] bytes = Bytes;
            int low = Take(2L * count), high = low + count;
            int value = 0;
            for (int end = high, at = first; low < end; low++, high++, at += stride)
            {
                value += Difference(bytes[low] | bytes[high] << 8);
                target[at] = (ushort)value;
            }
        }

        /// <summary>A difference out of its zigzag form.</summary>
        internal static int Difference(int zigzag) { return zigzag >> 1 ^ -(zigzag & 1); }
    }
}
