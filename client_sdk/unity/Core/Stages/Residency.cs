using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// Which segments are on the GPU, which should be, and when the visible set may change. What is visible changes in
    /// <see cref="Swap"/> alone, to exactly what the newest landing's ready or degraded event said, and when another scene version
    /// comes. No I/O, no clock: whoever owns it decodes, uploads, frees, and says so.
    /// </summary>
    /// <remarks>
    /// A segment goes held (its payload is here), decoding, decoded (waiting for, or under, upload), uploaded, resident (can be
    /// drawn at once), and from each of them back.
    /// </remarks>
    internal sealed partial class Residency
    {
        /// <summary>Segments of aims that wait for spare room; the oldest goes.</summary>
        private const int MaxPrefetched = 4096;
        private static readonly uint[] None = Array.Empty<uint>();
        private readonly SegmentShelf shelf;
        // Sets for lookups beside the arrays that keep an order.
        private readonly HashSet<uint> visibleIds = new HashSet<uint>();
        private readonly HashSet<uint> landingIds = new HashSet<uint>();
        // What the newest plan keeps ready beside what is shown.
        private readonly HashSet<uint> nearbyIds = new HashSet<uint>();
        private readonly List<uint> prefetched = new List<uint>();
        private readonly HashSet<uint> hiddenIds = new HashSet<uint>();
        // What the newest landing shows, nearest first: the order of decoding and uploading.
        private uint[] landingOrder = None;
        // Revision of Coming for which the base's lists are ready: a swap needs both.
        private int preparedRevision = -1;
        // False after a search found nothing: the lists are not walked in every frame, but when something changed.
        private bool mayDecode = true;
        // Cache of Missing(); null where it must be worked out anew.
        private IReadOnlyList<uint> missing;

        internal Residency(StageOptions options)
        {
            shelf = new SegmentShelf(
                options, segment => landingIds.Contains(segment) || visibleIds.Contains(segment) || nearbyIds.Contains(segment));
            Visible = None;
        }

        /// <summary>Segments shown, ascending.</summary>
        internal uint[] Visible { get; private set; }

        /// <summary>The newest landing, or null before the first.</summary>
        internal LandingRecord Newest { get; private set; }

        /// <summary>Number of this scene version, from 0: answers to requests of an earlier one are dropped.</summary>
        internal int Epoch { get; private set; }

        /// <summary>What the next swap will show as far as known, ascending; null where nothing is coming.</summary>
        internal uint[] Coming { get; private set; }

        /// <summary>Changes whenever <see cref="Coming"/> does.</summary>
        internal int ComingRevision { get; private set; }

        /// <summary>Segments being decoded, or decoded and not uploaded.</summary>
        internal int InFlight => shelf.InFlightCount;

        /// <summary>GPU bytes of segments there, or on their way, that nobody wants now.</summary>
        internal long SpareBytes => shelf.SpareBytes;

        /// <summary>What to decode now, most urgent first; marks it so. False where nothing is to be decoded.</summary>
        internal bool TryTakeDecode(out uint segment)
        {
            segment = 0;
            if (!mayDecode || !shelf.HasRoom)
            {
                return false;
            }
            // 1. What the newest landing waits for, nearest first.
            if (Newest != null && Newest.Plan != null)
            {
                for (int at = 0; at < landingOrder.Length; at++)
                {
                    if (shelf.TryDecode(landingOrder[at]))
                    {
                        segment = landingOrder[at];
                        return true;
                    }
                }
            }
            // 2. What aims brought, oldest first, as far as there is spare room.
            // What finds no spare room waits for the next swap.
            while (prefetched.Count > 0 && shelf.HasSpareRoom)
            {
                segment = prefetched[0];
                prefetched.RemoveAt(0);
                if (shelf.TryDecode(segment))
                {
                    return true;
                }
            }
            mayDecode = false;
            return false;
        }

        /// <summary>A mesh came that will take those bytes on the GPU. False where nobody wants it any more.</summary>
        internal bool Decoded(uint segment, int epoch, long bytes)
        {
            mayDecode = true;
            return epoch == Epoch && shelf.Take(segment, bytes);
        }

        /// <summary>It could not be decoded, or not be uploaded: its base faces stay, and it is told as missing.</summary>
        internal void Failed(uint segment, int epoch)
        {
            if (epoch == Epoch)
            {
                shelf.Fail(segment);
                Recompute();
            }
        }

        /// <summary>The most urgent mesh that waits for its upload, none of those left out; false where there is none.</summary>
        internal bool TryNextUpload(Dictionary<uint, SegmentMesh> waiting, HashSet<uint> excluded, out uint segment)
        {
            segment = 0;
            if (waiting.Count <= excluded.Count)
            {
                return false;
            }
            // 1. The newest landing's, nearest first; 2. any other (an aim's), in no order.
            for (int at = 0; at < landingOrder.Length; at++)
            {
                segment = landingOrder[at];
                if (shelf.StepOf(segment) == SegmentStep.Decoded && !excluded.Contains(segment))
                {
                    return true;
                }
            }
            foreach (KeyValuePair<uint, SegmentMesh> pair in waiting)
            {
                segment = pair.Key;
                if (shelf.StepOf(segment) == SegmentStep.Decoded && !excluded.Contains(segment))
                {
                    return true;
                }
            }
            return false;
        }

        /// <summary>A segment's whole mesh is on the GPU.</summary>
        internal void Uploaded(uint segment)
        {
            shelf.Uploaded(segment);
            mayDecode = true;
        }

        /// <summary>An uploaded segment can be drawn without any further preparation.</summary>
        internal void Warmed(uint segment) { shelf.Warmed(segment); }

        /// <summary>The base's lists for the coming set of this revision are ready too.</summary>
        internal void BasePrepared(int revision) { preparedRevision = revision; }

        /// <summary>Ids whose GPU memory, or waiting mesh, is to be freed; each is told once.</summary>
        internal void TakeFreed(List<uint> target) { shelf.TakeFreed(target); }

        /// <summary>Whether a swap would show the newest landing: in full, the declared inner part of it, or nothing yet.</summary>
        internal LandingRecord.Extent Presentable()
        {
            if (Newest == null || Coming == null || Newest.Swapped == LandingRecord.Extent.Full || preparedRevision != ComingRevision)
            {
                return LandingRecord.Extent.Nothing;
            }
            bool isWhole;
            if (Newest.Target(out isWhole) == null)
            {
                return LandingRecord.Extent.Nothing;
            }
            // All or nothing: one segment that is not drawable yet holds the swap back, so that no half of a landing is seen.
            for (int at = 0; at < Coming.Length; at++)
            {
                if (shelf.StepOf(Coming[at]) != SegmentStep.Resident)
                {
                    return LandingRecord.Extent.Nothing;
                }
            }
            return isWhole ? LandingRecord.Extent.Full : LandingRecord.Extent.Degraded;
        }

        /// <summary>
        /// Show what is presentable; null where nothing is. The one place where the visible set changes within a version.
        /// </summary>
        internal SceneSwap Swap()
        {
            LandingRecord.Extent extent = Presentable();
            return extent == LandingRecord.Extent.Nothing ? null : Show(extent);
        }

        /// <summary>Apart, since this makes garbage and the question is asked in every frame.</summary>
        private SceneSwap Show(LandingRecord.Extent extent)
        {
            // Set differences: what both landings show is not touched, and does not flicker.
            uint[] previous = Visible;
            uint[] next = Coming;
            uint[] shown = SegmentIds.Without(next, visibleIds);
            Newest.Swapped = extent;
            Visible = next;
            visibleIds.Clear();
            visibleIds.UnionWith(next);
            uint[] hidden = SegmentIds.Without(previous, visibleIds);
            hiddenIds.Clear();
            hiddenIds.UnionWith(hidden);
            int landing = Newest.Landing;
            // Only now: until the swap, the old landing was on the screen.
            shelf.FreeAfterSwap(landing, hiddenIds);
            prefetched.RemoveAll(segment => !shelf.IsAimedSince(segment, landing));
            mayDecode = true;
            Recompute();
            return new SceneSwap { Landing = landing, IsDegraded = extent == LandingRecord.Extent.Degraded, Shown = shown,
                Hidden = hidden };
        }

        /// <summary>To be called once a frame: notes when the newest landing became presentable in full.</summary>
        internal void Settle(double nowMs)
        {
            if (Newest != null && Newest.PresentableMs == null && Presentable() == LandingRecord.Extent.Full)
            {
                Newest.PresentableMs = nowMs - Newest.RequestedAtMs;
            }
        }

        /// <summary>Share of the newest landing that came and was uploaded, 0 to 1.</summary>
        internal double Fraction() { return Newest == null ? 0 : Newest.Fraction(shelf); }

        /// <summary>What the newest landing's full set lacks: told by the stream, or not decodable. Ascending.</summary>
        internal IReadOnlyList<uint> Missing()
        {
            if (missing != null)
            {
                return missing;
            }
            var ids = new HashSet<uint>();
            if (Newest != null)
            {
                ids.UnionWith(Newest.Missing);
                IReadOnlyList<uint> expected = ComingIds() ?? Newest.Expected() ?? (IReadOnlyList<uint>)None;
                for (int at = 0; at < expected.Count; at++)
                {
                    if (shelf.StepOf(expected[at]) == SegmentStep.Failed)
                    {
                        ids.Add(expected[at]);
                    }
                }
            }
            missing = SegmentIds.Sorted(new List<uint>(ids));
            return missing;
        }

        private LandingRecord Find(int landing)
        {
            return Newest != null && Newest.Landing == landing && Newest.Refusal == null ? Newest : null;
        }

        private void SetLandingIds(uint[] ids)
        {
            landingOrder = ids;
            landingIds.Clear();
            landingIds.UnionWith(ids);
            shelf.Trim();
            mayDecode = true;
            Recompute();
        }

        private void SetVisible(uint[] ids)
        {
            Visible = ids;
            visibleIds.Clear();
            visibleIds.UnionWith(ids);
            shelf.Trim();
        }

        private IReadOnlyList<uint> ComingIds()
        {
            bool isWhole;
            return Newest.Target(out isWhole);
        }

        /// <summary>Work out what the next swap will show.</summary>
        private void Recompute()
        {
            missing = null;
            uint[] next = null;
            if (Newest != null && Newest.Swapped != LandingRecord.Extent.Full)
            {
                // Before ready the plan says what will presumably come: the base's lists can be prepared while payloads travel.
                IReadOnlyList<uint> ids = ComingIds() ?? Newest.Expected();
                if (ids != null)
                {
                    var list = new List<uint>(ids);
                    list.RemoveAll(segment => shelf.StepOf(segment) == SegmentStep.Failed);
                    next = list.ToArray();
                    Array.Sort(next);
                }
            }
            if (!SegmentIds.IsSame(next, Coming))
            {
                Coming = next;
                ComingRevision++;
            }
        }
    }
}
