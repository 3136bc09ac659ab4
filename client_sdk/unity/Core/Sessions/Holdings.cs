using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>
    /// What the client holds, and what the server must be told of it: a segment that is not held any more must be named in an
    /// evict before the next land or aim (wire protocol, 6.7), since the server counts on what it once sent.
    /// </summary>
    internal sealed class Holdings
    {
        // Dropped here, and the server not told yet.
        private readonly Dictionary<uint, SegmentFacts> unreported = new Dictionary<uint, SegmentFacts>();
        private readonly List<SegmentFacts> evicted = new List<SegmentFacts>();

        internal Holdings(SegmentCache cache) { Cache = cache; }

        /// <summary>The payloads themselves; the session's, read by the stream's users through pins.</summary>
        internal SegmentCache Cache { get; }

        /// <summary>Facts of what is held, or was until the server is told.</summary>
        internal bool TryGetFacts(uint segment, out SegmentFacts facts)
        {
            return Cache.TryGetFacts(segment, out facts) || unreported.TryGetValue(segment, out facts);
        }

        /// <summary>Hold a payload, whose buffer is the cache's from now on; an eviction of it that was not told yet is void.</summary>
        internal void Put(SegmentFacts facts, PayloadBuffer buffer)
        {
            unreported.Remove(facts.Segment);
            Cache.Put(facts, buffer);
        }

        /// <summary>Evict down to the bound; the ids that went, null for none.</summary>
        internal uint[] Trim()
        {
            evicted.Clear();
            Cache.Trim(evicted);
            if (evicted.Count == 0) return null;
            var ids = new uint[evicted.Count];
            for (int number = 0; number < ids.Length; number++)
            {
                SegmentFacts facts = evicted[number];
                unreported[facts.Segment] = facts;
                ids[number] = facts.Segment;
            }
            return ids;
        }

        /// <summary>Drop a segment that the server knows to be gone: dropped by it, or rejected.</summary>
        internal void Forget(uint segment)
        {
            Cache.Discard(segment);
            unreported.Remove(segment);
        }

        /// <summary>Say, once, the messages that tell the server what is gone.</summary>
        /// <param name="spared">Ids of a plan that is not ready: these must not be evicted now and are told later; or null.</param>
        /// <param name="into">Takes the messages.</param>
        internal void ReportEvictions(HashSet<uint> spared, List<WireMessage> into)
        {
            if (unreported.Count == 0) return;
            var ids = new List<uint>();
            foreach (uint segment in unreported.Keys)
            {
                if (spared == null || !spared.Contains(segment)) ids.Add(segment);
            }
            // Sorted, so that the same history sends the same bytes.
            ids.Sort();
            // Spared ids stay, and are told when their plan is over.
            foreach (uint segment in ids) unreported.Remove(segment);
            for (int start = 0; start < ids.Count; start += WireLimits.MaxHeldSegments)
            {
                int count = Math.Min(WireLimits.MaxHeldSegments, ids.Count - start);
                into.Add(new EvictMessage { Segments = ids.GetRange(start, count).ToArray() });
            }
        }

        /// <summary>Everything held, most recently used first; every eviction is told by what is not in it.</summary>
        internal List<HeldRow> Offer()
        {
            unreported.Clear();
            return Cache.Rows();
        }
    }
}
