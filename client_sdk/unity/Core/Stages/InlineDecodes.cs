using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>Decodes on the calling thread, a segment a step: for platforms without threads (WebGL).</summary>
    public sealed class InlineDecodes : IDecodeQueue
    {
        private readonly SegmentDecoder decoder = new SegmentDecoder();
        private readonly Action<SegmentMesh> afterDecode;
        private readonly MeshPool pool = new MeshPool();
        private readonly Queue<DecodeJob> jobs = new Queue<DecodeJob>();
        private readonly Queue<DecodeResult> results = new Queue<DecodeResult>();

        /// <summary>An empty queue.</summary>
        /// <param name="afterDecode">Run after each decode, before the mesh is handed out; may be null.</param>
        public InlineDecodes(Action<SegmentMesh> afterDecode = null) { this.afterDecode = afterDecode; }

        /// <inheritdoc/>
        public void Enqueue(uint segment, int epoch, IReadOnlyList<AttributeInfo> attributes, PinnedPayload payload)
        {
            jobs.Enqueue(new DecodeJob { Segment = segment, Epoch = epoch, Attributes = attributes, Payload = payload });
        }

        /// <inheritdoc/>
        public bool TryTake(out DecodeResult result)
        {
            // A result always has a mesh or an error: the default has neither.
            result = results.Count > 0 ? results.Dequeue() : default(DecodeResult);
            return result.Mesh != null || result.Error != null;
        }

        /// <inheritdoc/>
        public bool Step()
        {
            if (jobs.Count == 0)
            {
                return false;
            }
            results.Enqueue(jobs.Dequeue().Run(decoder, pool, afterDecode));
            return true;
        }

        /// <inheritdoc/>
        public void Recycle(SegmentMesh mesh) { pool.Return(mesh); }

        /// <summary>Let go of every payload that was not decoded.</summary>
        public void Dispose()
        {
            while (jobs.Count > 0)
            {
                jobs.Dequeue().Payload.Dispose();
            }
            results.Clear();
        }
    }
}
