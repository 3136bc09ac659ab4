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
        private const int MaxBlockBytes = 8192;
        private const int MaxBlockRows = 256;
        private const int GroupRows = 16;
        /// <summary>
        /// A group reads at most 24 bytes, and the end of a buffer has at least 32: one check serves a whole group.
        /// </summary>
        private const int GroupBytes = 24;
        private const int MinTailBytes = 32;
        private const int MaxStride = 256;

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
            if (count < 1 || stride < 4 || stride > MaxStride || stride % 4 != 0 || target.Length / stride < count)
            {
                return false;
            }
            // The tail is padded to 32 bytes, so that a group may be read whole near the end.
            int tail = Math.Max(stride, MinTailBytes);
            if (length < 1 + tail || source[offset] != Header)
            {
                return false;
            }
            fixed(byte *start = source) fixed(byte *rows = target)
            {
                // Four planes of one byte each: the differences of a 32-bit word of all rows of a block.
                byte *deltas = stackalloc byte[4 * MaxBlockRows];
                uint *lastWords = stackalloc uint[MaxStride / 4];
                byte *end = start + offset + length;
                for (int word = 0; word < stride / 4; word++)
                {
                    lastWords[word] = *(uint *)(end - stride + 4 * word);
                }
                // As the encoder cuts: 8 KiB of rows, whole groups of 16, at most 256 rows.
                int blockRows = Math.Min((MaxBlockBytes / stride) & ~(GroupRows - 1), MaxBlockRows);
                byte *data = start + offset + 1;
                for (int first = 0; first < count; first += blockRows)
                {
                    data = Block(data, end, rows + (long)first * stride, Math.Min(blockRows, count - first), stride, deltas, lastWords);
                    if (data == null)
                    {
                        return false;
                    }
                }
                // Neither too few bytes nor left-over ones: both mean damage.
                return end - data == tail;
            }
        }

        /// <summary>One block of rows, four channels at a time; the byte after it, or null if it is damaged.</summary>
        private static byte *Block(byte *data, byte *end, byte *rows, int count, int stride, byte *deltas, uint *lastWords)
        {
            for (int channel = 0; channel < stride; channel += 4)
            {
                bool hasChanges = false;
                for (int plane = 0; plane < 4; plane++)
                {
                    bool hasNonzero;
                    data = Channel(data, end, deltas + plane * MaxBlockRows, count, out hasNonzero);
                    if (data == null)
                    {
                        return null;
                    }
                    hasChanges |= hasNonzero;
                }
                uint *row = (uint *)(rows + channel);
                uint previous = lastWords[channel >> 2];
                lastWords[channel >> 2] = hasChanges ? Add(deltas, row, count, stride, previous) : Repeat(row, count, stride, previous);
            }
            return data;
        }

        /// <summary>
        /// Differences of one channel of a block, no longer zigzag; the byte after them, or null if they are damaged.
        /// </summary>
        private static byte *Channel(byte *data, byte *end, byte *deltas, int count, out bool hasNonzero)
        {
            int groups = (count + GroupRows - 1) / GroupRows;
            int headerBytes = (groups + 3) / 4;
            hasNonzero = false;
            if (end - data < headerBytes)
            {
                return null;
            }
            byte *header = data;
            data += headerBytes;
            for (int group = 0; group < groups; group++)
            {
                if (end - data < GroupBytes)
                {
                    return null;
                }
                // Whole groups are written, also past count: deltas has room for 256 rows, a multiple of 16.
                ulong *wide = (ulong *)(deltas + group * GroupRows);
                int bits = (header[group >> 2] >> ((group & 3) << 1)) & 3;
                // All differences of the group are 0: nothing is stored for it.
                if (bits == 0)
                {
                    wide[0] = 0;
                    wide[1] = 0;
                    continue;
                }
                hasNonzero = true;
                data = Group(data, (byte *)wide, bits);
                // Eight at a time: half the number, and all bits turned where it was odd.
                ulong value = wide[0];
                wide[0] = ((value >> 1) & 0x7F7F7F7F7F7F7F7F) ^ ((value & 0x0101010101010101) * 255);
                value = wide[1];
                wide[1] = ((value >> 1) & 0x7F7F7F7F7F7F7F7F) ^ ((value & 0x0101010101010101) * 255);
            }
            return data;
        }

        /// <summary>Sum up four channels, and write them to their rows. The last row's.</summary>
        private static uint Add(byte *deltas, uint *row, int count, int stride, uint value)
        {
            unchecked
            {
                byte *stop = deltas + count;
                int step = stride >> 2;
                for (; deltas < stop; deltas++)
                {
                    // One byte of each of the four planes, put together as a word.
                    uint delta = deltas[0] | ((uint)deltas[MaxBlockRows] << 8) | ((uint)deltas[2 * MaxBlockRows] << 16)
                        | ((uint)deltas[3 * MaxBlockRows] << 24);
                    // Four sums of bytes: the highest bits apart, so that nothing is carried from one to the next.
                    value = ((value & 0x7F7F7F7F) + (delta & 0x7F7F7F7F)) ^ ((value ^ delta) & 0x80808080);
                    *row = value;
                    row += step;
                }
                return value;
            }
        }

        /// <summary>Four channels that do not change: padding, and high bytes.</summary>
        private static uint Repeat(uint *row, int count, int stride, uint value)
        {
            for (; count > 0; count--)
            {
                *row = value;
                row += stride >> 2;
            }
            return value;
        }

        /// <summary>Sixteen differences; 24 bytes can be read. The byte after the group.</summary>
        private static byte *Group(byte *data, byte *deltas, int bits)
        {
            if (bits == 3)
            {
                ulong *wide = (ulong *)deltas;
                wide[0] = ((ulong *)data)[0];
                wide[1] = ((ulong *)data)[1];
                return data + GroupRows;
            }
            return bits == 1 ? GroupOf2Bits(data, deltas) : GroupOf4Bits(data, deltas);
        }

        /// <summary>Sixteen differences of 2 bits, the highest first; a 3 stands for a byte behind the 4 bytes.</summary>
        private static byte *GroupOf2Bits(byte *data, byte *deltas)
        {
            uint codes = *(uint *)data;
            uint escaped = codes & (codes >> 1) & 0x55555555;
            byte *escapes = data + 4;
            for (int at = 0; at < 4; at++)
            {
                uint four = codes & 0xFF;
                *(uint *)deltas = (four >> 6) | ((four & 0x30) << 4) | ((four & 0x0C) << 14) | ((four & 3) << 24);
                if ((escaped & 0xFF) != 0)
                {
                    deltas[0] = deltas[0] == 3 ? *escapes++ : deltas[0];
                    deltas[1] = deltas[1] == 3 ? *escapes++ : deltas[1];
                    deltas[2] = deltas[2] == 3 ? *escapes++ : deltas[2];
                    deltas[3] = deltas[3] == 3 ? *escapes++ : deltas[3];
                }
                codes >>= 8;
                escaped >>= 8;
                deltas += 4;
            }
            return escapes;
        }

        /// <summary>Sixteen differences of 4 bits, the higher half first; a 15 stands for a byte behind the 8 bytes.</summary>
        private static byte *GroupOf4Bits(byte *data, byte *deltas)
        {
            byte *escapes = data + 8;
            for (int at = 0; at < 8; at += 2)
            {
                uint four = *(ushort *)(data + at);
                *(uint *)deltas = ((four >> 4) & 15) | ((four & 15) << 8) | ((four & 0xF000) << 4) | ((four & 0x0F00) << 16);
                if ((four & (four >> 1) & (four >> 2) & (four >> 3) & 0x1111) != 0)
                {
                    deltas[0] = deltas[0] == 15 ? *escapes++ : deltas[0];
                    deltas[1] = deltas[1] == 15 ? *escapes++ : deltas[1];
                    deltas[2] = deltas[2] == 15 ? *escapes++ : deltas[2];
                    deltas[3] = deltas[3] == 15 ? *escapes++ : deltas[3];
                }
                deltas += 4;
            }
            return escapes;
        }
    }
}
