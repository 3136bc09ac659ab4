using System;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>Reads base.cover (scene format, section 8); every truncation and flipped bit is noticed.</summary>
    public static class CoverReader
    {
        private const string Magic = "TPCOVER1";
        private const int Major = 1;
        private const int HeaderBytes = 32;
        private const int ChecksumStart = 16;
        /// <summary>Base faces, and entries of all rows together: a few bytes can stand for any number of them.</summary>
        private const uint MaxRows = 1u << 24;
        /// <summary>Segments over one base face: bounds what one step costs.</summary>
        private const int MaxRowSegments = 4096;

        /// <summary>Read the cover of a base; the arrays are copies.</summary>
        /// <param name="file">The whole file.</param>
        /// <param name="baseFaces">Faces of the base mesh: the cover has one row for each.</param>
        /// <param name="segmentCount">Segments of the scene: ids are below it.</param>
        /// <exception cref="PayloadException">Damaged, of another base or scene, or with ids out of range.</exception>
        public static Cover Read(ArraySegment<byte> file, int baseFaces, int segmentCount)
        {
            CheckHeader(file, baseFaces);
            var offsets = new uint[baseFaces + 1];
            var segments = new uint[LittleEndian.ReadU32(file.Array, file.Offset + 28)];
            var steps = new StepReader(file, (int)LittleEndian.ReadU32(file.Array, file.Offset + 20));
            var row = new uint[MaxRowSegments];
            int rowLength = 0;
            int face = 0;
            int end = 0;
            // Invariant: what has been given to faces is at most what the header counts, and rows ascend.
            while (face < baseFaces)
            {
                int at = steps.At;
                steps.Next();
                if (steps.Segment >= (uint)segmentCount)
                {
                    throw new PayloadException("segment " + steps.Segment + " in the cover, expected below " + segmentCount, at);
                }
                rowLength = Toggle(row, rowLength, steps.Segment, at);
                int facesLeft = baseFaces - face;
                int entriesLeft = segments.Length - end;
                // In 64 bits: the product must not wrap around.
                if (steps.Run > facesLeft || steps.Run * rowLength > entriesLeft)
                {
                    string left = facesLeft + " faces and " + entriesLeft + " entries";
                    throw new PayloadException(steps.Run + " base faces of " + rowLength + " segments, expected " + left + " at most", at);
                }
                for (int last = face + (int)steps.Run; face < last; face++)
                {
                    Array.Copy(row, 0, segments, end, rowLength);
                    end += rowLength;
                    offsets[face + 1] = (uint)end;
                }
            }
            if (steps.At != file.Count || end != segments.Length)
            {
                throw new PayloadException("bytes or " + (segments.Length - end) + " entries left over, expected none", steps.At);
            }
            return new Cover(offsets, segments);
        }

        private static void CheckHeader(ArraySegment<byte> file, int baseFaces)
        {
            if (file.Count < HeaderBytes)
            {
                throw new PayloadException(file.Count + " bytes, expected " + HeaderBytes + " or more", 0);
            }
            for (int at = 0; at < Magic.Length; at++)
            {
                if (file.Array[file.Offset + at] != Magic[at])
                {
                    throw new PayloadException("another magic, expected " + Magic, 0);
                }
            }
            // Another major version may lay out anything anew.
            int major = LittleEndian.ReadU16(file.Array, file.Offset + 16);
            if (major != Major)
            {
                throw new PayloadException("format version " + major + ", expected " + Major, 16);
            }
            // From here on only a writer's mistake can be met, not a flipped bit.
            ulong expected = LittleEndian.ReadU64(file.Array, file.Offset + 8);
            ulong actual = Xxh3.Hash64(file.Array, file.Offset + ChecksumStart, file.Count - ChecksumStart);
            if (actual != expected)
            {
                throw new PayloadException("checksum " + actual.ToString("x16") + ", expected " + expected.ToString("x16"), 8);
            }
            uint start = LittleEndian.ReadU32(file.Array, file.Offset + 20);
            if (start < HeaderBytes || start > (uint)file.Count)
            {
                throw new PayloadException("steps at " + start + " of " + file.Count + " bytes", 20);
            }
            // What the rows will take, before they take it.
            uint rows = LittleEndian.ReadU32(file.Array, file.Offset + 24);
            if (rows != (uint)baseFaces)
            {
                throw new PayloadException("cover of " + rows + " base faces, expected " + baseFaces, 24);
            }
            uint entries = LittleEndian.ReadU32(file.Array, file.Offset + 28);
            if (Math.Max(rows, entries) > MaxRows)
            {
                string counts = rows + " base faces and " + entries + " entries";
                throw new PayloadException("cover of " + counts + ", expected at most " + MaxRows, 24);
            }
        }

        /// <summary>Put a segment into an ascending row, or take it out; the row's new length.</summary>
        private static int Toggle(uint[] row, int length, uint segment, int at)
        {
            int place = Array.BinarySearch(row, 0, length, segment);
            if (place >= 0)
            {
                Array.Copy(row, place + 1, row, place, length - place - 1);
                return length - 1;
            }
            if (length == row.Length)
            {
                throw new PayloadException("more than " + row.Length + " segments over a base face", at);
            }
            Array.Copy(row, ~place, row, ~place + 1, length - ~place);
            row[~place] = segment;
            return length + 1;
        }

        /// <summary>Steps, one after the other.</summary>
        private sealed class StepReader
        {
            // The segments that steps named last, the last one first: a step names them by half a byte.
            private readonly uint[] recent = new uint[15];
            private readonly ArraySegment<byte> file;

            internal StepReader(ArraySegment<byte> file, int start)
            {
                this.file = file;
                At = start;
            }

            /// <summary>Byte at which the next step starts.</summary>
            internal int At { get; private set; }

            /// <summary>Goes into the row, or out of it.</summary>
            internal uint Segment { get; private set; }

            /// <summary>How many faces then have the row.</summary>
            internal long Run { get; private set; }

            internal void Next()
            {
                byte step = Byte();
                int rank = step & 15;
                if (rank < recent.Length)
                {
                    Segment = recent[rank];
                }
                else
                {
                    uint ahead = Number();
                    // Even numbers lead ahead of the last segment, odd ones back; in 32 bits, around their end.
                    Segment = unchecked(recent[0] + ((ahead >> 1) ^ (0u - (ahead & 1))));
                    rank--;
                }
                Array.Copy(recent, 0, recent, 1, rank);
                recent[0] = Segment;
                Run = step >> 4;
                if (Run == 15)
                {
                    Run += Number();
                }
            }

            private byte Byte()
            {
                if (At == file.Count)
                {
                    throw new PayloadException("the steps end early", At);
                }
                byte value = file.Array[file.Offset + At];
                At++;
                return value;
            }

            /// <summary>Seven bits a byte, lowest first; the top bit says that more follow.</summary>
            private uint Number()
            {
                ulong value = 0;
                for (int shift = 0; shift < 35; shift += 7)
                {
                    byte next = Byte();
                    value |= (ulong)(next & 0x7Fu) << shift;
                    if (next < 0x80)
                    {
                        if (value <= uint.MaxValue)
                        {
                            return (uint)value;
                        }
                        break;
                    }
                }
                throw new PayloadException("a number in the steps is beyond 32 bits", At);
            }
        }
    }
}
