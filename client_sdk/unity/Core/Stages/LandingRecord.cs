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
        // Payload bytes of each segment that the plan loads.
        private readonly Dictionary<uint, int> loadBytes = new Dictionary<uint, int>();
        private readonly HashSet<uint> arrived = new HashSet<uint>();
        // What degraded and ready declared, as given; null until they came.
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

        /// <summary>How much of a landing a swap has shown.</summary>
        internal enum Extent
        {
            Nothing,
            Degraded,
            Full,
        }

        /// <summary>Number that the stream gave it.</summary>
        internal int Landing { get; private set; }

        /// <summary>Centre of the landing, metres, scene frame.</summary>
        internal Vec3 Position { get; private set; }

        internal double RadiusM { get; private set; }

        /// <summary>When Land was called, on the stage's clock.</summary>
        internal double RequestedAtMs { get; private set; }

        /// <summary>Its newest plan; null before one came, and after a new scene version.</summary>
        internal PlanFacts Plan { get; private set; }

        /// <summary>What the server said that it cannot send; never null.</summary>
        internal IReadOnlyList<uint> Missing { get; private set; }

        /// <summary>Why the server refused it; null where it did not.</summary>
        internal string Refusal { get; private set; }

        /// <summary>Milliseconds from Land until all bytes were verified, the first time.</summary>
        internal double? ReadyMs { get; private set; }

        /// <summary>Milliseconds from Land until all of it could be drawn, the first time.</summary>
        internal double? PresentableMs { get; set; }

        internal long PayloadBytes { get; private set; }

        /// <summary>How much of it was shown by a swap.</summary>
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

        /// <summary>Count a segment that came; after ready the server's own sum counts.</summary>
        internal void Arrived(SegmentFacts facts)
        {
            arrived.Add(facts.Segment);
            if (readySet == null && loadBytes.ContainsKey(facts.Segment))
            {
                PayloadBytes += facts.Length;
            }
        }

        /// <summary>Note the inner set, which may be shown before the rest.</summary>
        internal void Degrade(IReadOnlyList<uint> segments) { innerSet = segments; }

        /// <summary>Note the full set: exactly this is to be shown.</summary>
        internal void Ready(IReadOnlyList<uint> visible, IReadOnlyList<uint> missing, double elapsedMs, long payloadBytes)
        {
            readySet = visible;
            Missing = missing ?? Array.Empty<uint>();
            // The first one: a second ready, after a reconnect, does not make the landing slower.
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
            // The inner set is shown once; after that only the full one changes anything.
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
                // Twice: coming over the line is one half of the way, becoming drawable the other.
                totalBytes += 2L * pair.Value;
                drawableBytes += readySet != null || arrived.Contains(pair.Key) ? pair.Value : 0;
                drawableBytes += shelf.StepOf(pair.Key) == SegmentStep.Resident ? pair.Value : 0;
            }
            return totalBytes > 0 ? drawableBytes / (double)totalBytes : 1;
        }
    }
}
