using System;
using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>A stream and its connections: opened, kept, lost, opened again; by a clock that the test moves.</summary>
    [TestFixture]
    public class StreamLinkTests : StreamTestBase
    {
        [Test]
        public void ALandingIsToldFromTheLinkToReadyWithItsTime()
        {
            SceneStream stream = Network.Stream();
            int landing = stream.Land(Middle, 4);
            // The clock of a landing starts with the call, not with the connection.
            Network.NowMs += 250;
            Pump(stream);
            Assert.AreEqual("ws://toy.example/scenes/toy/stream", Network.Last.Url.AbsoluteUri);
            Assert.AreEqual("terraport.v1.msgpack", Network.Last.Subprotocol);
            Assert.AreEqual(new[] { LinkPhase.Connecting, LinkPhase.Open }, Links().Select(link => link.Phase).ToArray());
            StreamEvent opened = Of(StreamEventKind.Opened).Single();
            Assert.AreEqual("v1", opened.SceneVersion);
            Assert.AreEqual(500, opened.MaxRadiusM);
            uint[] expected = Network.Scene.Within(Middle, 4);
            StreamEvent ready = Of(StreamEventKind.Ready).Single();
            Assert.AreEqual(landing, ready.Landing);
            Assert.AreEqual(expected, ready.Segments);
            Assert.AreEqual(250, ready.ElapsedMs);
            Assert.AreEqual(Network.NowMs, ready.ReadyAtMs);
            Assert.AreEqual(0, Network.Last.Lent);
            foreach (StreamEvent arrived in Of(StreamEventKind.Arrived))
            {
                PinnedPayload pin;
                Assert.IsTrue(stream.TryPin(arrived.Facts.Segment, out pin));
                Assert.AreEqual(Network.Scene.Payloads[arrived.Facts.Segment], pin.Bytes.ToArray());
                pin.Dispose();
            }
            Assert.AreEqual(Network.Scene.BytesOf(expected), stream.Stats.HeldBytes);
            stream.Close();
            Assert.AreEqual("bye", Network.Last.Server.Heard.Last().Type);
            Assert.AreEqual(1000, Network.Last.ClosedByClientWith);
            Assert.IsTrue(Network.Last.IsDisposed);
            Assert.AreEqual(0, stream.Stats.HeldBytes);
        }

        [Test]
        public void AnUnusableUrlOrOptionIsRefusedAtOnce()
        {
            Assert.AreEqual("invalid_url", Assert.Throws<TerraportException>(() => Network.Stream(options => options.SceneUrl = "x")).Code);
            Assert.AreEqual(
                "invalid_url", Assert.Throws<TerraportException>(() => Network.Stream(options => options.SceneUrl = "http://h")).Code);
            Assert.Catch<ArgumentException>(() => Network.Stream(options => options.CreditBytes = 0));
            Assert.Catch<ArgumentException>(() => Network.Stream(options => options.ReleaseFactor = 9));
            Assert.AreEqual(0, Network.Connections.Count);
        }

        [Test]
        public void ALostConnectionIsMadeAgainAfterAWaitThatDoublesAndResumesWithWhatIsHeld()
        {
            SceneStream stream = Network.Stream();
            int landing = stream.Land(Middle, 4);
            int frames = 0;
            Network.Last.FrameComes = () =>
            {
                frames++;
                if (frames == 3) Network.Last.Break(1006);
            };
            // Lost in the middle of the landing, and then no connection comes about: 0.5 s doubled up to 30 s, each half random.
            Network.RefuseWith = 1006;
            double[] minWaitsMs = { 250, 500, 1000, 2000, 4000, 8000, 15000, 15000 };
            foreach (double waitMs in minWaitsMs)
            {
                int attempts = Network.Connections.Count;
                Pump(stream);
                LinkState link = Links().Last();
                Assert.AreEqual(LinkPhase.Waiting, link.Phase);
                Assert.That(link.RetryInMs, Is.InRange(waitMs, 2 * waitMs));
                Assert.AreEqual(Network.NowMs + link.RetryInMs, stream.DueMs, 1e-6);
                // Not a moment early, and not late.
                Network.NowMs += link.RetryInMs - 0.5;
                Pump(stream);
                Assert.AreEqual(attempts, Network.Connections.Count);
                Network.NowMs += 1;
                Pump(stream);
                Assert.AreEqual(attempts + 1, Network.Connections.Count);
            }
            Network.RefuseWith = 0;
            Network.NowMs += 30001;
            Pump(stream);
            StreamEvent ready = Of(StreamEventKind.Ready).Single();
            Assert.AreEqual(landing, ready.Landing);
            Assert.AreEqual(Network.Scene.Within(Middle, 4), ready.Segments);
            Assert.AreEqual(0, stream.Stats.RepeatedBytes);
            Assert.AreEqual(3, Of(StreamEventKind.Opened).Last().HeldCount);
            Assert.IsTrue(Network.Connections.All(transport => transport.Lent == 0));
        }

        [Test]
        public void ANoticeSaysHowLongToWait()
        {
            SceneStream stream = Network.Stream();
            Pump(stream);
            Network.Last.Server.Say(new NoticeMessage { Kind = "draining", ReconnectAfterMs = 7000 });
            Pump(stream);
            Network.Last.Break(4503, "draining");
            Pump(stream);
            LinkState link = Links().Last();
            Assert.AreEqual(7000, link.RetryInMs);
            Assert.AreEqual("draining", link.Code);
            Assert.AreEqual(4503, link.CloseCode);
        }

        [Test]
        public void ARefusedTokenClosesForGoodUntilAnotherOneIsGiven()
        {
            Network.RefuseWith = 4401;
            Network.RefuseReason = "unauthorised";
            Network.RefuseError = new ErrorMessage { Code = "unauthorised", Message = "no such token", Fatal = true };
            SceneStream stream = Network.Stream(options => options.Token = "old");
            int request = stream.Pick(Middle);
            int landing = stream.Land(Middle, 2);
            Pump(stream);
            Assert.AreEqual("old", Network.Last.Token);
            LinkState link = Links().Last();
            Assert.AreEqual(LinkPhase.Closed, link.Phase);
            Assert.AreEqual("unauthorised", link.Code);
            Assert.AreEqual("no such token", link.Message);
            Assert.AreEqual(request, Of(StreamEventKind.PickRefused).Single().Request);
            // Closed for good: no time brings it back, and picks are refused at once.
            Network.NowMs += 1e6;
            Pump(stream);
            Assert.AreEqual(1, Network.Connections.Count);
            Assert.IsTrue(double.IsPositiveInfinity(stream.DueMs));
            Assert.AreEqual(request + 1, stream.Pick(Middle));
            Pump(stream);
            Assert.AreEqual(2, Of(StreamEventKind.PickRefused).Count);
            Network.RefuseWith = 0;
            stream.Reconnect("new");
            Pump(stream);
            Assert.AreEqual("new", Network.Last.Token);
            Assert.AreEqual(landing, Of(StreamEventKind.Ready).Single().Landing);
        }

        [Test]
        public void AnotherTokenMakesANewConnectionAndKeepsWhatIsHeld()
        {
            SceneStream stream = Network.Stream(options => options.Token = "old");
            stream.Land(Middle, 3);
            Pump(stream);
            // The same token, or none: the connection works, and stays.
            stream.Reconnect("old");
            stream.Reconnect();
            Assert.AreEqual(1, Network.Connections.Count);
            stream.Reconnect("new");
            Pump(stream);
            Assert.AreEqual(2, Network.Connections.Count);
            Assert.IsTrue(Network.Connections[0].IsDisposed);
            Assert.AreEqual(Network.Scene.Within(Middle, 3).Length, Of(StreamEventKind.Opened).Last().HeldCount);
        }

        [Test]
        public void AFunctionGivesEachConnectionItsTokenAndARefusedOneMayBeRenewed()
        {
            string present = "first";
            int asked = 0;
            SceneStream stream = Network.Stream(options => options.TokenProvider = () =>
                {
                    asked++;
                    return present;
                });
            stream.Land(Middle, 3);
            Pump(stream);
            Assert.AreEqual("first", Network.Last.Token);
            Assert.AreEqual(1, asked);
            // It ends: there is another by now, so it is waited for as after any loss, and nothing comes twice.
            present = "second";
            int arrived = Of(StreamEventKind.Arrived).Count;
            Network.Last.Break(4401);
            Pump(stream);
            Assert.AreEqual(LinkPhase.Waiting, Links().Last().Phase);
            Assert.AreEqual("unauthorised", Links().Last().Code);
            Network.NowMs += 500;
            Pump(stream);
            Assert.AreEqual("second", Network.Last.Token);
            stream.Land(Middle, 3);
            Pump(stream);
            Assert.AreEqual(2, Of(StreamEventKind.Ready).Count);
            Assert.AreEqual(arrived, Of(StreamEventKind.Arrived).Count);
            // The same again is no other: closed for good.
            Network.Last.Break(4401);
            Pump(stream);
            Assert.AreEqual(LinkPhase.Closed, Links().Last().Phase);
            // Whoever gives one by hand is not overruled.
            stream.Reconnect("by hand");
            Pump(stream);
            Assert.AreEqual("by hand", Network.Last.Token);
            Assert.AreEqual(LinkPhase.Open, Links().Last().Phase);
        }

        [Test]
        public void AServiceThatNeverKnewTheTokenIsNotAskedAgain()
        {
            int asked = 0;
            Network.RefuseWith = 4401;
            SceneStream stream = Network.Stream(options => options.TokenProvider = () => (++asked).ToString());
            Pump(stream);
            Network.NowMs += 1e6;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Closed, Links().Last().Phase);
            Assert.AreEqual(1, Network.Connections.Count);
            Assert.AreEqual(1, asked);
        }

        [Test]
        public void AFunctionThatFailsIsALineThatIsDown()
        {
            bool fails = true;
            SceneStream stream = Network.Stream(options => options.TokenProvider = () =>
                {
                    if (fails) throw new InvalidOperationException("no login");
                    return "present";
                });
            Pump(stream);
            Assert.AreEqual(LinkPhase.Waiting, Links().Last().Phase);
            StringAssert.Contains("no login", Links().Last().Message);
            Assert.AreEqual(0, Network.Connections.Count);
            fails = false;
            Network.NowMs += 500;
            Pump(stream);
            Assert.AreEqual("present", Network.Last.Token);
            Assert.AreEqual(LinkPhase.Open, Links().Last().Phase);
        }

        [Test]
        public void AnOfferThatIsTooLargeIsMadeAfterTheWelcome()
        {
            SceneStream stream = Network.Stream();
            stream.Land(Middle, 3);
            Pump(stream);
            int heldSegments = stream.Stats.HeldSegments;
            Network.RefuseWith = 4413;
            Network.RefuseError = new ErrorMessage { Code = "too_large", Message = "too much", Fatal = true };
            Network.Last.Break(1006);
            Pump(stream);
            Network.NowMs += 500;
            stream.Pump();
            Network.RefuseWith = 0;
            Pump(stream);
            List<string> heard = Network.Last.Server.Heard.ConvertAll(message => message.Type);
            Assert.AreEqual(new[] { "hello", "held" }, heard.Take(2).ToArray());
            Assert.AreEqual(0, ((HelloMessage)Network.Last.Server.Heard[0]).Held.Length);
            Assert.AreEqual(heldSegments, Network.Last.Server.Held.Count);
        }

        [Test]
        public void ABrokenProtocolClosesWith4400ForGood()
        {
            SceneStream stream = Network.Stream();
            Pump(stream);
            Network.Last.Inject(new byte[] { 0xc1 });
            Pump(stream);
            Assert.AreEqual(4400, Network.Last.ClosedByClientWith);
            LinkState link = Links().Last();
            Assert.AreEqual(LinkPhase.Closed, link.Phase);
            Assert.AreEqual("malformed", link.Code);
            StringAssert.Contains("0xc1", link.Message);
            Assert.AreEqual(0, Network.Last.Lent);
        }

        [Test]
        public void AClosedStreamAnswersNothingAndConnectsNoMore()
        {
            SceneStream stream = Network.Stream();
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
            Assert.AreEqual(1, Network.Connections.Count);
        }
    }
}
