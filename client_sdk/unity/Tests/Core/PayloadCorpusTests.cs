using System;
using System.IO;
using System.Security.Cryptography;
using NUnit.Framework;
using Terraport.Json;

namespace Terraport.Tests
{
    /// <summary>Every file of the scene corpus: good ones give what is written beside them, bad ones are refused.</summary>
    [TestFixture]
    public class PayloadCorpusTests
    {
        /// <summary>One code of 127 and a little: normals may be rounded either way (scene format, section 9).</summary>
        private const double NormalTolerance = 0.009;

        /// <summary>Texture coordinates are written with six digits.</summary>
        private const double WrittenTolerance = 1e-6;

        [Test]
        public void Corpus_IsReadAndRefused()
        {
            int good = 0;
            int bad = 0;
            // One mesh for all: nothing of a payload may be left over in the next.
            var mesh = new SegmentMesh();
            foreach (CorpusPayload payload in CorpusPayload.All(""))
            {
                var bytes = new ArraySegment<byte>(payload.Bytes);
                bool isGood;
                payload.Expected["good"].TryFlag(out isGood);
                if (isGood)
                {
                    payload.Decode(bytes, mesh);
                    CheckMesh(mesh, payload.Expected, payload.Name);
                    good++;
                }
                else
                {
                    Assert.Throws<PayloadException>(() => payload.Decode(bytes, mesh), payload.Name);
                    Assert.AreEqual(0, mesh.VertexCount, "something is left of " + payload.Name);
                    bad++;
                }
            }
            Assert.GreaterOrEqual(good, 25);
            Assert.GreaterOrEqual(bad, 47);
        }

        [TestCase("good-full.glb")]
        [TestCase("good-attributes.tsg")]
        [TestCase("good-jpeg.tsg")]
        public void Payload_InTheMiddleOfAnArray_IsTheSame(string name)
        {
            var payload = new CorpusPayload(name);
            var larger = new byte[payload.Bytes.Length + 20];
            Buffer.BlockCopy(payload.Bytes, 0, larger, 7, payload.Bytes.Length);
            var mesh = new SegmentMesh();
            payload.Decode(new ArraySegment<byte>(larger, 7, payload.Bytes.Length), mesh);
            CheckMesh(mesh, payload.Expected, "moved " + name);
        }

        [TestCase("plain.tsg")]
        [TestCase("colours.tsg")]
        [TestCase("image.tsg")]
        public void Segment_OfBefore_IsRead(string name)
        {
            byte[] bytes = File.ReadAllBytes(Repository.PathTo("tests/payload/golden_segments/" + name));
            var mesh = new SegmentMesh();
            new SegmentDecoder().Decode(new ArraySegment<byte>(bytes), new CorpusPayload("good-attribute.tsg").Attributes, mesh);
            Assert.AreEqual(50, mesh.FaceCount);
            Assert.AreEqual(name == "colours.tsg", mesh.HasColours);
            Assert.AreEqual(name == "image.tsg", mesh.HasTexture);
            Assert.AreEqual(name == "plain.tsg" ? 0 : 1, mesh.Attributes.Count);
        }

        private static void CheckMesh(SegmentMesh mesh, JsonValue expected, string name)
        {
            // 1. What there is, and how much of it.
            Assert.AreEqual(expected["positions"].Count, mesh.VertexCount, name);
            Assert.AreEqual(expected["faces"].Count, mesh.FaceCount, name);
            Assert.AreEqual(expected["colours"].IsNull, !mesh.HasColours, name);
            Assert.AreEqual(expected["region_ids"].IsNull, !mesh.HasRegionIds, name);
            Assert.AreEqual(expected["texture"].IsNull, !mesh.HasTexture, name);
            Assert.AreEqual(expected["attributes"].Count, mesh.Attributes.Count, name);
            // 2. Every vertex, by the public accessors: those round as all clients do.
            for (int vertex = 0; vertex < mesh.VertexCount; vertex++)
            {
                float x, y, z;
                mesh.PositionAt(vertex, out x, out y, out z);
                CheckRow(expected["positions"][vertex], 0, name + " position", x, y, z);
                mesh.NormalAt(vertex, out x, out y, out z);
                CheckRow(expected["normals"][vertex], NormalTolerance, name + " normal", x, y, z);
                if (mesh.HasColours)
                {
                    byte red, green, blue;
                    mesh.ColourAt(vertex, out red, out green, out blue);
                    CheckRow(expected["colours"][vertex], 0, name + " colour", red, green, blue);
                }
                if (mesh.HasRegionIds)
                {
                    Assert.AreEqual(Number(expected["region_ids"][vertex]), mesh.RegionIds[vertex], name);
                }
                if (mesh.HasTexture)
                {
                    mesh.UvAt(vertex, out x, out y);
                    CheckRow(expected["uvs"][vertex], WrittenTolerance, name + " uv", x, y);
                }
                foreach (MeshAttribute attribute in mesh.Attributes)
                {
                    JsonValue value = expected["attributes"][attribute.Name][vertex];
                    float decoded = attribute.ValueAt(vertex);
                    Assert.AreEqual(value.IsNull, float.IsNaN(decoded), name + " " + attribute.Name);
                    Assert.IsTrue(value.IsNull || (float)Number(value) == decoded, name + " " + attribute.Name);
                }
            }
            // 3. Faces, corner by corner: the first corner of each counts too.
            for (int face = 0; face < mesh.FaceCount; face++)
            {
                uint[] indices = mesh.Indices;
                CheckRow(expected["faces"][face], 0, name + " face", indices[face * 3], indices[face * 3 + 1], indices[face * 3 + 2]);
            }
            // 4. The image, byte for byte by its digest.
            if (mesh.HasTexture)
            {
                JsonValue texture = expected["texture"];
                Assert.AreEqual(texture["media_type"].Text, mesh.Image.MediaType, name);
                Assert.AreEqual(Number(texture["width"]), mesh.Image.Width, name);
                Assert.AreEqual(Number(texture["height"]), mesh.Image.Height, name);
                Assert.AreEqual(Number(texture["gpu_bytes"]), mesh.Image.GpuBytes, name);
                using (SHA256 digest = SHA256.Create())
                {
                    byte[] hash = digest.ComputeHash(mesh.Image.Bytes, 0, mesh.Image.Length);
                    Assert.AreEqual(texture["sha256"].Text, BitConverter.ToString(hash).Replace("-", "").ToLowerInvariant(), name);
                }
            }
        }

        private static void CheckRow(JsonValue row, double tolerance, string name, params double[] decoded)
        {
            Assert.AreEqual(row.Count, decoded.Length, name);
            for (int at = 0; at < decoded.Length; at++)
            {
                double expected = Number(row[at]);
                Assert.IsTrue(
                    Math.Abs((float)expected - decoded[at]) <= tolerance, name + ": expected " + expected + ", got " + decoded[at]);
            }
        }

        private static double Number(JsonValue value)
        {
            double number;
            Assert.IsTrue(value.TryNumber(out number));
            return number;
        }
    }
}
