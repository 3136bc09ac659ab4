using Terraport.Wire;

namespace Terraport
{
    /// <summary>CRC-32 as gzip and PNG have it (ISO 3309, RFC 1952 section 8), four bytes at a time.</summary>
    internal static class Crc32
    {
        private const uint Polynomial = 0xEDB88320;
        // Of byte b with k bytes of zeros behind it, at 256 k + b.
        private static readonly uint[] Table = MakeTable();

        /// <summary>The checksum of a part of an array.</summary>
        internal static uint Of(byte[] bytes, int start, int count)
        {
            uint[] table = Table;
            uint crc = uint.MaxValue;
            int at = start;
            for (int end = start + count - 4; at <= end; at += 4)
            {
                crc ^= LittleEndian.ReadU32(bytes, at);
                crc = table[768 + (crc & 255)] ^ table[512 + (crc >> 8 & 255)] ^ table[256 + (crc >> 16 & 255)] ^ table[crc >> 24];
            }
            for (; at < start + count; at++)
            {
                crc = table[(crc ^ bytes[at]) & 255] ^ crc >> 8;
            }
            return ~crc;
        }

        private static uint[] MakeTable()
        {
            var table = new uint[1024];
            for (uint at = 0; at < table.Length; at++)
            {
                // A byte alone, or what one byte of zeros makes of the entry before.
                uint crc = at < 256 ? at : table[at - 256];
                for (int bit = 0; at < 256 && bit < 8; bit++)
                {
                    crc = (crc & 1) == 0 ? crc >> 1 : crc >> 1 ^ Polynomial;
                }
                table[at] = at < 256 ? crc : table[crc & 255] ^ crc >> 8;
            }
            return table;
        }
    }
}
