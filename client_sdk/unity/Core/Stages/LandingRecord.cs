using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// What is known of one landing, from Land until a newer one: its plan, what arrived, and what its degraded and ready events
    /// said is to be shown.
    /// </summary>
    internal sealed class LandingRecord
    {
        private readonly Dictionary<uint, int> loadBytes = new Dictionary<uint, int>();
        private readonly HashSet<uint> arrived = new HashSet<uint>();
        private IReadOnlyList<uint> innerSet;
        private IReadOnlyList<uint> readySet;

        internal LandingRecord(int landing, Vec3 position, double radiusM, double requestedAtMs)
        {
            Landing = landing;
            Position = position;
            RadiusM = radiusM;
            RequestedAtMs = requestedAtMs;
            Missing = Array.Empty<uint>();
        }

        /// <summary>What was shown of a landing.</summary>
        internal enum Extent
        {
            Nothing,
            Degraded,
            Full,
        }

        internal int Landing { get; private set; }

        internal Vec3 Position { get; private set; }

        internal double RadiusM { get; private set; }

        internal double RequestedAtMs { get; private set; }

        internal PlanFacts Plan { get; private set; }

        internal IReadOnlyList<uint> Missing { get; private set; }

        internal string Refusal { get; private set; }

        internal double? ReadyMs { get; private set; }

        internal double? PresentableMs { get; set; }

        internal long PayloadBytes { get; private set; }

        internal Extent Swapped { get; set; }

        /// <summary>
        /// A plan came: the first, or another one after a reconnect. What was shown stays shown until the next ready.
        /// </summary>
        internal void Planned(PlanFacts plan)
        {
            Plan = plan;
            innerSet = null;
            readySet = null;
            loadBytes.Clear();
            for (int at = 0; at < plan.Load.Count; at++)
            {
                loadBytes[plan.Load[at].Segment] = plan.Load[at].Length;
            }
        }

        internal void Arrived(SegmentFacts facts)
        {
            arrived.Add(facts.Segment);
            if (readySet == null && loadBytes.ContainsKey(facts.Segment))
            {
                PayloadBytes += facts.Length;
            }
        }

        internal void Degrade(IReadOnlyList<uint> segments) { innerSet = segments; }

        internal void Ready(IReadOnlyList<uint> visible, IReadOnlyList<uint> missing, double elapsedMs, long payloadBytes)
        {
            readySet = visible;
            Missing = missing ?? Array.Empty<uint>();
            ReadyMs = ReadyMs ?? elapsedMs;
            PayloadBytes = payloadBytes;
        }

        internal void Refuse(string message) { Refusal = message ?? "refused"; }

        /// <summary>A new scene version: there is no plan of it yet.</summary>
        internal void Restart()
        {
            Plan = null;
            Missing = Array.Empty<uint>();
            Swapped = Extent.Nothing;
            innerSet = null;
            readySet = null;
            loadBytes.Clear();
            arrived.Clear();
        }

        /// <summary>
        /// What may be shown next, once it is on the GPU; null where nothing was declared yet, or the inner part is
        /// shown.
        /// </summary>
        internal IReadOnlyList<uint> Target(out bool isWhole)
        {
            isWhole = readySet != null;
            if (Refusal != null)
            {
                return null;
            }
            return isWhole ? readySet : Swapped == Extent.Degraded ? null : innerSet;
        }

        /// <summary>What ready will presumably say: the plan's load and keep; null without a plan.</summary>
        internal List<uint> Expected()
        {
            if (Plan == null || Refusal != null)
            {
                return null;
            }
            var expected = new List<uint>(Plan.Keep);
            for (int at = 0; at < Plan.Load.Count; at++)
            {
                expected.Add(Plan.Load[at].Segment);
            }
            return expected;
        }

        /// <summary>Bytes that came and were uploaded, of those that must: each half counts once.</summary>
        internal double Fraction(SegmentShelf shelf)
        {
            if (Plan == null)
            {
                return 0;
            }
            long totalBytes = 0;
            long drawableBytes = 0;
            foreach (KeyValuePair<uint, int> pair in loadBytes)
            {
                totalBytes += 2L * pair.Value;
                drawableBytes += readySet != null || arrived.Contains(pair.Key) ? pair.Value : 0;
                drawableBytes += shelf.StepOf(pair.Key) == SegmentStep.Resident ? pair.Value : 0;
            }
            return totalBytes > 0 ? drawableBytes / (double)totalBytes : 1;
        }
    }
}
