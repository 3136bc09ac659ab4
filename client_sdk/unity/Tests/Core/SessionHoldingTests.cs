using System;
using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>What is evicted, rejected, offered and dropped: the client's state machine against the model server.</summary>
    [TestFixture]
    public class SessionHoldingTests
    {
        private static readonly Vec3 Middle = SessionToyScene.Middle;
        private static readonly Vec3 Corner = SessionToyScene.Corner;
        private static readonly Vec3 Far = SessionToyScene.FarCorner;
        private readonly SessionToyScene toy = new SessionToyScene();

        [Test]
        public void EvictionsAreToldBeforeTheNextLandingAndAsEventsAtOnce()
        {
            // With a cache of 0 bytes each landing evicts the one before, so the third loads what the first did.
            SessionPair pair = Visited(Corner, Far, Corner);
            List<StreamEvent> plans = pair.Of(StreamEventKind.Planned);
            Assert.Greater(plans[0].Plan.LoadBytes, 0);
            Assert.AreEqual(plans[0].Plan.LoadBytes, plans[2].Plan.LoadBytes);
            IReadOnlyList<uint> dropped = pair.Of(StreamEventKind.Dropped).Last().Segments;
            Assert.IsTrue(toy.Within(Far, 2).All(dropped.Contains));
            uint[] beyond = pair.Server.Held.Where(segment => !pair.Client.Visible.Contains(segment)).OrderBy(segment => segment).ToArray();
            pair.Client.Land(Corner, 2);
            List<WireMessage> sent = Decoded(pair);
            Assert.AreEqual(new[] { "evict", "land" }, sent.Select(message => message.Type).ToArray());
            Assert.AreEqual(beyond, ((EvictMessage)sent[0]).Segments);
        }

        [Test]
        public void EvictionsNeverComeBetweenALandingAndItsPlan()
        {
            SessionPair pair = Visited(Corner, Far);
            pair.Client.Land(Corner, 2);
            // The first land is with the server, whose plan is not here: now nothing may be evicted (6.7, rule 2).
            foreach (byte[] data in pair.TakeSent()) pair.Server.Receive(data);
            pair.Client.Land(Far, 2);
            List<byte[]> second = pair.TakeSent();
            Assert.AreEqual(1, second.Count);
            pair.Server.Receive(second[0]);
            Assert.AreEqual("land", pair.Server.Heard.Last().Type);
            pair.Settle();
            Assert.AreEqual(toy.Within(Far, 2), pair.Client.Visible);
        }

        [Test]
        public void EvictionsWaitWhereALandingBecomesReadyWhileANewerOneHasNoPlan()
        {
            SessionPair pair = Visited(Corner);
            pair.Client.Land(Far, 2);
            int wholeCount = pair.Received.Count + toy.Within(Far, 2).Length;
            pair.Until(() => pair.Received.Count == wholeCount);
            pair.Client.Land(Corner, 2);
            // The newer land is under way when the older landing becomes ready.
            List<byte[]> onTheirWay = pair.TakeSent();
            pair.Give(pair.Server.Next());
            Assert.AreEqual(toy.Within(Far, 2), pair.Client.Visible);
            foreach (byte[] data in onTheirWay) pair.Server.Receive(data);
            pair.Settle();
            Assert.AreEqual(0, pair.Rejects.Count);
            Assert.AreEqual(0, pair.Of(StreamEventKind.Planned).Last().Plan.LoadBytes);
            Assert.AreEqual(toy.Within(Corner, 2), pair.Client.Visible);
        }

        [Test]
        public void EvictionsAreNotToldToANewConnection()
        {
            SessionPair pair = Visited(Corner, Far);
            Assert.AreEqual(1, pair.Of(StreamEventKind.Dropped).Count);
            pair.Disconnect();
            // A new connection knows only what hello offers: evictions of the old one say nothing to it.
            pair.Connect().Settle();
            pair.Client.Land(Corner, 2);
            pair.Settle();
            Assert.AreEqual(new[] { "hello", "land" }, pair.Server.Heard.Select(message => message.Type).ToArray());
        }

        [Test]
        public void EvictionsSpareWhatADegradedLandingShowsUntilItIsReady()
        {
            SessionPair pair = Visited();
            pair.Client.Land(Corner, 5, new LandOptions { InnerRadiusM = 1, DeadlineMs = 1 });
            pair.Until(() => pair.Received.Count >= 3);
            pair.Server.DeadlinePassed = true;
            pair.Until(() => pair.Of(StreamEventKind.Degraded).Count > 0);
            pair.Client.Land(Far, 0.5);
            pair.Until(() => pair.Of(StreamEventKind.Planned).Count == 2);
            uint[] inner = toy.Within(Corner, 1);
            // It may be on the screen: pinned until a newer landing is shown.
            Assert.IsTrue(inner.All(pair.Client.Cache.Contains));
            pair.Settle();
            Assert.IsFalse(inner.Any(pair.Client.Cache.Contains));
        }

        [Test]
        public void AWrongByteIsRejectedAndTheSegmentSentAgain()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            int spoilt = 0;
            pair.Spoil = data => SessionPair.SegmentOf(data) == 14 && spoilt++ == 0 ? SessionPair.Flipped(data) : data;
            pair.Client.Land(Middle, 4);
            pair.Settle();
            RejectMessage reject = pair.Rejects.Single();
            Assert.AreEqual(14, reject.Segment);
            Assert.AreEqual("hash_mismatch", reject.Reason);
            Assert.AreEqual(0, pair.Of(StreamEventKind.Ready).Last().Missing.Count);
            Assert.AreEqual(toy.Payloads[14], pair.Payload(14));
        }

        [Test]
        public void AWrongByteTwiceLeavesTheSegmentMissingAndTheNextLandingTriesAgain()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Spoil = data => SessionPair.SegmentOf(data) == 14 ? SessionPair.Flipped(data) : data;
            pair.Client.Land(Middle, 4);
            pair.Settle();
            uint[] expected = toy.Within(Middle, 4);
            Assert.AreEqual(2, pair.Rejects.Count);
            StreamEvent ready = pair.Of(StreamEventKind.Ready).Single();
            Assert.AreEqual(new uint[] { 14 }, ready.Missing);
            Assert.AreEqual(expected.Where(segment => segment != 14).ToArray(), ready.Segments);
            Assert.IsFalse(pair.Client.Cache.Contains(14));
            pair.Spoil = null;
            pair.Client.Land(Middle, 4);
            pair.Settle();
            Assert.AreEqual(expected, pair.Client.Visible);
        }

        [Test]
        public void AWrongByteWhoseRejectCrossesTheNextLandingIsSentAgainInThatOneAndRejectedOnce()
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { Lag = 5 }).Connect();
            int frames = 0;
            pair.Spoil = data => frames++ == 0 ? SessionPair.Flipped(data) : data;
            pair.Client.Land(Corner, 1);
            pair.Until(() => frames > 0);
            pair.Client.Land(Corner, 1);
            pair.Settle();
            // The plan keeps the segment, since the reject had not reached the server: it is waited for, not rejected again (6.4, rule 7).
            Assert.AreEqual(1, pair.Rejects.Count);
            Assert.AreEqual(new uint[] { 0 }, pair.Of(StreamEventKind.Planned).Last().Plan.Keep);
            Assert.AreEqual(0, pair.Of(StreamEventKind.Ready).Last().Missing.Count);
            Assert.AreEqual(toy.Payloads[0], pair.Payload(0));
        }

        [Test]
        public void AnOfferNamesWhatIsHeldInHelloOrNothingWhereThatWasTooLarge()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Client.Land(Middle, 4);
            pair.Settle();
            pair.Disconnect();
            pair.Client.Connected();
            var hello = (HelloMessage)Decoded(pair).Single();
            Assert.AreEqual("glb", hello.Encoding);
            Assert.AreEqual("1.0", hello.Protocol.ToString());
            List<HeldRow> rows = hello.Held.OrderBy(row => row.Segment).ToList();
            Assert.AreEqual(pair.Client.Visible, rows.Select(row => row.Segment).ToArray());
            foreach (HeldRow row in rows) Assert.AreEqual(toy.Facts[row.Segment].Xxh3, row.Xxh3);
            // The newest stands first: a server that takes fewer takes those.
            Assert.AreEqual(pair.Received.Last(), hello.Held[0].Segment);
            // As after a server found the hello too large.
            pair.Client.Connected(false);
            Assert.AreEqual(0, ((HelloMessage)Decoded(pair).Single()).Held.Length);
        }

        [Test]
        public void AnOfferGoesInAsManyTablesAsTheServerAsksForBeforeTheLanding()
        {
            var options = new SessionModelOptions { MaxHeldSegments = 5 };
            SessionPair pair = new SessionPair(toy, options).Connect();
            pair.Client.Land(Middle, 5);
            pair.Settle();
            pair.Disconnect();
            // Offered after the welcome, in tables of five, and before the land that counts on them.
            pair.OffersHeld = false;
            pair.Client.Land(Middle, 5);
            pair.Connect().Settle();
            int tables = (toy.Within(Middle, 5).Length + 4) / 5;
            Assert.Greater(tables, 2);
            var types = new List<string> { "hello" };
            types.AddRange(Enumerable.Repeat("held", tables));
            types.Add("land");
            Assert.AreEqual(types, pair.Server.Heard.Select(message => message.Type).ToList());
            Assert.AreEqual(0, pair.Of(StreamEventKind.Planned).Last().Plan.LoadBytes);
            Assert.AreEqual(0, pair.Client.Stats.RepeatedBytes);
        }

        [Test]
        public void AnOfferIsNotMadeToAServerThatTakesNoTable()
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { MaxHeldSegments = 0 }).Connect();
            pair.Client.Land(Middle, 4);
            pair.Settle();
            pair.Disconnect();
            pair.OffersHeld = false;
            pair.Connect().Settle();
            Assert.AreEqual(new[] { "hello" }, pair.Server.Heard.Select(message => message.Type).ToArray());
            // What cannot be offered is let go: the server would send it again, and it would count twice.
            Assert.AreEqual(toy.Within(Middle, 4).Length, pair.Of(StreamEventKind.Dropped).Last().Segments.Count);
            Assert.AreEqual(0, pair.Client.Cache.Count);
            pair.Client.Land(Middle, 4);
            pair.Settle();
            Assert.AreEqual(toy.Within(Middle, 4), pair.Client.Visible);
            Assert.AreEqual(0, pair.Client.Stats.RepeatedBytes);
        }

        [Test]
        public void ANewerVersionHidesAllDropsWhatChangedAndKeepsTheRest()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Client.Land(Middle, 4);
            pair.Settle();
            uint[] before = pair.Client.Visible.ToArray();
            pair.Disconnect();
            var newer = new SessionToyScene(0, "v2");
            uint[] changed = before.Take(3).ToArray();
            // Three of the shown segments have other bytes in the new version; the rest are the same, and stay held.
            foreach (uint segment in changed) newer.Replace(segment, Enumerable.Repeat((byte)segment, 300).ToArray());
            pair.Scene = newer;
            pair.Received.Clear();
            pair.Connect().Settle();
            Assert.AreEqual(new[] { false, true }, pair.Of(StreamEventKind.Opened).Select(streamEvent => streamEvent.IsChanged).ToArray());
            Assert.AreEqual(changed, pair.Of(StreamEventKind.Dropped).Single().Segments.OrderBy(segment => segment).ToArray());
            Assert.AreEqual(0, pair.Client.Visible.Count);
            pair.Client.Land(Middle, 4);
            pair.Settle();
            Assert.AreEqual(changed, pair.Received.OrderBy(segment => segment).ToArray());
            Assert.AreEqual(before, pair.Client.Visible);
        }

        [Test]
        public void NewsArePassedOnAndGroupsAndWhatIsNotKnownAreSkipped()
        {
            SessionPair pair = new SessionPair(toy).Connect();
            pair.Settle();
            pair.Server.Say(new NoticeMessage { Kind = "scene_published", Version = "v9" });
            pair.Server.Say(new NoticeMessage { Kind = "draining", ReconnectAfterMs = 1000 });
            pair.Server.Say(new RosterMessage { Group = "g", Members = new MemberPart[0] });
            pair.Settle();
            // {"type": "new"}, and a frame of a later kind.
            pair.Give(new byte[] { 0x81, 0xa4, 0x74, 0x79, 0x70, 0x65, 0xa3, 0x6e, 0x65, 0x77 });
            pair.Give(new byte[] { 0x05, 1, 2, 3 });
            List<StreamEvent> notices = pair.Of(StreamEventKind.Notice);
            Assert.AreEqual(new[] { "scene_published", "draining" }, notices.Select(streamEvent => streamEvent.Notice).ToArray());
            Assert.AreEqual("v9", notices[0].SceneVersion);
            Assert.AreEqual(null, notices[0].ReconnectAfterMs);
            Assert.AreEqual(1000, notices[1].ReconnectAfterMs);
            Assert.AreEqual(pair.Events.Count, notices.Count + 1);
        }

        /// <summary>A pair whose client keeps nothing but what is shown, after these landings.</summary>
        private SessionPair Visited(params Vec3[] positions)
        {
            SessionPair pair = new SessionPair(toy, new SessionModelOptions { CacheBytes = 0 }).Connect();
            pair.Settle();
            foreach (Vec3 position in positions)
            {
                pair.Client.Land(position, 2);
                pair.Settle();
            }
            return pair;
        }

        private static List<WireMessage> Decoded(SessionPair pair)
        {
            return pair.TakeSent().ConvertAll(data => WireCodec.Decode(new ArraySegment<byte>(data), Direction.ClientToServer));
        }
    }
}
