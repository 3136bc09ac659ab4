using System.Collections.Generic;

namespace Terraport.Wire
{
    /// <summary>Rules between the fields of one message, which no table can say (wire protocol, sections 6 and 13).</summary>
    internal static class MessageRules
    {
        /// <summary>Check the rules of a message whose fields are right.</summary>
        /// <exception cref="RefusedException">With the field that contradicts another.</exception>
        internal static void Check(WireMessage message)
        {
            // Messages without rules between their fields fall through.
            var aim = message as AimMessage;
            var land = message as LandMessage;
            var gather = message as GatherMessage;
            var plan = message as PlanMessage;
            var prefetch = message as PrefetchMessage;
            if (aim != null)
                CheckCoarse(aim.CoarseRadiusM, aim.RadiusM);
            else if (land != null)
                CheckLand(land);
            else if (gather != null)
                CheckInner(gather.InnerRadiusM, gather.RadiusM);
            else if (plan != null)
                CheckPlan(plan);
            else if (prefetch != null)
                ExpectSum("bytes", prefetch.Bytes, Bytes(prefetch.Segments));
        }

        private static void CheckLand(LandMessage land)
        {
            CheckCoarse(land.CoarseRadiusM, land.RadiusM);
            // A deadline without an inner set could show nothing early (6.4, rule 3).
            if (!land.InnerRadiusM.HasValue && (land.DeadlineMs.HasValue || land.StallMs.HasValue))
            {
                throw new RefusedException(
                    "got a deadline without inner_radius_m, expected both", land.DeadlineMs.HasValue ? "deadline_ms" : "stall_ms");
            }
            CheckInner(land.InnerRadiusM, land.RadiusM);
        }

        private static void CheckCoarse(double? coarseRadiusM, double radiusM)
        {
            if (coarseRadiusM.HasValue && coarseRadiusM.Value < radiusM)
            {
                throw new RefusedException("got " + coarseRadiusM.Value + ", expected at least radius_m " + radiusM, "coarse_radius_m");
            }
        }

        private static void CheckInner(double? innerRadiusM, double radiusM)
        {
            if (innerRadiusM.HasValue && innerRadiusM.Value > radiusM)
            {
                throw new RefusedException("got " + innerRadiusM.Value + ", expected at most radius_m " + radiusM, "inner_radius_m");
            }
        }

        private static void CheckPlan(PlanMessage plan)
        {
            // The sums are redundant on purpose: a budget or a progress bar may trust them without adding up.
            ExpectSum("load_bytes", plan.LoadBytes, Bytes(plan.Load));
            ExpectSum("load_triangles", plan.LoadTriangles, Triangles(plan.Load));
            // keep has no table on the wire, so of the totals only a lower bound can be checked.
            ExpectAtLeast("total_bytes", plan.TotalBytes, "load_bytes", plan.LoadBytes);
            ExpectAtLeast("total_triangles", plan.TotalTriangles, "load_triangles", plan.LoadTriangles);
            if ((plan.OmittedBy == null) != (plan.OmittedSegments == 0))
            {
                throw new RefusedException("got one of omitted_by and omitted_segments, expected both", "omitted_by");
            }
            CheckOverlap(plan);
        }

        private static void CheckOverlap(PlanMessage plan)
        {
            // Each list was checked for repeats of its own; here the three against each other, in the order in which Python names them.
            var kept = new HashSet<uint>(plan.Keep);
            var loaded = new HashSet<uint>();
            foreach (SegmentFacts facts in plan.Load)
            {
                loaded.Add(facts.Segment);
                if (kept.Contains(facts.Segment)) throw Overlap("keep", "load");
            }
            foreach (uint segment in plan.Nearby)
            {
                if (kept.Contains(segment)) throw Overlap("keep", "nearby");
            }
            foreach (uint segment in plan.Nearby)
            {
                if (loaded.Contains(segment)) throw Overlap("load", "nearby");
            }
        }

        private static RefusedException Overlap(string other, string field)
        {
            return new RefusedException("got an id of " + other + ", expected load, keep and nearby to be disjoint", field);
        }

        private static long Bytes(SegmentFacts[] rows)
        {
            long sum = 0;
            foreach (SegmentFacts row in rows) sum += row.Length;
            return sum;
        }

        private static long Triangles(SegmentFacts[] rows)
        {
            long sum = 0;
            foreach (SegmentFacts row in rows) sum += row.Faces;
            return sum;
        }

        private static void ExpectSum(string field, long received, long expected)
        {
            if (received == expected) return;
            throw new RefusedException("got " + received + ", expected the sum over the segments, " + expected, field);
        }

        private static void ExpectAtLeast(string field, long received, string lowerField, long min)
        {
            if (received < min) throw new RefusedException("got " + received + ", expected at least " + lowerField, field);
        }
    }
}
