using System;
using System.Collections.Generic;
using System.IO;
using System.IO.Compression;
using System.Linq;
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
            var mesh = new SegmentMesh();
            var noise = new Noise(7);
            int refused = 0;
            foreach (CorpusPayload payload in CorpusPayload.All("good-"))
            {
                for (int round = 0; round < Rounds; round++)
                {
                    refused += CheckDamaged(payload, Damaged(payload.Bytes, noise), mesh);
                }
            }
            Assert.Greater(refused, Rounds / 2, "the damage must matter");
        }

        [Test]
        public void Damage_InsideTheChecksum_IsRefusedOrHarmless()
        {
            var mesh = new SegmentMesh();
            var noise = new Noise(8);
            int refused = 0, taken = 0;
            foreach (CorpusPayload payload in CorpusPayload.All("good-"))
            {
                for (int round = 0; payload.IsSegment && round < Rounds; round++)
                {
                    int wasRefused = CheckDamaged(payload, WithStream(payload.Bytes, stream => Damaged(stream, noise)), mesh);
                    refused += wasRefused;
                    taken += 1 - wasRefused;
                }
            }
            Assert.Greater(refused, Rounds, "the damage must matter");
            Assert.Greater(taken, Rounds, "it must come past the head");
        }

        [Test]
        public void Segment_CutAnywhere_IsRefused()
        {
            var payload = new CorpusPayload("good-jpeg.tsg");
            var mesh = new SegmentMesh();
            int packedBytes = BitConverter.ToInt32(payload.Bytes, 4);
            for (int length = 0; length < payload.Bytes.Length; length++)
            {
                Assert.Throws<PayloadException>(() => payload.Decode(new ArraySegment<byte>(payload.Bytes, 0, length), mesh));
            }
            for (int cut = 1; cut < packedBytes; cut++)
            {
                // The lengths agree: it is the inflater that must notice, also where only the checksum is missing.
                byte[] cutStream = Joined(payload.Bytes, payload.Bytes.Skip(12).Take(packedBytes - cut).ToArray());
                Assert.Throws<PayloadException>(() => payload.Decode(new ArraySegment<byte>(cutStream), mesh), cut + " bytes less");
            }
        }

        [Test]
        public void Stream_WithoutBound_IsRefusedBeforeMemoryIsReserved()
        {
            var payload = new CorpusPayload("good-plain.tsg");
            // Zeros: a bound of 2^28 bytes, and what the end states may be anything.
            byte[] bomb = WithStream(payload.Bytes, stream => new byte[(1 << 28) + 1]);
            Assert.Less(bomb.Length, 1 << 19);
            var error = Assert.Throws<PayloadException>(() => payload.Decode(new ArraySegment<byte>(bomb), new SegmentMesh()));
            Assert.IsTrue(error.Message.Contains("state a length"), error.Message);
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

        private static void Decode(byte[] glb) { new GlbDecoder().Decode(new ArraySegment<byte>(glb), new SegmentMesh()); }

        /// <summary>1 where it is refused, and then empty; 0 where it is decoded, and then harmless.</summary>
        private static int CheckDamaged(CorpusPayload payload, byte[] damaged, SegmentMesh mesh)
        {
            try
            {
                payload.Decode(new ArraySegment<byte>(damaged), mesh);
            }
            catch (PayloadException)
            {
                Assert.AreEqual(0, mesh.VertexCount);
                return 1;
            }
            CheckHarmless(mesh);
            return 0;
        }

        /// <summary>A segment with another stream, its lengths and checksum right.</summary>
        private static byte[] WithStream(byte[] segment, Func<byte[], byte[]> change)
        {
            var stream = new MemoryStream();
            using (var packed = new MemoryStream(segment, 12, BitConverter.ToInt32(segment, 4))) using (
                var inflater = new GZipStream(packed, CompressionMode.Decompress)) inflater.CopyTo(stream);
            var changed = new MemoryStream();
            using (var deflater = new GZipStream(changed, CompressionMode.Compress))
            {
                byte[] bytes = change(stream.ToArray());
                deflater.Write(bytes, 0, bytes.Length);
            }
            return Joined(segment, changed.ToArray());
        }

        /// <summary>A segment with another gzip stream, and the lengths right.</summary>
        private static byte[] Joined(byte[] segment, byte[] packed)
        {
            IEnumerable<byte> head = segment.Take(4).Concat(BitConverter.GetBytes(packed.Length)).Concat(segment.Skip(8).Take(4));
            return head.Concat(packed).Concat(segment.Skip(12 + BitConverter.ToInt32(segment, 4))).ToArray();
        }

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
