using System;
using System.Collections.Generic;
using System.Threading;

namespace Terraport
{
    /// <summary>Decodes on threads of its own, below the priority of those that draw.</summary>
    public sealed class DecodeThreads : IDecodeQueue
    {
        private const int MaxThreads = 16;
        private const int JoinMs = 1000;
        private readonly Action<SegmentMesh> afterDecode;
        private readonly MeshPool pool = new MeshPool();
        // Each queue is its own lock; a thread never holds both.
        private readonly Queue<DecodeJob> jobs = new Queue<DecodeJob>();
        private readonly Queue<DecodeResult> results = new Queue<DecodeResult>();
        private readonly Thread[] threads;
        private bool isDisposed;

        /// <summary>A queue with threads of its own, which start now.</summary>
        /// <param name="threads">How many, 1 to 16; 0 for half of the machine's, at most 4.</param>
        /// <param name="afterDecode">Run after each decode, on its thread, before the mesh is handed out; may be null.</param>
        public DecodeThreads(int threads = 0, Action<SegmentMesh> afterDecode = null)
        {
            if (threads < 0 || threads > MaxThreads)
            {
                throw new ArgumentOutOfRangeException("threads", threads + " threads, expected 0 to " + MaxThreads);
            }
            this.afterDecode = afterDecode;
            int count = threads > 0 ? threads : Math.Max(1, Math.Min(4, Environment.ProcessorCount / 2));
            this.threads = new Thread[count];
            for (int at = 0; at < count; at++)
            {
                this.threads[at] = new Thread(Work);
                this.threads[at].Name = "terraport decode " + at;
                this.threads[at].IsBackground = true;
                // Below normal: on a device with few cores, the threads that draw and play sound go first.
                this.threads[at].Priority = ThreadPriority.BelowNormal;
                this.threads[at].Start();
            }
        }

        /// <inheritdoc/>
        public void Enqueue(uint segment, int epoch, IReadOnlyList<AttributeInfo> attributes, PinnedPayload payload)
        {
            lock (jobs)
            {
                if (!isDisposed)
                {
                    jobs.Enqueue(new DecodeJob { Segment = segment, Epoch = epoch, Attributes = attributes, Payload = payload });
                    Monitor.Pulse(jobs);
                    return;
                }
            }
            // Outside the lock, and only where nobody will decode it any more: the caller handed it over.
            payload.Dispose();
        }

        /// <inheritdoc/>
        public bool TryTake(out DecodeResult result)
        {
            lock (results)
            {
                if (results.Count > 0)
                {
                    result = results.Dequeue();
                    return true;
                }
            }
            result = default(DecodeResult);
            return false;
        }

        /// <inheritdoc/>
        public bool Step() { return false; }

        /// <inheritdoc/>
        public void Recycle(SegmentMesh mesh) { pool.Return(mesh); }

        /// <summary>
        /// Let go of every payload that was not decoded, and end the threads; waits for a decode under way, a second at
        /// most.
        /// </summary>
        public void Dispose()
        {
            lock (jobs)
            {
                isDisposed = true;
                while (jobs.Count > 0)
                {
                    jobs.Dequeue().Payload.Dispose();
                }
                // Wakes all, so that each sees isDisposed and ends.
                Monitor.PulseAll(jobs);
            }
            foreach (Thread thread in threads)
            {
                thread.Join(JoinMs);
            }
        }

        private void Work()
        {
            // One a thread: its scratch memory is not shared.
            var decoder = new SegmentDecoder();
            for (;;)
            {
                DecodeJob job;
                lock (jobs)
                {
                    while (jobs.Count == 0 && !isDisposed)
                    {
                        Monitor.Wait(jobs);
                    }
                    if (isDisposed)
                    {
                        return;
                    }
                    job = jobs.Dequeue();
                }
                DecodeResult result = job.Run(decoder, pool, afterDecode);
                lock (results) { results.Enqueue(result); }
            }
        }
    }
}
