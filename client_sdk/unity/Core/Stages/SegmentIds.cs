using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>Lists of segment ids.</summary>
    internal static class SegmentIds
    {
        /// <summary>The same ids, ascending.</summary>
        internal static uint[] Sorted(IReadOnlyList<uint> ids)
        {
            var sorted = new uint[ids.Count];
            for (int at = 0; at < sorted.Length; at++)
            {
                sorted[at] = ids[at];
            }
            Array.Sort(sorted);
            return sorted;
        }

        /// <summary>Whether two lists are equal; either may be null.</summary>
        internal static bool IsSame(uint[] left, uint[] right)
        {
            if (left == null || right == null || left.Length != right.Length)
            {
                return left == right;
            }
            for (int at = 0; at < left.Length; at++)
            {
                if (left[at] != right[at])
                {
                    return false;
                }
            }
            return true;
        }

        /// <summary>The ids in the order of another list; those that it does not have last, as they were.</summary>
        internal static uint[] InOrderOf(uint[] order, uint[] ids)
        {
            var ranks = new Dictionary<uint, int>();
            for (int at = 0; at < order.Length; at++)
            {
                ranks[order[at]] = at;
            }
            var keys = new int[ids.Length];
            for (int at = 0; at < ids.Length; at++)
            {
                int rank;
                // Ranks differ, so the unstable Array.Sort gives one order only.
                keys[at] = ranks.TryGetValue(ids[at], out rank) ? rank : order.Length + at;
            }
            var ordered = (uint[])ids.Clone();
            Array.Sort(keys, ordered);
            return ordered;
        }

        /// <summary>The ids that are not in a set, in their order.</summary>
        internal static uint[] Without(uint[] ids, HashSet<uint> excluded) { return Array.FindAll(ids, id => !excluded.Contains(id)); }
    }
}
