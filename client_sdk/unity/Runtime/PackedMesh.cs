using System;
using System.Runtime.InteropServices;

namespace Terraport.Unity
{
    /// <summary>
    /// A decoded mesh as the GPU wants it: axes turned, vertices interleaved, winding for Unity. Made on the decoding thread, so
    /// that the main thread only copies. Its buffers grow and are reused with the <see cref="SegmentMesh"/> they belong to:
    /// packing allocates nothing once they are large enough. No engine: compiled and run without Unity by the tests.
    /// </summary>
    /// <remarks>
    /// Positions are written as floats about the scene's origin, and not as the codes they come in: every segment is then drawn
    /// with one and the same matrix, whatever the material, so equal border vertices stay equal to the last bit and no crack opens.
    /// It costs four bytes a vertex (docs/decisions/engine-rendering.md).
    /// </remarks>
    public sealed class PackedMesh
    {
        /// <summary>Linear light of ground that has neither colour nor texture: the viewer's grey, 65535 is 1.</summary>
        private const ushort PlainRed = 17254, PlainGreen = 17254, PlainBlue = 15916;

        /// <summary>Bytes of a vertex on the GPU, of either kind.</summary>
        public static readonly int VertexBytes = Math.Max(Marshal.SizeOf(typeof(TintedVertex)), Marshal.SizeOf(typeof(PhotoVertex)));

        /// <summary>Whether <see cref="Photographed"/> holds the vertices; else <see cref="Tinted"/>.</summary>
        public bool IsPhotographed { get; private set; }

        /// <summary>Vertices that count.</summary>
        public int VertexCount { get; private set; }

        /// <summary>Vertices with colours; may be longer than <see cref="VertexCount"/>.</summary>
        public TintedVertex[] Tinted { get; private set; } = Array.Empty<TintedVertex>();

        /// <summary>Vertices with texture coordinates; may be longer than <see cref="VertexCount"/>.</summary>
        public PhotoVertex[] Photographed { get; private set; } = Array.Empty<PhotoVertex>();

        /// <summary>Indices that count: three per face.</summary>
        public int IndexCount { get; private set; }

        /// <summary>Whether <see cref="ShortIndices"/> holds the indices; else <see cref="LongIndices"/>.</summary>
        public bool HasShortIndices { get; private set; }

        /// <summary>Clockwise seen from outside; may be longer than <see cref="IndexCount"/>.</summary>
        public ushort[] ShortIndices { get; private set; } = Array.Empty<ushort>();

        /// <summary>Clockwise seen from outside; may be longer than <see cref="IndexCount"/>.</summary>
        public uint[] LongIndices { get; private set; } = Array.Empty<uint>();

        /// <summary>Box of the vertices, metres, Unity's axes.</summary>
        public Box Bounds { get; private set; }

        /// <summary>
        /// Pack a mesh into its own <see cref="SegmentMesh.EngineData"/>. This is what runs on the decoding threads.
        /// </summary>
        public static void PackOnto(SegmentMesh mesh)
        {
            PackedMesh packed = mesh.EngineData as PackedMesh;
            if (packed == null)
            {
                packed = new PackedMesh();
                mesh.EngineData = packed;
            }
            packed.Pack(mesh);
        }

        /// <summary>Pack a whole mesh; what was here before is overwritten.</summary>
        public void Pack(SegmentMesh mesh)
        {
            // Vertices keep their numbers: the payload's order already serves the vertex cache.
            Begin(mesh, mesh.VertexCount, mesh.FaceCount * 3);
            for (int vertex = 0; vertex < mesh.VertexCount; vertex++)
            {
                Write(mesh, vertex, vertex);
            }
            // Winding is turned here as in Axes.Indices: Z was negated, which mirrors every face.
            uint[] indices = mesh.Indices;
            if (HasShortIndices)
            {
                for (int at = 0; at < IndexCount; at += 3)
                {
                    ShortIndices[at] = (ushort)indices[at];
                    ShortIndices[at + 1] = (ushort)indices[at + 2];
                    ShortIndices[at + 2] = (ushort)indices[at + 1];
                }
            }
            else
            {
                Axes.Indices(indices, mesh.FaceCount, LongIndices);
            }
            Bounds = Axes.Turn(mesh.Bounds);
        }

        /// <summary>
        /// Pack some consecutive faces of a mesh, with the vertices that they use alone, numbered anew in the order of their first use.
        /// </summary>
        /// <param name="mesh">The whole mesh.</param>
        /// <param name="faces">Which faces; at most 21845, so that indices fit into 16 bits.</param>
        /// <param name="remap">One entry per vertex of the mesh, all -1; left so.</param>
        public void PackFaces(SegmentMesh mesh, FaceRange faces, int[] remap)
        {
            if (faces.Count > ushort.MaxValue / 3)
            {
                throw new ArgumentException("part of " + faces.Count + " faces, expected at most " + ushort.MaxValue / 3);
            }
            uint[] indices = mesh.Indices;
            // 1. Number the vertices that these faces use, in the order of first use: neighbours stay close in memory.
            int vertexCount = 0;
            for (int at = faces.First * 3; at < faces.End * 3; at++)
            {
                if (remap[indices[at]] < 0)
                {
                    remap[indices[at]] = vertexCount++;
                }
            }
            // 2. Indices by the new numbers. At most 21845 faces have at most 65535 vertices: 16 bits are enough.
            Begin(mesh, vertexCount, faces.Count * 3);
            for (int from = faces.First * 3, to = 0; to < IndexCount; from += 3, to += 3)
            {
                ShortIndices[to] = (ushort)remap[indices[from]];
                ShortIndices[to + 1] = (ushort)remap[indices[from + 2]];
                ShortIndices[to + 2] = (ushort)remap[indices[from + 1]];
            }
            // 3. Each vertex once, and the box of them in Unity's axes. Setting remap back to -1 marks it as written, and leaves the array
            // as it came: the next block needs no clearing.
            float minX = float.PositiveInfinity, minY = minX, minZ = minX;
            float maxX = float.NegativeInfinity, maxY = maxX, maxZ = maxX;
            for (int at = faces.First * 3; at < faces.End * 3; at++)
            {
                uint vertex = indices[at];
                if (remap[vertex] < 0)
                {
                    continue; // Written already.
                }
                Write(mesh, (int)vertex, remap[vertex]);
                remap[vertex] = -1;
                float x, y, z;
                mesh.PositionAt((int)vertex, out x, out y, out z);
                z = Axes.TurnZ(z);
                minX = Math.Min(minX, x);
                minY = Math.Min(minY, y);
                minZ = Math.Min(minZ, z);
                maxX = Math.Max(maxX, x);
                maxY = Math.Max(maxY, y);
                maxZ = Math.Max(maxZ, z);
            }
            Bounds = faces.Count == 0 ? default(Box) : new Box(minX, minY, minZ, maxX, maxY, maxZ);
        }

        /// <summary>Let the memory of the vertices go, once they are on the GPU; the indices stay.</summary>
        public void DropVertices()
        {
            Tinted = Array.Empty<TintedVertex>();
            Photographed = Array.Empty<PhotoVertex>();
        }

        private void Begin(SegmentMesh mesh, int vertexCount, int indexCount)
        {
            IsPhotographed = mesh.HasTexture;
            VertexCount = vertexCount;
            IndexCount = indexCount;
            // Up to index 65534: 65535 would restart a strip on some GPUs.
            HasShortIndices = vertexCount <= ushort.MaxValue;
            if (IsPhotographed)
            {
                // Only the kind that is needed grows; the other keeps its buffer for a later mesh.
                Photographed = WithRoom(Photographed, vertexCount);
            }
            else
            {
                Tinted = WithRoom(Tinted, vertexCount);
            }
            if (HasShortIndices)
            {
                ShortIndices = WithRoom(ShortIndices, indexCount);
            }
            else
            {
                LongIndices = WithRoom(LongIndices, indexCount);
            }
        }

        private void Write(SegmentMesh mesh, int from, int to)
        {
            if (IsPhotographed)
            {
                WritePhoto(mesh, from, ref Photographed[to]);
            }
            else
            {
                WriteTinted(mesh, from, ref Tinted[to]);
            }
        }

        private static void WriteTinted(SegmentMesh mesh, int from, ref TintedVertex vertex)
        {
            float z;
            mesh.PositionAt(from, out vertex.X, out vertex.Y, out z);
            vertex.Z = Axes.TurnZ(z);
            Normal(mesh, from, out vertex.NormalX, out vertex.NormalY, out vertex.NormalZ);
            vertex.Padding = 0;
            // Four components, since UNorm16 x 3 is no vertex format; the shader takes no alpha.
            vertex.Alpha = ushort.MaxValue;
            if (!mesh.HasColours)
            {
                vertex.Red = PlainRed;
                vertex.Green = PlainGreen;
                vertex.Blue = PlainBlue;
            }
            else
            {
                vertex.Red = mesh.LinearColours[from * 4];
                vertex.Green = mesh.LinearColours[from * 4 + 1];
                vertex.Blue = mesh.LinearColours[from * 4 + 2];
            }
        }

        private static void WritePhoto(SegmentMesh mesh, int from, ref PhotoVertex vertex)
        {
            float z;
            mesh.PositionAt(from, out vertex.X, out vertex.Y, out z);
            vertex.Z = Axes.TurnZ(z);
            Normal(mesh, from, out vertex.NormalX, out vertex.NormalY, out vertex.NormalZ);
            vertex.Padding = 0;
            vertex.U = (float)(mesh.UvScaleU * mesh.UvCodes[from * 2]);
            vertex.V = Axes.TurnV((float)(mesh.UvScaleV * mesh.UvCodes[from * 2 + 1]));
        }

        private static void Normal(SegmentMesh mesh, int from, out sbyte x, out sbyte y, out sbyte z)
        {
            x = mesh.NormalCodes[from * 4];
            y = mesh.NormalCodes[from * 4 + 1];
            z = Axes.TurnNormalZ(mesh.NormalCodes[from * 4 + 2]);
        }

        private static T[] WithRoom<T>(T[] buffer, int count)
        {
            return buffer.Length >= count ? buffer : new T[Math.Max(count, (int)Math.Min(2L * buffer.Length, int.MaxValue / 64))];
        }
    }
}
