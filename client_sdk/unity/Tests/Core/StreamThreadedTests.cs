using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Linq;
using System.Threading;
using NUnit.Framework;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>The stream on a thread of its own.</summary>
    [TestFixture]
    public class StreamThreadedTests
    {
        private static readonly Vec3 Middle = StreamToyScene.Middle;

        [Test]
        public void LandsAsTheInlineStreamDoesAndPinsFromAnyThread()
        {
            var network = new StreamFakeNetwork();
            var stream = new ThreadedStream(network.StreamOptions(), network);
            var events = new List<StreamEvent>();
            int last = 0;
            // Numbers come back before the thread has run the commands.
            for (int count = 1; count <= 20; count++)
            {
                last = stream.Land(Middle, 1 + count % 5);
                Assert.AreEqual(count, last);
                stream.Aim(Middle, 2);
            }
            int request = stream.Pick(Middle);
            Until(stream, events,
                () => events.Exists(streamEvent => streamEvent.Kind == StreamEventKind.Ready && streamEvent.Landing == last)
                    && events.Exists(streamEvent => streamEvent.Kind == StreamEventKind.Picked));
            StreamEvent ready = events.FindLast(streamEvent => streamEvent.Kind == StreamEventKind.Ready);
            Assert.AreEqual(network.Scene.Within(Middle, 1 + 20 % 5), ready.Segments);
            Assert.GreaterOrEqual(ready.ElapsedMs, 0);
            Assert.AreEqual(request, events.Find(streamEvent => streamEvent.Kind == StreamEventKind.Picked).Request);
            foreach (uint segment in ready.Segments)
            {
                PinnedPayload pin;
                Assert.IsTrue(stream.TryPin(segment, out pin));
                Assert.AreEqual(network.Scene.Payloads[segment], pin.Bytes.ToArray());
                pin.Dispose();
            }
            Until(stream, events, () => stream.Stats.HeldSegments > 0);
            stream.Close();
            PinnedPayload released;
            Until(stream, events, () => !stream.TryPin(ready.Segments[0], out released));
            Assert.AreEqual("bye", network.Last.Server.Heard.Last().Type);
            stream.Dispose();
        }

        [Test]
        public void TellsWhatBreaksItsThread()
        {
            var network = new StreamFakeNetwork();
            var stream = new ThreadedStream(network.StreamOptions(), network);
            // The transport's factory throws on the stream's thread.
            network.Creating = () => throw new PlatformNotSupportedException("no sockets here");
            stream.Reconnect("another token");
            var events = new List<StreamEvent>();
            Until(stream, events,
                () => events.Exists(streamEvent => streamEvent.Kind == StreamEventKind.Link && streamEvent.Link.Phase == LinkPhase.Closed));
            LinkState end = events.FindLast(streamEvent => streamEvent.Kind == StreamEventKind.Link).Link;
            Assert.AreEqual("internal", end.Code);
            StringAssert.Contains("no sockets here", end.Message);
            Assert.IsTrue(network.Last.IsDisposed);
            stream.Land(Middle, 1); // Nobody hears it, and nothing breaks.
            stream.Dispose();
        }

        [Test]
        public void RefusesNumbersThatCannotBeInTheCallersThread()
        {
            var network = new StreamFakeNetwork();
            using (var stream = new ThreadedStream(network.StreamOptions(), network))
            {
                Assert.Catch<ArgumentException>(() => stream.Land(Middle, 0));
                Assert.Catch<ArgumentException>(() => stream.Land(Middle, 1, new LandOptions { DeadlineMs = 1 }));
                Assert.Catch<ArgumentException>(() => stream.Aim(Middle, double.NaN));
                Assert.Catch<ArgumentException>(() => stream.Pick(Middle, new Vec3(0, 0, 0)));
                Assert.AreEqual(1, stream.Land(Middle, 1));
                Assert.AreEqual(1, stream.Pick(Middle));
            }
        }

        [Test]
        public void ConnectsAgainByItself()
        {
            var network = new StreamFakeNetwork { RefuseWith = 1006 };
            var events = new List<StreamEvent>();
            using (var stream = new ThreadedStream(network.StreamOptions(), network))
            {
                int landing = stream.Land(Middle, 2);
                Until(stream, events,
                    () => events.Exists(
                        streamEvent => streamEvent.Kind == StreamEventKind.Link && streamEvent.Link.Phase == LinkPhase.Waiting));
                network.RefuseWith = 0;
                Until(stream, events,
                    () => events.Exists(streamEvent => streamEvent.Kind == StreamEventKind.Ready && streamEvent.Landing == landing));
            }
        }

        [Test]
        public void ALandingEndsTheAimsBeforeIt()
        {
            var network = new StreamFakeNetwork();
            var events = new List<StreamEvent>();
            var isBusy = new ManualResetEvent(false);
            var mayGoOn = new ManualResetEvent(false);
            using (var stream = new ThreadedStream(network.StreamOptions(), network))
            {
                Until(stream, events, () => events.Exists(streamEvent => streamEvent.Kind == StreamEventKind.Opened));
                // The thread is held up while aim and landing are called, so that both wait together.
                network.Creating = () =>
                {
                    isBusy.Set();
                    mayGoOn.WaitOne(20000);
                };
                stream.Reconnect("another");
                Assert.IsTrue(isBusy.WaitOne(20000));
                stream.Aim(new Vec3(0, 0, 0), 1);
                int landing = stream.Land(Middle, 1);
                mayGoOn.Set();
                Until(stream, events,
                    () => events.Exists(streamEvent => streamEvent.Kind == StreamEventKind.Ready && streamEvent.Landing == landing));
                // Longer than the period of aims: one that was to be sent would have been.
                Thread.Sleep(150);
                Assert.AreEqual(0, network.Last.Server.HeardOf<WireMessage>().Count(message => message.Type == "aim"));
            }
        }

        private static void Until(ThreadedStream stream, List<StreamEvent> events, Func<bool> condition)
        {
            Stopwatch clock = Stopwatch.StartNew();
            do
            {
                stream.Pump();
                StreamEvent next;
                while (stream.TryNextEvent(out next)) events.Add(next);
                Assert.Less(clock.ElapsedMilliseconds, 20000, "it never is so");
                Thread.Sleep(1);
            }
            while (!condition());
        }
    }
}
