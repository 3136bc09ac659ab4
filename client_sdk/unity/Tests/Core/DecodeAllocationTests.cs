using System;
using System.IO;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>Decoding makes no garbage once its buffers are large enough: a frame must not wait for a collector.</summary>
    [TestFixture]
    public class DecodeAllocationTests
    {
        private const int Decodes = 200;

        [TestCase("good-full.glb")]
        [TestCase("good-float.glb")]
        [TestCase("good-jpeg.glb")]
        public void Decode_InSteadyState_AllocatesNothing(string name)
        {
            var payload = new ArraySegment<byte>(File.ReadAllBytes(Repository.PathTo("tests/conformance/scene/payload/" + name)));
            var decoder = new SegmentDecoder();
            var mesh = new SegmentMesh();
            long allocated = Allocations.Of(Decodes, () => decoder.Decode(payload, mesh));
            Assert.Greater(mesh.VertexCount, 0);
            Assert.AreEqual(0, allocated);
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
