using System.Runtime.InteropServices;

namespace Terraport.Unity
{
    /// <summary>A vertex with a texture coordinate in a photograph, as it lies on the GPU: 24 bytes, in Unity's axes.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct PhotoVertex
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

        /// <summary>Texture coordinate, 0 the image's left edge.</summary>
        public float U;

        /// <summary>Texture coordinate, 0 the image's lower edge.</summary>
        public float V;
    }
}
