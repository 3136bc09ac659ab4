using System;

namespace Terraport.Wire
{
    /// <summary>One chunk of one segment's payload in one binary WebSocket message (wire protocol, section 4).</summary>
    public readonly struct PayloadFrame
    {
        private const byte KindSegmentChunk = 0x01;
        private const byte FlagLast = 0x01;
        private const byte FirstMessageByte = 0x80;

        /// <summary>A chunk; whether it is the last follows from the numbers. The bytes are viewed, not copied.</summary>
        public PayloadFrame(uint generation, uint segment, int offset, int total, ArraySegment<byte> chunk)
        {
            Generation = generation;
            Segment = segment;
            Offset = offset;
            Total = total;
            Chunk = chunk;
        }

        /// <summary>Generation of the plan or prefetch that it is sent for.</summary>
        public uint Generation { get; }

        /// <summary>Segment id.</summary>
        public uint Segment { get; }

        /// <summary>Where the chunk starts in the payload, bytes.</summary>
        public int Offset { get; }

        /// <summary>Length of the whole payload, bytes.</summary>
        public int Total { get; }

        /// <summary>A view of the received message, not a copy.</summary>
        public ArraySegment<byte> Chunk { get; }

        /// <summary>Whether the chunk ends the segment.</summary>
        public bool IsLast => Offset + Chunk.Count == Total;

        /// <summary>Whether a binary WebSocket message is a payload frame and not a message: a msgpack map starts at 0x80.</summary>
        public static bool IsPayload(ArraySegment<byte> data) { return data.Count > 0 && data.Array[data.Offset] < FirstMessageByte; }

        /// <summary>Read the frame that one binary WebSocket message holds; nothing is allocated.</summary>
        /// <param name="data">The message.</param>
        /// <param name="frame">The frame.</param>
        /// <returns>False for a frame of a kind that this version does not know: skip it. <c>frame.Total</c> then is 0.</returns>
        /// <exception cref="DecodeException">It is cut off, too long, contradicts itself, or is no frame.</exception>
        public static bool TryDecode(ArraySegment<byte> data, out PayloadFrame frame)
        {
            frame = default(PayloadFrame);
            // 1. Size and kind. Kinds of later minor versions are skipped, not refused.
            int size = data.Count;
            if (size > WireLimits.MaxFrameBytes)
            {
                throw new DecodeException("too_large", "got a frame of " + size + " bytes, expected at most " + WireLimits.MaxFrameBytes);
            }
            if (size == 0) throw Malformed("got an empty message, expected a frame", 0);
            byte[] bytes = data.Array;
            int at = data.Offset;
            byte kind = bytes[at];
            if (kind == 0 || kind >= FirstMessageByte)
            {
                throw Malformed("got frame kind 0x" + kind.ToString("x2") + ", expected 0x01 to 0x7f", 0);
            }
            if (kind != KindSegmentChunk) return false;
            // 2. The header states its own length: a later minor version may lengthen it, and the chunk starts behind it.
            if (size < WireLimits.HeaderBytes)
            {
                throw Malformed("got " + size + " bytes, expected a header of " + WireLimits.HeaderBytes, size);
            }
            int header = LittleEndian.ReadU16(bytes, at + 2);
            if (header < WireLimits.HeaderBytes || header > WireLimits.MaxHeaderBytes)
            {
                throw Malformed(
                    "got a header of " + header + ", expected " + WireLimits.HeaderBytes + " to " + WireLimits.MaxHeaderBytes, 2);
            }
            // 3. Lengths, each against the protocol's limit before it is used as an int.
            uint offset = LittleEndian.ReadU32(bytes, at + 12);
            uint total = LittleEndian.ReadU32(bytes, at + 16);
            if (total > WireLimits.MaxSegmentBytes)
            {
                throw new DecodeException(
                    "too_large", "got a segment of " + total + " bytes, expected at most " + WireLimits.MaxSegmentBytes, 16);
            }
            if (size <= header) throw Malformed("got no payload bytes, expected at least one", size);
            int length = size - header;
            // In 64 bits: offset and length together may pass 2^32.
            long end = (long)offset + length;
            if (end > total) throw Malformed("got " + length + " bytes at " + offset + ", expected to end within " + total, 12);
            // 4. The flag says nothing new, but a contradiction shows a broken sender.
            bool isLast = (bytes[at + 1] & FlagLast) != 0;
            if (isLast != (end == total))
            {
                throw Malformed("got last = " + isLast + ", expected " + !isLast + " by offset and total", 1);
            }
            frame = new PayloadFrame(LittleEndian.ReadU32(bytes, at + 4), LittleEndian.ReadU32(bytes, at + 8), (int)offset, (int)total,
                new ArraySegment<byte>(bytes, at + header, length));
            return true;
        }

        /// <summary>Write the frame. A server's part; here so that both directions are tested against one corpus.</summary>
        /// <exception cref="InvalidMessageException">A number is out of range, or the chunk lies outside the segment.</exception>
        public byte[] Encode()
        {
            int length = Chunk.Count;
            Expect("total", Total, 1, WireLimits.MaxSegmentBytes);
            Expect("length", length, 1, WireLimits.MaxChunkBytes);
            Expect("offset", Offset, 0, Total - length);
            var data = new byte[WireLimits.HeaderBytes + length];
            data[0] = KindSegmentChunk;
            data[1] = IsLast ? FlagLast : (byte)0;
            LittleEndian.WriteU16(data, 2, WireLimits.HeaderBytes);
            LittleEndian.WriteU32(data, 4, Generation);
            LittleEndian.WriteU32(data, 8, Segment);
            LittleEndian.WriteU32(data, 12, (uint)Offset);
            LittleEndian.WriteU32(data, 16, (uint)Total);
            Buffer.BlockCopy(Chunk.Array, Chunk.Offset, data, WireLimits.HeaderBytes, length);
            return data;
        }

        private static DecodeException Malformed(string text, int offset) { return new DecodeException("malformed", text, offset); }

        private static void Expect(string field, int value, int low, int high)
        {
            if (value >= low && value <= high) return;
            throw new InvalidMessageException("frame", field, "got " + value + ", expected " + low + " to " + high);
        }
    }
}
