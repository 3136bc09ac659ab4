using System;
using System.Collections.Generic;
using System.Threading;
using Terraport.Sessions;

namespace Terraport.Disk
{
    /// <summary>
    /// A <see cref="DiskCache"/> on a thread of its own: reads what was kept once, then writes what came. What waits to be written is
    /// bounded; more is not kept.
    /// </summary>
    internal sealed class DiskShelf
    {
        /// <summary>A visit begins after so long at the latest, with what was read by then.</summary>
        internal const double RestoreMs = 1500;

        /// <summary>Payloads that wait to be written: 32 MiB.</summary>
        internal const long MaxWaitingBytes = 32L * 1024 * 1024;

        // Guards everything below.
        private readonly object gate = new object();
        private readonly Queue<PinnedPayload> writes = new Queue<PinnedPayload>();
        private readonly Queue<SegmentFacts> uses = new Queue<SegmentFacts>();
        private readonly AutoResetEvent wake = new AutoResetEvent(false);
        private readonly DiskCache cache;
        private List<KeyValuePair<SegmentFacts, PayloadBuffer>> restored;
        private long waitingBytes;
        private bool isClosed;

        /// <summary>Begin to read.</summary>
        /// <param name="cache">From now on this shelf's alone.</param>
        /// <param name="mostBytes">Payload bytes to read at most.</param>
        /// <param name="pool">Where buffers come from.</param>
        /// <param name="changed">Called on the shelf's thread once all is read; may be null.</param>
        internal DiskShelf(DiskCache cache, long mostBytes, PayloadPool pool, Action changed)
        {
            this.cache = cache;
            var thread = new Thread(() =>
                {
                    List<KeyValuePair<SegmentFacts, PayloadBuffer>> kept = cache.Restore(mostBytes, RestoreMs, pool);
                    lock (gate) restored = kept;
                    if (changed != null) changed();
                    Work();
                });
            thread.Name = "terraport disk";
            thread.IsBackground = true;
            thread.Start();
        }

        /// <summary>Take what was read, once; null while it is being read. Buffers are the caller's.</summary>
        internal List<KeyValuePair<SegmentFacts, PayloadBuffer>> TakeRestored()
        {
            lock (gate)
            {
                List<KeyValuePair<SegmentFacts, PayloadBuffer>> taken = restored;
                restored = null;
                return taken;
            }
        }

        /// <summary>Keep a payload; soon, not now. The pin is the shelf's from now on.</summary>
        internal void Put(PinnedPayload payload)
        {
            lock (gate)
            {
                if (!isClosed && waitingBytes + payload.Facts.Length <= MaxWaitingBytes)
                {
                    waitingBytes += payload.Facts.Length;
                    writes.Enqueue(payload);
                    wake.Set();
                    return;
                }
            }
            payload.Dispose();
        }

        /// <summary>Note that a segment was used.</summary>
        internal void Use(SegmentFacts facts)
        {
            lock (gate)
            {
                // As many as two landings may show; one that is left out only goes a little sooner.
                if (!isClosed && uses.Count < 2 * Wire.WireLimits.MaxHeldSegments) uses.Enqueue(facts);
            }
            wake.Set();
        }

        /// <summary>Drop what waits; the file in hand is ended.</summary>
        internal void Close()
        {
            lock (gate)
            {
                isClosed = true;
                while (writes.Count > 0) writes.Dequeue().Dispose();
                uses.Clear();
            }
            wake.Set();
        }

        private void Work()
        {
            for (;;)
            {
                PinnedPayload payload = default(PinnedPayload);
                SegmentFacts used = default(SegmentFacts);
                bool isWrite, isUse;
                lock (gate)
                {
                    if (isClosed) return;
                    isWrite = writes.Count > 0;
                    isUse = !isWrite && uses.Count > 0;
                    if (isWrite) payload = writes.Dequeue();
                    if (isUse) used = uses.Dequeue();
                }
                if (isWrite)
                {
                    cache.Put(payload.Facts, payload.Bytes.Array);
                    payload.Dispose();
                    lock (gate) waitingBytes -= payload.Facts.Length;
                }
                else if (isUse)
                    cache.Use(used);
                else
                    wake.WaitOne();
            }
        }
    }
}
