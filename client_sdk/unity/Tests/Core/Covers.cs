using System.Collections.Generic;

namespace Terraport.Tests
{
    /// <summary>Covers made up, and what they hide by brute force.</summary>
    internal static class Covers
    {
        /// <summary>Rows of 0 to 4 ascending segments; a fifth of them is empty.</summary>
        internal static Cover Random(Noise noise, int faces, int segments)
        {
            var offsets = new List<uint> { 0 };
            var entries = new List<uint>();
            for (int face = 0; face < faces; face++)
            {
                var row = new SortedSet<uint>();
                for (int count = noise.Below(5); count > 0; count--)
                {
                    row.Add((uint)noise.Below(segments));
                }
                entries.AddRange(row);
                offsets.Add((uint)entries.Count);
            }
            return new Cover(offsets.ToArray(), entries.ToArray());
        }

        /// <summary>Brute force: 1 for each face whose row is not empty and whose segments are all shown.</summary>
        internal static byte[] Hidden(Cover cover, ICollection<uint> shown)
        {
            var hidden = new byte[cover.Offsets.Length - 1];
            for (int face = 0; face < hidden.Length; face++)
            {
                bool isHidden = cover.Offsets[face] < cover.Offsets[face + 1];
                for (uint entry = cover.Offsets[face]; entry < cover.Offsets[face + 1]; entry++)
                {
                    isHidden &= shown.Contains(cover.Segments[entry]);
                }
                hidden[face] = isHidden ? (byte)1 : (byte)0;
            }
            return hidden;
        }

        internal static bool IsSame(byte[] left, byte[] right)
        {
            bool isSame = left.Length == right.Length;
            for (int at = 0; isSame && at < left.Length; at++)
            {
                isSame = left[at] == right[at];
            }
            return isSame;
        }

        internal static int Sum(byte[] mask)
        {
            int sum = 0;
            foreach (byte hidden in mask)
            {
                sum += hidden;
            }
            return sum;
        }
    }
}
