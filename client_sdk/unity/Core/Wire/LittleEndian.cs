using System.Runtime.InteropServices;

namespace Terraport.Wire
{
    /// <summary>Little-endian numbers in byte arrays, on machines of either order. Callers have checked the length.</summary>
    internal static class LittleEndian
    {
        internal static ushort ReadU16(byte[] data, int at) { return (ushort)(data[at] | data[at + 1] << 8); }

        internal static uint ReadU32(byte[] data, int at)
        {
            return data[at] | (uint)data[at + 1] << 8 | (uint)data[at + 2] << 16 | (uint)data[at + 3] << 24;
        }

        internal static ulong ReadU64(byte[] data, int at) { return ReadU32(data, at) | (ulong)ReadU32(data, at + 4) << 32; }
    }
}
