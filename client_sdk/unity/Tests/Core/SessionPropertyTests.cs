using System;
using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>Random landings, aims, cuts and flipped bits: the last landing alone decides what is visible.</summary>
    [TestFixture]
    public class SessionPropertyTests
    {
        private const int Seeds = 300;
        private readonly SessionToyScene toy = new SessionToyScene();

        [TestCase(false)]
        [TestCase(true)]
        public void WhateverHappensTheVisibleSetIsThatOfTheLastLanding(bool spoils)
        {
            for (int seed = 0; seed < Seeds; seed++) OneHistory(seed, spoils);
        }

        private void OneHistory(int seed, bool spoils)
        {
            var random = new Random(seed);
            string history = "seed " + seed;
            // 1. Random conditions: memory, credit, lag, chunk sizes, limits of the server.
            long cacheBytes = Pick(random, 0, 2000, 8000, 1 << 20);
            SessionPair pair = new SessionPair(toy,
                new SessionModelOptions {
                    CacheBytes = cacheBytes,
                    CreditBytes = Pick(random, 50, 700, 1 << 20, 4000),
                    Lag = (int)Pick(random, 0, 1, 5, 30),
                    MaxChunk = (int)Pick(random, 7, 100, 100000, 900),
                    ReleaseFactor = random.Next(2) == 0 ? 1 : 1.5,
                    MaxHeldSegments = (int)Pick(random, 1, 5, 1000, 20),
                    Random = random,
                })
                                   .Connect();
            pair.OffersHeld = random.Next(2) == 0;
            // 2. A line that flips a bit of a frame now and then.
            bool spoilNext = false;
            pair.Spoil = data =>
            {
                byte[] carried = spoilNext ? SessionPair.Flipped(data) : data;
                // 4. Whatever came before, a last landing over a good line must end right.
                spoilNext = false;
                return carried;
            };
            // 3. A random history of landings, aims, lost connections, and time passing.
            for (int steps = random.Next(25); steps > 0; steps--)
            {
                switch (random.Next(6))
                {
                    case 0: pair.Client.Land(RandomPosition(random), 0.5 + 7.5 * random.NextDouble()); break;
                    case 1:
                        pair.Client.Aim(RandomPosition(random), 0.5 + 7.5 * random.NextDouble());
                        pair.Client.FlushAim();
                        break;
                    case 2:
                        pair.Disconnect();
                        pair.Connect();
                        break;
                    case 3: spoilNext = spoils; break;
                    default:
                        for (int count = random.Next(60); count > 0; count--) pair.Step();
                        break;
                }
            }
            spoilNext = false;
            pair.Client.Land(SessionToyScene.Middle, 3.3);
            pair.Settle();
            CheckEnd(pair, spoils, cacheBytes, history);
        }

        private void CheckEnd(SessionPair pair, bool spoils, long cacheBytes, string history)
        {
            // Shown is what the plan says, and what brute force says.
            uint[] visible = pair.Client.Visible.ToArray();
            PlanFacts plan = pair.Of(StreamEventKind.Planned).Last().Plan;
            uint[] planned = plan.Load.Select(facts => facts.Segment).Concat(plan.Keep).OrderBy(segment => segment).ToArray();
            Assert.AreEqual(planned, visible, history);
            Assert.AreEqual(toy.Within(SessionToyScene.Middle, 3.3), visible, history);
            Assert.IsNull(pair.Client.Unfinished, history);
            Assert.AreEqual(0, pair.Client.PartialSegments, history);
            // No byte came twice, though connections were lost: what is held was offered and kept.
            Assert.AreEqual(0, pair.Client.Stats.RepeatedBytes, history);
            if (!spoils) Assert.AreEqual(0, pair.Rejects.Count, history);
            Assert.LessOrEqual(pair.Client.Cache.Bytes, Math.Max(cacheBytes, toy.BytesOf(visible.Concat(plan.Nearby))), history);
            foreach (uint segment in visible) Assert.AreEqual(toy.Payloads[segment], pair.Payload(segment), history);
            // What was told as here and not as gone is here, and nothing else.
            var reported = new HashSet<uint>();
            foreach (StreamEvent streamEvent in pair.Events)
            {
                if (streamEvent.Kind == StreamEventKind.Arrived)
                    reported.Add(streamEvent.Facts.Segment);
                else if (streamEvent.Kind == StreamEventKind.Dropped)
                    reported.ExceptWith(streamEvent.Segments);
            }
            Assert.IsTrue(reported.All(pair.Client.Cache.Contains), history);
            Assert.AreEqual(pair.Client.Cache.Count, reported.Count, history);
            // Every landing ends in one way: ready, superseded, or the last one.
            List<int?> ends =
                pair.Events
                    .Where(streamEvent => streamEvent.Kind == StreamEventKind.Ready || streamEvent.Kind == StreamEventKind.Superseded)
                    .Select(streamEvent => streamEvent.Landing)
                    .ToList();
            Assert.AreEqual(ends.Count, ends.Distinct().Count(), history);
            // What the server believes held is here, once the next landing has told the evictions.
            pair.Client.Land(SessionToyScene.Middle, 3.3);
            pair.Settle();
            Assert.IsTrue(pair.Server.Held.All(pair.Client.Cache.Contains), history);
        }

        private static long Pick(Random random, params long[] values) { return values[random.Next(values.Length)]; }

        private static Vec3 RandomPosition(Random random)
        {
            return new Vec3(16 * random.NextDouble() - 2, 0, 16 * random.NextDouble() - 2);
        }
    }
}
