using System;
using System.Collections.Generic;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>Decoding makes no garbage that grows with a payload, once its buffers are large enough: a frame must not wait for a collector.</summary>
    [TestFixture]
    public class DecodeAllocationTests
    {
        private const int Decodes = 200;
        /// <summary>.NET's has to be made anew for each stream: a buffer of 4096 bytes, and some objects.</summary>
        private const int InflaterBytes = 5000;

        [TestCase("good-full.glb", 0)]
        [TestCase("good-float.glb", 0)]
        [TestCase("good-jpeg.glb", 0)]
        [TestCase("good-plain.tsg", InflaterBytes)]
        [TestCase("good-strips.tsg", InflaterBytes)]
        [TestCase("good-jpeg.tsg", InflaterBytes)]
        public void Decode_InSteadyState_AllocatesNoMoreThanItsInflater(string name, int bytes)
        {
            var payload = new CorpusPayload(name);
            var whole = new ArraySegment<byte>(payload.Bytes);
            IReadOnlyList<AttributeInfo> attributes = payload.IsSegment ? payload.Attributes : null;
            var segments = new SegmentDecoder();
            var bases = new GlbDecoder();
            var mesh = new SegmentMesh();
            Action decode = () => bases.Decode(whole, mesh);
            if (payload.IsSegment) decode = () => segments.Decode(whole, attributes, mesh);
            long allocated = Allocations.Of(Decodes, decode);
            Assert.Greater(mesh.VertexCount, 0);
            Assert.LessOrEqual(allocated, (long)bytes * Decodes);
        }

        [Test]
        public void Hash_AllocatesNothing()
        {
            byte[] bytes = Noise.Bytes(2000);
            ulong sum = 0;
            long allocated = Allocations.Of(Decodes, () => sum += Xxh3.Hash64(bytes));
            Assert.AreNotEqual(0, sum);
            Assert.AreEqual(0, allocated);
        }
    }
}
