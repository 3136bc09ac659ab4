using System;
using System.Collections.Generic;
using NUnit.Framework;
using Terraport.Sessions;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>What no server should send, beside what the session corpus has of it.</summary>
    [TestFixture]
    public class SessionHostileTests
    {
        private static readonly Vec3 Corner = new Vec3(0, 0, 0);
        private readonly StreamToyScene toy = new StreamToyScene();

        [Test]
        public void OptionsThatCannotBeAreRefusedHere()
        {
            Assert.Catch<ArgumentException>(() => new ClientSession(new SessionOptions { CreditBytes = 0 }));
            Assert.Catch<ArgumentException>(() => new ClientSession(new SessionOptions { CacheBytes = -1 }));
            Assert.Catch<ArgumentException>(() => new ClientSession(new SessionOptions { Budgets = new Budgets { MaxBytes = -1 } }));
            Assert.Catch<ArgumentException>(() => new ClientSession(new SessionOptions { ReleaseFactor = 0.5 }));
            Assert.Catch<ArgumentException>(() => new ClientSession(new SessionOptions { Client = new string('x', 129) }));
        }

        [Test]
        public void AnotherMajorVersionIsAViolation()
        {
            ClientSession session = Connected();
            byte[] data = Answers(session, new StreamAnsweringServer(toy))[0];
            var welcome = (WelcomeMessage)WireCodec.Decode(new ArraySegment<byte>(data), Direction.ServerToClient);
            welcome.Protocol = new ProtocolVersion(2, 1);
            var error = Assert.Throws<ProtocolViolationException>(() => Give(session, WireCodec.Encode(welcome)));
            StringAssert.Contains("protocol 2.1", error.Message);
        }

        [Test]
        public void MoreGpuBytesThanAllowedAreAViolation()
        {
            var session = new ClientSession(new SessionOptions {
                Client = "t",
                CreditBytes = 100,
                Budgets = new Budgets { MaxGpuBytes = 1000, GpuVertexBytes = 24 },
            });
            session.Connected();
            foreach (byte[] data in Answers(session, new StreamAnsweringServer(toy))) Give(session, data);
            session.Land(Corner, 1);
            session.TakeMessages(new Queue<byte[]>());
            PlanMessage plan = EmptyPlan();
            plan.TotalGpuBytes = 1001;
            var error = Assert.Throws<ProtocolViolationException>(() => Give(session, WireCodec.Encode(plan)));
            StringAssert.Contains("1001 GPU bytes", error.Message);
            plan.TotalGpuBytes = 1000;
            Give(session, WireCodec.Encode(plan));
        }

        [Test]
        public void DeclaredLengthsReserveNothing()
        {
            // A plan of many segments of 64 MiB each, and one byte of every one of them.
            ClientSession session = Connected();
            foreach (byte[] data in Answers(session, new StreamAnsweringServer(toy))) Give(session, data);
            session.Land(Corner, 1);
            session.TakeMessages(new Queue<byte[]>());
            var load = new SegmentFacts[1000];
            for (uint segment = 0; segment < load.Length; segment++)
            {
                load[segment] = new SegmentFacts(segment, WireLimits.MaxSegmentBytes, 0, 1, 1, default(Box));
            }
            long bytes = (long)load.Length * WireLimits.MaxSegmentBytes;
            long before = GC.GetTotalMemory(true);
            var plan = new PlanMessage {
                Generation = 1,
                RadiusM = 1,
                ReleaseRadiusM = 1,
                EffectiveRadiusM = 1,
                Load = load,
                Keep = new uint[0],
                Nearby = new uint[0],
                LoadBytes = bytes,
                LoadTriangles = load.Length,
                TotalBytes = bytes,
                TotalTriangles = load.Length,
            };
            Give(session, WireCodec.Encode(plan));
            var one = new ArraySegment<byte>(new byte[1]);
            for (uint segment = 0; segment < load.Length; segment++)
            {
                Give(session, new PayloadFrame(1, segment, 0, WireLimits.MaxSegmentBytes, one).Encode());
            }
            Assert.AreEqual(load.Length, session.PartialSegments);
            // Some 62 GiB are announced, 1000 bytes have come: a buffer grows with what comes.
            Assert.Less(GC.GetTotalMemory(true) - before, 16L * 1024 * 1024);
        }

        private static PlanMessage EmptyPlan()
        {
            return new PlanMessage {
                Generation = 1,
                RadiusM = 1,
                ReleaseRadiusM = 1,
                EffectiveRadiusM = 1,
                Load = new SegmentFacts[0],
                Keep = new uint[0],
                Nearby = new uint[0],
            };
        }

        [Test]
        public void MutilatedMessagesAreViolationsAndNothingElse()
        {
            var random = new Random(11);
            int violations = 0;
            for (int count = 0; count < 3000; count++)
            {
                ClientSession session = Connected();
                var server = new StreamAnsweringServer(toy);
                List<byte[]> said = Answers(session, server);
                if (random.Next(4) > 0)
                {
                    Give(session, said[0]);
                    session.Land(Corner, 2);
                    said = Answers(session, server);
                    for (int heard = random.Next(said.Count); heard > 0; heard--)
                    {
                        Give(session, said[0]);
                        said.RemoveAt(0);
                    }
                }
                byte[] next = said[0];
                for (int flips = random.Next(4); flips >= 0; flips--) next[random.Next(next.Length)] = (byte)random.Next(256);
                // Flipped bytes, and every third time cut short.
                if (random.Next(3) == 0) Array.Resize(ref next, random.Next(next.Length));
                try
                {
                    Give(session, next);
                }
                catch (ProtocolViolationException)
                {
                    violations++;
                }
            }
            Assert.Greater(violations, 500);
        }

        private static ClientSession Connected()
        {
            var session = new ClientSession(new SessionOptions());
            session.Connected();
            return session;
        }

        /// <summary>All that a server says to what the session has to say.</summary>
        private static List<byte[]> Answers(ClientSession session, StreamAnsweringServer server)
        {
            var sent = new Queue<byte[]>();
            session.TakeMessages(sent);
            foreach (byte[] data in sent) server.Receive(data);
            var said = new List<byte[]>();
            for (byte[] data = server.Next(); data != null; data = server.Next()) said.Add(data);
            return said;
        }

        private static void Give(ClientSession session, byte[] data) { session.Receive(new ArraySegment<byte>(data), false); }
    }
}
