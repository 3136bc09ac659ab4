using System;

namespace Terraport
{
    /// <summary>The two filters of EXT_meshopt_compression that scenes use; segments fold normals as the first does.</summary>
    internal static unsafe class MeshoptFilters
    {
        /// <summary>Size of the octahedron that writers use: all 8 bits.</summary>
        private const int FullSize = 127;

        /// <summary>
        /// Results for that size, by x and y as bytes: 256 KB, made once in 5 ms. A root and a division a vertex were a third of
        /// decoding.
        /// </summary>
        private static readonly uint[] FullResults = MakeFullResults();

        /// <summary>
        /// OCTAHEDRAL with rows of 4 bytes, in place: x, y on the octahedron and its size become x, y, z of 127 together; the fourth
        /// stays. A row without length becomes 0, 0, 0.
        /// </summary>
        internal static void Octahedral(byte[] rows, int count)
        {
            if (count < 0 || rows.Length / 4 < count)
            {
                throw new ArgumentOutOfRangeException("count");
            }
            // The range was checked above, once: no access below is checked.
            fixed(byte *start = rows) fixed(uint *results = FullResults)
            {
                uint *row = (uint *)start;
                for (uint *stop = row + count; row < stop; row++)
                {
                    uint value = *row;
                    uint size = (value >> 16) & 0xFF;
                    uint decoded = size == FullSize ? results[value & 0xFFFF] : Unfold((sbyte)value, (sbyte)(value >> 8), (sbyte)size);
                    *row = (value & 0xFF000000) | decoded;
                }
            }
        }

        /// <summary>What <see cref="Octahedral"/> makes of a row of that size: x, y, z, the lowest byte first.</summary>
        internal static uint Unfolded(byte x, byte y) { return FullResults[x | y << 8]; }

        /// <summary>
        /// EXPONENTIAL: 8 bits of exponent over 24 bits of mantissa, both signed, become float32; as they are read, not
        /// in place.
        /// </summary>
        internal static void Exponential(int[] words, float[] values, int count)
        {
            for (int at = 0; at < count; at++)
            {
                int word = words[at];
                // Shifted up and down again: the sign of the 24 bits is extended.
                int mantissa = (word << 8) >> 8;
                // Exact: 24 bits of mantissa and a power of two within double's range.
                values[at] = (float)(mantissa * PowerOfTwo(word >> 24));
            }
        }

        /// <summary>2^exponent, by its bits: exact, where Math.Pow need not be.</summary>
        private static double PowerOfTwo(int exponent) { return BitConverter.Int64BitsToDouble((long)(exponent + 1023) << 52); }

        private static uint[] MakeFullResults()
        {
            var results = new uint[1 << 16];
            for (int at = 0; at < results.Length; at++)
            {
                results[at] = Unfold((sbyte)at, (sbyte)(at >> 8), FullSize);
            }
            return results;
        }

        /// <summary>One row: three bytes, the lowest first. Rounded to float32 where meshoptimizer's decoder rounds.</summary>
        private static uint Unfold(int x, int y, int size)
        {
            // The lower half of the octahedron is folded over the upper: negative z moves x and y back out.
            int z = size - Math.Abs(x) - Math.Abs(y);
            int fold = z >= 0 ? 0 : z;
            x += x >= 0 ? fold : -fold;
            y += y >= 0 ? fold : -fold;
            int square = x * x + y * y + z * z;
            float scale = square > 0 ? 127f / (float)Math.Sqrt(square) : 0;
            return RoundToByte(x * scale) | (RoundToByte(y * scale) << 8) | (RoundToByte(z * scale) << 16);
        }

        /// <summary>Half away from zero, as meshoptimizer's decoder rounds, in the lowest byte.</summary>
        private static uint RoundToByte(float value) { return (byte)(sbyte)(int)(value + (value >= 0 ? 0.5f : -0.5f)); }
    }
}
