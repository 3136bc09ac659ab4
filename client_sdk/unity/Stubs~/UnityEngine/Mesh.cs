using System;
using Unity.Collections;
using UnityEngine.Rendering;

namespace UnityEngine
{
    /// <summary>Keeps what it is filled with, so that a test can look at what would be drawn.</summary>
    public sealed class Mesh : Object
    {
        /// <summary>The one vertex buffer, an array of the struct that it was filled with.</summary>
        [StubsOwn]
        public Array VertexData { get; private set; }

        /// <summary>The index buffer, ushort[] or uint[].</summary>
        [StubsOwn]
        public Array IndexData {
            get; private set;
        }

        [StubsOwn]
        public VertexAttributeDescriptor[] Layout {
            get; private set;
        }

        [StubsOwn]
        public SubMeshDescriptor SubMesh {
            get; private set;
        }

        public Bounds bounds { get; set; }
        public void MarkDynamic() {}

        public void Clear()
        {
            VertexData = null;
            IndexData = null;
        }

        public IndexFormat indexFormat { get; set; }
        public void SetVertices(Vector3[] inVertices) { VertexData = inVertices; }

        public void SetIndices(int[] indices, MeshTopology topology, int submesh)
        {
            IndexData = indices;
            SubMesh = new SubMeshDescriptor(0, indices.Length, topology);
        }

        public void UploadMeshData(bool markNoLongerReadable) {}
        public void SetSubMesh(int index, SubMeshDescriptor desc, MeshUpdateFlags flags = MeshUpdateFlags.Default) { SubMesh = desc; }

        public void SetIndexBufferData<T>(
            T[] data, int dataStart, int meshBufferStart, int count, MeshUpdateFlags flags = MeshUpdateFlags.Default)
            where T : struct { Array.Copy(data, dataStart, IndexData, meshBufferStart, count); }

        public static MeshDataArray AllocateWritableMeshData(int meshCount) { return new MeshDataArray(new Buffers()); }

        public static void ApplyAndDisposeWritableMeshData(MeshDataArray data, Mesh mesh, MeshUpdateFlags flags = MeshUpdateFlags.Default)
        {
            mesh.Layout = data.Buffers.Layout;
            mesh.VertexData = data.Buffers.Vertices;
            mesh.IndexData = data.Buffers.Indices;
            mesh.SubMesh = data.Buffers.SubMesh;
        }

        internal sealed class Buffers
        {
            public VertexAttributeDescriptor[] Layout;
            public int VertexCount;
            public int IndexCount;
            public Array Vertices;
            public Array Indices;
            public SubMeshDescriptor SubMesh;
        }

        public struct MeshDataArray : IDisposable
        {
            internal readonly Buffers Buffers;
            internal MeshDataArray(Buffers buffers) { Buffers = buffers; }
            public MeshData this[int index] => new MeshData(Buffers);
            public void Dispose() {}
        }

        public struct MeshData
        {
            private readonly Buffers buffers;
            internal MeshData(Buffers buffers) { this.buffers = buffers; }

            public int subMeshCount
            {
                get => 1;
                set {
                }
            }

            public void SetVertexBufferParams(int vertexCount, params VertexAttributeDescriptor[] attributes)
            {
                buffers.VertexCount = vertexCount;
                buffers.Layout = attributes;
            }

            public NativeArray<T> GetVertexData<T>(int stream = 0)
                where T : struct
            {
                T[] vertices = new T[buffers.VertexCount];
                buffers.Vertices = vertices;
                return new NativeArray<T>(vertices);
            }

            public void SetIndexBufferParams(int indexCount, IndexFormat format) { buffers.IndexCount = indexCount; }

            public NativeArray<T> GetIndexData<T>()
                where T : struct
            {
                T[] indices = new T[buffers.IndexCount];
                buffers.Indices = indices;
                return new NativeArray<T>(indices);
            }

            public void SetSubMesh(int index, SubMeshDescriptor desc, MeshUpdateFlags flags = MeshUpdateFlags.Default)
            {
                buffers.SubMesh = desc;
            }
        }
    }
}

namespace Unity.Collections
{
    public struct NativeArray<T>
        where T : struct
    {
        private readonly T[] elements;
        internal NativeArray(T[] elements) { this.elements = elements; }

        public static void Copy(T[] src, int srcIndex, NativeArray<T> dst, int dstIndex, int length)
        {
            Array.Copy(src, srcIndex, dst.elements, dstIndex, length);
        }

        public static implicit operator NativeSlice<T>(NativeArray<T> nativeArray) { return default(NativeSlice<T>); }
    }

    public struct NativeSlice<T>
        where T : struct
    {
    }
}
