using System;

namespace Terraport
{
    /// <summary>CRC-32 of gzip and PNG (ISO 3309, RFC 1952 section 8), four bytes at a time.</summary>
    internal static class Crc32
    {
        private const uint Polynomial = 0xEDB88320;
        // Entry 256 k + b: byte b with k bytes of zeros behind it.
        private static readonly uint[] Table = MakeTable();

        internal static uint Of(ArraySegment<byte> data)
        {
            uint[] table = Table;
            byte[] bytes = data.Array;
            uint crc = uint.MaxValue;
            int at = data.Offset, end = data.Offset + data.Count;
            for (; at <= end - 4; at += 4)
            {
                crc ^= Wire.LittleEndian.ReadU32(bytes, at);
                crc = table[768 + (crc & 255)] ^ table[512 + (crc >> 8 & 255)] ^ table[256 + (crc >> 16 & 255)] ^ table[crc >> 24];
            }
            for (; at < end; at++) crc = table[(crc ^ bytes[at]) & 255] ^ crc >> 8;
            return ~crc;
        }

        private static uint[] MakeTable()
        {
            var table = new uint[1024];
            for (uint entry = 0; entry < table.Length; entry++)
            {
                uint crc = entry < 256 ? entry : table[entry - 256];
                for (int bit = 0; entry < 256 && bit < 8; bit++) crc = (crc & 1) == 0 ? crc >> 1 : crc >> 1 ^ Polynomial;
                table[entry] = entry < 256 ? crc : table[crc & 255] ^ crc >> 8;
            }
            return table;
        }
    }
}
