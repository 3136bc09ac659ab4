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

        /// <summary>All triangles of a buffer whose lengths were checked; false where its data does not end at the table.</summary>
        /// <remarks>
        /// code: One byte a triangle. data: Bytes of their own behind them. table: Its 16 bytes end the buffer: a triangle reads at
        /// most 16 bytes, so one check serves it. fifos: Room for 16 edges and 16 vertices.
        /// Invariant: edgeHead and vertexHead are the next free entries of the two rings; next is the lowest vertex never used, and
        /// last the one that differences count from. Encoder and decoder change them alike.
        /// </remarks>
        private static bool Decode(byte *code, byte *data, byte *table, uint *target, uint *end, uint *fifos, uint mask)
        {
            // An entry of a fifo that was never written to is no vertex number: callers refuse it.
            for (int at = 0; at < 48; at++)
            {
                fifos[at] = uint.MaxValue;
            }
            // 1. Both rings start empty; 16 entries of two vertices, and 16 of one.
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
                    // Before reading: what a triangle takes stays within the table then.
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
                        // 2. An edge of an earlier triangle (upper half of the code) and a third vertex (lower half).
                        uint edgeAt = ((edgeHead - 1 - (triangle >> 4)) & 15) << 1;
                        a = edges[edgeAt];
                        b = edges[edgeAt + 1];
                        uint third = triangle & 15;
                        // 0: a vertex that was never used; it enters the ring.
                        if (third == 0)
                        {
                            c = next++;
                            vertices[vertexHead] = c;
                            vertexHead = (vertexHead + 1) & 15;
                        }
                        // 1 to 12: a recent vertex; it stays where it is in the ring.
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
                        // The two new edges, turned round: the neighbour runs through them in the other direction.
                        edges[edgeHead << 1] = c;
                        edges[(edgeHead << 1) + 1] = b;
                        edgeHead = (edgeHead + 1) & 15;
                        edges[edgeHead << 1] = a;
                        edges[(edgeHead << 1) + 1] = c;
                        edgeHead = (edgeHead + 1) & 15;
                    }
                    else
                    {
                        // 3. Three vertices: how b and c are named is in the table, or in a byte of the data.
                        bool isExplicit = triangle >= 0xFE;
                        uint pair = isExplicit ? *data++ : table[triangle & 15];
                        // The encoder starts its numbering anew: vertices come in a second order of first use.
                        if (isExplicit && pair == 0)
                        {
                            next = 0;
                        }
                        uint second = pair >> 4;
                        uint third = pair & 15;
                        a = triangle == 0xFF ? 0 : next++;
                        b = second == 0 ? next++ : vertices[(vertexHead - second) & 15];
                        c = third == 0 ? next++ : vertices[(vertexHead - third) & 15];
                        // Numbers far from all recent ones come as differences, behind the byte, in the order a, b, c.
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
                        // 4. The rings, in the encoder's order: the vertices that were not recent, then all three edges.
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
                    // 5. Written without a check of its range: MeshChecks.Indices looks at the whole list once.
                    target[0] = a & mask;
                    target[1] = b & mask;
                    target[2] = c & mask;
                    target += 3;
                }
            }
            // Left-over bytes mean damage as well.
            return data == table;
        }

        /// <summary>A zigzag difference of up to 5 bytes, 7 bits each, lowest first.</summary>
        private static uint Difference(ref byte *data)
        {
            unchecked
            {
                uint octet = *data++;
                uint value = octet & 127;
                // Bounded at five bytes: a hostile run of continuation bits must end.
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
