using Unity.Collections;
using UnityEngine;
using UnityEngine.Rendering;

namespace Terraport.Unity
{
    /// <summary>Fills Unity's meshes from packed ones: one copy each for vertices and indices, no garbage. Main thread.</summary>
    internal static class MeshFiller
    {
        /// <summary>What Unity would check again: the decoder has checked every index, and the box is known.</summary>
        /// <remarks>
        /// Not DontNotifyMeshUsers: meshes are filled again while their renderers live, which would be culled by the box of what the mesh held
        /// before.
        /// </remarks>
        private const MeshUpdateFlags Unchecked =
            MeshUpdateFlags.DontValidateIndices | MeshUpdateFlags.DontRecalculateBounds | MeshUpdateFlags.DontResetBoneBounds;

        // Kept: a params array would be made at every call.
        private static readonly VertexAttributeDescriptor[] ColourLayout =
            LayoutOf(new VertexAttributeDescriptor(VertexAttribute.Color, VertexAttributeFormat.UNorm16, 4));
        private static readonly VertexAttributeDescriptor[] ImageLayout =
            LayoutOf(new VertexAttributeDescriptor(VertexAttribute.TexCoord0, VertexAttributeFormat.Float32, 2));

        /// <summary>Whether the graphics card can read these vertices.</summary>
        internal static bool IsSupported => SystemInfo.SupportsVertexAttributeFormat(VertexAttributeFormat.SNorm8, 4)
            && SystemInfo.SupportsVertexAttributeFormat(VertexAttributeFormat.UNorm16, 4);

        /// <summary>Replace what a mesh holds, and upload it now.</summary>
        internal static void Fill(Mesh mesh, PackedMesh packed)
        {
            // The engine's own memory, written by one copy each: Mesh.SetVertices and the like would convert and check.
            Mesh.MeshDataArray array = Mesh.AllocateWritableMeshData(1);
            Mesh.MeshData data = array[0];
            data.SetVertexBufferParams(packed.VertexCount, packed.HasImage ? ImageLayout : ColourLayout);
            NativeArray<GroundVertex>.Copy(packed.Vertices, 0, data.GetVertexData<GroundVertex>(), 0, packed.VertexCount);
            data.SetIndexBufferParams(packed.IndexCount, packed.HasShortIndices ? IndexFormat.UInt16 : IndexFormat.UInt32);
            if (packed.HasShortIndices)
                NativeArray<ushort>.Copy(packed.ShortIndices, 0, data.GetIndexData<ushort>(), 0, packed.IndexCount);
            else
                NativeArray<uint>.Copy(packed.LongIndices, 0, data.GetIndexData<uint>(), 0, packed.IndexCount);
            data.subMeshCount = 1;
            data.SetSubMesh(0, SubMeshOf(packed, packed.IndexCount), Unchecked);
            Mesh.ApplyAndDisposeWritableMeshData(array, mesh, Unchecked);
            // Of the submesh and of the mesh: renderers are culled by the mesh's.
            mesh.bounds = ToBounds(packed.Bounds);
            // Now, and not when it is first drawn, which is the frame of the swap. Kept readable, or it could not be filled again.
            mesh.UploadMeshData(false);
        }

        /// <summary>Replace the faces of a filled mesh by a list that is at most as long as its own, and upload it now.</summary>
        internal static void SetFaces(Mesh mesh, PackedMesh packed, ushort[] indices, int indexCount)
        {
            // The buffer keeps its length; the submesh says how much of it is drawn.
            mesh.SetIndexBufferData(indices, 0, 0, indexCount, Unchecked);
            mesh.SetSubMesh(0, SubMeshOf(packed, indexCount), Unchecked);
            mesh.UploadMeshData(false);
        }

        private static VertexAttributeDescriptor[] LayoutOf(VertexAttributeDescriptor last)
        {
            return new[] {
                new VertexAttributeDescriptor(VertexAttribute.Position, VertexAttributeFormat.Float32, 3),
                new VertexAttributeDescriptor(VertexAttribute.Normal, VertexAttributeFormat.SNorm8, 4),
                last,
            };
        }

        private static Bounds ToBounds(Box box)
        {
            Vector3 min = new Vector3(box.MinX, box.MinY, box.MinZ), max = new Vector3(box.MaxX, box.MaxY, box.MaxZ);
            return new Bounds((min + max) * 0.5f, max - min);
        }

        private static SubMeshDescriptor SubMeshOf(PackedMesh packed, int indexCount)
        {
            return new SubMeshDescriptor(0, indexCount, MeshTopology.Triangles) {
                firstVertex = 0,
                vertexCount = packed.VertexCount,
                bounds = ToBounds(packed.Bounds),
            };
        }
    }
}
