using System;
using System.Collections.Generic;
using System.Linq;
using NUnit.Framework;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>What a stream bounds: silence, rates, and everything that could grow.</summary>
    [TestFixture]
    public class StreamBoundsTests : StreamTestBase
    {
        [Test]
        public void AServerThatSaysNothingIsGivenUp()
        {
            // 1. Nobody answers the handshake: given up after 10 s, and tried again.
            Network.IsDeaf = true;
            SceneStream stream = Network.Stream();
            Network.NowMs += 9999;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Connecting, Links().Last().Phase);
            Network.NowMs += 2;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Waiting, Links().Last().Phase);
            Assert.AreEqual("timeout", Links().Last().Code);
            Network.IsDeaf = false;
            Network.NowMs += 500;
            Pump(stream);
            // 2. A server that says nothing any more, without and with an answer owed.
            Network.Last.IsSilent = true;
            // Silence of a server that owes nothing is no silence.
            Network.NowMs += 100000;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Open, Links().Last().Phase);
            stream.Land(Middle, 2);
            Pump(stream);
            Network.NowMs += 29999;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Open, Links().Last().Phase);
            Network.NowMs += 2;
            Pump(stream);
            Assert.AreEqual(LinkPhase.Waiting, Links().Last().Phase);
            Assert.AreEqual("the server is silent", Links().Last().Message);
        }

        [Test]
        public void AimsAreSentTenTimesASecondAtMostAndTheNewestCounts()
        {
            SceneStream stream = Network.Stream();
            Pump(stream);
            for (int frame = 0; frame < 90; frame++)
            {
                // A headset's 90 frames a second, for one second.
                stream.Aim(new Vec3(frame, 0, 0), 1);
                stream.Pump();
                Network.NowMs += 1000.0 / 90;
            }
            Network.NowMs += 100;
            Pump(stream);
            List<AimMessage> aims = Network.Last.Server.HeardOf<AimMessage>().ToList();
            Assert.That(aims.Count, Is.InRange(9, 11));
            Assert.AreEqual(89, aims.Last().Position.X);
        }

        [Test]
        public void MessagesKeepToTheServersRate()
        {
            SceneStream stream = Network.Stream();
            Pump(stream);
            for (int frame = 0; frame < 2000; frame++)
            {
                stream.Land(Middle, 1 + frame % 3);
                Pump(stream);
                Network.NowMs += 5;
            }
            // Within any 10 s: the bucket, full at the start, and the rate.
            List<double> sent = Network.Last.SentAtMs;
            for (int first = 0; first < sent.Count; first++)
            {
                int within = sent.Count(atMs => atMs >= sent[first] && atMs < sent[first] + 10000);
                Assert.LessOrEqual(within, 60 * 10 * 2);
            }
            Assert.Less(sent.Count, 1000);
            Network.NowMs += 20000;
            Pump(stream);
            Assert.AreEqual(2000, Of(StreamEventKind.Ready).Last().Landing);
        }

        [Test]
        public void ATransportThatIsFullGetsItsMessagesLater()
        {
            SceneStream stream = Network.Stream();
            Pump(stream);
            Network.Last.TakesNothing = true;
            stream.Land(Middle, 1);
            // The transport takes nothing: the older land is replaced before it leaves.
            int newest = stream.Land(Middle, 2);
            Pump(stream);
            Assert.AreEqual(1, Network.Last.Server.Heard.Count);
            Network.Last.TakesNothing = false;
            Pump(stream);
            Assert.AreEqual(newest, Of(StreamEventKind.Ready).Last().Landing);
        }

        [Test]
        public void EventsThatNobodyTakesStopTheReceiving()
        {
            SceneStream stream = Network.Stream();
            Pump(stream);
            for (int count = 0; count < 3 * SceneStream.MaxWaitingEvents; count++)
            {
                Network.Last.Inject(WireCodec.Encode(new NoticeMessage { Kind = "news" }));
            }
            // Pumped, and nobody takes the events: it stops at its bound, give or take one pump.
            for (int count = 0; count < 10; count++) stream.Pump();
            int events = Take(stream);
            Assert.That(events, Is.InRange(SceneStream.MaxWaitingEvents, 3 * SceneStream.MaxWaitingEvents));
            Pump(stream);
            Assert.AreEqual(3 * SceneStream.MaxWaitingEvents, Of(StreamEventKind.Notice).Count);
        }

        [Test]
        public void AServerThatSendsWrongBytesWithoutEndFillsNoMemory()
        {
            SceneStream stream = Network.Stream();
            Pump(stream);
            Network.Last.IsSilent = true;
            stream.Aim(Middle, 1);
            Pump(stream);
            SegmentFacts facts = Network.Scene.Facts[0];
            Network.Last.Inject(WireCodec.Encode(new PrefetchMessage { Generation = 1, Segments = new[] { facts }, Bytes = facts.Length }));
            var chunk = new ArraySegment<byte>(new byte[facts.Length]);
            byte[] wrong = new PayloadFrame(1, 0, 0, facts.Length, chunk).Encode();
            // Each wrong frame makes a reject that must be sent; the pacer lets few of them leave.
            for (int count = 0; count < 5000; count++) Network.Last.Inject(wrong);
            Pump(stream);
            int rejects = Network.Last.Server.HeardOf<RejectMessage>().Count();
            Assert.That(Network.Last.Left, Is.InRange(5000 - rejects - 600, 5000 - rejects));
            // It goes on as the rejects leave, and not faster.
            Network.NowMs += 60000;
            Pump(stream);
            Assert.Greater(Network.Last.Server.HeardOf<RejectMessage>().Count(), rejects);
        }

        [Test]
        public void MorePicksThanMayWaitAreRefusedHere()
        {
            SceneStream stream = Network.Stream();
            for (int count = 0; count < SceneStream.MaxPicks + 3; count++) Assert.AreEqual(count + 1, stream.Pick(Middle));
            Pump(stream);
            Assert.AreEqual(SceneStream.MaxPicks, Of(StreamEventKind.Picked).Count);
            Assert.IsTrue(Of(StreamEventKind.PickRefused)
                    .All(streamEvent => streamEvent.Code == "too_many" && streamEvent.Request > SceneStream.MaxPicks));
            Assert.AreEqual(3, Of(StreamEventKind.PickRefused).Count);
            Assert.AreEqual(SceneStream.MaxPicks, Network.Last.Server.HeardOf<PickMessage>().Count());
        }
    }
}
