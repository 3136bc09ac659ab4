using System;
using System.Runtime.InteropServices;

namespace Terraport.Unity
{
    /// <summary>A vertex on the graphics card: 24 bytes, Unity's axes.</summary>
    [StructLayout(LayoutKind.Explicit)]
    internal struct GroundVertex
    {
        internal const int Bytes = 24;

        /// <summary>Metres about the scene's origin.</summary>
        [FieldOffset(0)]
        internal float X;
        [FieldOffset(4)]
        internal float Y;
        [FieldOffset(8)]
        internal float Z;

        /// <summary>127 is 1.</summary>
        [FieldOffset(12)]
        internal sbyte NormalX;
        [FieldOffset(13)]
        internal sbyte NormalY;
        [FieldOffset(14)]
        internal sbyte NormalZ;

        /// <summary>With an image: its coordinates from the lower left.</summary>
        [FieldOffset(16)]
        internal float U;
        [FieldOffset(20)]
        internal float V;

        /// <summary>Without: linear light, 65535 is 1.</summary>
        [FieldOffset(16)]
        internal ushort Red;
        [FieldOffset(18)]
        internal ushort Green;
        [FieldOffset(20)]
        internal ushort Blue;
        [FieldOffset(22)]
        internal ushort Alpha;
    }

    /// <summary>
    /// A decoded mesh as the graphics card wants it, made on a decoding thread so that the main thread only copies. Buffers grow and are used
    /// again. No engine: the tests run it without Unity.
    /// </summary>
    /// <remarks>
    /// Positions are floats about the scene's origin, and everything is drawn with one matrix: equal border vertices stay equal to the last
    /// bit, and no crack opens. It costs four bytes a vertex (docs/decisions/engine-rendering.md).
    /// </remarks>
    internal sealed class PackedMesh
    {
        /// <summary>Linear light of ground that has neither colour nor image: the viewer's grey.</summary>
        private const ushort PlainRed = 17254, PlainGreen = 17254, PlainBlue = 15916;

        /// <summary>From 65535 on an index would restart a strip on some cards.</summary>
        private const int MaxShortVertices = 65535;

        private static readonly ushort[] Linear = MakeLinear();

        internal bool HasImage;
        internal int VertexCount, IndexCount;

        /// <summary>May be longer than the counts.</summary>
        internal GroundVertex[] Vertices = Array.Empty<GroundVertex>();

        /// <summary>Clockwise seen from outside; those of 16 bits count where <see cref="HasShortIndices"/>.</summary>
        internal ushort[] ShortIndices = Array.Empty<ushort>();
        internal uint[] LongIndices = Array.Empty<uint>();

        /// <summary>Unity's axes.</summary>
        internal Box Bounds;

        /// <summary>A copy of the image's file; null without one.</summary>
        internal byte[] ImageFile;
        internal ImageHeader Image;

        internal bool HasShortIndices => VertexCount <= MaxShortVertices;

        /// <summary>Pack a whole mesh; vertices keep their numbers.</summary>
        internal void Pack(SegmentMesh mesh)
        {
            Begin(mesh, mesh.VertexCount, 3 * mesh.FaceCount);
            for (int vertex = 0; vertex < VertexCount; vertex++) Write(mesh, vertex, ref Vertices[vertex]);
            for (int face = 0; face < IndexCount; face += 3)
            {
                for (int corner = 0; corner < 3; corner++) SetIndex(face + corner, mesh.Indices[face + Axes.TurnCorner(corner)]);
            }
            Box box = mesh.Bounds;
            Bounds = new Box(box.MinX, box.MinY, Axes.TurnZ(box.MaxZ), box.MaxX, box.MaxY, Axes.TurnZ(box.MinZ));
            ImageFile = null;
            if (!mesh.HasImage) return;
            // Exactly as long as the file: Unity's reader takes whole arrays. The one piece of garbage of an upload.
            ImageFile = new byte[mesh.ImageFile.Count];
            Buffer.BlockCopy(mesh.ImageFile.Array, mesh.ImageFile.Offset, ImageFile, 0, ImageFile.Length);
            Image = mesh.Image;
        }

        /// <summary>Pack some faces of a mesh, with the vertices that they use, numbered in the order of first use.</summary>
        /// <param name="mesh">The whole mesh.</param>
        /// <param name="faces">Faces of the mesh.</param>
        /// <param name="first">The first that counts.</param>
        /// <param name="count">How many count: at most 21845, so that indices fit into 16 bits.</param>
        /// <param name="numbers">An entry for each vertex of the mesh, all -1; left so.</param>
        internal void PackFaces(SegmentMesh mesh, int[] faces, int first, int count, int[] numbers)
        {
            int vertices = 0;
            for (int at = 3 * first; at < 3 * (first + count); at++)
            {
                uint vertex = mesh.Indices[3 * faces[at / 3] + at % 3];
                if (numbers[vertex] < 0) numbers[vertex] = vertices++;
            }
            Begin(mesh, vertices, 3 * count);
            float minX = float.PositiveInfinity, minY = minX, minZ = minX, maxX = float.NegativeInfinity, maxY = maxX, maxZ = maxX;
            for (int to = 0; to < IndexCount; to++)
            {
                uint vertex = mesh.Indices[3 * faces[first + to / 3] + Axes.TurnCorner(to % 3)];
                int number = numbers[vertex];
                SetIndex(to, (uint)number);
                Write(mesh, (int)vertex, ref Vertices[number]);
                GroundVertex written = Vertices[number];
                minX = Math.Min(minX, written.X);
                minY = Math.Min(minY, written.Y);
                minZ = Math.Min(minZ, written.Z);
                maxX = Math.Max(maxX, written.X);
                maxY = Math.Max(maxY, written.Y);
                maxZ = Math.Max(maxZ, written.Z);
            }
            Bounds = new Box(minX, minY, minZ, maxX, maxY, maxZ);
            for (int at = 3 * first; at < 3 * (first + count); at++) numbers[mesh.Indices[3 * faces[at / 3] + at % 3]] = -1;
        }

        /// <summary>Let the vertices go, once they are on the graphics card.</summary>
        internal void DropVertices() { Vertices = Array.Empty<GroundVertex>(); }

        private void Begin(SegmentMesh mesh, int vertexCount, int indexCount)
        {
            HasImage = mesh.HasImage;
            VertexCount = vertexCount;
            IndexCount = indexCount;
            Vertices = WithRoom(Vertices, vertexCount);
            if (HasShortIndices)
                ShortIndices = WithRoom(ShortIndices, indexCount);
            else
                LongIndices = WithRoom(LongIndices, indexCount);
        }

        private void SetIndex(int at, uint vertex)
        {
            if (HasShortIndices)
                ShortIndices[at] = (ushort)vertex;
            else
                LongIndices[at] = vertex;
        }

        private void Write(SegmentMesh mesh, int from, ref GroundVertex vertex)
        {
            mesh.PositionAt(from, out vertex.X, out vertex.Y, out float z);
            vertex.Z = Axes.TurnZ(z);
            vertex.NormalX = mesh.Normals[3 * from];
            vertex.NormalY = mesh.Normals[3 * from + 1];
            vertex.NormalZ = (sbyte)-mesh.Normals[3 * from + 2];
            if (HasImage)
            {
                vertex.U = mesh.UvCodes[2 * from] * 0.5f / mesh.Image.Width;
                vertex.V = Axes.TurnV(mesh.UvCodes[2 * from + 1] * 0.5f / mesh.Image.Height);
                return;
            }
            vertex.Alpha = ushort.MaxValue;
            vertex.Red = mesh.HasColours ? Linear[mesh.Colours[3 * from]] : PlainRed;
            vertex.Green = mesh.HasColours ? Linear[mesh.Colours[3 * from + 1]] : PlainGreen;
            vertex.Blue = mesh.HasColours ? Linear[mesh.Colours[3 * from + 2]] : PlainBlue;
        }

        private static T[] WithRoom<T>(T[] buffer, int count) { return buffer.Length >= count ? buffer : new T[count + count / 4]; }

        /// <summary>Linear light by sRGB level (IEC 61966-2-1).</summary>
        private static ushort[] MakeLinear()
        {
            var codes = new ushort[256];
            for (int level = 0; level < codes.Length; level++)
            {
                double value = level / 255.0, light = value <= 0.04045 ? value / 12.92 : Math.Pow((value + 0.055) / 1.055, 2.4);
                codes[level] = (ushort)Math.Round(light * 65535);
            }
            return codes;
        }
    }
}
