using System;
using System.Collections.Generic;
using System.Linq;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>
    /// The other end of a stream: a server that answers what it is asked, one landing at a time, and no more. How a session
    /// behaves is shown by the session corpus, which the real server's state machine made; tests of the stream need somebody
    /// who answers at a time that they choose.
    /// </summary>
    internal sealed class StreamAnsweringServer
    {
        /// <summary>Ids that the client holds.</summary>
        internal readonly HashSet<uint> Held = new HashSet<uint>();
        /// <summary>Every message of the client, in order.</summary>
        internal readonly List<WireMessage> Heard = new List<WireMessage>();

        private readonly StreamToyScene scene;
        private readonly Queue<WireMessage> outbox = new Queue<WireMessage>();
        // The landing that is being sent, and what of it is still to be sent; null for none.
        private LandMessage landing;
        private Queue<uint> load;

        internal StreamAnsweringServer(StreamToyScene scene) { this.scene = scene; }

        internal void Say(WireMessage message) { outbox.Enqueue(message); }

        internal IEnumerable<T> HeardOf<T>()
            where T : WireMessage { return Heard.OfType<T>(); }

        internal void Receive(byte[] data)
        {
            WireMessage message = WireCodec.Decode(new ArraySegment<byte>(data), Direction.ClientToServer);
            Heard.Add(message);
            if (message is HelloMessage)
                Welcome((HelloMessage)message);
            else if (message is HeldMessage)
                Held.UnionWith(((HeldMessage)message).Segments.Select(row => row.Segment));
            else if (message is EvictMessage)
                Held.ExceptWith(((EvictMessage)message).Segments);
            else if (message is PickMessage)
                Say(new PickedMessage { Request = ((PickMessage)message).Request });
            else if (message is LandMessage)
                Plan((LandMessage)message);
        }

        /// <summary>The next WebSocket message; null where nothing is to be said.</summary>
        internal byte[] Next()
        {
            if (outbox.Count > 0) return WireCodec.Encode(outbox.Dequeue());
            if (landing == null) return null;
            if (load.Count == 0)
            {
                uint generation = landing.Generation;
                landing = null;
                return WireCodec.Encode(new ReadyMessage { Generation = generation, Missing = new uint[0] });
            }
            uint segment = load.Dequeue();
            Held.Add(segment);
            byte[] payload = scene.Payloads[segment];
            return new PayloadFrame(landing.Generation, segment, 0, payload.Length, new ArraySegment<byte>(payload)).Encode();
        }

        private void Welcome(HelloMessage hello)
        {
            Held.UnionWith((hello.Held ?? new HeldRow[0]).Select(row => row.Segment));
            Say(new WelcomeMessage {
                Protocol = new ProtocolVersion(WireLimits.ProtocolMajor, WireLimits.ProtocolMinor),
                Server = "answering",
                Session = "s",
                Scene = new SceneInfoPart { Id = "toy", Version = scene.Version, Name = "toy", SegmentCount = (uint)scene.Facts.Length },
                Limits =
                    new ServerLimitsPart {
                        MaxRadiusM = 500,
                        MaxMessageBytes = 1 << 20,
                        MaxMessagesPerS = 60,
                        MaxHeldSegments = 1000,
                        MaxPlanSegments = 16384,
                        MaxCreditBytes = 1 << 26,
                        IdleTimeoutS = 60,
                    },
                ReleaseFactor = 1,
                Dropped = new uint[0],
                HeldCount = Held.Count,
            });
        }

        private void Plan(LandMessage land)
        {
            if (landing != null) Say(new SupersededMessage { Generation = landing.Generation, By = land.Generation });
            uint[] wanted = scene.Within(land.Position, land.RadiusM);
            landing = land;
            load = new Queue<uint>(wanted.Where(segment => !Held.Contains(segment)));
            Say(new PlanMessage {
                Generation = land.Generation,
                Position = land.Position,
                RadiusM = land.RadiusM,
                ReleaseRadiusM = land.RadiusM,
                EffectiveRadiusM = land.RadiusM,
                Load = load.Select(segment => scene.Facts[segment]).ToArray(),
                Keep = wanted.Where(segment => Held.Contains(segment)).ToArray(),
                Nearby = new uint[0],
                LoadBytes = scene.BytesOf(load),
                LoadTriangles = StreamToyScene.FacesEach *load.Count,
                TotalBytes = scene.BytesOf(wanted),
                TotalTriangles = StreamToyScene.FacesEach *wanted.Length,
            });
        }
    }
}
