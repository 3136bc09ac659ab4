using System;
using NUnit.Framework;
using Terraport.Unity;

namespace Terraport.Tests
{
    /// <summary>Decoded meshes as the graphics card gets them.</summary>
    [TestFixture]
    public class PackedMeshTests
    {
        private static readonly float[] Square = { 0, 0, 0, 2, 0, 0, 2, 1, -3, 0, 0, -3 };
        private static readonly uint[] TwoFaces = { 0, 1, 2, 0, 2, 3 };

        [Test]
        public void ColouredVerticesAreTurnedAndLinear()
        {
            byte[] colours = { 0, 128, 255, 255, 10, 20, 30, 255, 1, 2, 3, 255, 4, 5, 6, 255 };
            PackedMesh packed = Packed(GlbFile.Of(Square, TwoFaces).WithColours(Array.ConvertAll(colours, LinearOf)));
            Assert.IsFalse(packed.IsPhotographed);
            Assert.AreEqual(4, packed.VertexCount);
            TintedVertex corner = packed.Tinted[2];
            // z = -3 of the scene is 3 north of its origin.
            Assert.AreEqual(new[] { 2f, 1f, 3f }, new[] { corner.X, corner.Y, corner.Z });
            Assert.AreEqual(new sbyte[] { 0, 127, 0 }, new[] { corner.NormalX, corner.NormalY, corner.NormalZ });
            for (int vertex = 0; vertex < 4; vertex++)
            {
                TintedVertex tinted = packed.Tinted[vertex];
                Assert.AreEqual(colours[vertex * 4], LinearColour.ToSrgb(tinted.Red));
                Assert.AreEqual(colours[vertex * 4 + 1], LinearColour.ToSrgb(tinted.Green));
                Assert.AreEqual(colours[vertex * 4 + 2], LinearColour.ToSrgb(tinted.Blue));
                Assert.AreEqual(65535, tinted.Alpha);
            }
            Assert.AreEqual(new Box(0, 0, 0, 2, 1, 3), packed.Bounds);
        }

        [Test]
        public void FacesAreTurnedRound()
        {
            PackedMesh packed = Packed(GlbFile.Of(Square, TwoFaces));
            Assert.IsTrue(packed.HasShortIndices);
            Assert.AreEqual(new ushort[] { 0, 2, 1, 0, 3, 2 }, Head(packed.ShortIndices, packed.IndexCount));
        }

        [Test]
        public void BareGroundIsGrey()
        {
            TintedVertex bare = Packed(GlbFile.Of(Square, TwoFaces)).Tinted[0];
            Assert.AreEqual(140, LinearColour.ToSrgb(bare.Red)); // 0.55, 0.55, 0.53: the viewer's.
            Assert.AreEqual(135, LinearColour.ToSrgb(bare.Blue));
        }

        [Test]
        public void PhotographsHaveTheirVTurned()
        {
            // A quarter a step: V 0 is the upper edge of the image, Unity's 1.
            ushort[] quarters = { 0, 0, 4, 0, 4, 4, 0, 1 };
            PackedMesh packed = Packed(GlbFile.Of(Square, TwoFaces).WithTexture(quarters, 0.25, OnePixelPng()));
            Assert.IsTrue(packed.IsPhotographed);
            Assert.AreEqual(1f, packed.Photographed[0].V);
            Assert.AreEqual(0f, packed.Photographed[2].V);
            Assert.AreEqual(0.75f, packed.Photographed[3].V);
            Assert.AreEqual(1f, packed.Photographed[1].U);
        }

        [Test]
        public void ManyVerticesTakeLongIndices()
        {
            // One vertex more than 16 bits allow with 65535 left out.
            float[] positions = new float[3 * 65536];
            for (int vertex = 0; vertex < 65536; vertex++)
            {
                positions[vertex * 3] = vertex;
            }
            PackedMesh packed = Packed(GlbFile.Of(positions, new uint[] { 0, 1, 65535 }));
            Assert.IsFalse(packed.HasShortIndices);
            Assert.AreEqual(new uint[] { 0, 65535, 1 }, Head(packed.LongIndices, packed.IndexCount));
        }

        [Test]
        public void BlocksHoldTheirOwnVerticesAlone()
        {
            SegmentMesh mesh = GlbFile.Of(Square, TwoFaces).Decode();
            BaseBlocks blocks = new BaseBlocks(mesh, 1);
            while (blocks.Step())
            {
            }
            Assert.AreEqual(2, blocks.Count);
            PackedMesh second = blocks.PackedOf(1);
            Assert.AreEqual(3, second.VertexCount);
            Assert.AreEqual(new ushort[] { 0, 2, 1 }, Head(second.ShortIndices, second.IndexCount)); // 0, 2, 3 anew, turned round.
            Assert.AreEqual(3f, second.Tinted[2].Z);
            Assert.AreEqual(new Box(0, 0, 0, 2, 1, 3), second.Bounds);
        }

        [Test]
        public void HiddenFacesAreLeftOut()
        {
            ushort[] all = { 0, 1, 2, 3, 4, 5, 6, 7, 8 };
            ushort[] into = new ushort[9];
            // Three faces from number 10 on, of which 11 is hidden.
            int written = FaceList.Write(all, new FaceRange(10, 3), Mask(20, 11), into);
            Assert.AreEqual(new ushort[] { 0, 1, 2, 6, 7, 8 }, Head(into, written));
            Assert.AreEqual(0, FaceList.Write(all, new FaceRange(10, 3), Mask(20, 10, 11, 12), into));
        }

        [Test]
        public void PackingAgainAllocatesNothing()
        {
            SegmentMesh mesh = GlbFile.Of(Square, TwoFaces).Decode();
            PackedMesh.PackOnto(mesh);
            object packed = mesh.EngineData;
            TintedVertex[] vertices = ((PackedMesh)packed).Tinted;
            for (int round = 0; round < 100; round++)
            {
                PackedMesh.PackOnto(mesh);
            }
            Assert.AreSame(packed, mesh.EngineData);
            Assert.AreSame(vertices, ((PackedMesh)packed).Tinted);
        }

        private static PackedMesh Packed(GlbFile file)
        {
            PackedMesh packed = new PackedMesh();
            packed.Pack(file.Decode());
            return packed;
        }

        /// <summary>Code of linear light of an sRGB level.</summary>
        private static ushort LinearOf(byte level)
        {
            double share = level / 255.0;
            return (ushort)Math.Round(65535 * (share <= 0.04045 ? share / 12.92 : Math.Pow((share + 0.055) / 1.055, 2.4)));
        }

        private static T[] Head<T>(T[] values, int count)
        {
            T[] head = new T[count];
            Array.Copy(values, head, count);
            return head;
        }

        private static byte[] Mask(int faces, params int[] hidden)
        {
            byte[] mask = new byte[faces];
            foreach (int face in hidden)
            {
                mask[face] = 1;
            }
            return mask;
        }

        private static byte[] OnePixelPng()
        {
            return Convert.FromBase64String(
                "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==");
        }
    }
}
