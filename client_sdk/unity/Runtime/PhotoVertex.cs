using System.Runtime.InteropServices;

namespace Terraport.Unity
{
    /// <summary>A vertex with a place in a photograph, as it lies on the GPU: 24 bytes, in Unity's axes.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct PhotoVertex
    {
        /// <summary>Metres, Unity's axes, about the scene's origin; so are Y and Z.</summary>
        public float X, Y, Z;

        /// <summary>Normal, 127 is 1; the fourth fills up to four bytes.</summary>
        public sbyte NormalX, NormalY, NormalZ, Padding;

        /// <summary>Texture coordinate, (0, 0) the image's lower left corner.</summary>
        public float U, V;
    }
}
