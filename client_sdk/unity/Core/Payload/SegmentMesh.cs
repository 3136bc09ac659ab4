using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// A decoded segment, base or overview. Made to be used again: arrays may be longer than the counts say, and count only where a flag
    /// says so.
    /// </summary>
    internal sealed class SegmentMesh
    {
        internal const ushort NoRegion = 65535, NoValue = 65535;
        internal const int MaxAttributes = 32;

        internal int VertexCount, FaceCount;

        /// <summary>A vertex is at Step x (Origin + code), metres, scene frame: exact in float32.</summary>
        internal Vec3 Origin;
        internal double StepM;

        /// <summary>Three planes, one behind the other: VertexCount codes of x, then of y, then of z.</summary>
        internal int[] PositionCodes = Array.Empty<int>();

        /// <summary>Three for each vertex, 127 is 1.</summary>
        internal sbyte[] Normals = Array.Empty<sbyte>();

        /// <summary>Three for each vertex, sRGB; only where <see cref="HasColours"/>.</summary>
        internal byte[] Colours = Array.Empty<byte>();
        internal bool HasColours;

        /// <summary>Two for each vertex, half pixels from the image's upper left; only where <see cref="HasImage"/>.</summary>
        internal ushort[] UvCodes = Array.Empty<ushort>();
        internal bool HasImage;
        internal ImageHeader Image;

        /// <summary>The image's file, a part of the payload that was decoded.</summary>
        internal ArraySegment<byte> ImageFile;

        /// <summary>Region of each vertex; only where <see cref="HasRegions"/>.</summary>
        internal ushort[] Regions = Array.Empty<ushort>();
        internal bool HasRegions;

        /// <summary>Codes of the attributes by their position in the scene's list; null for those that the segment lacks.</summary>
        internal readonly ushort[][] Attributes = new ushort[MaxAttributes][];

        /// <summary>Three for each face, counter-clockwise seen from outside.</summary>
        internal uint[] Indices = Array.Empty<uint>();

        /// <summary>Box of the positions, metres, scene frame.</summary>
        internal Box Bounds;

        /// <summary>The position of a vertex in float32 metres.</summary>
        internal void PositionAt(int vertex, out float x, out float y, out float z)
        {
            x = (float)(StepM * (Origin.X + PositionCodes[vertex]));
            y = (float)(StepM * (Origin.Y + PositionCodes[vertex + VertexCount]));
            z = (float)(StepM * (Origin.Z + PositionCodes[vertex + 2 * VertexCount]));
        }

        /// <summary>Bytes of the image on a graphics card, with all mips (protocol, section 4).</summary>
        internal long ImageGpuBytes
        {
            get {
                long bits = 0;
                for (long w = Image.Width, h = Image.Height; HasImage; w = Math.Max(w / 2, 1), h = Math.Max(h / 2, 1))
                {
                    // Compressed formats have blocks of 4 x 4 texels, also in small mips.
                    bits += Image.TexelBits == 32 ? w * h * 32 : (w + 3) / 4 * ((h + 3) / 4) * 16 * Image.TexelBits;
                    if (w == 1 && h == 1) break;
                }
                return bits / 8;
            }
        }
    }
}
