using System;
using System.Collections.Generic;
using System.Threading;
using NUnit.Framework;
using Terraport.Sessions;

namespace Terraport.Tests
{
    /// <summary>Both queues: every payload comes out once, as a mesh or an error, and its bytes are let go.</summary>
    [TestFixture]
    public class DecodeQueueTests
    {
        private static readonly CorpusPayload Payload = new CorpusPayload("good-attributes.tsg");
        private static readonly byte[] Good = Payload.Bytes;
        private static readonly IReadOnlyList<AttributeInfo> Attributes = Payload.Attributes;

        [Test]
        public void Threads_DecodeEverything()
        {
            int hooks = 0;
            using (var queue = new DecodeThreads(3, mesh => Interlocked.Increment(ref hooks)))
            {
                CheckAll(queue);
                // Every fourth payload is damaged, and has no mesh to be packed.
                Assert.AreEqual(75, hooks);
            }
        }

        [Test]
        public void Inline_DecodesEverything()
        {
            using (var queue = new InlineDecodes()) { CheckAll(queue); }
        }

        [Test]
        public void Hook_ThatThrows_FailsItsSegmentAlone()
        {
            using (var queue = new DecodeThreads(1,
                       mesh =>
                       { throw new InvalidOperationException("mine"); }))
            {
                var pool = new PayloadPool();
                queue.Enqueue(1, 0, Attributes, Pin(pool, Good));
                queue.Enqueue(2, 0, Attributes, Pin(pool, Good));
                for (int at = 0; at < 2; at++)
                {
                    DecodeResult result = Take(queue);
                    Assert.IsNull(result.Mesh);
                    Assert.AreEqual("internal", result.Error.Code);
                }
            }
        }

        [Test]
        public void Dispose_LetsGoOfWhatWaits()
        {
            var pool = new PayloadPool();
            PayloadBuffer buffer = pool.Rent(Good.Length);
            long size = buffer.Data.Length;
            buffer.Release();
            using (var gate = new ManualResetEvent(false))
            {
                // The one thread stands in its hook: nine payloads wait behind it.
                var queue = new DecodeThreads(1, mesh => gate.WaitOne());
                for (uint segment = 0; segment < 10; segment++)
                {
                    queue.Enqueue(segment, 0, Attributes, Pin(pool, Good));
                }
                Assert.AreEqual(0, pool.IdleBytes);
                gate.Set();
                queue.Dispose();
                Assert.AreEqual(10 * size, pool.IdleBytes);
                queue.Enqueue(11, 0, Attributes, Pin(pool, Good));
            }
            Assert.AreEqual(10 * size, pool.IdleBytes, "a queue that was disposed of lets go at once");
        }

        private static void CheckAll(IDecodeQueue queue)
        {
            var pool = new PayloadPool();
            var seen = new HashSet<uint>();
            for (uint segment = 0; segment < 100; segment++)
            {
                queue.Enqueue(segment, 7, Attributes, Pin(pool, segment % 4 == 3 ? new byte[64] : Good));
            }
            for (int count = 0; count < 100; count++)
            {
                DecodeResult result = Take(queue);
                Assert.IsTrue(seen.Add(result.Segment));
                Assert.AreEqual(7, result.Epoch);
                Assert.AreEqual(result.Segment % 4 == 3, result.Mesh == null);
                Assert.AreEqual(result.Segment % 4 == 3, result.Error is PayloadException);
                if (result.Mesh != null)
                {
                    Assert.AreEqual(9, result.Mesh.VertexCount);
                    queue.Recycle(result.Mesh);
                }
            }
            DecodeResult none;
            Assert.IsFalse(queue.TryTake(out none));
        }

        private static DecodeResult Take(IDecodeQueue queue)
        {
            DecodeResult result;
            for (int wait = 0; wait < 5000; wait++)
            {
                if (queue.TryTake(out result))
                {
                    return result;
                }
                if (!queue.Step())
                {
                    Thread.Sleep(1);
                }
            }
            throw new TimeoutException("nothing came");
        }

        private static PinnedPayload Pin(PayloadPool pool, byte[] bytes)
        {
            PayloadBuffer buffer = pool.Rent(bytes.Length);
            Buffer.BlockCopy(bytes, 0, buffer.Data, 0, bytes.Length);
            return new PinnedPayload(buffer, default(SegmentFacts));
        }
    }
}
