using System;

namespace Terraport
{
    /// <summary>The two filters of EXT_meshopt_compression that scenes use, in place.</summary>
    internal static class MeshoptFilters
    {
        /// <summary>
        /// OCTAHEDRAL with rows of 4 bytes: x, y on the octahedron and its size become x, y, z of 127 together; the fourth stays. A
        /// row without length becomes 0, 0, 0.
        /// </summary>
        internal static void Octahedral(byte[] rows, int count)
        {
            for (int at = 0; at < count * 4; at += 4)
            {
                float x = (sbyte)rows[at];
                float y = (sbyte)rows[at + 1];
                float z = (sbyte)rows[at + 2] - Math.Abs(x) - Math.Abs(y);
                float fold = z >= 0 ? 0 : z;
                x += x >= 0 ? fold : -fold;
                y += y >= 0 ? fold : -fold;
                float square = x * x + y * y + z * z;
                float scale = square > 0 ? 127f / (float)Math.Sqrt(square) : 0;
                rows[at] = (byte)Rounded(x * scale);
                rows[at + 1] = (byte)Rounded(y * scale);
                rows[at + 2] = (byte)Rounded(z * scale);
            }
        }

        /// <summary>EXPONENTIAL: 8 bits of exponent over 24 bits of mantissa, both signed, become float32; as they are read, not in place.</summary>
        internal static void Exponential(int[] words, float[] values, int count)
        {
            for (int at = 0; at < count; at++)
            {
                int word = words[at];
                int mantissa = (word << 8) >> 8;
                // Exact: 24 bits of mantissa and a power of two within double's range.
                values[at] = (float)(mantissa * PowerOfTwo(word >> 24));
            }
        }

        private static double PowerOfTwo(int exponent)
        {
            return BitConverter.Int64BitsToDouble((long)(exponent + 1023) << 52);
        }

        private static int Rounded(float value)
        {
            return (int)(value + (value >= 0 ? 0.5f : -0.5f));
        }
    }
}
