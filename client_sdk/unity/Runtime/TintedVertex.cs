using System.Runtime.InteropServices;

namespace Terraport.Unity
{
    /// <summary>A vertex with a colour, as it lies on the GPU: 24 bytes, in Unity's axes.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct TintedVertex
    {
        /// <summary>East, metres about the scene's origin.</summary>
        public float X;

        /// <summary>Up, metres.</summary>
        public float Y;

        /// <summary>North, metres.</summary>
        public float Z;

        /// <summary>Normal's X, 127 is 1.</summary>
        public sbyte NormalX;

        /// <summary>Normal's Y.</summary>
        public sbyte NormalY;

        /// <summary>Normal's Z.</summary>
        public sbyte NormalZ;

        /// <summary>Fills up to four bytes.</summary>
        public sbyte Padding;

        /// <summary>Red, linear light, 65535 is 1.</summary>
        public ushort Red;

        /// <summary>Green, linear light.</summary>
        public ushort Green;

        /// <summary>Blue, linear light.</summary>
        public ushort Blue;

        /// <summary>Always 65535: opaque.</summary>
        public ushort Alpha;
    }
}
