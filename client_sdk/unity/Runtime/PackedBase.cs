using System;
using System.Collections.Generic;

namespace Terraport.Unity
{
    /// <summary>
    /// The base in blocks: each a compact piece of ground, so that few blocks change in a swap and blocks out of view are not drawn. Made on
    /// a thread while the scene is loaded. No engine.
    /// </summary>
    internal sealed class PackedBase
    {
        /// <summary>Faces of a block: 13 blocks for 200,000 faces, and at most 96 KiB of indices to write for one.</summary>
        internal const int BlockFaces = 16384;

        private readonly int[] faces;
        private readonly int blockFaces;

        /// <summary>Cut and pack a base; it is only read.</summary>
        internal PackedBase(SegmentMesh mesh, int blockFaces = BlockFaces)
        {
            this.blockFaces = blockFaces;
            faces = Sorted(mesh, blockFaces);
            Blocks = new PackedMesh[(faces.Length + blockFaces - 1) / blockFaces];
            var numbers = new int[mesh.VertexCount];
            for (int vertex = 0; vertex < numbers.Length; vertex++) numbers[vertex] = -1;
            for (int block = 0; block < Blocks.Count; block++)
            {
                var packed = new PackedMesh();
                packed.PackFaces(mesh, faces, block * blockFaces, FacesOf(block), numbers);
                ((PackedMesh[])Blocks)[block] = packed;
            }
            ImageFile = mesh.HasImage ? new List<byte>(mesh.ImageFile).ToArray() : null;
            Image = mesh.Image;
        }

        internal IReadOnlyList<PackedMesh> Blocks { get; }

        /// <summary>The file of its image; null without one.</summary>
        internal byte[] ImageFile { get; }

        internal ImageHeader Image { get; }

        internal int FacesOf(int block) { return Math.Min(blockFaces, faces.Length - block * blockFaces); }

        /// <summary>Whether two sets of hidden faces (one bit each) differ within a block.</summary>
        internal bool Differs(int block, byte[] a, byte[] b)
        {
            for (int at = block * blockFaces, end = at + FacesOf(block); at < end; at++)
            {
                if (GroundMesh.IsHidden(a, faces[at]) != GroundMesh.IsHidden(b, faces[at])) return true;
            }
            return false;
        }

        /// <summary>Write the corners of each face of a block that is not hidden; returns how many.</summary>
        internal int WriteVisible(int block, byte[] hidden, ushort[] into)
        {
            ushort[] all = Blocks[block].ShortIndices;
            int written = 0;
            for (int face = 0, count = FacesOf(block); face < count; face++)
            {
                if (GroundMesh.IsHidden(hidden, faces[block * blockFaces + face])) continue;
                for (int corner = 0; corner < 3; corner++) into[written++] = all[3 * face + corner];
            }
            return written;
        }

        /// <summary>Faces in an order in which each block is compact: halved along the longest axis down to blocks.</summary>
        private static int[] Sorted(SegmentMesh mesh, int blockFaces)
        {
            var order = new int[mesh.FaceCount];
            var centres = new float [3][];
            for (int axis = 0; axis < 3; axis++) centres[axis] = new float[mesh.FaceCount];
            for (int face = 0; face < order.Length; face++)
            {
                order[face] = face;
                for (int corner = 0; corner < 3; corner++)
                {
                    mesh.PositionAt((int)mesh.Indices[3 * face + corner], out float x, out float y, out float z);
                    centres[0][face] += x;
                    centres[1][face] += y;
                    centres[2][face] += z;
                }
            }
            Split(order, centres, 0, order.Length, blockFaces);
            return order;
        }

        private static void Split(int[] order, float[][] centres, int first, int end, int blockFaces)
        {
            int blocks = (end - first + blockFaces - 1) / blockFaces;
            if (blocks < 2)
            {
                Array.Sort(order, first, end - first); // The file's order within a block serves the vertex cache.
                return;
            }
            float[] longest = null;
            float longestExtent = -1;
            foreach (float[] axis in centres)
            {
                float low = float.PositiveInfinity, high = float.NegativeInfinity;
                for (int at = first; at < end; at++)
                {
                    low = Math.Min(low, axis[order[at]]);
                    high = Math.Max(high, axis[order[at]]);
                }
                if (high - low <= longestExtent) continue;
                longest = axis;
                longestExtent = high - low;
            }
            var keys = new float[end - first];
            for (int at = first; at < end; at++) keys[at - first] = longest[order[at]];
            var part = new int[end - first];
            Array.Copy(order, first, part, 0, part.Length);
            Array.Sort(keys, part);
            Array.Copy(part, 0, order, first, part.Length);
            // At a multiple of the block: every block but the last is full.
            int middle = first + blocks / 2 * blockFaces;
            Split(order, centres, first, middle, blockFaces);
            Split(order, centres, middle, end, blockFaces);
        }
    }
}
