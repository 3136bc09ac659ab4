using System.Collections.Generic;

namespace Terraport
{
    /// <content>What the stream tells.</content>
    internal sealed partial class Residency
    {
        /// <summary>
        /// A landing was asked for: it is the newest from now on. What the one before wanted is kept until the plan is here, since a
        /// short hop wants most of it again.
        /// </summary>
        internal void Land(int landing, Vec3 position, double radiusM, double nowMs)
        {
            Newest = new LandingRecord(landing, position, radiusM, nowMs);
            Recompute();
        }

        /// <summary>Its plan came; once more after a reconnect.</summary>
        internal void Planned(PlanFacts plan)
        {
            LandingRecord landing = Find(plan.Landing);
            if (landing == null)
            {
                return;
            }
            landing.Planned(plan);
            for (int at = 0; at < plan.Keep.Count; at++)
            {
                // Kept segments are held by what the stream says, even where this stage never saw them arrive.
                shelf.Hold(plan.Keep[at], -1);
            }
            // Before SetLandingIds, which trims by what is needed: nearby counts as needed.
            nearbyIds.Clear();
            nearbyIds.UnionWith(plan.Nearby);
            SetLandingIds(landing.Expected().ToArray());
            shelf.FreeUnneededMeshes();
        }

        /// <summary>A segment's payload is here: for a landing, or (null) for an aim.</summary>
        internal void Arrived(SegmentFacts facts, int? landing)
        {
            // -1: came for a landing. Else the landing that was newest when the aim brought it: older ones are freed first.
            int aimedDuring = landing != null ? -1 : Newest == null ? 0 : Newest.Landing;
            mayDecode = true;
            // It had failed, and its bytes came anew: worth another decode.
            if (shelf.Hold(facts.Segment, aimedDuring))
            {
                shelf.Forgive(facts.Segment);
                Recompute();
            }
            if (Newest != null)
            {
                Newest.Arrived(facts);
            }
            if (landing == null && !landingIds.Contains(facts.Segment))
            {
                if (prefetched.Count == MaxPrefetched)
                {
                    prefetched.RemoveAt(0); // Its payload stays held.
                }
                prefetched.Add(facts.Segment);
            }
        }

        /// <summary>The deadline passed: these may be shown before the rest.</summary>
        internal void Degraded(int number, IReadOnlyList<uint> segments)
        {
            LandingRecord landing = Find(number);
            if (landing != null)
            {
                landing.Degrade(segments);
            }
            Recompute();
        }

        /// <summary>Every byte is here: exactly these are to be shown.</summary>
        internal void Ready(int number, IReadOnlyList<uint> visible, IReadOnlyList<uint> absent, double elapsedMs, long payloadBytes)
        {
            LandingRecord landing = Find(number);
            if (landing == null)
            {
                return;
            }
            uint[] sorted = SegmentIds.Sorted(visible);
            bool isShown = landing.Swapped == LandingRecord.Extent.Full && SegmentIds.IsSame(sorted, Visible);
            landing.Ready(visible, absent, elapsedMs, payloadBytes);
            // After a reconnect the same set may be declared once more.
            landing.Swapped = isShown ? LandingRecord.Extent.Full : LandingRecord.Extent.Nothing;
            for (int at = 0; at < sorted.Length; at++)
            {
                shelf.Hold(sorted[at], -1);
            }
            SetLandingIds(SegmentIds.InOrderOf(landingOrder, sorted)); // Nearest first, as in the plan.
            shelf.FreeUnneededMeshes();
        }

        /// <summary>The server said no to a landing: what is shown stays.</summary>
        internal void Refused(int number, string message)
        {
            LandingRecord landing = Find(number);
            if (landing != null)
            {
                landing.Refuse(message);
                SetLandingIds(None);
                shelf.FreeUnneededMeshes();
            }
        }

        /// <summary>The cache let these go: they cannot be decoded any more. What is on the GPU stays.</summary>
        internal void Dropped(IReadOnlyList<uint> segments)
        {
            for (int at = 0; at < segments.Count; at++)
            {
                shelf.Drop(segments[at]);
            }
            Recompute();
        }

        /// <summary>
        /// Another scene version: ids mean other segments now. Everything is forgotten but what is visible, which stays drawn until
        /// <see cref="ClearVisible"/>. Nothing is told to be freed: the owner knows what it uploaded.
        /// </summary>
        internal void VersionChanged()
        {
            // First: decodes that are under way come back with the old number, and are dropped.
            Epoch++;
            shelf.Clear();
            prefetched.Clear();
            nearbyIds.Clear();
            if (Newest != null)
            {
                Newest.Restart();
            }
            SetLandingIds(None);
        }

        /// <summary>The base of the new version is drawn: nothing of the old one is shown any more.</summary>
        internal void ClearVisible()
        {
            SetVisible(None);
            Recompute();
        }
    }
}
