using System;
using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;
using Terraport.Sessions;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>The small parts: cache, assembly, pool, waits, pace, close codes.</summary>
    [TestFixture]
    public class SessionPartsTests
    {
        [Test]
        public void TheCacheDoesOverAnyHistoryWhatAListDoesSlowly()
        {
            for (int seed = 0; seed < 300; seed++)
            {
                var random = new Random(seed);
                // The model: a list from the least to the most recently used. Tiny bounds and seven ids, so that everything collides.
                int maxBytes = random.Next(120);
                var pool = new PayloadPool();
                var cache = new SegmentCache(maxBytes);
                var model = new List<SegmentFacts>();
                var pinned = new uint[0];
                for (int step = 0; step < 40; step++)
                {
                    // 1. One random operation on both.
                    var id = (uint)random.Next(7);
                    bool isHeld = model.Exists(entry => entry.Segment == id);
                    switch (random.Next(5))
                    {
                        case 0:
                            SegmentFacts facts = Facts(id, 1 + random.Next(50));
                            cache.Put(facts, pool.Rent(facts.Length));
                            model.RemoveAll(entry => entry.Segment == id);
                            model.Add(facts);
                            break;
                        case 1:
                            Assert.AreEqual(isHeld, cache.Touch(id));
                            if (!isHeld) break;
                            SegmentFacts touched = model.Find(entry => entry.Segment == id);
                            model.RemoveAll(entry => entry.Segment == id);
                            model.Add(touched);
                            break;
                        case 2:
                            Assert.AreEqual(isHeld, cache.Discard(id));
                            model.RemoveAll(entry => entry.Segment == id);
                            break;
                        case 3:
                            pinned = new[] { id, (id + 1) % 7 };
                            cache.UnpinAll();
                            cache.Pin(pinned);
                            break;
                        default:
                            var evicted = new List<SegmentFacts>();
                            cache.Trim(evicted);
                            Assert.AreEqual(Trimmed(model, pinned, maxBytes), evicted.Select(entry => entry.Segment).ToList());
                            break;
                    }
                    // 2. After each: the same segments in the same order of use, and the same bytes.
                    Assert.AreEqual(Enumerable.Reverse(model).Select(entry => entry.Segment), cache.Rows().Select(row => row.Segment));
                    Assert.AreEqual(model.Sum(entry => entry.Length), cache.Bytes);
                }
            }
        }

        [Test]
        public void APinnedPayloadOutlivesItsEvictionAndItsBufferIsThenUsedAgain()
        {
            var pool = new PayloadPool();
            var cache = new SegmentCache(0);
            PayloadBuffer buffer = pool.Rent(100);
            byte[] data = buffer.Data;
            data[99] = 42;
            cache.Put(Facts(1, 100), buffer);
            PinnedPayload pin;
            Assert.IsTrue(cache.TryPin(1, out pin));
            cache.Trim(new List<SegmentFacts>());
            Assert.IsFalse(cache.Contains(1));
            Assert.AreNotSame(data, pool.Rent(100).Data);
            Assert.AreEqual(100, pin.Bytes.Count);
            Assert.AreEqual(42, pin.Bytes.Array[99]);
            pin.Dispose();
            Assert.AreSame(data, pool.Rent(100).Data);
            Assert.IsFalse(cache.TryPin(1, out pin));
        }

        [Test]
        public void ThePoolBoundsWhatLiesIdleAndWastesLittle()
        {
            var pool = new PayloadPool(20000);
            var buffers = new List<PayloadBuffer>();
            for (int count = 0; count < 10; count++) buffers.Add(pool.Rent(4096));
            foreach (PayloadBuffer buffer in buffers) buffer.Release();
            Assert.AreEqual(4 * 4096, pool.IdleBytes);
            foreach (int length in new[] { 1, 4096, 4097, 5000, 100000, 131048, 1000003, WireLimits.MaxSegmentBytes })
            {
                Assert.That(pool.Rent(length).Data.Length, Is.InRange(length, Math.Max(4096, length + length / 4)));
            }
            Assert.Throws<ArgumentOutOfRangeException>(() => new PayloadPool(-1));
            Assert.Throws<ArgumentOutOfRangeException>(() => new SegmentCache(-1));
        }

        [Test]
        public void AssemblyGivesThePayloadHoweverItWasCut()
        {
            byte[] payload = Enumerable.Range(0, 40000).Select(at => (byte)(at * 7 >> 3)).ToArray();
            for (int seed = 0; seed < 50; seed++)
            {
                var random = new Random(seed);
                var assembler = new Assembler(new PayloadPool());
                PayloadBuffer whole = null;
                for (int at = 0; at < payload.Length;)
                {
                    Assert.IsNull(whole);
                    Assert.AreEqual(at, assembler.Received(1));
                    int end = Math.Min(payload.Length, at + 1 + random.Next(seed % 2 == 0 ? 9000 : 45000));
                    whole = assembler.Take(Chunk(payload, at, end), payload.Length);
                    at = end;
                }
                Assert.AreEqual(payload.Length, whole.Length);
                Assert.AreEqual(payload, whole.Data.Take(whole.Length).ToArray());
                Assert.AreEqual(0, assembler.Count);
            }
        }

        [TestCase(2, 4, 40, "continues at byte 2, expected 3")]
        [TestCase(4, 5, 40, "continues at byte 4, expected 3")]
        [TestCase(3, 5, 39, "announces 40 bytes, expected 39 by the plan")]
        public void AssemblyRefusesAGapAnOverlapAndAWrongTotal(int start, int end, int length, string text)
        {
            var payload = new byte[40];
            var assembler = new Assembler(new PayloadPool());
            assembler.Take(Chunk(payload, 0, 3), 40);
            var error = Assert.Throws<ProtocolViolationException>(() => assembler.Take(Chunk(payload, start, end), length));
            StringAssert.Contains(text, error.Message);
        }

        [Test]
        public void AssemblyForgetsThePartsThatAPlanDoesNotNeed()
        {
            var payload = new byte[40];
            var assembler = new Assembler(new PayloadPool());
            foreach (uint segment in new uint[] { 1, 2, 3 }) assembler.Take(Chunk(payload, 0, 3, segment), 40);
            assembler.KeepOnly(new Dictionary<uint, SegmentFacts> { { 2, Facts(2, 40) } });
            Assert.AreEqual(new[] { 0, 3, 0 }, new uint[] { 1, 2, 3 }.Select(assembler.Received).ToArray());
            assembler.Clear();
            Assert.AreEqual(0, assembler.Count);
        }

        [TestCase(0)]
        [TestCase(1)]
        [TestCase(5)]
        [TestCase(6)]
        [TestCase(60)]
        [TestCase(1000000)]
        public void WaitsStayBetweenHalfAndAllOfTheDoubling(int attempt)
        {
            double fullWaitMs = Math.Min(30000, 500 * Math.Pow(2, Math.Min(attempt, 30)));
            Assert.AreEqual(fullWaitMs / 2, Backoff.WaitMs(attempt, 0));
            Assert.AreEqual(fullWaitMs, Backoff.WaitMs(attempt, 1));
            Assert.AreEqual(fullWaitMs * 0.75, Backoff.WaitMs(attempt, 0.5));
        }

        [Test]
        public void ConnectionsAreMadeAgainAfterExactlyTheCloseCodesThatTheProtocolLists()
        {
            foreach (int code in new[] { 1001, 1006, 1011, 1012, 4408, 4429, 4500, 4503 })
            {
                Assert.AreEqual(AfterClose.Again, Closes.After(code), code.ToString());
            }
            foreach (int code in new[] { 4400, 4403, 4404, 4409, 4413 }) Assert.AreEqual(AfterClose.Stop, Closes.After(code));
            Assert.AreEqual(AfterClose.Done, Closes.After(1000));
            Assert.AreEqual(AfterClose.Token, Closes.After(4401));
            Assert.AreEqual(4401, Closes.OfHttpStatus(401));
            Assert.AreEqual(4503, Closes.OfHttpStatus(503));
            Assert.AreEqual(1006, Closes.OfHttpStatus(418));
            Assert.AreEqual("unknown_scene", Closes.ErrorOf(4404));
            Assert.AreEqual("closed", Closes.ErrorOf(1006));
        }

        [Test]
        public void ThePaceIsOneThatTheServersOwnBucketNeverFindsTooFast()
        {
            for (int seed = 0; seed < 50; seed++)
            {
                var random = new Random(seed);
                double perS = 0.5 + 200 * random.NextDouble();
                double nowMs = 1000;
                var pacer = new Pacer(perS, nowMs);
                double tokens = Math.Max(1, perS * 10);
                for (int message = 0; message < 300; message++)
                {
                    double beforeMs = nowMs;
                    nowMs += random.NextDouble() * 3000 * (seed % 2);
                    nowMs += pacer.Take(nowMs);
                    tokens = Math.Min(Math.Max(1, perS * 10), tokens + (nowMs - beforeMs) / 1000 * perS) - 1;
                    Assert.GreaterOrEqual(tokens, -1e-6);
                }
            }
        }

        [Test]
        public void ATokenTravelsAsASubprotocolWhereNoHeaderCan()
        {
            Assert.AreEqual("terraport.token.c2VjcmV0Pz8_", WireCodec.TokenSubprotocol("secret???"));
            Assert.AreEqual("terraport.token.w6k", WireCodec.TokenSubprotocol("\u00e9"));
        }

        private static SegmentFacts Facts(uint segment, int length)
        {
            return new SegmentFacts(segment, length, segment + 5, 1, 3, default(Box));
        }

        private static PayloadFrame Chunk(byte[] payload, int start, int end, uint segment = 1)
        {
            return new PayloadFrame(1, segment, start, payload.Length, new ArraySegment<byte>(payload, start, end - start));
        }

        private static List<uint> Trimmed(List<SegmentFacts> model, uint[] pinned, int maxBytes)
        {
            var evicted = new List<uint>();
            foreach (SegmentFacts facts in model.ToList())
            {
                if (model.Sum(entry => entry.Length) <= maxBytes) break;
                if (pinned.Contains(facts.Segment)) continue;
                model.Remove(facts);
                evicted.Add(facts.Segment);
            }
            return evicted;
        }
    }
}
