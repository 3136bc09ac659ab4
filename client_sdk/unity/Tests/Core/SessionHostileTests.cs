using System;
using System.Collections.Generic;
using NUnit.Framework;
using Terraport.Sessions;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>What the protocol forbids, from either side.</summary>
    [TestFixture]
    public class SessionHostileTests
    {
        private static readonly Vec3 Corner = SessionToyScene.Corner;
        private readonly SessionToyScene toy = new SessionToyScene();

        [Test]
        public void NumbersThatCannotBeAreRefusedHereAndChangeNothing()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            ClientSession client = pair.Client;
            var calls = new Dictionary<string, Action> {
                { "radius_m 0", () => client.Land(Corner, 0) },
                { "radius_m negative", () => client.Land(Corner, -1) },
                { "radius_m NaN", () => client.Land(Corner, double.NaN) },
                { "radius_m too large", () => client.Land(Corner, 1e7) },
                { "position", () => client.Land(new Vec3(double.PositiveInfinity, 0, 0), 1) },
                { "deadline_ms", () => client.Land(Corner, 1, new LandOptions { DeadlineMs = 5 }) },
                { "stall_ms", () => client.Land(Corner, 1, new LandOptions { StallMs = 5 }) },
                { "inner_radius_m", () => client.Land(Corner, 1, new LandOptions { InnerRadiusM = 2 }) },
                { "radius_m of an aim", () => client.Aim(Corner, 0) },
                { "direction", () => client.Pick(Corner, Corner) },
                { "origin", () => client.Pick(new Vec3(0, double.NaN, 0)) },
            };
            foreach (KeyValuePair<string, Action> call in calls)
            {
                string field = call.Key.Split(' ')[0];
                var error = Assert.Throws<InvalidMessageException>(() => call.Value(), call.Key);
                Assert.AreEqual(field, error.Field, call.Key);
            }
            // Nothing was sent, noted or counted: the next landing is the first.
            Assert.AreEqual(0, pair.TakeSent().Count);
            Assert.IsFalse(client.AwaitsAnswer);
            Assert.IsFalse(client.HasAim);
            Assert.AreEqual(1, client.Land(Corner, 1));
        }

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
        public void WhatTheServerMustNotSendIsAViolation()
        {
            Violates("got 0 bytes", pair => pair.Give(new byte[0]));
            Violates("0xc1", pair => pair.Give(new byte[] { 0xc1 }));
            Violates("text", pair => pair.Client.Receive(new ArraySegment<byte>(new byte[] { 0x7b, 0x7d }), true));
            Violates("frame kind 0x00", pair => pair.Give(new byte[30]));
            Violates("generation 5", pair => pair.Give(Frame(5, 1, 0, 4)));
            Violates("does not load", pair => pair.Give(Frame(1, 35, 0, 4)));
            Violates("announces", pair => pair.Give(Frame(1, 0, 0, toy.Payloads[0].Length + 1)));
            Violates("continues at byte 1, expected 0", pair => pair.Give(Frame(1, 0, 1, toy.Payloads[0].Length)));
            Violates("second welcome", pair => pair.Give(Welcome(1)));
            Violates("ready of generation 7", pair => Say(pair, new ReadyMessage { Generation = 7, Missing = new uint[0] }));
        }

        [Test]
        public void AnotherMajorVersionIsAViolation()
        {
            var pair = new SessionPair(toy);
            pair.Client.Connected();
            var error = Assert.Throws<ProtocolViolationException>(() => pair.Give(Welcome(2)));
            StringAssert.Contains("protocol 2.1", error.Message);
        }

        [Test]
        public void APlanBeforeTheWelcomeOrASecondOneIsAViolation()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            pair.Client.Land(SessionToyScene.Middle, 1);
            foreach (byte[] data in pair.TakeSent()) pair.Server.Receive(data);
            byte[] plan = pair.Server.Next();
            var ungreeted = new SessionPair(toy);
            ungreeted.Client.Connected();
            StringAssert.Contains("plan first", Assert.Throws<ProtocolViolationException>(() => ungreeted.Give(plan)).Message);
            pair.Give(plan);
            var error = Assert.Throws<ProtocolViolationException>(() => pair.Give(plan));
            StringAssert.Contains("plan of generation 1, expected none", error.Message);
        }

        [Test]
        public void APlanThatKeepsWhatWasNeverHeldIsAViolation()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            // The server believes in a segment that the client never had.
            pair.Server.Held.Add(7);
            pair.Client.Land(new Vec3(2, 0, 2), 1);
            var error = Assert.Throws<ProtocolViolationException>(() => pair.Settle());
            StringAssert.Contains("keeps segment 7, which was never held", error.Message);
        }

        [Test]
        public void DeclaredLengthsReserveNothing()
        {
            // A plan of many segments of 64 MiB each, and one byte of every one of them.
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            pair.Client.Land(SessionToyScene.Middle, 1);
            pair.TakeSent();
            var load = new SegmentFacts[1000];
            for (uint segment = 0; segment < load.Length; segment++)
            {
                load[segment] = new SegmentFacts(segment, WireLimits.MaxSegmentBytes, 0, 1, 1, default(Box));
            }
            long bytes = (long)load.Length * WireLimits.MaxSegmentBytes;
            long before = GC.GetTotalMemory(true);
            Say(pair,
                new PlanMessage {
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
                });
            for (uint segment = 0; segment < load.Length; segment++) pair.Give(Frame(1, segment, 0, WireLimits.MaxSegmentBytes));
            Assert.AreEqual(load.Length, pair.Client.PartialSegments);
            // Some 62 GiB are announced, 1000 bytes have come: a buffer grows with what comes.
            Assert.Less(GC.GetTotalMemory(true) - before, 16L * 1024 * 1024);
        }

        [Test]
        public void MutilatedMessagesAreViolationsAndNothingElse()
        {
            var random = new Random(11);
            int violations = 0;
            for (int count = 0; count < 3000; count++)
            {
                SessionPair pair = new SessionPair(toy).Connect();
                pair.Settle();
                pair.Client.Land(Corner, 2);
                for (int step = random.Next(8); step >= 0; step--) pair.Step();
                foreach (byte[] data in pair.TakeSent()) pair.Server.Receive(data);
                byte[] next = pair.Server.Next() ?? Welcome(1);
                for (int flips = random.Next(4); flips >= 0; flips--) next[random.Next(next.Length)] = (byte)random.Next(256);
                // Flipped bytes, and every third time cut short.
                if (random.Next(3) == 0) Array.Resize(ref next, random.Next(next.Length));
                try
                {
                    pair.Give(next);
                }
                catch (ProtocolViolationException)
                {
                    violations++;
                }
            }
            Assert.Greater(violations, 500);
        }

        private void Violates(string text, Action<SessionPair> give)
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            pair.Client.Land(Corner, 1);
            pair.Until(() => pair.Of(StreamEventKind.Planned).Count > 0);
            var error = Assert.Throws<ProtocolViolationException>(() => give(pair), text);
            StringAssert.Contains(text, error.Message);
        }

        private static void Say(SessionPair pair, WireMessage message) { pair.Give(WireCodec.Encode(message)); }

        private static byte[] Frame(uint generation, uint segment, int offset, int total)
        {
            return new PayloadFrame(generation, segment, offset, total, new ArraySegment<byte>(new byte[1])).Encode();
        }

        private byte[] Welcome(int major)
        {
            var server = new SessionModelServer(toy, new SessionModelOptions());
            var client = new SessionPair(toy);
            client.Client.Connected();
            foreach (byte[] data in client.TakeSent()) server.Receive(data);
            var welcome = (WelcomeMessage)WireCodec.Decode(new ArraySegment<byte>(server.Next()), Direction.ServerToClient);
            welcome.Protocol = new ProtocolVersion(major, 1);
            return WireCodec.Encode(welcome);
        }
    }
}
