using System;

namespace Terraport.Wire
{
    /// <summary>A piece of one segment's payload, as one WebSocket message carries it (protocol, section 3).</summary>
    internal struct Frame
    {
        internal const int MaxBytes = 128 * 1024, MaxSegmentBytes = 64 * 1024 * 1024;
        private const int HeaderBytes = 24, MaxHeaderBytes = 1024;
        private const byte PayloadKind = 1;

        internal uint Generation;
        internal ulong Key;
        internal int Offset;

        /// <summary>Bytes of the whole payload.</summary>
        internal int Total;

        /// <summary>A view of the received message.</summary>
        internal ArraySegment<byte> Data;

        /// <summary>Whether a WebSocket message is a frame; else it is a message.</summary>
        internal static bool IsFrame(ArraySegment<byte> message) { return message.Count > 0 && message.Array[message.Offset] < 0x80; }

        /// <summary>Read a frame; false for a kind that is to be skipped.</summary>
        /// <exception cref="WireException">It is cut off or contradicts itself.</exception>
        internal static bool TryRead(ArraySegment<byte> message, out Frame frame)
        {
            byte[] bytes = message.Array;
            int start = message.Offset, size = message.Count;
            frame = default;
            if (size == 0 || size > MaxBytes || bytes[start] == 0 || bytes[start] >= 0x80)
                throw new WireException("got " + size + " bytes, expected a frame");
            if (bytes[start] != PayloadKind) return false;
            if (size < HeaderBytes) throw new WireException("got a frame of " + size + " bytes, expected a header of " + HeaderBytes);
            int header = LittleEndian.ReadU16(bytes, start + 2);
            long offset = LittleEndian.ReadU32(bytes, start + 16), total = LittleEndian.ReadU32(bytes, start + 20);
            if (header < HeaderBytes || header > MaxHeaderBytes || size <= header || total > MaxSegmentBytes
                || size - header > total - offset)
            {
                string text = "got " + (size - header) + " bytes at " + offset + " of " + total + ", header " + header;
                throw new WireException(text + ", expected a part of a segment");
            }
            frame = new Frame {
                Generation = LittleEndian.ReadU32(bytes, start + 4),
                Key = LittleEndian.ReadU64(bytes, start + 8),
                Offset = (int)offset,
                Total = (int)total,
                Data = new ArraySegment<byte>(bytes, start + header, size - header),
            };
            return true;
        }
    }
}
