using System.Runtime.InteropServices;

namespace Terraport.Unity
{
    /// <summary>A vertex with a colour, as it lies on the GPU: 24 bytes, in Unity's axes.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct TintedVertex
    {
        /// <summary>Metres, Unity's axes, about the scene's origin; so are Y and Z.</summary>
        public float X, Y, Z;

        /// <summary>Normal, 127 is 1; the fourth fills up to four bytes.</summary>
        public sbyte NormalX, NormalY, NormalZ, Padding;

        /// <summary>Linear light, 65535 is 1.</summary>
        public ushort Red, Green, Blue, Alpha;
    }
}
