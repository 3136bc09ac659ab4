using System;
using System.Collections.Generic;
using NUnit.Framework;
using Terraport.Unity;

namespace Terraport.Tests
{
    /// <summary>The base in blocks that are pieces of ground: the same faces over the same segments, in another order.</summary>
    [TestFixture]
    public class BaseOrderTests
    {
        private const int Side = 24;
        private const int BlockFaces = 32;

        [Test]
        public void EveryFaceKeepsItsSegments()
        {
            SceneFiles before = Grid();
            Dictionary<string, string> expected = RowsByFace(before);
            SceneFiles after = BaseOrder.Sort(before, BlockFaces);
            Dictionary<string, string> actual = RowsByFace(after);
            // By corners, not by number: the same face over the same segments, wherever it lies now.
            Assert.AreEqual(expected.Count, actual.Count);
            foreach (KeyValuePair<string, string> face in expected)
            {
                Assert.AreEqual(face.Value, actual[face.Key]);
            }
        }

        [Test]
        public void BlocksAreCompact()
        {
            SceneFiles before = Grid();
            double straggling = MeanExtent(before.Base);
            double compact = MeanExtent(BaseOrder.Sort(before, BlockFaces).Base);
            // 32 faces of half a square metre: 4 m by 4 m, give or take; row by row a block is 16 m wide and more.
            Assert.Less(compact, 10);
            Assert.Less(compact, straggling / 2);
        }

        [Test]
        public void EqualCentresAreSortedToo()
        {
            // A hundred times the same triangle: a selection that loops on equal keys would never end.
            float[] positions = { 0, 0, 0, 1, 0, 0, 0, 0, 1 };
            uint[] indices = new uint[3 * 100];
            for (int face = 0; face < 100; face++)
            {
                indices[face * 3 + 1] = 1;
                indices[face * 3 + 2] = 2;
            }
            SegmentMesh mesh = GlbFile.Of(positions, indices).Decode();
            SceneFiles sorted = BaseOrder.Sort(new SceneFiles(null, mesh, new Cover(new uint[101], new uint[0]), null, null), 7);
            Assert.AreEqual(101, sorted.Cover.Offsets.Length);
        }

        private static SceneFiles Grid()
        {
            List<float> positions = new List<float>();
            List<uint> indices = new List<uint>();
            List<uint> offsets = new List<uint> { 0 };
            List<uint> segments = new List<uint>();
            for (int z = 0; z <= Side; z++)
            {
                for (int x = 0; x <= Side; x++)
                {
                    positions.AddRange(new float[] { x, 0, z });
                }
            }
            for (uint z = 0; z < Side; z++)
            {
                for (uint x = 0; x < Side; x++)
                {
                    uint corner = z * (Side + 1) + x;
                    indices.AddRange(new[] { corner, corner + Side + 1, corner + 1, corner + 1, corner + Side + 1, corner + Side + 2 });
                    for (uint face = 0; face < 2; face++)
                    {
                        // Rows of 0 to 3 segments, so that offsets differ from face to face.
                        for (uint segment = 0; segment < (x + z + face) % 4; segment++)
                        {
                            segments.Add(x * 4 + segment);
                        }
                        offsets.Add((uint)segments.Count);
                    }
                }
            }
            SegmentMesh mesh = GlbFile.Of(positions.ToArray(), indices.ToArray()).Decode();
            return new SceneFiles(null, mesh, new Cover(offsets.ToArray(), segments.ToArray()), null, null);
        }

        private static Dictionary<string, string> RowsByFace(SceneFiles files)
        {
            Dictionary<string, string> rows = new Dictionary<string, string>();
            for (int face = 0; face < files.Base.FaceCount; face++)
            {
                uint[] corners = new uint[3];
                Array.Copy(files.Base.Indices, face * 3, corners, 0, 3);
                List<string> row = new List<string>();
                for (uint at = files.Cover.Offsets[face]; at < files.Cover.Offsets[face + 1]; at++)
                {
                    row.Add(files.Cover.Segments[at].ToString());
                }
                rows.Add(corners[0] + " " + corners[1] + " " + corners[2], string.Join(" ", row));
            }
            return rows;
        }

        private static double MeanExtent(SegmentMesh mesh)
        {
            BaseBlocks blocks = new BaseBlocks(mesh, BlockFaces);
            double sum = 0;
            while (blocks.Step())
            {
                Box box = blocks.PackedOf(blocks.PackedCount - 1).Bounds;
                sum += (box.MaxX - box.MinX) + (box.MaxZ - box.MinZ);
            }
            return sum / blocks.Count;
        }
    }
}
