using System;
using Terraport.Sessions;

namespace Terraport
{
    /// <summary>
    /// The bytes of a held segment, safe from reuse until disposed: eviction waits for it. Read the bytes from any thread, do
    /// not change them, and dispose exactly once; a copy of this value is the same pin.
    /// </summary>
    public readonly struct PinnedPayload : IDisposable
    {
        private readonly PayloadBuffer buffer;

        /// <summary>A pin of a buffer that the caller retained: what a stream of another kind hands out.</summary>
        public PinnedPayload(PayloadBuffer buffer, SegmentFacts facts)
        {
            this.buffer = buffer;
            Facts = facts;
        }

        /// <summary>What the scene's index says of the segment.</summary>
        public SegmentFacts Facts { get; }

        /// <summary>The payload; its array is larger and belongs to a pool.</summary>
        public ArraySegment<byte> Bytes =>
            buffer == null ? default(ArraySegment<byte>) : new ArraySegment<byte>(buffer.Data, 0, buffer.Length);

        /// <summary>Let the bytes go. They must not be read any more.</summary>
        public void Dispose()
        {
            if (buffer != null) buffer.Release();
        }
    }
}
