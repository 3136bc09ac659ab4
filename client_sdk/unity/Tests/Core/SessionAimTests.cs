using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>Aims and picks: the client's state machine against the model server.</summary>
    [TestFixture]
    public class SessionAimTests
    {
        private static readonly Vec3 Middle = SessionToyScene.Middle;
        private static readonly Vec3 Corner = SessionToyScene.Corner;
        private readonly SessionToyScene toy = new SessionToyScene();

        [Test]
        public void AnAimIsHeldForTheLandingThatFollowsWhichCostsNothing()
        {
            SessionPair pair = Open();
            Aim(pair, Middle, 3);
            pair.Settle();
            uint[] expected = toy.Within(Middle, 3);
            StreamEvent prefetching = pair.Of(StreamEventKind.Prefetching).Single();
            Assert.AreEqual(expected.Length, prefetching.Count);
            Assert.AreEqual(toy.BytesOf(expected), prefetching.Bytes);
            Assert.AreEqual(expected.Length, pair.Of(StreamEventKind.Prefetched).Single().Count);
            Assert.IsTrue(pair.Of(StreamEventKind.Arrived).All(streamEvent => streamEvent.Landing == null));
            Assert.AreEqual(0, pair.Client.Visible.Count);
            // Everything is here already, so the landing loads nothing, and counts as a hit.
            pair.Client.Land(Middle, 3);
            pair.Settle();
            Assert.AreEqual(0, pair.Of(StreamEventKind.Planned).Last().Plan.LoadBytes);
            Assert.AreEqual(expected, pair.Client.Visible);
            StreamStats stats = pair.Client.Stats;
            Assert.AreEqual(1, stats.AimedLandings);
            Assert.AreEqual(1, stats.AimHits);
            Assert.AreEqual(toy.BytesOf(expected), stats.UsedPrefetchedBytes);
            Assert.AreEqual(toy.BytesOf(expected), stats.PrefetchedBytes);
        }

        [Test]
        public void AnAimElsewhereIsAMissAndCounted()
        {
            SessionPair pair = Open();
            Aim(pair, Corner, 1);
            pair.Settle();
            pair.Client.Land(Middle, 2);
            pair.Settle();
            StreamStats stats = pair.Client.Stats;
            Assert.AreEqual(1, stats.AimedLandings);
            Assert.AreEqual(0, stats.AimHits);
            Assert.AreEqual(0, stats.UsedPrefetchedBytes);
            Assert.AreEqual(toy.BytesOf(toy.Within(Corner, 1)), stats.PrefetchedBytes);
        }

        [Test]
        public void AnAimReplacesTheOneBeforeAndIsDroppedByALanding()
        {
            SessionPair pair = Open();
            // Five aims, of which the last is sent; then one that a landing makes pointless.
            for (int x = 0; x < 5; x++) pair.Client.Aim(new Vec3(x, 0, 0), 1);
            pair.Client.FlushAim();
            Assert.AreEqual(1, pair.TakeSent().Count);
            pair.Client.Aim(Corner, 1);
            pair.Client.Land(Middle, 1);
            Assert.IsFalse(pair.Client.HasAim);
        }

        [Test]
        public void AnAimThatComesWrongTwiceIsGivenUp()
        {
            SessionPair pair = Open();
            // Every frame is wrong: rejected twice, then given up. A landing would ask for it again.
            pair.Spoil = SessionPair.Flipped;
            Aim(pair, Corner, 0.5);
            pair.Settle();
            Assert.AreEqual(new uint[] { 0, 0 }, pair.Rejects.Select(reject => reject.Segment).ToArray());
            Assert.AreEqual(1, pair.Of(StreamEventKind.Prefetched).Count);
            Assert.IsFalse(pair.Client.Cache.Contains(0));
        }

        [Test]
        public void AnAimThatACutEndedIsSentAnewAndNothingComesTwice()
        {
            // Small credit, so that the cut comes in the middle of the prefetch.
            SessionPair pair = Open(300);
            Aim(pair, Middle, 3);
            pair.Until(() => pair.Received.Count >= 2);
            pair.Disconnect();
            pair.Connect().Settle(true);
            Assert.AreEqual(toy.Within(Middle, 3), pair.Received.OrderBy(segment => segment).ToArray());
            Assert.AreEqual(1, pair.Of(StreamEventKind.Prefetched).Count);
            pair.Client.Land(Middle, 3);
            pair.Settle();
            Assert.AreEqual(0, pair.Of(StreamEventKind.Planned).Last().Plan.LoadBytes);
        }

        [Test]
        public void AnAimIsNotSentAnewOnceAllHasComeOrTheUserHasLanded()
        {
            SessionPair pair = Open();
            Aim(pair, Middle, 3);
            pair.Settle();
            // All of it had come: nothing is left to be asked for.
            pair.Disconnect();
            pair.Connect().Settle();
            Assert.IsFalse(pair.Client.HasAim);
            Aim(pair, Corner, 3);
            pair.Client.Land(Middle, 3);
            pair.Disconnect();
            pair.Connect().Settle();
            Assert.IsFalse(pair.Client.HasAim);
            Assert.AreEqual(toy.Within(Middle, 3), pair.Of(StreamEventKind.Ready).Last().Segments);
        }

        [Test]
        public void AnAimAfterAnUnfinishedLandingComesBehindItAgain()
        {
            SessionPair pair = Open(300);
            int number = pair.Client.Land(Middle, 3);
            // The server lets it wait behind the landing (7, rule 2); the cut ends both.
            Aim(pair, Corner, 2);
            pair.Until(() => pair.Received.Count > 0);
            pair.Disconnect();
            pair.Connect().Settle(true);
            List<StreamEvent> ends = pair.Events.FindAll(
                streamEvent => streamEvent.Kind == StreamEventKind.Ready || streamEvent.Kind == StreamEventKind.Prefetched);
            Assert.AreEqual(
                new[] { StreamEventKind.Ready, StreamEventKind.Prefetched }, ends.Select(streamEvent => streamEvent.Kind).ToArray());
            Assert.AreEqual(number, ends[0].Landing);
            Assert.AreEqual(pair.Received.Count, pair.Received.Distinct().Count());
        }

        [Test]
        public void PicksAreAnsweredAndAskedAgainAfterALostConnectionUnlessRefusedHere()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            int first = pair.Client.Pick(new Vec3(0, 1, 0));
            pair.Disconnect();
            int second = pair.Client.Pick(new Vec3(0, 1, 0), new Vec3(0, -1, 0));
            // Refused here before it was ever sent: the server must not hear of it.
            int third = pair.Client.Pick(new Vec3(5, 1, 0));
            pair.Client.RefusePick(third, "too_many", "no more");
            pair.Connect().Settle();
            List<StreamEvent> answers = pair.Of(StreamEventKind.Picked);
            Assert.AreEqual(new[] { first, second }, answers.Select(streamEvent => streamEvent.Request).ToArray());
            PickHit hit = answers[0].Hit;
            Assert.AreEqual(3, hit.Segment);
            Assert.AreEqual(9, hit.HeightM);
            Assert.AreEqual(1.5, hit.Attributes["grade"]);
            Assert.IsNull(hit.StableId);
            Assert.IsNull(hit.Label);
            Assert.AreEqual(third, pair.Of(StreamEventKind.PickRefused).Single().Request);
            Assert.IsFalse(pair.Client.AwaitsAnswer);
        }

        [Test]
        public void PicksThatTheServerRefusesAreTold()
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { RefusesPicks = true }).Connect();
            int request = pair.Client.Pick(Corner);
            pair.Settle();
            StreamEvent refused = pair.Of(StreamEventKind.PickRefused).Single();
            Assert.AreEqual(request, refused.Request);
            Assert.AreEqual("too_many", refused.Code);
            Assert.AreEqual(0, pair.Of(StreamEventKind.Refused).Count);
        }

        private SessionPair Open(long creditBytes = 4096)
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { CreditBytes = creditBytes }).Connect();
            pair.Settle();
            return pair;
        }

        private static void Aim(SessionPair pair, Vec3 position, double radiusM)
        {
            pair.Client.Aim(position, radiusM);
            Assert.IsTrue(pair.Client.HasAim);
            pair.Client.FlushAim();
        }
    }
}
