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
    /// Memory is bounded by what has really come: no more is taken for a part than four times its bytes, whatever length the
    /// plan declares, and a new plan forgets the parts that it does not load.
    /// </remarks>
    public sealed class Assembler
    {
        private const int Ahead = 4;

        private readonly PayloadPool pool;
        private readonly Dictionary<uint, Part> parts = new Dictionary<uint, Part>();
        private readonly List<uint> unwanted = new List<uint>();

        /// <summary>Make one whose payloads come from this pool.</summary>
        public Assembler(PayloadPool pool) { this.pool = pool; }

        /// <summary>Segments that are partly here.</summary>
        public int Count => parts.Count;

        /// <summary>Bytes of one segment that are here already.</summary>
        public int Received(uint segment)
        {
            Part part;
            return parts.TryGetValue(segment, out part) ? part.Received : 0;
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
            Part part;
            parts.TryGetValue(frame.Segment, out part);
            if (frame.Offset != part.Received)
            {
                throw new ProtocolViolationException(
                    "segment " + frame.Segment + " continues at byte " + frame.Offset + ", expected " + part.Received);
            }
            int end = part.Received + frame.Chunk.Count;
            PayloadBuffer buffer = Grown(part, end, length);
            Buffer.BlockCopy(frame.Chunk.Array, frame.Chunk.Offset, buffer.Data, part.Received, frame.Chunk.Count);
            if (frame.IsLast)
            {
                parts.Remove(frame.Segment);
                buffer.SetLength(length);
                return buffer;
            }
            parts[frame.Segment] = new Part { Buffer = buffer, Received = end };
            return null;
        }

        /// <summary>Forget every part of a segment that is not among these.</summary>
        public void KeepOnly(Dictionary<uint, SegmentFacts> segments)
        {
            unwanted.Clear();
            foreach (uint segment in parts.Keys)
            {
                if (!segments.ContainsKey(segment)) unwanted.Add(segment);
            }
            foreach (uint segment in unwanted)
            {
                parts[segment].Buffer.Release();
                parts.Remove(segment);
            }
        }

        /// <summary>Forget everything: the connection is gone.</summary>
        public void Clear()
        {
            foreach (Part part in parts.Values) part.Buffer.Release();
            parts.Clear();
        }

        /// <summary>A buffer with room up to <paramref name="end"/> that holds what has come.</summary>
        private PayloadBuffer Grown(Part part, int end, int length)
        {
            if (part.Buffer != null && part.Buffer.Data.Length >= end) return part.Buffer;
            PayloadBuffer larger = pool.Rent((int)Math.Min(length, (long)Ahead * end));
            if (part.Buffer == null) return larger;
            Buffer.BlockCopy(part.Buffer.Data, 0, larger.Data, 0, part.Received);
            part.Buffer.Release();
            return larger;
        }

        private struct Part
        {
            internal PayloadBuffer Buffer;
            internal int Received;
        }
    }
}
