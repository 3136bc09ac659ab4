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

        internal static float ReadF32(byte[] data, int at) { return new FloatBits { Bits = ReadU32(data, at) }.Number; }

        internal static void WriteU16(byte[] data, int at, ushort value)
        {
            data[at] = (byte)value;
            data[at + 1] = (byte)(value >> 8);
        }

        internal static void WriteU32(byte[] data, int at, uint value)
        {
            WriteU16(data, at, (ushort)value);
            WriteU16(data, at + 2, (ushort)(value >> 16));
        }

        internal static void WriteU64(byte[] data, int at, ulong value)
        {
            WriteU32(data, at, (uint)value);
            WriteU32(data, at + 4, (uint)(value >> 32));
        }

        internal static void WriteF32(byte[] data, int at, float value) { WriteU32(data, at, new FloatBits { Number = value }.Bits); }

        /// <summary>A float32 and its bits, in the same four bytes.</summary>
        [StructLayout(LayoutKind.Explicit)]
        // A union: BitConverter.Int32BitsToSingle is missing in .NET Framework profiles.
        internal struct FloatBits
        {
            [FieldOffset(0)]
            internal float Number;

            [FieldOffset(0)]
            internal uint Bits;
        }
    }
}
