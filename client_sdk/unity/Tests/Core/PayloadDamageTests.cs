using System;
using System.Collections.Generic;
using System.IO;
using System.Text;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>Payloads that were damaged at random: refused or decoded, never another exception, and never a mesh that would crash a GPU.</summary>
    [TestFixture]
    public class PayloadDamageTests
    {
        private const int Rounds = 400;

        [Test]
        public void Damage_IsRefusedOrHarmless()
        {
            var decoder = new SegmentDecoder();
            var mesh = new SegmentMesh();
            var noise = new Noise(7);
            int refused = 0;
            foreach (string path in Directory.GetFiles(Repository.PathTo("tests/conformance/scene/payload"), "good-*.glb"))
            {
                byte[] whole = File.ReadAllBytes(path);
                for (int round = 0; round < Rounds; round++)
                {
                    byte[] damaged = Damaged(whole, noise);
                    try
                    {
                        decoder.Decode(new ArraySegment<byte>(damaged), mesh);
                        CheckHarmless(mesh);
                    }
                    catch (PayloadException)
                    {
                        // Refused means empty: nothing of it can be drawn.
                        Assert.AreEqual(0, mesh.VertexCount);
                        refused++;
                    }
                }
            }
            Assert.Greater(refused, Rounds / 2, "the damage must matter");
        }

        [TestCase("{\"asset\":}")]
        [TestCase("{\"a\":1,}")]
        [TestCase("{\"a\" 1}")]
        [TestCase("[1 2]")]
        [TestCase("[]")]
        [TestCase("{} {}")]
        [TestCase("{\"a\":01}")]
        [TestCase("{\"a\":1.}")]
        [TestCase("{\"a\":-}")]
        [TestCase("{\"a\":\"\\x\"}")]
        [TestCase("{\"a\":\"\\u12\"}")]
        [TestCase("{\"a\":NaN}")]
        [TestCase("{\"a\":\"open")]
        [TestCase("{\"a\":[1,2")]
        [TestCase("{'a':1}")]
        [TestCase("{\"a\":tru}")]
        public void Document_ThatIsNoJson_IsRefused(string text)
        {
            var error = Assert.Throws<PayloadException>(() => Decode(Glb(Encoding.UTF8.GetBytes(text))));
            Assert.IsTrue(error.Message.Contains("JSON"), error.Message);
        }

        [Test]
        public void Document_NestedDeeply_IsRefusedWithoutUsingUpTheStack()
        {
            // A recursive parser would end the process here, not the test.
            string text = "{\"a\":" + new string('[', 500000) + new string(']', 500000) + "}";
            Assert.Throws<PayloadException>(() => Decode(Glb(Encoding.ASCII.GetBytes(text))));
        }

        [Test]
        public void Document_ThatIsNoUtf8_IsRefused()
        {
            // A longer form than needed, a surrogate, beyond U+10FFFF, cut short.
            byte[][] wrong = { new byte[] { 0xC0, 0x80 }, new byte[] { 0xED, 0xA0, 0x80 }, new byte[] { 0xF4, 0x90, 0x80, 0x80 },
                new byte[] { 0xE2, 0x82 } };
            foreach (byte[] damaged in wrong)
            {
                var text = new List<byte>(Encoding.ASCII.GetBytes("{\"a\":\""));
                text.AddRange(damaged);
                text.AddRange(Encoding.ASCII.GetBytes("\"}"));
                var error = Assert.Throws<PayloadException>(() => Decode(Glb(text.ToArray())));
                Assert.IsTrue(error.Message.Contains("UTF-8"), error.Message);
            }
        }

        private static void Decode(byte[] glb) { new GlbDecoder().Decode(new ArraySegment<byte>(glb), false, new SegmentMesh()); }

        private static byte[] Glb(byte[] text)
        {
            int padded = (text.Length + 3) / 4 * 4;
            using (var file = new MemoryStream()) using (var writer = new BinaryWriter(file))
            {
                writer.Write(0x46546C67u);
                writer.Write(2u);
                writer.Write(12 + 8 + padded + 8);
                writer.Write(padded);
                writer.Write(0x4E4F534Au);
                writer.Write(text);
                for (int at = text.Length; at < padded; at++)
                {
                    writer.Write((byte)' ');
                }
                writer.Write(0);
                writer.Write(0x004E4942u);
                writer.Flush();
                return file.ToArray();
            }
        }

        private static byte[] Damaged(byte[] whole, Noise noise)
        {
            var damaged = (byte[])whole.Clone();
            for (int times = 1 + noise.Below(4); times > 0; times--)
            {
                int at = noise.Below(damaged.Length);
                damaged[at] = noise.Below(3) == 0 ? (byte)noise.Below(256) : (byte)(damaged[at] ^ (1 << noise.Below(8)));
            }
            if (noise.Below(8) == 0)
            {
                Array.Resize(ref damaged, noise.Below(damaged.Length));
            }
            return damaged;
        }

        private static void CheckHarmless(SegmentMesh mesh)
        {
            Assert.Greater(mesh.VertexCount, 0);
            Assert.GreaterOrEqual(mesh.Indices.Length, mesh.FaceCount * 3);
            for (int at = 0; at < mesh.FaceCount * 3; at++)
            {
                Assert.Less(mesh.Indices[at], (uint)mesh.VertexCount);
            }
            for (int vertex = 0; vertex < mesh.VertexCount; vertex++)
            {
                float x, y, z;
                mesh.PositionAt(vertex, out x, out y, out z);
                Assert.IsFalse(float.IsNaN(x + y + z) || float.IsInfinity(x) || float.IsInfinity(y) || float.IsInfinity(z));
            }
        }
    }
}
