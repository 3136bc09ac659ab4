namespace Terraport.Tests
{
    /// <summary>The same noise everywhere: a linear congruential generator, so that digests can be written down.</summary>
    internal sealed class Noise
    {
        private uint state;

        internal Noise(uint seed) { state = seed; }

        internal static byte[] Bytes(int count)
        {
            var noise = new Noise(1);
            var bytes = new byte[count];
            for (int at = 0; at < count; at++)
            {
                bytes[at] = (byte)(noise.Next() >> 24);
            }
            return bytes;
        }

        internal uint Next()
        {
            unchecked
            {
                state = state * 1664525 + 1013904223;
                return state;
            }
        }

        /// <summary>A number below <paramref name="bound"/>, from the better bits.</summary>
        internal int Below(int bound) { return (int)((Next() >> 8) % (uint)bound); }
    }
}
