using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// Which faces of the base mesh the shown segments hide. The rule (docs/topics/hand-off.md): a base face is hidden if and only
    /// if its list is not empty and every segment in it is shown. Each face has one counter, the number of segments over it that
    /// are not shown, so a landing costs only the faces under the segments that change. No distance, no geometry: the outcome
    /// depends on the set alone.
    /// </summary>
    /// <remarks>
    /// Building costs all entries of the cover once, for the inverse lists; adding or removing a segment its entries.
    /// </remarks>
    public sealed class CoverCounters
    {
        // Segments over each face that are not shown. Invariant: a face is hidden where it is 0 and the face's list is not empty.
        private readonly int[] unshown;
        // The inverse lists: faces under segment s are faces[starts[s]] to faces[starts[s + 1] - 1].
        private readonly int[] starts;
        private readonly int[] faces;
        private readonly HashSet<uint> shown = new HashSet<uint>();

        /// <summary>Counters of a cover that <see cref="CoverReader"/> checked, nothing shown.</summary>
        /// <exception cref="ArgumentException">The arrays are no rows: offsets from 0 to the number of entries, never falling.</exception>
        public CoverCounters(Cover cover)
        {
            if (cover == null)
            {
                throw new ArgumentNullException("cover");
            }
            uint[] offsets = cover.Offsets;
            uint[] segments = cover.Segments;
            CheckRows(offsets, segments);
            FaceCount = offsets.Length - 1;
            unshown = new int[FaceCount];
            Hidden = new HiddenFaces(new byte[FaceCount]);
            // Counting sort by segment: count, sum up, fill. The ids need not be dense, but bound the array.
            uint highestId = 0;
            for (int entry = 0; entry < segments.Length; entry++)
            {
                highestId = Math.Max(highestId, segments[entry]);
            }
            starts = new int[segments.Length == 0 ? 1 : (int)highestId + 2];
            for (int entry = 0; entry < segments.Length; entry++)
            {
                starts[segments[entry] + 1]++;
            }
            for (int segment = 0; segment + 1 < starts.Length; segment++)
            {
                starts[segment + 1] += starts[segment];
            }
            var fillAt = (int[])starts.Clone();
            faces = new int[segments.Length];
            for (int face = 0; face < FaceCount; face++)
            {
                unshown[face] = (int)(offsets[face + 1] - offsets[face]);
                for (uint entry = offsets[face]; entry < offsets[face + 1]; entry++)
                {
                    faces[fillAt[segments[entry]]++] = face;
                }
            }
        }

        /// <summary>Faces of the base.</summary>
        public int FaceCount { get; private set; }

        /// <summary>What must not be drawn while exactly the shown segments are. A live view: read only.</summary>
        public HiddenFaces Hidden { get; private set; }

        /// <summary>How many segments count as shown.</summary>
        public int ShownCount => shown.Count;

        /// <summary>Whether a segment counts as shown.</summary>
        public bool IsShown(uint segment) { return shown.Contains(segment); }

        /// <summary>Put the shown segments into a list.</summary>
        public void CopyShown(List<uint> target)
        {
            foreach (uint segment in shown)
            {
                target.Add(segment);
            }
        }

        /// <summary>Count one more segment as shown; a repeat changes nothing. The entries of its list, for budgets.</summary>
        /// <remarks>onFace: Told of every face that is hidden now and was not; may be null.</remarks>
        public int Add(uint segment, Action<int> onFace)
        {
            if (!shown.Add(segment) || segment + 1L >= starts.Length)
            {
                return 0; // What lies over no face is remembered, but hides nothing.
            }
            for (int entry = starts[segment]; entry < starts[segment + 1]; entry++)
            {
                int face = faces[entry];
                unshown[face]--;
                if (unshown[face] == 0)
                {
                    SetHidden(face, 1, onFace);
                }
            }
            return starts[segment + 1] - starts[segment];
        }

        /// <summary>Count a segment as no longer shown. The entries of its list, for budgets.</summary>
        /// <remarks>onFace: Told of every face that is to be drawn now and was not; may be null.</remarks>
        public int Remove(uint segment, Action<int> onFace)
        {
            if (!shown.Remove(segment) || segment + 1L >= starts.Length)
            {
                return 0;
            }
            for (int entry = starts[segment]; entry < starts[segment + 1]; entry++)
            {
                int face = faces[entry];
                unshown[face]++;
                if (unshown[face] == 1)
                {
                    SetHidden(face, 0, onFace);
                }
            }
            return starts[segment + 1] - starts[segment];
        }

        /// <summary>A well-mixed number for an id: the finaliser of MurmurHash3 (A. Appleby, public domain) over id + 1.</summary>
        internal static uint Mix(uint id)
        {
            unchecked
            {
                uint hash = (id + 1) * 0x9E3779B1;
                hash = (hash ^ (hash >> 16)) * 0x85EBCA6B;
                hash = (hash ^ (hash >> 13)) * 0xC2B2AE35;
                return hash ^ (hash >> 16);
            }
        }

        private static void CheckRows(uint[] offsets, uint[] segments)
        {
            if (offsets.Length < 1 || offsets[0] != 0 || offsets[offsets.Length - 1] != (uint)segments.Length)
            {
                throw new ArgumentException("cover offsets must run from 0 to the number of entries, " + segments.Length);
            }
            for (int face = 0; face + 1 < offsets.Length; face++)
            {
                if (offsets[face + 1] < offsets[face])
                {
                    throw new ArgumentException("cover offsets fall after face " + face);
                }
            }
            for (int entry = 0; entry < segments.Length; entry++)
            {
                // More rows than an index of 1 GiB has: nothing is reserved by an id beyond it.
                if (segments[entry] >= 1u << 25)
                {
                    throw new ArgumentException("cover names segment " + segments[entry] + ", expected below 2^25");
                }
            }
        }

        /// <summary>Hide or draw one face, keeping mask, count and hash in step.</summary>
        private void SetHidden(int face, byte isHidden, Action<int> onFace)
        {
            Hidden.Mask[face] = isHidden;
            Hidden.Count += isHidden == 1 ? 1 : -1;
            // Exclusive or: hiding a face and drawing it again gives the old hash, in whatever order.
            Hidden.Hash ^= Mix((uint)face);
            if (onFace != null)
            {
                onFace(face);
            }
        }
    }
}
