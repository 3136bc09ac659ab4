using System;
using System.Collections.Generic;

namespace Terraport.Unity
{
    /// <summary>
    /// The base cut into blocks of consecutive faces, packed. Made on a thread while the scene is loaded, or in slices where there are
    /// no threads. No engine.
    /// </summary>
    public sealed class BaseBlocks
    {
        private readonly SegmentMesh mesh;
        private readonly List<FaceRange> ranges = new List<FaceRange>();
        private readonly List<PackedMesh> packed = new List<PackedMesh>();
        // New number of each vertex of the base within the block at hand, else -1; shared by all blocks, gone after the last.
        private int[] remap;

        /// <param name="mesh">The base; must not be changed meanwhile.</param>
        /// <param name="blockFaces">Faces of a block, 1 to 21845; <see cref="StageOptions.BaseBlockFaces"/>.</param>
        public BaseBlocks(SegmentMesh mesh, int blockFaces)
        {
            if (blockFaces < 1 || blockFaces > ushort.MaxValue / 3)
            {
                throw new ArgumentOutOfRangeException(nameof(blockFaces), blockFaces, "expected 1 to " + ushort.MaxValue / 3);
            }
            this.mesh = mesh;
            for (int first = 0; first < mesh.FaceCount; first += blockFaces)
            {
                // Cut once; packing follows in steps.
                ranges.Add(new FaceRange(first, Math.Min(blockFaces, mesh.FaceCount - first)));
            }
        }

        /// <summary>How many blocks there are.</summary>
        public int Count => ranges.Count;

        /// <summary>Blocks that are packed, from the first on.</summary>
        public int PackedCount => packed.Count;

        /// <summary>Which faces a block holds.</summary>
        public FaceRange RangeOf(int block) { return ranges[block]; }

        /// <summary>A packed block, below <see cref="PackedCount"/>; its vertices may have been dropped.</summary>
        public PackedMesh PackedOf(int block) { return packed[block]; }

        /// <summary>Pack the next block; false where all are.</summary>
        public bool Step()
        {
            if (packed.Count >= ranges.Count)
            {
                return false;
            }
            if (remap == null)
            {
                remap = new int[mesh.VertexCount];
                // PackFaces leaves it as it found it, so this is done once for all blocks.
                for (int vertex = 0; vertex < remap.Length; vertex++)
                {
                    remap[vertex] = -1;
                }
            }
            PackedMesh block = new PackedMesh();
            block.PackFaces(mesh, ranges[packed.Count], remap);
            packed.Add(block);
            if (packed.Count == ranges.Count)
            {
                remap = null;
            }
            return true;
        }

        /// <summary>
        /// Cut and pack a whole base and keep it with the mesh (<see cref="SegmentMesh.EngineData"/>), where the renderer finds it.
        /// </summary>
        public static void PackOnto(SegmentMesh mesh, int blockFaces)
        {
            BaseBlocks blocks = new BaseBlocks(mesh, blockFaces);
            while (blocks.Step())
            {
            }
            mesh.EngineData = blocks;
        }
    }
}
