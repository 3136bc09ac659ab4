using System;

namespace Terraport
{
    /// <summary>
    /// Buffers that grow and never shrink: a quarter of room more than asked for, so that the next larger payload often
    /// fits.
    /// </summary>
    internal static class Grow
    {
        /// <summary>
        /// At least that many entries; what the array held is lost where it grows. Callers have checked the length.
        /// </summary>
        internal static T[] To<T>(T[] array, int length)
        {
            if (array != null && array.Length >= length)
            {
                return array;
            }
            // In 64 bits: a quarter more than a large length would overflow an int.
            return new T[(int)Math.Min(length + length / 4L, int.MaxValue / 8)];
        }
    }
}
