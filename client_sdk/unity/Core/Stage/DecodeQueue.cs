using System;
using System.Collections.Generic;
using System.Threading;

namespace Terraport
{
    /// <summary>A segment to be decoded; then what came of it, or why it could not be decoded.</summary>
    internal sealed class DecodeJob
    {
        internal ulong Key;
        internal byte[] Payload;

        /// <summary>The payload was read from disk.</summary>
        internal bool IsRestored;
        internal Box Box;

        /// <summary>What the renderer has made of it.</summary>
        internal object Prepared;
        internal GroundMesh Ground;
        internal long GpuBytes;
        internal TerraportException Error;
    }

    /// <summary>Decodes segments on threads; without threads one at a time in <see cref="Step"/>.</summary>
    internal sealed class DecodeQueue : IDisposable
    {
        private const int JoinMs = 1000;

        // Decoded segments that wait: bounds the memory where uploads are slower.
        private const int MaxResults = 16;

        private readonly IGroundRenderer renderer;
        private readonly int vertexBytes;
        private readonly Thread[] threads;
        private readonly SegmentDecoder inlineDecoder = new SegmentDecoder();
        private readonly SegmentMesh inlineMesh = new SegmentMesh();
        // Also the lock of both queues.
        private readonly Queue<DecodeJob> jobs = new Queue<DecodeJob>();
        private readonly Queue<DecodeJob> results = new Queue<DecodeJob>();
        private bool isDisposed;

        /// <param name="renderer">Makes meshes ready to be uploaded.</param>
        /// <param name="threadCount">0 for none.</param>
        /// <param name="vertexBytes">What a vertex takes on the graphics card.</param>
        internal DecodeQueue(IGroundRenderer renderer, int threadCount, int vertexBytes)
        {
            this.renderer = renderer;
            this.vertexBytes = vertexBytes;
            threads = new Thread[threadCount];
            for (int at = 0; at < threadCount; at++)
            {
                // Below normal: on a device with few cores, the threads that draw and play sound go first.
                threads[at] =
                    new Thread(Work) { Name = "terraport decode " + at, IsBackground = true, Priority = ThreadPriority.BelowNormal };
                threads[at].Start();
            }
        }

        internal void Enqueue(ulong key, byte[] payload, bool isRestored = false)
        {
            lock (jobs)
            {
                jobs.Enqueue(new DecodeJob { Key = key, Payload = payload, IsRestored = isRestored });
                if (threads.Length > 0) Monitor.Pulse(jobs);
            }
        }

        internal bool TryTake(out DecodeJob result)
        {
            lock (jobs)
            {
                result = results.Count > 0 ? results.Dequeue() : null;
                if (result != null && threads.Length > 0) Monitor.Pulse(jobs);
                return result != null;
            }
        }

        /// <summary>Without threads: decode one segment; false where there is nothing to do.</summary>
        internal bool Step()
        {
            if (threads.Length > 0 || jobs.Count == 0) return false;
            DecodeJob job = jobs.Dequeue();
            Decode(job, inlineDecoder, inlineMesh);
            results.Enqueue(job);
            return true;
        }

        /// <summary>End the threads; waits for a decode under way, a second at most.</summary>
        public void Dispose()
        {
            lock (jobs)
            {
                isDisposed = true;
                Monitor.PulseAll(jobs);
            }
            foreach (Thread thread in threads) thread.Join(JoinMs);
        }

        private void Work()
        {
            var decoder = new SegmentDecoder();
            var mesh = new SegmentMesh();
            for (;;)
            {
                DecodeJob job;
                lock (jobs)
                {
                    while ((jobs.Count == 0 || results.Count >= MaxResults) && !isDisposed) Monitor.Wait(jobs);
                    if (isDisposed) return;
                    job = jobs.Dequeue();
                }
                Decode(job, decoder, mesh);
                lock (jobs) results.Enqueue(job);
            }
        }

        private void Decode(DecodeJob job, SegmentDecoder decoder, SegmentMesh mesh)
        {
            try
            {
                // With any attributes: nothing here reads their values, and the scene may have changed meanwhile.
                decoder.Decode(new ArraySegment<byte>(job.Payload), SegmentMesh.MaxAttributes, mesh);
                int faceBytes = mesh.VertexCount < 65535 ? 6 : 12;
                job.Box = mesh.Bounds;
                job.GpuBytes = (long)vertexBytes * mesh.VertexCount + (long)faceBytes * mesh.FaceCount + mesh.ImageGpuBytes;
                job.Ground = new GroundMesh(mesh);
                job.Prepared = renderer.Prepare(mesh);
            }
            catch (TerraportException error)
            {
                job.Error = error;
            }
            catch (OutOfMemoryException error)
            {
                job.Error = new TerraportException("memory", "segment of " + job.Payload.Length + " bytes: " + error.Message, null, error);
            }
        }
    }
}
