using System.Collections.Generic;
using System.Linq;

namespace Terraport
{
    /// <summary>Payloads in memory by content key, bounded in bytes; what was used longest ago goes first.</summary>
    internal sealed class SegmentCache
    {
        private readonly long maxBytes;
        private readonly Dictionary<ulong, LinkedListNode<Entry>> entries = new Dictionary<ulong, LinkedListNode<Entry>>();
        // Used longest ago first.
        private readonly LinkedList<Entry> byUse = new LinkedList<Entry>();

        /// <param name="maxBytes">Payload bytes at most, besides what <see cref="Trim"/> must keep.</param>
        internal SegmentCache(long maxBytes) { this.maxBytes = maxBytes; }

        /// <summary>Payload bytes held now.</summary>
        internal long Bytes { get; private set; }

        internal int Count => entries.Count;

        internal IEnumerable<KeyValuePair<ulong, Box>> Boxes => byUse.Select(entry => new KeyValuePair<ulong, Box>(entry.Key, entry.Box));

        /// <summary>Whether <see cref="Trim"/> has something to do.</summary>
        internal bool IsFull => Bytes > maxBytes;

        internal bool Contains(ulong key) { return entries.ContainsKey(key); }

        /// <summary>Note that a payload is used; false where it is not held.</summary>
        internal bool Touch(ulong key)
        {
            if (!entries.TryGetValue(key, out LinkedListNode<Entry> node)) return false;
            byUse.Remove(node);
            byUse.AddLast(node);
            return true;
        }

        /// <summary>The payload of a key; null where it is not held.</summary>
        internal byte[] Find(ulong key) { return entries.TryGetValue(key, out LinkedListNode<Entry> node) ? node.Value.Payload : null; }

        /// <summary>Hold a payload as the one used last; evicts nothing.</summary>
        internal void Put(ulong key, Box box, byte[] payload)
        {
            Remove(key);
            entries[key] = byUse.AddLast(new Entry { Key = key, Box = box, Payload = payload });
            Bytes += payload.Length;
        }

        /// <summary>Let go of what is not in <paramref name="kept"/> until the bound holds or nothing else is left.</summary>
        internal void Trim(HashSet<ulong> kept)
        {
            LinkedListNode<Entry> next = byUse.First;
            while (IsFull && next != null)
            {
                ulong key = next.Value.Key;
                next = next.Next;
                if (!kept.Contains(key)) Remove(key);
            }
        }

        private void Remove(ulong key)
        {
            if (!entries.TryGetValue(key, out LinkedListNode<Entry> node)) return;
            entries.Remove(key);
            byUse.Remove(node);
            Bytes -= node.Value.Payload.Length;
        }

        private sealed class Entry
        {
            internal ulong Key;
            internal Box Box;
            internal byte[] Payload;
        }
    }
}
