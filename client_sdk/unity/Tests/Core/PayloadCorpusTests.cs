using System;
using System.Collections.Generic;
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
            string folder = Repository.PathTo("tests/conformance/scene/payload");
            int good = 0;
            int bad = 0;
            // One decoder and one mesh for all: nothing of a payload may be left over in the next.
            var decoder = new SegmentDecoder();
            var mesh = new SegmentMesh();
            foreach (string path in Directory.GetFiles(folder, "*.glb"))
            {
                JsonValue expected = JsonReader.Read(new ArraySegment<byte>(File.ReadAllBytes(path + ".json")));
                var payload = new ArraySegment<byte>(File.ReadAllBytes(path));
                bool isGood;
                expected["good"].TryFlag(out isGood);
                if (isGood)
                {
                    decoder.Decode(payload, mesh);
                    CheckMesh(mesh, expected, Path.GetFileName(path));
                    good++;
                }
                else
                {
                    Assert.Throws<PayloadException>(() => decoder.Decode(payload, mesh), Path.GetFileName(path));
                    Assert.AreEqual(0, mesh.VertexCount, "something is left of " + Path.GetFileName(path));
                    bad++;
                }
            }
            Assert.GreaterOrEqual(good, 9);
            Assert.GreaterOrEqual(bad, 18);
        }

        [Test]
        public void Payload_InTheMiddleOfAnArray_IsTheSame()
        {
            byte[] bytes = File.ReadAllBytes(Repository.PathTo("tests/conformance/scene/payload/good-full.glb"));
            var larger = new byte[bytes.Length + 20];
            Buffer.BlockCopy(bytes, 0, larger, 7, bytes.Length);
            var mesh = new SegmentMesh();
            new GlbDecoder().Decode(new ArraySegment<byte>(larger, 7, bytes.Length), false, mesh);
            CheckMesh(mesh,
                JsonReader.Read(
                    new ArraySegment<byte>(File.ReadAllBytes(Repository.PathTo("tests/conformance/scene/payload/good-full.glb.json")))),
                "moved");
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
