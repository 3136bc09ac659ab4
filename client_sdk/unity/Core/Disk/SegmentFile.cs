using System;
using Terraport.Wire;

namespace Terraport.Disk
{
    /// <summary>The head of a segment on disk, before its payload: magic, row of the load table, hash of the row. As the Python SDK's.</summary>
    internal static class SegmentFile
    {
        internal const int HeadBytes = 64;

        private const int RowAt = 8;
        private const int RowBytes = 48;
        private static readonly byte[] Magic = { (byte)'T', (byte)'P', (byte)'S', (byte)'D', (byte)'K', (byte)'S', (byte)'G', (byte)'1' };

        internal static byte[] Head(SegmentFacts facts)
        {
            var head = new byte[HeadBytes];
            Magic.CopyTo(head, 0);
            LittleEndian.WriteU32(head, 8, facts.Segment);
            LittleEndian.WriteU32(head, 12, (uint)facts.Length);
            LittleEndian.WriteU64(head, 16, facts.Xxh3);
            LittleEndian.WriteU32(head, 24, facts.Faces);
            LittleEndian.WriteU32(head, 28, facts.Vertices);
            Box box = facts.Bounds;
            float[] bounds = { box.MinX, box.MinY, box.MinZ, box.MaxX, box.MaxY, box.MaxZ };
            for (int at = 0; at < bounds.Length; at++) LittleEndian.WriteF32(head, 32 + 4 * at, bounds[at]);
            LittleEndian.WriteU64(head, RowAt + RowBytes, Xxh3.Hash64(head, RowAt, RowBytes));
            return head;
        }

        /// <summary>What a head says; false where it is none, or not of a file of this length.</summary>
        internal static bool TryRead(byte[] head, long fileBytes, out SegmentFacts facts)
        {
            facts = default(SegmentFacts);
            for (int at = 0; at < Magic.Length; at++)
            {
                if (head[at] != Magic[at]) return false;
            }
            if (Xxh3.Hash64(head, RowAt, RowBytes) != LittleEndian.ReadU64(head, RowAt + RowBytes)) return false;
            uint length = LittleEndian.ReadU32(head, 12);
            if (length == 0 || length > WireLimits.MaxSegmentBytes || length != fileBytes - HeadBytes) return false;
            var bounds = new float[6];
            for (int at = 0; at < bounds.Length; at++) bounds[at] = LittleEndian.ReadF32(head, 32 + 4 * at);
            facts =
                new SegmentFacts(LittleEndian.ReadU32(head, 8), (int)length, LittleEndian.ReadU64(head, 16), LittleEndian.ReadU32(head, 24),
                    LittleEndian.ReadU32(head, 28), new Box(bounds[0], bounds[1], bounds[2], bounds[3], bounds[4], bounds[5]));
            return true;
        }

        /// <summary>Name of a segment's file.</summary>
        internal static string NameOf(uint segment, ulong xxh3) { return segment + "-" + xxh3.ToString("x16") + Ending; }

        /// <summary>Segment of a file's name; false where it is no segment's.</summary>
        internal static bool TryParse(string name, out uint segment)
        {
            int dash = name.IndexOf('-');
            segment = 0;
            return dash > 0 && name.Length == dash + 17 + Ending.Length && name.EndsWith(Ending, StringComparison.Ordinal)
                && uint.TryParse(name.Substring(0, dash), out segment);
        }

        private const string Ending = "." + SegmentDecoder.Encoding;
    }
}
