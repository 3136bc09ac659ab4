namespace Terraport
{
    /// <summary>
    /// Decoder of meshoptimizer's index codec, version 1 (EXT_meshopt_compression, mode TRIANGLES).
    /// </summary>
    /// <remarks>
    /// One code byte a triangle. It names one of the last 16 edges and a vertex (new, one of the last 16, or a difference), or, from
    /// 0xF0 on, three vertices by a table of 16 bytes at the end of the buffer or by a byte of their own.
    /// </remarks>
    internal static unsafe class IndexCodec
    {
        private const byte Header = 0xE1;
        private const int TableBytes = 16;

        /// <summary>Least length of a buffer: header, a code a triangle, table.</summary>
        internal static int MinLength(int count) { return 1 + count / 3 + TableBytes; }

        /// <summary>
        /// Decode vertex numbers into the start of <paramref name="target"/>; safe on hostile bytes. False if they are no such
        /// buffer. The numbers themselves may be anything.
        /// </summary>
        /// <remarks>mask: 0xFFFF where the buffer holds 16-bit numbers, else all bits.</remarks>
        internal static bool TryDecode(byte[] source, int offset, int length, uint[] target, int count, uint mask)
        {
            if (source == null || target == null || offset < 0 || length < 0 || length > source.Length - offset)
            {
                return false;
            }
            if (count < 0 || count % 3 != 0 || target.Length < count || length < MinLength(count) || source[offset] != Header)
            {
                return false;
            }
            fixed(byte *start = source) fixed(uint *indices = target)
            {
                uint *fifos = stackalloc uint[48];
                byte *code = start + offset + 1;
                return Decode(code, code + count / 3, start + offset + length - TableBytes, indices, indices + count, fifos, mask);
            }
        }

        /// <remarks>table: Its 16 bytes end the buffer: a triangle reads at most 16 bytes, so one check serves it.</remarks>
        private static bool Decode(byte *code, byte *data, byte *table, uint *target, uint *end, uint *fifos, uint mask)
        {
            // A place in a fifo that was never written to is no vertex number: callers refuse it.
            for (int at = 0; at < 48; at++)
            {
                fifos[at] = uint.MaxValue;
            }
            uint *edges = fifos;
            uint *vertices = fifos + 32;
            uint edgeHead = 0;
            uint vertexHead = 0;
            uint next = 0;
            uint last = 0;
            unchecked
            {
                while (target < end)
                {
                    if (data > table)
                    {
                        return false;
                    }
                    uint triangle = *code++;
                    uint a;
                    uint b;
                    uint c;
                    if (triangle < 0xF0)
                    {
                        uint edgeAt = ((edgeHead - 1 - (triangle >> 4)) & 15) << 1;
                        a = edges[edgeAt];
                        b = edges[edgeAt + 1];
                        uint third = triangle & 15;
                        if (third == 0)
                        {
                            c = next++;
                            vertices[vertexHead] = c;
                            vertexHead = (vertexHead + 1) & 15;
                        }
                        else if (third < 13)
                        {
                            c = vertices[(vertexHead - 1 - third) & 15];
                        }
                        else
                        {
                            // 13 and 14 are one less and one more than the last free vertex.
                            last = third == 15 ? last + Difference(ref data) : last + (third == 13 ? uint.MaxValue : 1);
                            c = last;
                            vertices[vertexHead] = c;
                            vertexHead = (vertexHead + 1) & 15;
                        }
                        edges[edgeHead << 1] = c;
                        edges[(edgeHead << 1) + 1] = b;
                        edgeHead = (edgeHead + 1) & 15;
                        edges[edgeHead << 1] = a;
                        edges[(edgeHead << 1) + 1] = c;
                        edgeHead = (edgeHead + 1) & 15;
                    }
                    else
                    {
                        bool isExplicit = triangle >= 0xFE;
                        uint pair = isExplicit ? *data++ : table[triangle & 15];
                        if (isExplicit && pair == 0)
                        {
                            next = 0;
                        }
                        uint second = pair >> 4;
                        uint third = pair & 15;
                        a = triangle == 0xFF ? 0 : next++;
                        b = second == 0 ? next++ : vertices[(vertexHead - second) & 15];
                        c = third == 0 ? next++ : vertices[(vertexHead - third) & 15];
                        if (isExplicit)
                        {
                            if (triangle == 0xFF)
                            {
                                last = a = last + Difference(ref data);
                            }
                            if (second == 15)
                            {
                                last = b = last + Difference(ref data);
                            }
                            if (third == 15)
                            {
                                last = c = last + Difference(ref data);
                            }
                        }
                        vertices[vertexHead] = a;
                        vertexHead = (vertexHead + 1) & 15;
                        if (second == 0 || (isExplicit && second == 15))
                        {
                            vertices[vertexHead] = b;
                            vertexHead = (vertexHead + 1) & 15;
                        }
                        if (third == 0 || (isExplicit && third == 15))
                        {
                            vertices[vertexHead] = c;
                            vertexHead = (vertexHead + 1) & 15;
                        }
                        edges[edgeHead << 1] = b;
                        edges[(edgeHead << 1) + 1] = a;
                        edgeHead = (edgeHead + 1) & 15;
                        edges[edgeHead << 1] = c;
                        edges[(edgeHead << 1) + 1] = b;
                        edgeHead = (edgeHead + 1) & 15;
                        edges[edgeHead << 1] = a;
                        edges[(edgeHead << 1) + 1] = c;
                        edgeHead = (edgeHead + 1) & 15;
                    }
                    target[0] = a & mask;
                    target[1] = b & mask;
                    target[2] = c & mask;
                    target += 3;
                }
            }
            return data == table;
        }

        /// <summary>A zigzag difference of up to 5 bytes, 7 bits each, lowest first.</summary>
        private static uint Difference(ref byte *data)
        {
            unchecked
            {
                uint octet = *data++;
                uint value = octet & 127;
                for (int shift = 7; octet >= 128 && shift < 35; shift += 7)
                {
                    octet = *data++;
                    value |= (octet & 127) << shift;
                }
                return (value >> 1) ^ (0u - (value & 1));
            }
        }
    }
}
