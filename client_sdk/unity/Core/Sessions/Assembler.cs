using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>
    /// Chunks to payloads. A segment comes in chunks, in order, without gap or overlap (wire protocol, section 4). A newer
    /// landing may carry on where an older one stopped; what it does not need is forgotten by both sides (6.5, rule 3).
    /// </summary>
    /// <remarks>
    /// Memory is bounded by what has really come: no more is taken for a partial payload than four times its bytes, whatever length the
    /// plan declares, and a new plan forgets those that it does not load.
    /// </remarks>
    public sealed class Assembler
    {
        // Four: growing copies a payload a few times at most, and what a lying plan can reserve stays small.
        private const int GrowthFactor = 4;

        private readonly PayloadPool pool;
        private readonly Dictionary<uint, PartialPayload> partials = new Dictionary<uint, PartialPayload>();
        private readonly List<uint> unwanted = new List<uint>();

        /// <summary>An assembler whose payloads come from this pool; they go back to it when their last user releases them.</summary>
        public Assembler(PayloadPool pool) { this.pool = pool; }

        /// <summary>Segments of which some chunks have come, and not all.</summary>
        public int Count => partials.Count;

        /// <summary>Bytes of one segment that are here already.</summary>
        public int Received(uint segment)
        {
            PartialPayload partial;
            return partials.TryGetValue(segment, out partial) ? partial.Received : 0;
        }

        /// <summary>Take one chunk, which is copied; the payload when this was its last one, else null.</summary>
        /// <param name="frame">The chunk.</param>
        /// <param name="length">The payload's length by the load table.</param>
        /// <returns>The payload, which the caller owns; null where more of it is to come.</returns>
        /// <exception cref="ProtocolViolationException">A gap, an overlap, or a total that is not the plan's.</exception>
        public PayloadBuffer Take(PayloadFrame frame, int length)
        {
            if (frame.Total != length)
            {
                throw new ProtocolViolationException(
                    "segment " + frame.Segment + " announces " + frame.Total + " bytes, expected " + length + " by the plan");
            }
            PartialPayload partial;
            partials.TryGetValue(frame.Segment, out partial);
            // A segment that is not in the table has received 0 bytes: its first chunk must be at 0.
            if (frame.Offset != partial.Received)
            {
                throw new ProtocolViolationException(
                    "segment " + frame.Segment + " continues at byte " + frame.Offset + ", expected " + partial.Received);
            }
            int end = partial.Received + frame.Chunk.Count;
            PayloadBuffer buffer = EnsureRoom(partial, end, length);
            Buffer.BlockCopy(frame.Chunk.Array, frame.Chunk.Offset, buffer.Data, partial.Received, frame.Chunk.Count);
            if (frame.IsLast)
            {
                // Ownership passes to the caller; SetLength, since the buffer was rented before the length was reached.
                partials.Remove(frame.Segment);
                buffer.SetLength(length);
                return buffer;
            }
            partials[frame.Segment] = new PartialPayload { Buffer = buffer, Received = end };
            return null;
        }

        /// <summary>Forget the partial payloads of all segments but these; their buffers go back to the pool.</summary>
        public void KeepOnly(Dictionary<uint, SegmentFacts> segments)
        {
            unwanted.Clear();
            foreach (uint segment in partials.Keys)
            {
                // Collected first: a dictionary must not change while it is enumerated.
                if (!segments.ContainsKey(segment)) unwanted.Add(segment);
            }
            foreach (uint segment in unwanted)
            {
                partials[segment].Buffer.Release();
                partials.Remove(segment);
            }
        }

        /// <summary>Forget everything: the connection is gone.</summary>
        public void Clear()
        {
            foreach (PartialPayload partial in partials.Values) partial.Buffer.Release();
            partials.Clear();
        }

        /// <summary>A buffer with room up to <paramref name="end"/> that holds what has come.</summary>
        private PayloadBuffer EnsureRoom(PartialPayload partial, int end, int length)
        {
            if (partial.Buffer != null && partial.Buffer.Data.Length >= end) return partial.Buffer;
            PayloadBuffer larger = pool.Rent((int)Math.Min(length, (long)GrowthFactor * end));
            if (partial.Buffer == null) return larger;
            Buffer.BlockCopy(partial.Buffer.Data, 0, larger.Data, 0, partial.Received);
            partial.Buffer.Release();
            return larger;
        }

        /// <summary>A payload of which the first Received bytes are in Buffer, which the assembler owns.</summary>
        private struct PartialPayload
        {
            internal PayloadBuffer Buffer;
            internal int Received;
        }
    }
}
