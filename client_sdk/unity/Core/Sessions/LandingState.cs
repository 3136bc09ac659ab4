using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>One landing that the user asked for, over as many generations as reconnecting takes.</summary>
    internal sealed class LandingState
    {
        private static readonly uint[] None = new uint[0];

        // As asked for: repeated on every connection, whose server may allow another ring.
        private readonly Vec3 position;
        private readonly double radiusM;
        private readonly double? coarseRadiusM;
        private readonly double? innerRadiusM;
        private readonly int? deadlineMs;
        private readonly int? stallMs;

        internal LandingState(int number, Vec3 position, double radiusM, LandOptions options)
        {
            Number = number;
            this.position = position;
            this.radiusM = radiusM;
            // Copied: the caller may reuse its options.
            if (options == null) return;
            coarseRadiusM = options.CoarseRadiusM;
            innerRadiusM = options.InnerRadiusM;
            deadlineMs = options.DeadlineMs;
            stallMs = options.StallMs;
        }

        /// <summary>The session's own number, the same over reconnects.</summary>
        internal int Number { get; }

        /// <summary>Generation on the present connection; -1 before it was sent there.</summary>
        internal long Generation { get; set; } = -1;

        /// <summary>Of the load table, and of segments of keep that are sent after all, by id.</summary>
        internal Dictionary<uint, SegmentFacts> Facts { get; } = new Dictionary<uint, SegmentFacts>();

        /// <summary>
        /// Facts of segments rejected after this landing was asked for and before its plan came, by id: the plan may still keep
        /// them, and the server sends them again (6.4, rule 7).
        /// </summary>
        internal Dictionary<uint, SegmentFacts> Crossed { get; } = new Dictionary<uint, SegmentFacts>();

        /// <summary>Ids of load and keep.</summary>
        internal HashSet<uint> PlannedIds { get; } = new HashSet<uint>();

        /// <summary>Wanted ids whose payload is not here yet.</summary>
        internal HashSet<uint> Waiting { get; } = new HashSet<uint>();

        /// <summary>Ids of the latest ready.missing.</summary>
        internal HashSet<uint> Missing { get; } = new HashSet<uint>();

        /// <summary>The declared inner set, ascending, until it has been reported; null where there is none.</summary>
        internal uint[] Inner { get; set; }

        /// <summary>Whether the server has said ready for the present generation; payloads may still be on their way.</summary>
        internal bool IsReadySeen { get; set; }

        /// <summary>Chunk bytes that came for it, in all its generations.</summary>
        internal long PayloadBytes { get; set; }

        /// <summary>Whether it became ready for the client.</summary>
        internal bool IsReady { get; set; }

        /// <summary>Whether it is ready for the client (6.4, rule 5).</summary>
        internal bool IsComplete => IsReadySeen && (Waiting.Count == 0 || Waiting.IsSubsetOf(Missing));

        /// <summary>The message that asks for it under a generation, of a server that allows so large a radius.</summary>
        internal LandMessage Message(uint generation, double maxRadiusM)
        {
            return new LandMessage {
                Generation = generation,
                Position = position,
                RadiusM = radiusM,
                CoarseRadiusM = RingOf(radiusM, coarseRadiusM, maxRadiusM),
                InnerRadiusM = innerRadiusM,
                DeadlineMs = deadlineMs,
                StallMs = stallMs,
            };
        }

        /// <summary>The ring's radius, cut to what the server allows: a landing with less coarse ground is better than none.</summary>
        internal static double? RingOf(double radiusM, double? coarseRadiusM, double maxRadiusM)
        {
            // One below the radius stays: it is a mistake, and is to be told.
            if (!coarseRadiusM.HasValue || coarseRadiusM.Value < radiusM) return coarseRadiusM;
            return Math.Max(radiusM, Math.Min(coarseRadiusM.Value, maxRadiusM));
        }

        /// <summary>Take the plan of a generation, in place of any before.</summary>
        internal void Begin(PlanMessage plan)
        {
            // A plan replaces all that an earlier one of this landing said; only the number and the counted bytes stay.
            Facts.Clear();
            PlannedIds.Clear();
            Waiting.Clear();
            Missing.Clear();
            Inner = null;
            IsReadySeen = false;
            foreach (SegmentFacts facts in plan.Load)
            {
                Facts.Add(facts.Segment, facts);
                PlannedIds.Add(facts.Segment);
                Waiting.Add(facts.Segment);
            }
            // What is kept is here already, or is asked for again by whoever calls.
            PlannedIds.UnionWith(plan.Keep);
        }

        /// <summary>Wait for a segment of keep that is not here after all.</summary>
        internal void ExpectAgain(SegmentFacts facts)
        {
            Waiting.Add(facts.Segment);
            Facts[facts.Segment] = facts;
        }

        /// <summary>What it shows once complete: all that is wanted and whole, ascending.</summary>
        internal uint[] Shown()
        {
            var shownIds = new List<uint>(PlannedIds.Count);
            foreach (uint segment in PlannedIds)
            {
                if (!Waiting.Contains(segment)) shownIds.Add(segment);
            }
            shownIds.Sort();
            return shownIds.ToArray();
        }

        /// <summary>What it should show and cannot, ascending.</summary>
        internal uint[] NotShown()
        {
            if (Waiting.Count == 0) return None;
            var missing = new uint[Waiting.Count];
            Waiting.CopyTo(missing);
            Array.Sort(missing);
            return missing;
        }

        /// <summary>What the user is told of its plan.</summary>
        internal PlanFacts FactsOf(PlanMessage plan)
        {
            return new PlanFacts {
                Landing = Number,
                Position = plan.Position,
                RadiusM = plan.RadiusM,
                // The wire has one number: how far the plan reaches, at whichever level.
                EffectiveRadiusM = Math.Min(plan.EffectiveRadiusM, plan.RadiusM),
                CoarseRadiusM = plan.EffectiveRadiusM > plan.RadiusM ? plan.EffectiveRadiusM : (double?)null,
                Load = plan.Load,
                Keep = plan.Keep,
                Nearby = plan.Nearby,
                LoadBytes = plan.LoadBytes,
                TotalBytes = plan.TotalBytes,
                TotalTriangles = plan.TotalTriangles,
                OmittedSegments = plan.OmittedSegments,
                OmittedBy = plan.OmittedBy,
            };
        }
    }
}
