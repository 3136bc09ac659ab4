using System;
using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>A stream and its connections: opened, kept, lost, opened again; by a clock that the test moves.</summary>
    [TestFixture]
    public class StreamLinkTests
    {
        private static readonly Vec3 Middle = SessionToyScene.Middle;
        private StreamFakeNetwork network;
        private List<StreamEvent> events;

        [SetUp]
        public void Begin()
        {
            network = new StreamFakeNetwork();
            events = new List<StreamEvent>();
        }

        [TestCase(Subprotocol.Msgpack)]
        [TestCase(Subprotocol.Json)]
        public void ALandingIsToldFromTheLinkToReadyWithItsTime(Subprotocol subprotocol)
        {
            network.Options.Subprotocol = subprotocol;
            SceneStream stream = network.Stream();
            int landing = stream.Land(Middle, 4);
            network.NowMs += 250;
            Pump(stream);
            Assert.AreEqual("ws://toy.example/scenes/toy/stream", network.Last.Url.AbsoluteUri);
            Assert.AreEqual(WireCodec.NameOf(subprotocol), network.Last.Subprotocol);
            Assert.AreEqual(new[] { LinkPhase.Connecting, LinkPhase.Open }, Links().Select(link => link.Phase).ToArray());
            StreamEvent opened = Of(StreamEventKind.Opened).Single();
            Assert.AreEqual("v1", opened.SceneVersion);
            Assert.AreEqual(500, opened.MaxRadiusM);
            uint[] want = network.Scene.Within(Middle, 4);
            StreamEvent ready = Of(StreamEventKind.Ready).Single();
            Assert.AreEqual(landing, ready.Landing);
            Assert.AreEqual(want, ready.Segments);
            Assert.AreEqual(250, ready.ElapsedMs);
            Assert.AreEqual(network.NowMs, ready.ReadyAtMs);
            Assert.AreEqual(0, network.Last.Lent);
            foreach (StreamEvent arrived in Of(StreamEventKind.Arrived))
            {
                PinnedPayload pin;
                Assert.IsTrue(stream.TryPin(arrived.Facts.Segment, out pin));
                Assert.AreEqual(network.Scene.Payloads[arrived.Facts.Segment], pin.Bytes.ToArray());
                pin.Dispose();
            }
            Assert.AreEqual(network.Scene.BytesOf(want), stream.Stats.HeldBytes);
            stream.Close();
            Assert.AreEqual("bye", network.Last.Server.Heard.Last().Type);
            Assert.AreEqual(1000, network.Last.ClosedByClientWith);
            Assert.IsTrue(network.Last.IsDisposed);
            Assert.AreEqual(0, stream.Stats.HeldBytes);
        }

        [Test]
        public void AnUnusableUrlOrOptionIsRefusedAtOnce()
        {
            Assert.AreEqual("invalid_url", Assert.Throws<TerraportException>(() => network.Stream(options => options.SceneUrl = "x")).Code);
            Assert.AreEqual(
                "invalid_url", Assert.Throws<TerraportException>(() => network.Stream(options => options.SceneUrl = "http://h")).Code);
            Assert.Catch<ArgumentException>(() => network.Stream(options => options.CreditBytes = 0));
            Assert.Catch<ArgumentException>(() => network.Stream(options => options.ReleaseFactor = 9));
            Assert.AreEqual(0, network.Made.Count);
        }

        [Test]
        public void ALostConnectionIsMadeAgainAfterAWaitThatDoublesAndResumesWithWhatIsHeld()
        {
            SceneStream stream = network.Stream();
            int landing = stream.Land(Middle, 4);
            int frames = 0;
            network.Last.Spoil = data =>
            {
                frames++;
                if (frames == 3) network.Last.Break(1006);
                return data;
            };
            network.RefuseWith = 1006;
            double[] least = { 250, 500, 1000, 2000, 4000, 8000, 15000, 15000 };
            foreach (double waitMs in least)
            {
                int made = network.Made.Count;
                Pump(stream);
                LinkState link = Links().Last();
                Assert.AreEqual(LinkPhase.Waiting, link.Phase);
                Assert.That(link.RetryInMs, Is.InRange(waitMs, 2 * waitMs));
                Assert.AreEqual(network.NowMs + link.RetryInMs, stream.DueMs, 1e-6);
                network.NowMs += link.RetryInMs - 0.5;
                Pump(stream);
                Assert.AreEqual(made, network.Made.Count);
                network.NowMs += 1;
                Pump(stream);
                Assert.AreEqual(made + 1, network.Made.Count);
            }
            network.RefuseWith = 0;
            network.NowMs += 30001;
            Pump(stream);
            StreamEvent ready = Of(StreamEventKind.Ready).Single();
            Assert.AreEqual(landing, ready.Landing);
            Assert.AreEqual(network.Scene.Within(Middle, 4), ready.Segments);
            Assert.AreEqual(0, stream.Stats.RepeatedBytes);
            Assert.AreEqual(3, Of(StreamEventKind.Opened).Last().HeldCount);
            Assert.IsTrue(network.Made.All(one => one.Lent == 0));
        }

        [Test]
        public void ANoticeSaysHowLongToWait()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            network.Last.Server.Say(new NoticeMessage { Kind = "draining", ReconnectAfterMs = 7000 });
            Pump(stream);
            network.Last.Break(4503, "draining");
            Pump(stream);
            LinkState link = Links().Last();
            Assert.AreEqual(7000, link.RetryInMs);
            Assert.AreEqual("draining", link.Code);
            Assert.AreEqual(4503, link.CloseCode);
        }

        [Test]
        public void ARefusedTokenClosesForGoodUntilAnotherOneIsGiven()
        {
            network.RefuseWith = 4401;
            network.RefuseReason = "unauthorised";
            network.RefuseError = new ErrorMessage { Code = "unauthorised", Message = "no such token", Fatal = true };
            SceneStream stream = network.Stream(options => options.Token = "old");
            int request = stream.Pick(Middle);
            int landing = stream.Land(Middle, 2);
            Pump(stream);
            Assert.AreEqual("old", network.Last.Token);
            LinkState link = Links().Last();
            Assert.AreEqual(LinkPhase.Closed, link.Phase);
            Assert.AreEqual("unauthorised", link.Code);
            Assert.AreEqual("no such token", link.Message);
            Assert.AreEqual(request, Of(StreamEventKind.PickRefused).Single().Request);
            network.NowMs += 1e6;
            Pump(stream);
            Assert.AreEqual(1, network.Made.Count);
            Assert.IsTrue(double.IsPositiveInfinity(stream.DueMs));
            Assert.AreEqual(request + 1, stream.Pick(Middle));
            Pump(stream);
            Assert.AreEqual(2, Of(StreamEventKind.PickRefused).Count);
            network.RefuseWith = 0;
            stream.Reconnect("new");
            Pump(stream);
            Assert.AreEqual("new", network.Last.Token);
            Assert.AreEqual(landing, Of(StreamEventKind.Ready).Single().Landing);
        }

        [Test]
        public void AnotherTokenMakesANewConnectionAndKeepsWhatIsHeld()
        {
            SceneStream stream = network.Stream(options => options.Token = "old");
            stream.Land(Middle, 3);
            Pump(stream);
            stream.Reconnect("old");
            stream.Reconnect();
            Assert.AreEqual(1, network.Made.Count);
            stream.Reconnect("new");
            Pump(stream);
            Assert.AreEqual(2, network.Made.Count);
            Assert.IsTrue(network.Made[0].IsDisposed);
            Assert.AreEqual(network.Scene.Within(Middle, 3).Length, Of(StreamEventKind.Opened).Last().HeldCount);
        }

        [Test]
        public void AnOfferThatIsTooLargeIsMadeAfterTheWelcome()
        {
            SceneStream stream = network.Stream();
            stream.Land(Middle, 3);
            Pump(stream);
            int held = stream.Stats.HeldSegments;
            network.RefuseWith = 4413;
            network.RefuseError = new ErrorMessage { Code = "too_large", Message = "too much", Fatal = true };
            network.Last.Break(1006);
            Pump(stream);
            network.NowMs += 500;
            stream.Pump();
            network.RefuseWith = 0;
            Pump(stream);
            List<string> heard = network.Last.Server.Heard.ConvertAll(one => one.Type);
            Assert.AreEqual(new[] { "hello", "held" }, heard.Take(2).ToArray());
            Assert.AreEqual(0, ((HelloMessage)network.Last.Server.Heard[0]).Held.Length);
            Assert.AreEqual(held, network.Last.Server.Held.Count);
        }

        [Test]
        public void ABrokenProtocolClosesWith4400ForGood()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            network.Last.Inject(new byte[] { 0xc1 });
            Pump(stream);
            Assert.AreEqual(4400, network.Last.ClosedByClientWith);
            LinkState link = Links().Last();
            Assert.AreEqual(LinkPhase.Closed, link.Phase);
            Assert.AreEqual("malformed", link.Code);
            StringAssert.Contains("0xc1", link.Message);
            Assert.AreEqual(0, network.Last.Lent);
        }

        [Test]
        public void AFlippedByteIsAskedForAgain()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            int frames = 0;
            network.Last.Spoil = data => frames++ == 2 ? SessionPair.Flipped(data) : data;
            stream.Land(Middle, 4);
            Pump(stream);
            Assert.AreEqual(1, network.Last.Server.HeardOf<RejectMessage>().Count());
            Assert.AreEqual(network.Scene.Within(Middle, 4), Of(StreamEventKind.Ready).Single().Segments);
            Assert.AreEqual(0, Of(StreamEventKind.Ready).Single().Missing.Count);
        }

        [Test]
        public void AServerThatSaysNothingIsGivenUp()
        {
            network.IsDeaf = true;
            SceneStream stream = network.Stream();
            network.NowMs += 9999;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Connecting, Links().Last().Phase);
            network.NowMs += 2;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Waiting, Links().Last().Phase);
            Assert.AreEqual("timeout", Links().Last().Code);
            network.IsDeaf = false;
            network.NowMs += 500;
            Pump(stream);
            network.Last.IsSilent = true;
            // Silence of a server that owes nothing is no silence.
            network.NowMs += 100000;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Open, Links().Last().Phase);
            stream.Land(Middle, 2);
            Pump(stream);
            network.NowMs += 29999;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Open, Links().Last().Phase);
            network.NowMs += 2;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Waiting, Links().Last().Phase);
            Assert.AreEqual("the server is silent", Links().Last().Message);
        }

        [Test]
        public void AimsAreSentTenTimesASecondAtMostAndTheNewestCounts()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            for (int frame = 0; frame < 90; frame++)
            {
                stream.Aim(new Vec3(frame, 0, 0), 1);
                stream.Pump();
                network.NowMs += 1000.0 / 90;
            }
            network.NowMs += 100;
            Pump(stream);
            List<AimMessage> aims = network.Last.Server.HeardOf<AimMessage>().ToList();
            Assert.That(aims.Count, Is.InRange(9, 11));
            Assert.AreEqual(89, aims.Last().Position.X);
        }

        [Test]
        public void MessagesKeepToTheServersRate()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            for (int frame = 0; frame < 2000; frame++)
            {
                stream.Land(Middle, 1 + frame % 3);
                Pump(stream);
                network.NowMs += 5;
            }
            List<double> sent = network.Last.SentAtMs;
            for (int first = 0; first < sent.Count; first++)
            {
                int within = sent.Count(atMs => atMs >= sent[first] && atMs < sent[first] + 10000);
                Assert.LessOrEqual(within, 60 * 10 * 2);
            }
            Assert.Less(sent.Count, 1000);
            network.NowMs += 20000;
            Pump(stream);
            Assert.AreEqual(2000, Of(StreamEventKind.Ready).Last().Landing);
        }

        [Test]
        public void ATransportThatIsFullGetsItsMessagesLater()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            network.Last.TakesNothing = true;
            stream.Land(Middle, 1);
            int newest = stream.Land(Middle, 2);
            Pump(stream);
            Assert.AreEqual(1, network.Last.Server.Heard.Count);
            network.Last.TakesNothing = false;
            Pump(stream);
            Assert.AreEqual(newest, Of(StreamEventKind.Ready).Last().Landing);
        }

        [Test]
        public void EventsThatNobodyTakesStopTheReceiving()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            for (int count = 0; count < 3 * SceneStream.MaxWaitingEvents; count++)
            {
                network.Last.Inject(WireCodec.Encode(new NoticeMessage { Kind = "news" }, Subprotocol.Msgpack));
            }
            for (int count = 0; count < 10; count++) stream.Pump();
            int taken = Take(stream);
            Assert.That(taken, Is.InRange(SceneStream.MaxWaitingEvents, 3 * SceneStream.MaxWaitingEvents));
            Pump(stream);
            Assert.AreEqual(3 * SceneStream.MaxWaitingEvents, Of(StreamEventKind.Notice).Count);
        }

        [Test]
        public void AServerThatSendsWrongBytesWithoutEndFillsNoMemory()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            network.Last.IsSilent = true;
            stream.Aim(Middle, 1);
            Pump(stream);
            SegmentFacts facts = network.Scene.Facts[0];
            network.Last.Inject(WireCodec.Encode(
                new PrefetchMessage { Generation = 1, Segments = new[] { facts }, Bytes = facts.Length }, Subprotocol.Msgpack));
            var chunk = new ArraySegment<byte>(new byte[facts.Length]);
            byte[] wrong = new PayloadFrame(1, 0, 0, facts.Length, chunk).Encode();
            for (int count = 0; count < 5000; count++) network.Last.Inject(wrong);
            Pump(stream);
            int told = network.Last.Server.HeardOf<RejectMessage>().Count();
            Assert.That(network.Last.Left, Is.InRange(5000 - told - 600, 5000 - told));
            network.NowMs += 60000;
            Pump(stream);
            Assert.Greater(network.Last.Server.HeardOf<RejectMessage>().Count(), told);
        }

        [Test]
        public void MorePicksThanMayWaitAreRefusedHere()
        {
            SceneStream stream = network.Stream();
            for (int count = 0; count < SceneStream.MaxPicks + 3; count++) Assert.AreEqual(count + 1, stream.Pick(Middle));
            Pump(stream);
            Assert.AreEqual(SceneStream.MaxPicks, Of(StreamEventKind.Picked).Count);
            Assert.IsTrue(Of(StreamEventKind.PickRefused).All(one => one.Code == "too_many" && one.Request > SceneStream.MaxPicks));
            Assert.AreEqual(3, Of(StreamEventKind.PickRefused).Count);
            Assert.AreEqual(SceneStream.MaxPicks, network.Last.Server.HeardOf<PickMessage>().Count());
        }

        [Test]
        public void AClosedStreamAnswersNothingAndConnectsNoMore()
        {
            SceneStream stream = network.Stream();
            Pump(stream);
            int request = stream.Pick(Middle);
            stream.Close();
            stream.Close();
            stream.Reconnect("x");
            stream.Land(Middle, 1);
            stream.Aim(Middle, 1);
            stream.Pump();
            Take(stream);
            Assert.AreEqual(request, Of(StreamEventKind.PickRefused).Single().Request);
            Assert.AreEqual(1, network.Made.Count);
        }

        private void Pump(SceneStream stream)
        {
            for (int count = 0; count < 50; count++) PumpOnce(stream);
        }

        private void PumpOnce(SceneStream stream)
        {
            stream.Pump();
            Take(stream);
        }

        private int Take(ISceneStream stream)
        {
            int count = 0;
            StreamEvent next;
            while (stream.TryNextEvent(out next))
            {
                events.Add(next);
                count++;
            }
            return count;
        }

        private List<StreamEvent> Of(StreamEventKind kind)
        {
            return events.FindAll(one => one.Kind == kind);
        }

        private List<LinkState> Links()
        {
            return Of(StreamEventKind.Link).ConvertAll(one => one.Link);
        }
    }
}
