using System;
using System.Collections.Generic;
using System.Linq;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>
    /// The server's half of the wire protocol, as short as its rules allow: what the client's state machine is tested against.
    /// One connection. Throws on what a client must not do. Section numbers are those of spec/wire-protocol.md.
    /// </summary>
    internal sealed class SessionModelServer
    {
        /// <summary>Ids that this server believes the client holds.</summary>
        internal readonly HashSet<uint> Held = new HashSet<uint>();
        /// <summary>Every message of the client, in order.</summary>
        internal readonly List<WireMessage> Heard = new List<WireMessage>();
        /// <summary>Segments whose payload this server cannot read: they end as missing.</summary>
        internal readonly HashSet<uint> Unreadable = new HashSet<uint>();
        /// <summary>Chunk bytes that may still be sent.</summary>
        internal long Credit;
        /// <summary>Chunk bytes sent.</summary>
        internal long ChunkBytes;
        /// <summary>Set by a test: the deadline of the landing has passed.</summary>
        internal bool DeadlinePassed;
        // Whether a landing that comes now waits for its plan, until a newer one ends it (6.3).
        internal bool PlansNothing;
        private uint? unplanned;

        private readonly SessionToyScene scene;
        private readonly SessionModelOptions options;
        private readonly Queue<WireMessage> outbox = new Queue<WireMessage>();
        // Bytes sent of segments that are not whole: a newer plan that loads them goes on from there (6.5, rule 3).
        private readonly Dictionary<uint, int> sentBytes = new Dictionary<uint, int>();
        private bool isOpen;
        private bool hasMoved;
        private BudgetsPart budgets;
        private double releaseFactor;
        private long generation = -1;
        private SessionModelSending landing;
        private SessionModelSending prefetch;
        private AimMessage waitingAim;

        internal SessionModelServer(SessionToyScene scene, SessionModelOptions options)
        {
            this.scene = scene;
            this.options = options;
        }

        /// <summary>Queue a message; a test may inject what no server should send.</summary>
        internal void Say(WireMessage message) { outbox.Enqueue(message); }

        internal IEnumerable<T> HeardOf<T>()
            where T : WireMessage { return Heard.OfType<T>(); }

        /// <summary>Take one message of the client; throws where the protocol forbids it.</summary>
        internal void Receive(byte[] data)
        {
            WireMessage message = WireCodec.Decode(new ArraySegment<byte>(data), Direction.ClientToServer);
            Heard.Add(message);
            if (message is HelloMessage)
                Hello((HelloMessage)message);
            else if (!isOpen)
                throw new InvalidOperationException("got " + message.Type + " before hello");
            else if (message is HeldMessage)
                MoreHeld(((HeldMessage)message).Segments);
            else if (message is CreditMessage)
                Credit += ((CreditMessage)message).Bytes;
            else if (message is EvictMessage)
                Evict(((EvictMessage)message).Segments);
            else if (message is RejectMessage)
                Reject(((RejectMessage)message).Segment);
            else if (message is PickMessage)
                Pick(((PickMessage)message).Request);
            else if (message is LandMessage)
                Land((LandMessage)message);
            else if (message is AimMessage)
                Aim((AimMessage)message);
            else if (!(message is ByeMessage))
                throw new InvalidOperationException("the client said " + message.Type);
        }

        /// <summary>The next WebSocket message; null where nothing can be sent now.</summary>
        internal byte[] Next()
        {
            if (outbox.Count > 0) return Encoded();
            foreach (SessionModelSending sending in new[] { landing, prefetch })
            {
                if (sending == null || sending.IsReadySent) continue;
                Degrade(sending);
                if (outbox.Count > 0) return Encoded();
                byte[] chunk = Chunk(sending);
                if (chunk != null) return chunk;
                Settle(sending);
                if (outbox.Count > 0) return Encoded();
                // An aim never disturbs a landing (7, rule 2).
                if (!sending.IsReadySent) return null;
            }
            return null;
        }

        private byte[] Encoded() { return WireCodec.Encode(outbox.Dequeue()); }

        private void Hello(HelloMessage hello)
        {
            if (isOpen) throw new InvalidOperationException("a second hello");
            isOpen = true;
            Credit = hello.CreditBytes;
            budgets = hello.Budgets;
            releaseFactor = hello.ReleaseFactor ?? 1.25;
            uint[] dropped = Accept(hello.Held ?? new HeldRow[0]);
            Say(new WelcomeMessage {
                Protocol = new ProtocolVersion(WireLimits.ProtocolMajor, WireLimits.ProtocolMinor),
                Server = "model",
                Session = "s",
                Scene = new SceneInfoPart { Id = "toy", Version = scene.Version, Name = "toy", SegmentCount = (uint)scene.Facts.Length },
                Limits =
                    new ServerLimitsPart {
                        MaxRadiusM = 500,
                        MaxMessageBytes = 1 << 20,
                        MaxMessagesPerS = 60,
                        MaxHeldSegments = options.MaxHeldSegments,
                        MaxPlanSegments = 16384,
                        MaxCreditBytes = 1 << 26,
                        IdleTimeoutS = 60,
                    },
                ReleaseFactor = releaseFactor,
                Dropped = dropped,
                HeldCount = Held.Count,
            });
        }

        /// <summary>Count the rows that are of this version as held; the ids of the others.</summary>
        private uint[] Accept(HeldRow[] rows)
        {
            var dropped = new List<uint>();
            foreach (HeldRow row in rows)
            {
                if (row.Segment < scene.Facts.Length && scene.Facts[row.Segment].Xxh3 == row.Xxh3)
                    Held.Add(row.Segment);
                else
                    dropped.Add(row.Segment);
            }
            return dropped.ToArray();
        }

        private void MoreHeld(HeldRow[] rows)
        {
            if (hasMoved) throw new InvalidOperationException("held after an aim or land");
            if (rows.Length > options.MaxHeldSegments) throw new InvalidOperationException("held with " + rows.Length + " rows");
            Say(new HeldCheckedMessage { Dropped = Accept(rows), HeldCount = (uint)Held.Count });
        }

        private void Evict(uint[] segments)
        {
            foreach (uint segment in segments)
            {
                if (landing != null && !landing.IsReadySent && landing.Order.Contains(segment))
                {
                    throw new InvalidOperationException("evicts " + segment + " of a plan that is not ready (6.7, rule 2)");
                }
                Held.Remove(segment);
            }
        }

        private void Reject(uint segment)
        {
            Held.Remove(segment);
            SessionModelSending sending = landing != null && landing.Order.Contains(segment) ? landing : prefetch;
            if (sending == null || !sending.Order.Contains(segment)) return;
            // A prefetch sends again only what it loads; a landing also what its plan keeps (6.4, rule 7).
            if (sending.Land == null && !sending.Load.Contains(segment)) return;
            if (!sending.Rejected.Add(segment))
            {
                if (sending.Land == null) return;
                sending.Missing.Add(segment);
                sending.IsReadySent = false;
                return;
            }
            sending.IsReadySent = false;
            sending.Queue.Add(segment);
            sending.Queue = sending.Queue.OrderBy(id => sentBytes.ContainsKey(id) ? -1 : Array.IndexOf(sending.Order, id)).ToList();
        }

        private void Pick(uint request)
        {
            if (options.RefusesPicks)
            {
                Say(new ErrorMessage { Code = "too_many", Message = "picks", Fatal = false, Request = request });
                return;
            }
            Say(new PickedMessage {
                Request = request,
                Hit =
                    new HitPart {
                        Normal = new Vec3(0, 1, 0),
                        Segment = 3,
                        Region = 1,
                        HeightM = 9,
                        Attributes = new[] { new KeyValuePair<string, double>("grade", 1.5) },
                    },
            });
        }

        private void Land(LandMessage land)
        {
            ExpectNewer(land.Generation);
            if (land.RadiusM > 500)
            {
                Say(new ErrorMessage { Code = "radius_too_large", Message = "too large", Fatal = false, Generation = land.Generation });
                return;
            }
            // 1. The new landing ends the older one and every aim.
            Supersede(land.Generation);
            DeadlinePassed = false;
            landing = PlansNothing ? null : landing;
            unplanned = PlansNothing ? (uint?)land.Generation : null;
            if (PlansNothing) return;
            // 2. Candidates, nearest first, with what is held out to the release radius; of them what the budgets allow.
            uint[] order = Ordered(land.Position, land.RadiusM);
            string omittedBy;
            uint[] fitting = Within(order, out omittedBy);
            uint[] near = order.Where(segment => Far(land.Position, segment) <= land.RadiusM).ToArray();
            uint[] planned = fitting.Take(near.Length).ToArray();
            uint[] load = planned.Where(segment => !Held.Contains(segment)).ToArray();
            double innerRadiusM = land.InnerRadiusM ?? -1;
            uint[] inner = planned.Where(segment => Far(land.Position, segment) <= innerRadiusM).ToArray();
            // 3. The plan: what is held is kept, the rest is loaded in that order.
            prefetch = null;
            landing = Begin(land.Generation, land, planned, load, inner);
            bool isCut = planned.Length < near.Length;
            Say(new PlanMessage {
                Generation = land.Generation,
                Position = land.Position,
                RadiusM = land.RadiusM,
                ReleaseRadiusM = land.RadiusM * releaseFactor,
                EffectiveRadiusM = isCut ? Far(land.Position, near[planned.Length]) : land.RadiusM,
                InnerCount = inner.Length,
                Load = load.Select(segment => scene.Facts[segment]).ToArray(),
                Keep = planned.Where(segment => Held.Contains(segment)).OrderBy(segment => segment).ToArray(),
                Nearby = fitting.Skip(near.Length).OrderBy(segment => segment).ToArray(),
                LoadBytes = scene.BytesOf(load),
                LoadTriangles = SessionToyScene.FacesEach * load.Length,
                TotalBytes = scene.BytesOf(planned),
                TotalTriangles = SessionToyScene.FacesEach * planned.Length,
                OmittedSegments = (uint)(near.Length - planned.Length),
                OmittedBy = isCut ? omittedBy : null,
            });
        }

        private void Aim(AimMessage aim)
        {
            ExpectNewer(aim.Generation);
            if (waitingAim != null) SaySuperseded(waitingAim.Generation, aim.Generation, 0);
            waitingAim = aim;
            if (landing != null && !landing.IsReadySent) return;
            TellSuperseded(prefetch, aim.Generation);
            StartAim();
        }

        private void StartAim()
        {
            AimMessage aim = waitingAim;
            if (aim == null) return;
            waitingAim = null;
            string omittedBy;
            uint[] planned = Within(Ordered(aim.Position, aim.RadiusM), out omittedBy);
            uint[] load = planned.Where(segment => !Held.Contains(segment)).ToArray();
            prefetch = Begin(aim.Generation, null, planned, load, new uint[0]);
            Say(new PrefetchMessage {
                Generation = aim.Generation,
                Segments = load.Select(segment => scene.Facts[segment]).ToArray(),
                Bytes = scene.BytesOf(load),
            });
        }

        private SessionModelSending Begin(uint number, LandMessage land, uint[] order, uint[] load, uint[] inner)
        {
            foreach (uint segment in sentBytes.Keys.ToList())
            {
                if (!load.Contains(segment)) sentBytes.Remove(segment);
            }
            return new SessionModelSending {
                Generation = number,
                Land = land,
                Order = order,
                Inner = inner,
                Queue = load.ToList(),
                Load = new HashSet<uint>(load),
            };
        }

        private void Supersede(uint by)
        {
            if (unplanned != null) SaySuperseded(unplanned.Value, by, 0);
            if (waitingAim != null) SaySuperseded(waitingAim.Generation, by, 0);
            waitingAim = null;
            TellSuperseded(prefetch, by);
            TellSuperseded(landing, by);
        }

        private void TellSuperseded(SessionModelSending sending, uint by)
        {
            if (sending != null && !sending.IsReadySent) SaySuperseded(sending.Generation, by, scene.BytesOf(sending.Queue));
        }

        private void SaySuperseded(uint number, uint by, long unsentBytes)
        {
            Say(new SupersededMessage { Generation = number, By = by, UnsentBytes = unsentBytes });
        }

        private double Far(Vec3 centre, uint segment) { return scene.Facts[segment].Bounds.DistanceM(centre); }

        /// <summary>Candidates in order (6.1).</summary>
        private uint[] Ordered(Vec3 centre, double radiusM)
        {
            return scene.Facts.Select(facts => facts.Segment)
                .Where(segment => Far(centre, segment) <= (Held.Contains(segment) ? radiusM * releaseFactor : radiusM))
                .OrderBy(segment => Far(centre, segment))
                .ThenBy(segment => segment)
                .ToArray();
        }

        /// <summary>The strict prefix that the budgets allow (6.2).</summary>
        private uint[] Within(uint[] order, out string omittedBy)
        {
            long bytes = 0;
            for (int count = 0; count < order.Length; count++)
            {
                bytes += scene.Payloads[order[count]].Length;
                omittedBy = count + 1 > (budgets.MaxSegments ?? 16384)                                  ? "max_segments"
                    : SessionToyScene.FacesEach * (count + 1) > (budgets.MaxTriangles ?? long.MaxValue) ? "max_triangles"
                    : bytes > (budgets.MaxBytes ?? long.MaxValue)                                       ? "max_bytes"
                                                                                                        : null;
                if (omittedBy != null) return order.Take(count).ToArray();
            }
            omittedBy = null;
            return order;
        }

        private byte[] Chunk(SessionModelSending sending)
        {
            while (sending.Queue.Count > 0 && Unreadable.Contains(sending.Queue[0]))
            {
                sending.Missing.Add(sending.Queue[0]);
                sending.Queue.RemoveAt(0);
            }
            if (sending.Queue.Count == 0 || Credit < 1) return null;
            uint segment = sending.Queue[0];
            byte[] payload = scene.Payloads[segment];
            int offset;
            sentBytes.TryGetValue(segment, out offset);
            int maxBytes = options.Random == null ? options.MaxChunk : 1 + options.Random.Next(options.MaxChunk);
            var length = (int)Math.Min(Math.Min(maxBytes, Credit), payload.Length - offset);
            Credit -= length;
            ChunkBytes += length;
            sending.PayloadBytes += length;
            sentBytes[segment] = offset + length;
            if (offset + length == payload.Length)
            {
                sentBytes.Remove(segment);
                sending.Queue.RemoveAt(0);
                sending.Delivered++;
                Held.Add(segment);
            }
            var chunk = new ArraySegment<byte>(payload, offset, length);
            return new PayloadFrame(sending.Generation, segment, offset, payload.Length, chunk).Encode();
        }

        /// <summary>Say degraded where the deadline has passed and the inner set is whole.</summary>
        private void Degrade(SessionModelSending sending)
        {
            if (!DeadlinePassed || sending.IsDegradedSent || sending.Inner.Length == 0 || !sending.Inner.All(Held.Contains)) return;
            sending.IsDegradedSent = true;
            Say(new DegradedMessage { Generation = sending.Generation, Segments = sending.Inner });
        }

        /// <summary>Say ready where everything is sent.</summary>
        private void Settle(SessionModelSending sending)
        {
            if (sending.Queue.Count > 0) return;
            sending.IsReadySent = true;
            if (sending.Land != null)
            {
                Say(new ReadyMessage {
                    Generation = sending.Generation,
                    Delivered = sending.Delivered,
                    PayloadBytes = sending.PayloadBytes,
                    Missing = sending.Missing.OrderBy(segment => segment).ToArray(),
                });
            }
            if (sending == landing) StartAim();
        }

        private void ExpectNewer(uint number)
        {
            if (number <= generation) throw new InvalidOperationException("generation " + number + " after " + generation);
            generation = number;
            hasMoved = true;
        }
    }
}
