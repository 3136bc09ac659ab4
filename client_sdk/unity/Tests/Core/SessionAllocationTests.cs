using System;
using System.Collections.Generic;
using System.Linq;
using System.Reflection;
using NUnit.Framework;
using Terraport.Sessions;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>What a segment costs the garbage collector once everything has its size: nothing.</summary>
    [TestFixture]
    public class SessionAllocationTests
    {
        private const int Segments = 500;
        private const int SegmentBytes = 300000;
        private const int ChunkBytes = 100000;

        [Test]
        public void SegmentsAllocateNothingOnceThePoolIsWarm()
        {
            // By reflection: Unity's class libraries may lack it.
            MethodInfo method = typeof(GC).GetMethod(
                "GetAllocatedBytesForCurrentThread", BindingFlags.Static | BindingFlags.Public | BindingFlags.NonPublic);
            if (method == null) Assert.Ignore("this platform does not count what is allocated");
            var allocated = (Func<long>)Delegate.CreateDelegate(typeof(Func<long>), method);
            var payload = new byte[SegmentBytes];
            new Random(3).NextBytes(payload);
            ulong hash = Xxh3.Hash64(payload, 0, payload.Length);
            var session = new ClientSession(new SessionOptions { CreditBytes = 1L << 40, CacheBytes = 1L << 30 });
            Open(session);
            var costs = new List<long>();
            // Four rounds of new ids: the first fills the pool, the second the tables, and then nothing may be allocated.
            for (uint round = 1; round <= 4; round++)
            {
                uint first = (round - 1) * 20;
                byte[][] frames = Frames(payload, round, first);
                Give(session, Prefetch(round, first, hash));
                long before = allocated();
                foreach (byte[] frame in frames)
                {
                    session.Receive(new ArraySegment<byte>(frame), false);
                    Drain(session);
                }
                costs.Add(allocated() - before);
                Assert.AreEqual(20, session.Cache.Count);
                // The server drops all of it, so the buffers go back.
                Give(session,
                    WireCodec.Encode(new HeldCheckedMessage { Dropped = session.Cache.Rows().ConvertAll(row => row.Segment).ToArray() }));
                Drain(session);
            }
            Assert.Greater(costs[0], 20 * SegmentBytes);
            Assert.AreEqual(0, costs.Skip(2).Max(), string.Join(", ", costs.Select(cost => cost.ToString()).ToArray()));
        }

        private static void Drain(ClientSession session)
        {
            StreamEvent next;
            while (session.TryNextEvent(out next))
            {
                if (next.Kind != StreamEventKind.Arrived) continue;
                PinnedPayload pin;
                if (session.Cache.TryPin(next.Facts.Segment, out pin)) pin.Dispose();
            }
        }

        private static void Open(ClientSession session)
        {
            var server = new StreamAnsweringServer(new StreamToyScene());
            session.Connected();
            var sent = new Queue<byte[]>();
            session.TakeMessages(sent);
            server.Receive(sent.Dequeue());
            Give(session, server.Next());
            session.Aim(new Vec3(0, 0, 0), 1);
            session.FlushAim();
        }

        private static byte[] Prefetch(uint generation, uint first, ulong hash)
        {
            var segments = new SegmentFacts[20];
            for (uint number = 0; number < segments.Length; number++)
            {
                segments[number] = new SegmentFacts((first + number) % Segments, SegmentBytes, hash, 1, 3, default(Box));
            }
            return WireCodec.Encode(new PrefetchMessage { Generation = generation, Segments = segments, Bytes = 20L * SegmentBytes });
        }

        private static byte[][] Frames(byte[] payload, uint generation, uint first)
        {
            var frames = new List<byte[]>();
            for (uint number = 0; number < 20; number++)
            {
                for (int at = 0; at < SegmentBytes; at += ChunkBytes)
                {
                    var chunk = new ArraySegment<byte>(payload, at, ChunkBytes);
                    frames.Add(new PayloadFrame(generation, (first + number) % Segments, at, SegmentBytes, chunk).Encode());
                }
            }
            return frames.ToArray();
        }

        private static void Give(ClientSession session, byte[] data) { session.Receive(new ArraySegment<byte>(data), false); }
    }
}
