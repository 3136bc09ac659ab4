using System;

namespace Terraport
{
    /// <summary>
    /// Decoder of meshoptimizer's vertex codec, version 0 (EXT_meshopt_compression, mode ATTRIBUTES).
    /// </summary>
    /// <remarks>
    /// Rows come in blocks of up to 256. Each byte of a row is a channel of its own: zigzag differences to the row before, in
    /// groups of 16, each group of 0, 2, 4 or 8 bits a difference; one that does not fit has all bits set and follows the group as
    /// a byte. The last bytes are the row before the first.
    /// </remarks>
    internal static unsafe class VertexCodec
    {
        private const byte Header = 0xA0;
        private const int MostBlockBytes = 8192;
        private const int MostBlockRows = 256;
        private const int GroupRows = 16;
        /// <summary>A group reads at most 24 bytes, and the end of a buffer has at least 32: one check serves a whole group.</summary>
        private const int GroupBytes = 24;
        private const int LeastTail = 32;
        private const int MostStride = 256;

        /// <summary>
        /// Decode rows into the start of <paramref name="target"/>; safe on hostile bytes. False if they are no such buffer.
        /// </summary>
        /// <remarks>stride: Bytes of a row: a multiple of 4, at most 256.</remarks>
        internal static bool TryDecode(byte[] source, int offset, int length, byte[] target, int count, int stride)
        {
            if (source == null || target == null || offset < 0 || length < 0 || length > source.Length - offset)
            {
                return false;
            }
            if (count < 1 || stride < 4 || stride > MostStride || stride % 4 != 0 || target.Length / stride < count)
            {
                return false;
            }
            int tail = Math.Max(stride, LeastTail);
            if (length < 1 + tail || source[offset] != Header)
            {
                return false;
            }
            fixed (byte* start = source)
            fixed (byte* rows = target)
            {
                byte* deltas = stackalloc byte[MostBlockRows];
                byte* last = stackalloc byte[stride];
                byte* end = start + offset + length;
                for (int at = 0; at < stride; at++)
                {
                    last[at] = end[at - stride];
                }
                int blockRows = Math.Min((MostBlockBytes / stride) & ~(GroupRows - 1), MostBlockRows);
                byte* data = start + offset + 1;
                for (int first = 0; first < count; first += blockRows)
                {
                    data = Block(data, end, rows + (long)first * stride, Math.Min(blockRows, count - first), stride, deltas, last);
                    if (data == null)
                    {
                        return false;
                    }
                }
                return end - data == tail;
            }
        }

        /// <summary>One block of rows; the byte after it, or null if it is damaged.</summary>
        private static byte* Block(byte* data, byte* end, byte* rows, int count, int stride, byte* deltas, byte* last)
        {
            int groups = (count + GroupRows - 1) / GroupRows;
            int headerBytes = (groups + 3) / 4;
            for (int channel = 0; channel < stride; channel++)
            {
                if (end - data < headerBytes)
                {
                    return null;
                }
                byte* header = data;
                data += headerBytes;
                for (int group = 0; group < groups; group++)
                {
                    if (end - data < GroupBytes)
                    {
                        return null;
                    }
                    int bits = (header[group >> 2] >> ((group & 3) << 1)) & 3;
                    data = Group(data, deltas + group * GroupRows, bits);
                }
                uint value = last[channel];
                byte* row = rows + channel;
                for (int at = 0; at < count; at++)
                {
                    uint delta = deltas[at];
                    value += (delta >> 1) ^ (0u - (delta & 1));
                    *row = (byte)value;
                    row += stride;
                }
                last[channel] = (byte)value;
            }
            return data;
        }

        /// <summary>Sixteen differences; 24 bytes can be read. The byte after the group.</summary>
        private static byte* Group(byte* data, byte* deltas, int bits)
        {
            ulong* wide = (ulong*)deltas;
            if (bits == 0)
            {
                wide[0] = 0;
                wide[1] = 0;
                return data;
            }
            if (bits == 3)
            {
                wide[0] = ((ulong*)data)[0];
                wide[1] = ((ulong*)data)[1];
                return data + GroupRows;
            }
            if (bits == 1)
            {
                byte* more = data + 4;
                for (int at = 0; at < 4; at++)
                {
                    uint four = data[at];
                    uint one = four >> 6;
                    deltas[0] = one == 3 ? *more++ : (byte)one;
                    one = (four >> 4) & 3;
                    deltas[1] = one == 3 ? *more++ : (byte)one;
                    one = (four >> 2) & 3;
                    deltas[2] = one == 3 ? *more++ : (byte)one;
                    one = four & 3;
                    deltas[3] = one == 3 ? *more++ : (byte)one;
                    deltas += 4;
                }
                return more;
            }
            byte* rest = data + 8;
            for (int at = 0; at < 8; at++)
            {
                uint two = data[at];
                uint one = two >> 4;
                deltas[0] = one == 15 ? *rest++ : (byte)one;
                one = two & 15;
                deltas[1] = one == 15 ? *rest++ : (byte)one;
                deltas += 2;
            }
            return rest;
        }
    }
}
