using System;
using Unity.Collections;
using UnityEngine;
using UnityEngine.Rendering;

namespace Terraport.Unity
{
    /// <summary>
    /// Fills meshes of Unity from packed ones: one copy each for vertices and indices, no garbage. Main thread.
    /// </summary>
    public static class MeshFiller
    {
        /// <summary>What Unity would look over anew, and need not: the decoder has checked every index, and the box is known.</summary>
        /// <remarks>
        /// Not DontNotifyMeshUsers: meshes are used again while their renderers live, and those would go on being culled by the box
        /// of what the mesh held before.
        /// </remarks>
        private const MeshUpdateFlags Unchecked =
            MeshUpdateFlags.DontValidateIndices | MeshUpdateFlags.DontRecalculateBounds | MeshUpdateFlags.DontResetBoneBounds;

        // Kept, since a params array would be made anew at every call.
        private static readonly VertexAttributeDescriptor[] TintedLayout = {
            new VertexAttributeDescriptor(VertexAttribute.Position, VertexAttributeFormat.Float32, 3),
            new VertexAttributeDescriptor(VertexAttribute.Normal, VertexAttributeFormat.SNorm8, 4),
            new VertexAttributeDescriptor(VertexAttribute.Color, VertexAttributeFormat.UNorm16, 4),
        };

        private static readonly VertexAttributeDescriptor[] PhotoLayout = {
            new VertexAttributeDescriptor(VertexAttribute.Position, VertexAttributeFormat.Float32, 3),
            new VertexAttributeDescriptor(VertexAttribute.Normal, VertexAttributeFormat.SNorm8, 4),
            new VertexAttributeDescriptor(VertexAttribute.TexCoord0, VertexAttributeFormat.Float32, 2),
        };

        /// <summary>Whether the graphics card can read these vertices; where not, there is nothing to be done but say so.</summary>
        public static bool IsSupported
        {
            get {
                return SystemInfo.SupportsVertexAttributeFormat(VertexAttributeFormat.SNorm8, 4)
                    && SystemInfo.SupportsVertexAttributeFormat(VertexAttributeFormat.UNorm16, 4);
            }
        }

        /// <summary>Put a packed mesh in the place of whatever the mesh held, and hand it to the graphics card now.</summary>
        public static void Fill(Mesh mesh, PackedMesh packed)
        {
            // 1. Memory of the engine's own, written by one copy each: Mesh.SetVertices and the like would convert and check.
            Mesh.MeshDataArray array = Mesh.AllocateWritableMeshData(1);
            bool isApplied = false;
            try
            {
                Mesh.MeshData data = array[0];
                if (packed.IsPhotographed)
                {
                    data.SetVertexBufferParams(packed.VertexCount, PhotoLayout);
                    NativeArray<PhotoVertex>.Copy(packed.Photographed, 0, data.GetVertexData<PhotoVertex>(), 0, packed.VertexCount);
                }
                else
                {
                    data.SetVertexBufferParams(packed.VertexCount, TintedLayout);
                    NativeArray<TintedVertex>.Copy(packed.Tinted, 0, data.GetVertexData<TintedVertex>(), 0, packed.VertexCount);
                }
                // 2. Indices, of 16 bits wherever they fit: half the memory.
                if (packed.HasShortIndices)
                {
                    data.SetIndexBufferParams(packed.IndexCount, IndexFormat.UInt16);
                    NativeArray<ushort>.Copy(packed.ShortIndices, 0, data.GetIndexData<ushort>(), 0, packed.IndexCount);
                }
                else
                {
                    data.SetIndexBufferParams(packed.IndexCount, IndexFormat.UInt32);
                    NativeArray<uint>.Copy(packed.LongIndices, 0, data.GetIndexData<uint>(), 0, packed.IndexCount);
                }
                // 3. One submesh with the known box; then the array becomes the mesh's.
                data.subMeshCount = 1;
                data.SetSubMesh(0, SubMeshOf(packed, packed.IndexCount), Unchecked);
                isApplied = true; // Apply disposes, whatever happens in it.
                Mesh.ApplyAndDisposeWritableMeshData(array, mesh, Unchecked);
            }
            finally
            {
                if (!isApplied)
                {
                    array.Dispose();
                }
            }
            // Of the submesh and of the mesh: renderers cull by the mesh's.
            mesh.bounds = ToBounds(packed.Bounds);
            // Now, and not when it is first drawn: that is the frame of the swap. Kept readable, or it could not be filled again.
            mesh.UploadMeshData(false);
        }

        /// <summary>Replace the list of faces of a filled mesh by a shorter or longer one, and hand it to the graphics card now.</summary>
        /// <param name="mesh">Filled from <paramref name="packed"/> before.</param>
        /// <param name="packed">Its vertices and box.</param>
        /// <param name="indices">The new list; at most as long as the mesh's own.</param>
        /// <param name="indexCount">How many of them count.</param>
        public static void SetFaces(Mesh mesh, PackedMesh packed, ushort[] indices, int indexCount)
        {
            // The buffer keeps the length of the full list; the submesh says how much of it is drawn.
            mesh.SetIndexBufferData(indices, 0, 0, indexCount, Unchecked);
            mesh.SetSubMesh(0, SubMeshOf(packed, indexCount), Unchecked);
            mesh.UploadMeshData(false);
        }

        /// <summary>Unity's box of a box in Unity's axes.</summary>
        public static Bounds ToBounds(Box box)
        {
            Vector3 min = new Vector3(box.MinX, box.MinY, box.MinZ);
            Vector3 max = new Vector3(box.MaxX, box.MaxY, box.MaxZ);
            return new Bounds((min + max) * 0.5f, max - min);
        }

        private static SubMeshDescriptor SubMeshOf(PackedMesh packed, int indexCount)
        {
            SubMeshDescriptor subMesh = new SubMeshDescriptor(0, indexCount, MeshTopology.Triangles);
            subMesh.firstVertex = 0;
            subMesh.vertexCount = packed.VertexCount;
            subMesh.bounds = ToBounds(packed.Bounds);
            return subMesh;
        }
    }
}
