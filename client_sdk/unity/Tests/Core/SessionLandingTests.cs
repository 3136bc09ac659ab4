using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>Landings, supersede, resume: the client's state machine against the model server.</summary>
    [TestFixture]
    public class SessionLandingTests
    {
        private static readonly Vec3 Middle = SessionToyScene.Middle;
        private static readonly Vec3 Corner = SessionToyScene.Corner;
        private readonly SessionToyScene toy = new SessionToyScene();

        [Test]
        public void ShowsExactlyWhatBruteForceFinds()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            int number = pair.Client.Land(Middle, 4);
            pair.Settle();
            uint[] expected = toy.Within(Middle, 4);
            // One event tells it, and the cache, the counters and the payloads agree with it.
            StreamEvent ready = pair.Of(StreamEventKind.Ready).Single();
            Assert.AreEqual(number, ready.Landing);
            Assert.AreEqual(expected, ready.Segments);
            Assert.AreEqual(0, ready.Missing.Count);
            Assert.AreEqual(toy.BytesOf(expected), ready.Bytes);
            Assert.AreEqual(expected, pair.Client.Visible);
            Assert.AreEqual(toy.BytesOf(expected), pair.Server.ChunkBytes);
            Assert.AreEqual(toy.BytesOf(expected), pair.Client.Stats.PayloadBytes);
            foreach (uint segment in expected) Assert.AreEqual(toy.Payloads[segment], pair.Payload(segment));
            PlanFacts plan = pair.Of(StreamEventKind.Planned).Single().Plan;
            Assert.AreEqual(expected.Length, plan.Load.Count);
            foreach (SegmentFacts facts in plan.Load)
            {
                SegmentFacts indexed = toy.Facts[facts.Segment];
                Assert.AreEqual(indexed.Xxh3, facts.Xxh3);
                Assert.AreEqual(indexed.Bounds, facts.Bounds);
                Assert.AreEqual(indexed.Faces, facts.Faces);
            }
        }

        [Test]
        public void CostsNoBytesTheSecondTime()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            for (int visit = 0; visit < 2; visit++)
            {
                pair.Client.Land(Middle, 4);
                pair.Settle();
            }
            List<StreamEvent> plans = pair.Of(StreamEventKind.Planned);
            // The second plan keeps everything: nothing is loaded, and nothing arrives twice.
            Assert.AreEqual(0, plans[1].Plan.LoadBytes);
            Assert.AreEqual(plans[0].Plan.Load.Count, plans[1].Plan.Keep.Count);
            Assert.AreEqual(0, pair.Of(StreamEventKind.Ready)[1].Bytes);
            Assert.AreEqual(pair.Received.Count, pair.Received.Distinct().Count());
        }

        [Test]
        public void KeepsWhatLiesALittleBeyondItsRadiusAndDoesNotShowIt()
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { CacheBytes = 0, ReleaseFactor = 1.5 }).Connect();
            // In and out again, within the release radius of the inner landing: 4.5 m x 1.5 is more than 6 m.
            foreach (double radiusM in new[] { 6, 4.5, 6 })
            {
                pair.Client.Land(Middle, radiusM);
                pair.Settle();
                Assert.AreEqual(toy.Within(Middle, radiusM), pair.Client.Visible);
            }
            PlanFacts[] plans = pair.Of(StreamEventKind.Planned).Select(streamEvent => streamEvent.Plan).ToArray();
            Assert.AreEqual(toy.Within(Middle, 6).Except(toy.Within(Middle, 4.5)).ToArray(), plans[1].Nearby);
            Assert.IsNotEmpty(plans[1].Nearby);
            Assert.IsEmpty(plans[2].Load);
            Assert.IsEmpty(pair.Of(StreamEventKind.Dropped));
            // A landing so small that most of it lies beyond its release radius: with a cache of 0 bytes that is dropped.
            pair.Client.Land(Middle, 1);
            pair.Settle();
            uint[] dropped = pair.Of(StreamEventKind.Dropped).SelectMany(streamEvent => streamEvent.Segments).ToArray();
            Assert.IsNotEmpty(dropped);
            Assert.IsEmpty(dropped.Intersect(toy.Within(Middle, 1.5)));
        }

        [Test]
        public void IsNotReadyBeforeTheServerSaysSoThoughItIsWhole()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Client.Land(Middle, 4);
            int count = toy.Within(Middle, 4).Length;
            // Every byte is here, but the server's ready is still on its way: it may yet name missing segments.
            pair.Until(() => pair.Received.Count == count);
            Assert.AreEqual(0, pair.Of(StreamEventKind.Ready).Count);
            Assert.AreEqual(0, pair.Client.Visible.Count);
            pair.Settle();
            Assert.AreEqual(1, pair.Of(StreamEventKind.Ready).Count);
        }

        [Test]
        public void ComesWholeHoweverSmallTheCredit()
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { CreditBytes = 1 }).Connect();
            pair.Client.Land(Corner, 0.5);
            pair.Settle();
            Assert.AreEqual(new uint[] { 0 }, pair.Client.Visible);
        }

        [Test]
        public void IsGrantedCreditInStepsOfHalf()
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { CreditBytes = 4000, MaxChunk = 100 }).Connect();
            pair.Client.Land(Middle, 9);
            pair.Settle();
            List<CreditMessage> grants = pair.Server.HeardOf<CreditMessage>().ToList();
            Assert.Greater(grants.Count, 2);
            // Half of 4000, and at most one chunk more.
            foreach (CreditMessage grant in grants) Assert.That(grant.Bytes, Is.InRange(2000, 2100));
        }

        [Test]
        public void KeepsToEveryBudgetAndSaysWhatWasLeftOut()
        {
            uint[] unbounded = toy.Within(Middle, 4);
            foreach (Budgets budgets in new[] {
                         new Budgets { MaxSegments = 3 },
                         new Budgets { MaxTriangles = 3 * SessionToyScene.FacesEach + 1 },
                         new Budgets { MaxBytes = toy.BytesOf(unbounded) / 2 },
                     })
            {
                SessionPair pair = new SessionPair(toy, new SessionModelOptions { Budgets = budgets }).Connect();
                pair.Client.Land(Middle, 4);
                pair.Settle();
                PlanFacts plan = pair.Of(StreamEventKind.Planned).Single().Plan;
                string by = budgets.MaxSegments.HasValue ? "max_segments" : budgets.MaxBytes.HasValue ? "max_bytes" : "max_triangles";
                Assert.AreEqual(by, plan.OmittedBy);
                Assert.AreEqual(unbounded.Length - pair.Client.Visible.Count, plan.OmittedSegments);
                // Nearest first: a budget takes from the outside, so a smaller circle is whole.
                Assert.LessOrEqual(plan.EffectiveRadiusM, 4);
                Assert.LessOrEqual(toy.BytesOf(pair.Client.Visible), budgets.MaxBytes ?? long.MaxValue);
            }
        }

        [Test]
        public void DeclaresTheInnerSetAfterItsDeadlineAndGoesOn()
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { CreditBytes = 2000 }).Connect();
            pair.Settle();
            pair.Client.Land(Middle, 5, new LandOptions { InnerRadiusM = 1.5, DeadlineMs = 100 });
            uint[] inner = toy.Within(Middle, 1.5);
            pair.Until(() => pair.Received.Count == inner.Length);
            // The inner set is here, and most of the rest is not.
            pair.Server.DeadlinePassed = true;
            pair.Settle();
            Assert.AreEqual(inner, pair.Of(StreamEventKind.Degraded).Single().Segments);
            Assert.AreEqual(toy.Within(Middle, 5), pair.Client.Visible);
        }

        [Test]
        public void IsNotDeclaredDegradedWithASegmentThatCameWrong()
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { Lag = 30 }).Connect();
            pair.Settle();
            // The first frame is flipped: its segment comes again, later than the deadline.
            int spoilt = 0;
            pair.Spoil = data => spoilt++ == 0 ? SessionPair.Flipped(data) : data;
            pair.Client.Land(Middle, 5, new LandOptions { InnerRadiusM = 1.5, DeadlineMs = 100 });
            pair.Step();
            pair.Server.DeadlinePassed = true;
            pair.Settle();
            int at = pair.Events.FindIndex(streamEvent => streamEvent.Kind == StreamEventKind.Degraded);
            uint[] inner = toy.Within(Middle, 1.5);
            List<uint> before = pair.Events.Take(at)
                                    .Where(streamEvent => streamEvent.Kind == StreamEventKind.Arrived)
                                    .Select(streamEvent => streamEvent.Facts.Segment)
                                    .ToList();
            Assert.IsTrue(inner.All(before.Contains));
            Assert.IsTrue(inner.Contains(pair.Rejects.Single().Segment));
        }

        [Test]
        public void WithoutWhatTheServerCannotReadIsReadyAndTriesItAgainTheNextTime()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Server.Unreadable.Add(14);
            pair.Client.Land(Middle, 4);
            pair.Settle();
            uint[] expected = toy.Within(Middle, 4);
            Assert.AreEqual(new uint[] { 14 }, pair.Of(StreamEventKind.Ready)[0].Missing);
            Assert.AreEqual(expected.Where(segment => segment != 14).ToArray(), pair.Client.Visible);
            // Readable again: the next landing that wants it gets it (6.4, rule 6).
            pair.Server.Unreadable.Clear();
            pair.Client.Land(Middle, 4);
            pair.Settle();
            Assert.AreEqual(expected, pair.Client.Visible);
        }

        [Test]
        public void ANewerLandingSupersedesAndWhatIsHalfHereGoesOn()
        {
            var scene = new SessionToyScene(0, "v1", 5000);
            SessionPair pair = new SessionPair(scene, new SessionModelOptions { CreditBytes = 100 }).Connect();
            // Small credit, so that the first landing is caught in the middle of a segment.
            int first = pair.Client.Land(Corner, 1);
            pair.Until(() => pair.Server.ChunkBytes >= 300);
            int second = pair.Client.Land(Corner, 2);
            pair.Settle();
            StreamEvent superseded = pair.Of(StreamEventKind.Superseded).Single();
            Assert.AreEqual(first, superseded.Landing);
            Assert.AreEqual(second, superseded.By);
            Assert.AreEqual(second, pair.Of(StreamEventKind.Ready).Single().Landing);
            // Each byte once: the partly sent segment went on where it had stopped.
            Assert.AreEqual(scene.BytesOf(scene.Within(Corner, 2)), pair.Server.ChunkBytes);
        }

        [Test]
        public void ALandingThatANewerOneEndsBeforeItsPlanNeverGetsOne()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            pair.Server.PlansNothing = true;
            int first = pair.Client.Land(Middle, 4);
            pair.Settle();
            Assert.AreEqual(first, pair.Client.Unfinished);
            pair.Server.PlansNothing = false;
            int second = pair.Client.Land(Middle, 2);
            pair.Settle();
            StreamEvent superseded = pair.Of(StreamEventKind.Superseded).Single();
            Assert.AreEqual(first, superseded.Landing);
            Assert.AreEqual(second, superseded.By);
            Assert.AreEqual(second, pair.Of(StreamEventKind.Planned).Single().Landing);
            Assert.AreEqual(second, pair.Of(StreamEventKind.Ready).Single().Landing);
        }

        [Test]
        public void ANewerLandingElsewhereMakesThePartsOfTheOlderOneForgotten()
        {
            var scene = new SessionToyScene(0, "v1", 5000);
            SessionPair pair = new SessionPair(scene, new SessionModelOptions { CreditBytes = 100 }).Connect();
            pair.Client.Land(Corner, 1);
            pair.Until(() => pair.Server.ChunkBytes >= 300);
            // Forgotten with the new plan, not with the command: frames of the old one may still come (6.5, rule 4).
            Assert.AreEqual(1, pair.Client.PartialSegments);
            pair.Client.Land(SessionToyScene.FarCorner, 0.5);
            pair.Until(() => pair.Of(StreamEventKind.Planned).Count == 2);
            Assert.AreEqual(0, pair.Client.PartialSegments);
        }

        [Test]
        public void ARefusedLandingLeavesTheOlderOneGoing()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            int accepted = pair.Client.Land(Middle, 4);
            for (int step = 0; step < 3; step++) pair.Step();
            int tooLarge = pair.Client.Land(Middle, 501);
            pair.Settle();
            StreamEvent refused = pair.Of(StreamEventKind.Refused).Single();
            Assert.AreEqual(tooLarge, refused.Landing);
            Assert.AreEqual("radius_too_large", refused.Code);
            Assert.IsFalse(refused.IsFatal);
            Assert.AreEqual(accepted, pair.Of(StreamEventKind.Ready).Single().Landing);
            Assert.AreEqual(0, pair.Of(StreamEventKind.Superseded).Count);
        }

        [Test]
        public void OnlyTheNewestLandingWaitsForAConnection()
        {
            var pair = new SessionPair(toy);
            int first = pair.Client.Land(Corner, 1);
            int second = pair.Client.Land(Middle, 1);
            Assert.AreEqual(second, pair.Client.Unfinished);
            pair.Connect().Settle();
            Assert.AreEqual(first, pair.Of(StreamEventKind.Superseded).Single().Landing);
            Assert.AreEqual(second, pair.Of(StreamEventKind.Ready).Single().Landing);
        }

        [Test]
        public void ALandingTakesThePlaceOfOneThatNeverLeft()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            // A hundred calls between two pumps: one land leaves, with the pick.
            for (int count = 0; count < 100; count++) pair.Client.Land(Middle, 1 + count / 50.0);
            pair.Client.Pick(Corner);
            List<byte[]> sent = pair.TakeSent();
            Assert.AreEqual(2, sent.Count);
            foreach (byte[] data in sent) pair.Server.Receive(data);
            pair.Settle();
            Assert.AreEqual(99, pair.Of(StreamEventKind.Superseded).Count);
            Assert.AreEqual(100, pair.Of(StreamEventKind.Ready).Single().Landing);
            Assert.AreEqual(toy.Within(Middle, 1 + 99 / 50.0), pair.Client.Visible);
        }

        [Test]
        public void ALostConnectionIsResumedAndNoSegmentComesTwice()
        {
            // Cut after 0 to 35 steps: before the plan, within it, and after ready.
            for (int steps = 0; steps < 36; steps++)
            {
                SessionPair pair = new SessionPair(toy, new SessionModelOptions { CreditBytes = 300 }).Connect();
                int number = pair.Client.Land(Middle, 4);
                for (int step = 0; step < steps; step++) pair.Step();
                pair.Disconnect();
                Assert.IsTrue(pair.Client.Unfinished == number || pair.Of(StreamEventKind.Ready).Count == 1);
                Assert.AreEqual(0, pair.Client.PartialSegments);
                pair.Connect().Settle();
                uint[] expected = toy.Within(Middle, 4);
                StreamEvent ready = pair.Of(StreamEventKind.Ready).Last();
                Assert.AreEqual(number, ready.Landing);
                Assert.AreEqual(expected, ready.Segments);
                Assert.AreEqual(expected, pair.Received.OrderBy(segment => segment).ToArray());
                Assert.AreEqual(0, pair.Client.Stats.RepeatedBytes);
                // What an old connection brought is no credit for the new one.
                long granted = pair.Server.HeardOf<CreditMessage>().Sum(credit => credit.Bytes);
                Assert.LessOrEqual(granted, pair.Server.ChunkBytes);
            }
        }

        [Test]
        public void ALostConnectionMakesWhatItSaidOfReadyVoid()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            int frames = 0;
            pair.Spoil = data => frames++ == 0 ? SessionPair.Flipped(data) : data;
            int number = pair.Client.Land(Corner, 0.5);
            pair.Until(() => frames > 0);
            // The reject of it waits in the outbox while the server says ready.
            pair.Give(pair.Server.Next());
            Assert.AreEqual(0, pair.Of(StreamEventKind.Ready).Count);
            pair.Disconnect();
            pair.Connect();
            pair.Until(() => pair.Received.Count > 0);
            Assert.AreEqual(0, pair.Of(StreamEventKind.Ready).Count);
            pair.Settle();
            Assert.AreEqual(number, pair.Of(StreamEventKind.Ready).Single().Landing);
        }

        [Test]
        public void ALostConnectionLeavesWhatIsShownUntilTheNewLandingIsReady()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Client.Land(Corner, 2);
            pair.Settle();
            // What is shown does not depend on the line.
            IReadOnlyList<uint> shown = pair.Client.Visible;
            pair.Client.Land(Middle, 4);
            pair.Step();
            pair.Disconnect();
            pair.Connect();
            Assert.AreEqual(shown, pair.Client.Visible);
            pair.Settle();
            Assert.AreEqual(toy.Within(Middle, 4), pair.Client.Visible);
        }
    }
}
