using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// Brings the base's lists of faces to what a coming set hides, one slice at a time, block by block; a swap then changes only
    /// which lists are drawn.
    /// </summary>
    internal sealed class BaseFaces
    {
        /// <summary>No coming set is prepared, or asked for.</summary>
        internal const int NoRevision = -1;

        private readonly CoverCounters counters;
        // Ids from here on are those of the coarser level; a cover names segments.
        private readonly uint segmentCount;
        private readonly ISceneRenderer renderer;
        private readonly int blockFaces;
        // Both masks are as Hidden.Mask: one byte a face, 1 where it is hidden. drawn is on the screen, prepared in the other lists.
        private readonly byte[] drawn;
        private readonly byte[] prepared;
        /// <summary>Blocks whose prepared list is what <see cref="prepared"/> says.</summary>
        private readonly bool[] isPrepared;
        /// <summary>Blocks that may differ from what is drawn, and are to be looked at.</summary>
        private readonly bool[] isTouched;
        // touched: blocks to be looked at, from nextTouched on. changed: blocks that the next swap exchanges.
        private readonly List<int> touched = new List<int>();
        private readonly List<int> changed = new List<int>();
        private readonly List<uint> toAdd = new List<uint>();
        private readonly List<uint> toRemove = new List<uint>();
        private readonly HashSet<uint> targetIds = new HashSet<uint>();
        // One delegate, made once: it is passed for every segment that changes.
        private readonly Action<int> touch;
        private int targetRevision = NoRevision;
        private int nextTouched;

        internal BaseFaces(SceneFiles files, ISceneRenderer renderer, int blockFaces)
        {
            this.renderer = renderer;
            this.blockFaces = blockFaces;
            counters = new CoverCounters(files.Cover);
            segmentCount = (uint)files.Manifest.SegmentCount;
            drawn = new byte[counters.FaceCount];
            prepared = new byte[counters.FaceCount];
            int blocks = (counters.FaceCount + blockFaces - 1) / blockFaces;
            isPrepared = new bool[blocks];
            isTouched = new bool[blocks];
            touch = Touch;
            PreparedRevision = NoRevision;
        }

        /// <summary>Revision of the coming set that the next swap can show.</summary>
        internal int PreparedRevision { get; private set; }

        /// <summary>What the lists hide once they are prepared; after a swap, what is drawn.</summary>
        internal HiddenFaces Hidden => counters.Hidden;

        /// <summary>Faces that the drawn lists hide.</summary>
        internal int DrawnHiddenCount { get; private set; }

        /// <summary>Hash of the set of faces that the drawn lists hide.</summary>
        internal uint DrawnHiddenHash { get; private set; }

        /// <summary>Make the lists ready for the segments of these payloads, at whichever level; <see cref="Step"/> does the work.</summary>
        internal void Prepare(IReadOnlyList<uint> payloads, int revision)
        {
            if (revision == targetRevision)
            {
                return;
            }
            targetRevision = revision;
            PreparedRevision = NoRevision;
            targetIds.Clear();
            toAdd.Clear();
            toRemove.Clear();
            for (int at = 0; at < payloads.Count; at++)
            {
                uint segment = payloads[at] % segmentCount;
                // A plan has each segment at one level; of one that names both the face is hidden once.
                if (targetIds.Add(segment) && !counters.IsShown(segment))
                {
                    toAdd.Add(segment);
                }
            }
            counters.CopyShown(toRemove);
            toRemove.RemoveAll(targetIds.Contains);
            // What was looked at for the set before is done; what was not is still due.
            touched.RemoveRange(0, nextTouched);
            nextTouched = 0;
            // Blocks that would change for the set before are looked at again.
            for (int at = 0; at < changed.Count; at++)
            {
                TouchBlock(changed[at]);
            }
            changed.Clear();
        }

        /// <summary>One slice of work: its bytes, or 0 where there is nothing to do.</summary>
        internal int Step()
        {
            if (targetRevision == NoRevision || PreparedRevision == targetRevision)
            {
                return 0;
            }
            // 1. The counters, one segment a step; 2. the blocks that they touched, one list a step; 3. done. Each step returns its bytes,
            // so that the frame's budget can stop in between.
            if (toRemove.Count > 0)
            {
                return 1 + counters.Remove(TakeLast(toRemove), touch);
            }
            if (toAdd.Count > 0)
            {
                return 1 + counters.Add(TakeLast(toAdd), touch);
            }
            while (nextTouched < touched.Count)
            {
                int block = touched[nextTouched++];
                isTouched[block] = false;
                FaceRange range = RangeOf(block);
                if (IsEqual(drawn, range))
                {
                    continue;
                }
                changed.Add(block);
                // Written for an earlier coming set, and right for this one: nothing to upload.
                if (isPrepared[block] && IsEqual(prepared, range))
                {
                    continue;
                }
                renderer.PrepareBase(range, counters.Hidden);
                Buffer.BlockCopy(counters.Hidden.Mask, range.First, prepared, range.First, range.Count);
                isPrepared[block] = true;
                // Three indices of up to four bytes a face.
                return range.Count * 12;
            }
            touched.Clear();
            nextTouched = 0;
            // By block, so that a swap names the same blocks in the same order whatever the order of work.
            changed.Sort();
            PreparedRevision = targetRevision;
            return 1;
        }

        /// <summary>The prepared lists are drawn from now on: the blocks that change.</summary>
        internal IReadOnlyList<FaceRange> Flip()
        {
            var ranges = new FaceRange[changed.Count];
            for (int at = 0; at < ranges.Length; at++)
            {
                FaceRange range = RangeOf(changed[at]);
                ranges[at] = range;
                Buffer.BlockCopy(prepared, range.First, drawn, range.First, range.Count);
                isPrepared[changed[at]] = false;
            }
            changed.Clear();
            DrawnHiddenCount = counters.Hidden.Count;
            DrawnHiddenHash = counters.Hidden.Hash;
            targetRevision = NoRevision;
            PreparedRevision = NoRevision;
            return ranges;
        }

        private static uint TakeLast(List<uint> list)
        {
            uint last = list[list.Count - 1];
            list.RemoveAt(list.Count - 1);
            return last;
        }

        private FaceRange RangeOf(int block)
        {
            int first = block * blockFaces;
            return new FaceRange(first, Math.Min(blockFaces, counters.FaceCount - first));
        }

        private bool IsEqual(byte[] mask, FaceRange range)
        {
            byte[] hidden = counters.Hidden.Mask;
            for (int face = range.First; face < range.End; face++)
            {
                if (mask[face] != hidden[face])
                {
                    return false;
                }
            }
            return true;
        }

        /// <summary>A face's counter passed zero: look at its block again.</summary>
        private void Touch(int face) { TouchBlock(face / blockFaces); }

        private void TouchBlock(int block)
        {
            if (!isTouched[block])
            {
                isTouched[block] = true;
                touched.Add(block);
            }
        }
    }
}
