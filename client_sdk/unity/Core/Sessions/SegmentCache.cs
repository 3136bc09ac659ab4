using System;
using System.Collections.Generic;

namespace Terraport.Sessions
{
    /// <summary>
    /// The client's memory of segments: a byte-bounded LRU with pins. What is pinned (the visible segments, and those of a plan
    /// on its way) is never evicted; everything else goes, least recently used first, as soon as the bound is exceeded. Pins
    /// may exceed the bound: a landing must be held whole, and its size is bounded by the budgets of the landing instead.
    /// </summary>
    /// <remarks>
    /// "Recently" is counted in accesses, not in time. Owned by one thread, but for <see cref="TryPin"/>, which any may call.
    /// </remarks>
    public sealed class SegmentCache
    {
        // Guards `entries` against TryPin on other threads: taken where entries change. The owner reads without it.
        private readonly object gate = new object();
        private readonly Dictionary<uint, Entry> entries = new Dictionary<uint, Entry>();
        // Entry objects without a segment: in the steady state nothing is allocated.
        private readonly Stack<Entry> spare = new Stack<Entry>();
        // Ids, held or not yet: a plan pins its segments before they come.
        private readonly HashSet<uint> pinned = new HashSet<uint>();
        // Head of a ring: its Newer is the oldest entry, its Older the newest.
        private readonly Entry ring = new Entry();
        private readonly long maxBytes;
        // Held entries that are not in `pinned`: Trim ends as soon as none is left.
        private int unpinnedCount;

        /// <summary>An empty cache.</summary>
        /// <param name="maxBytes">Bound on the payload bytes beside what is pinned; 0 keeps pinned segments only.</param>
        public SegmentCache(long maxBytes)
        {
            if (maxBytes < 0) throw new ArgumentOutOfRangeException("maxBytes", maxBytes, "expected 0 or more bytes");
            this.maxBytes = maxBytes;
            ring.Older = ring;
            ring.Newer = ring;
        }

        /// <summary>Payload bytes held now, pinned ones included.</summary>
        public long Bytes { get; private set; }

        /// <summary>Segments held now.</summary>
        public int Count => entries.Count;

        /// <summary>Whether a segment is held.</summary>
        public bool Contains(uint segment) { return entries.ContainsKey(segment); }

        /// <summary>Facts of a held segment; false where it is not held. Its age does not change.</summary>
        public bool TryGetFacts(uint segment, out SegmentFacts facts)
        {
            Entry entry;
            bool isHeld = entries.TryGetValue(segment, out entry);
            facts = isHeld ? entry.Facts : default(SegmentFacts);
            return isHeld;
        }

        /// <summary>Make a segment the most recently used; whether it is held.</summary>
        public bool Touch(uint segment)
        {
            Entry entry;
            if (!entries.TryGetValue(segment, out entry)) return false;
            Unlink(entry);
            LinkNewest(entry);
            return true;
        }

        /// <summary>Take hold of a payload; false where it is not held. From any thread.</summary>
        public bool TryPin(uint segment, out PinnedPayload payload)
        {
            lock (gate)
            {
                Entry entry;
                if (!entries.TryGetValue(segment, out entry))
                {
                    payload = default(PinnedPayload);
                    return false;
                }
                // Under the lock: after it, the owner could drop the entry and the buffer go back to the pool first.
                entry.Buffer.Retain();
                payload = new PinnedPayload(entry.Buffer, entry.Facts);
                return true;
            }
        }

        /// <summary>
        /// Add (or replace) a payload as the most recently used; the buffer is the cache's from now on. Evicts nothing: between
        /// a land and its plan nothing may be evicted, because the plan may count on it. <see cref="Trim"/> does.
        /// </summary>
        public void Put(SegmentFacts facts, PayloadBuffer buffer)
        {
            Discard(facts.Segment);
            Entry entry = spare.Count > 0 ? spare.Pop() : new Entry();
            entry.Facts = facts;
            entry.Buffer = buffer;
            lock (gate) entries.Add(facts.Segment, entry);
            LinkNewest(entry);
            Bytes += buffer.Length;
            if (!pinned.Contains(facts.Segment)) unpinnedCount++;
        }

        /// <summary>Drop one entry, pinned or not; whether it was held.</summary>
        public bool Discard(uint segment)
        {
            Entry entry;
            if (!entries.TryGetValue(segment, out entry)) return false;
            lock (gate) entries.Remove(segment);
            Unlink(entry);
            Bytes -= entry.Buffer.Length;
            if (!pinned.Contains(segment)) unpinnedCount--;
            entry.Buffer.Release();
            entry.Buffer = null;
            spare.Push(entry);
            return true;
        }

        /// <summary>Drop everything, pinned or not.</summary>
        public void Clear()
        {
            while (ring.Newer != ring) Discard(ring.Newer.Facts.Segment);
        }

        /// <summary>Pin nothing from now on. Evicts nothing.</summary>
        public void UnpinAll()
        {
            pinned.Clear();
            unpinnedCount = entries.Count;
        }

        /// <summary>Pin these too, held or not yet.</summary>
        public void Pin(IEnumerable<uint> segments)
        {
            foreach (uint segment in segments)
            {
                if (pinned.Add(segment) && entries.ContainsKey(segment)) unpinnedCount--;
            }
        }

        /// <summary>Evict unpinned entries, least recently used first, until the bound holds or none is left.</summary>
        /// <param name="evicted">What went is added here, in that order.</param>
        public void Trim(List<SegmentFacts> evicted)
        {
            Entry entry = ring.Newer;
            while (Bytes > maxBytes && unpinnedCount > 0 && entry != ring)
            {
                // Read before the entry goes: discarding cuts it out of the ring.
                Entry newer = entry.Newer;
                if (!pinned.Contains(entry.Facts.Segment))
                {
                    evicted.Add(entry.Facts);
                    Discard(entry.Facts.Segment);
                }
                entry = newer;
            }
        }

        /// <summary>Rows of everything held, most recently used first.</summary>
        public List<Wire.HeldRow> Rows()
        {
            var rows = new List<Wire.HeldRow>(entries.Count);
            for (Entry entry = ring.Older; entry != ring; entry = entry.Older)
            {
                rows.Add(new Wire.HeldRow(entry.Facts.Segment, entry.Facts.Xxh3));
            }
            return rows;
        }

        private static void Unlink(Entry entry)
        {
            entry.Older.Newer = entry.Newer;
            entry.Newer.Older = entry.Older;
        }

        private void LinkNewest(Entry entry)
        {
            entry.Older = ring.Older;
            entry.Newer = ring;
            ring.Older.Newer = entry;
            ring.Older = entry;
        }

        /// <summary>One of a ring from the oldest (behind its head) to the newest.</summary>
        private sealed class Entry
        {
            internal SegmentFacts Facts;
            internal PayloadBuffer Buffer;
            internal Entry Older;
            internal Entry Newer;
        }
    }
}
