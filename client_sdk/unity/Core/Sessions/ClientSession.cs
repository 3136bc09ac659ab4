using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>
    /// The client's half of the wire protocol as a state machine: WebSocket messages in; events, and messages to send, out. No
    /// I/O, no clock, no thread: <see cref="SceneStream"/> owns those. It outlives connections.
    /// </summary>
    /// <remarks>
    /// Whoever holds it calls <see cref="Connected"/>, <see cref="Receive"/>, <see cref="ConnectionLost"/> as the connection
    /// lives and dies, and <see cref="Land"/>, <see cref="Aim"/>, <see cref="Pick"/> for its user; after each of them it takes
    /// <see cref="TryNextEvent"/> and <see cref="TakeMessages"/>. Section numbers in comments are those of spec/wire-protocol.md.
    /// </remarks>
    public sealed partial class ClientSession
    {
        private readonly SessionOptions options;
        private readonly Queue<StreamEvent> events = new Queue<StreamEvent>();
        // Messages, not bytes: one that is overtaken before it leaves can still be taken back.
        private readonly List<WireMessage> outbox = new List<WireMessage>();
        private readonly Holdings holdings;
        private readonly Transfers transfers;
        private readonly AimState aim = new AimState();
        private readonly HeldOffer offer = new HeldOffer();
        private readonly PickState picks;
        private readonly GroupState group;
        // hello is on its way, and no welcome has come.
        private bool isGreeting;
        // Generation of the newest land or aim, counted over all connections.
        private uint generation;
        private int landings;
        private int requests;
        // The landing whose land is still in the outbox, and the one that waits for the next welcome.
        private LandingState unsent;
        private LandingState queued;
        // How many chunk bytes are granted back at a time (half the credit), and those consumed since the last credit message.
        private long creditStep = 1;
        private long consumedBytes;

        /// <summary>A session that is not connected yet.</summary>
        /// <exception cref="ArgumentException">An option that the protocol does not allow.</exception>
        public ClientSession(SessionOptions options)
        {
            if (options.CreditBytes < 1) throw new ArgumentException("credit is " + options.CreditBytes + " bytes, expected 1 or more");
            // A bad option throws here, at its source, and not when the connection is made.
            WireCodec.Check(options.Hello(new HeldRow[0]));
            this.options = options;
            Cache = new SegmentCache(options.CacheBytes);
            holdings = new Holdings(Cache);
            transfers = new Transfers(options.Budgets, holdings, Pool, outbox, events);
            picks = new PickState(events);
            group = new GroupState(outbox, events);
        }

        /// <summary>Where the payloads' buffers come from.</summary>
        internal PayloadPool Pool { get; } = new PayloadPool();

        /// <summary>What is held. Look, and pin; only the session changes it.</summary>
        public SegmentCache Cache { get; }

        /// <summary>Scene version of the newest connection; null before the first.</summary>
        public string Version { get; private set; }

        /// <summary>What the server of the newest connection allows; null before the first.</summary>
        public ServerLimitsPart Limits { get; private set; }

        /// <summary>Whether the server has said welcome on the present connection.</summary>
        public bool IsOpen { get; private set; }

        /// <summary>Whether an aim waits for <see cref="FlushAim"/>.</summary>
        public bool HasAim => aim.Waits && IsOpen;

        /// <summary>Ids that the last ready landing shows, ascending.</summary>
        public IReadOnlyList<uint> Visible => transfers.Visible;

        /// <summary>Number of the newest landing that is not ready; null for none.</summary>
        public int? Unfinished
        {
            get {
                LandingState landing = queued ?? transfers.Unfinished;
                return landing == null ? (int?)null : landing.Number;
            }
        }

        /// <summary>Whether the server owes an answer: to a landing or a pick.</summary>
        public bool AwaitsAnswer => queued != null || transfers.Unfinished != null || picks.Count > 0;

        /// <summary>Picks that wait for an answer.</summary>
        public int OpenPicks => picks.Count;

        /// <summary>Messages that wait for <see cref="TakeMessages"/>.</summary>
        public int UnsentMessages => outbox.Count;

        /// <summary>Segments of which some chunks have come, and not all.</summary>
        public int PartialSegments => transfers.PartialSegments;

        /// <summary>What has been counted over all connections.</summary>
        public StreamStats Stats => transfers.Stats;

        /// <summary>Hold a payload of an earlier run, before the first connection offers it; its buffer is the session's from now on.</summary>
        internal void Restore(SegmentFacts facts, PayloadBuffer payload) { holdings.Put(facts, payload); }

        /// <summary>Take the next event; false where none waits.</summary>
        public bool TryNextEvent(out StreamEvent next)
        {
            bool hasEvent = events.Count > 0;
            next = hasEvent ? events.Dequeue() : default(StreamEvent);
            return hasEvent;
        }

        /// <summary>Take the WebSocket messages to send, once, in order: binary ones.</summary>
        public void TakeMessages(Queue<byte[]> into)
        {
            foreach (WireMessage message in outbox) into.Enqueue(WireCodec.Encode(message));
            outbox.Clear();
            unsent = null;
        }

        /// <summary>Open a connection: the first message is hello with what is held.</summary>
        /// <param name="offersInHello">
        /// False after a server found the offer too large: it is made after its welcome, which says how large it may be.
        /// </param>
        public void Connected(bool offersInHello = true)
        {
            IsOpen = false;
            isGreeting = true;
            outbox.Clear();
            // The offer clears what had to be told as evicted: a new connection knows only what hello names.
            outbox.Add(options.Hello(offer.First(holdings.Offer(), offersInHello)));
        }

        /// <summary>
        /// Note that the connection is gone. The newest landing that is not ready waits for the next connection, and so do the
        /// newest aim after it, picks and the seat in a group. Parts of segments are forgotten (10.2).
        /// </summary>
        public void ConnectionLost()
        {
            // Credit and chunks belong to the connection. Landings, picks and held payloads outlive it.
            IsOpen = false;
            isGreeting = false;
            outbox.Clear();
            unsent = null;
            consumedBytes = 0;
            aim.ConnectionLost(transfers.CompletedAimGeneration);
            LandingState landing = transfers.ConnectionLost();
            if (landing != null) AwaitWelcome(landing);
            group.ConnectionLost();
        }

        /// <summary>Take one whole WebSocket message; nothing refers to its bytes afterwards.</summary>
        /// <exception cref="ProtocolViolationException">
        /// The server sent what the protocol does not allow; the connection must be closed with 4400.
        /// </exception>
        public void Receive(ArraySegment<byte> data, bool isText)
        {
            if (isText) throw new ProtocolViolationException("got a text message, expected a binary one");
            try
            {
                if (PayloadFrame.IsPayload(data))
                {
                    PayloadFrame frame;
                    // By far the most frequent message: no allocation on this path.
                    if (!PayloadFrame.TryDecode(data, out frame)) return;
                    transfers.OnFrame(frame);
                    // Granted after the chunk was copied: credit bounds what lies in buffers between server and session.
                    Grant(frame.Chunk.Count);
                    return;
                }
                OnMessage(WireCodec.Decode(data, Direction.ServerToClient));
            }
            catch (DecodeException error)
            {
                throw new ProtocolViolationException(error.Message, error);
            }
        }

        /// <summary>Ask for a landing; it supersedes every one before that is not ready.</summary>
        /// <returns>Its number in the events; the same when a reconnect asks again under a new generation.</returns>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        public int Land(Vec3 position, double radiusM, LandOptions landOptions = null)
        {
            var landing = new LandingState(landings + 1, position, radiusM, landOptions);
            // Before anything changes: after an exception the session is as it was.
            WireCodec.Check(landing.Message(0, double.PositiveInfinity));
            landings++;
            aim.Clear();
            if (IsOpen)
                SendLanding(landing);
            else
                AwaitWelcome(landing);
            return landing.Number;
        }

        /// <summary>Note where the user points; only the newest is kept until <see cref="FlushAim"/>.</summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        public void Aim(Vec3 position, double radiusM, double? coarseRadiusM = null)
        {
            AimState.Check(position, radiusM, coarseRadiusM);
            aim.Note(position, radiusM, coarseRadiusM);
        }

        /// <summary>Send the newest aim, if there is one and the connection is open.</summary>
        public void FlushAim()
        {
            if (!HasAim) return;
            // Evictions go before every land and aim: the server plans by what it thinks is held (6.7).
            SendEvictions();
            outbox.Add(aim.Take(NextGeneration(), Limits.MaxRadiusM));
        }

        /// <summary>Ask what lies along a ray; the request's number in the events.</summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        public int Pick(Vec3 origin, Vec3? direction = null)
        {
            var pick = new PickMessage { Request = (uint)(requests + 1), Origin = origin, Direction = direction };
            WireCodec.Check(pick);
            requests++;
            picks.Ask(pick);
            if (IsOpen) outbox.Add(pick);
            return requests;
        }

        /// <summary>Refuse the picks that wait: nobody answers them any more.</summary>
        public void RefusePicks(string code, string message) { picks.RefuseAll(code, message); }

        /// <summary>Refuse one pick that waits; where it was not sent yet, it never is.</summary>
        public void RefusePick(int request, string code, string message)
        {
            outbox.RemoveAll(waiting => waiting is PickMessage && ((PickMessage)waiting).Request == request);
            picks.RefuseRequest((uint)request, code, message);
        }

        /// <summary>End the session politely.</summary>
        public void Bye()
        {
            if (IsOpen) outbox.Add(new ByeMessage());
        }

        /// <summary>Give all memory back; pins stay valid. The session is of no use afterwards.</summary>
        public void Free()
        {
            transfers.Free();
            Cache.Clear();
        }

        private void OnMessage(WireMessage message)
        {
            if (message is UnknownMessage) return;
            var welcome = message as WelcomeMessage;
            var error = message as ErrorMessage;
            if (welcome != null)
                OnWelcome(welcome);
            else if (error != null)
                OnError(error);
            else if (IsOpen)
                OnAnswer(message);
            else
                throw new ProtocolViolationException("got " + message.Type + " first, expected welcome or error");
        }

        /// <summary>Take a message that only an open session has.</summary>
        private void OnAnswer(WireMessage message)
        {
            switch (message.Type)
            {
                case "plan": transfers.OnPlan((PlanMessage)message); break;
                case "ready": transfers.OnReady((ReadyMessage)message); break;
                case "degraded": transfers.OnDegraded((DegradedMessage)message); break;
                case "superseded": transfers.OnSuperseded((SupersededMessage)message); break;
                case "prefetch": transfers.OnPrefetch((PrefetchMessage)message); break;
                case "picked": picks.Answered((PickedMessage)message); break;
                case "held_checked": Drop(((HeldCheckedMessage)message).Dropped); break;
                case "notice": OnNotice((NoticeMessage)message); break;
                default: group.OnMessage(message); break;
            }
        }

        private void OnWelcome(WelcomeMessage welcome)
        {
            // Order matters below: version and limits first, then what the server no longer counts as held, then what waited.
            if (IsOpen || !isGreeting) throw new ProtocolViolationException("got a second welcome, expected one");
            if (welcome.Protocol.Major != WireLimits.ProtocolMajor)
            {
                throw new ProtocolViolationException("got protocol " + welcome.Protocol + ", expected " + WireLimits.ProtocolMajor + ".x");
            }
            IsOpen = true;
            isGreeting = false;
            bool isChanged = Version != null && Version != welcome.Scene.Version;
            Version = welcome.Scene.Version;
            Limits = welcome.Limits;
            if (isChanged) transfers.HideAll();
            // Half of what the server really granted: it may allow less than was asked for.
            creditStep = Math.Max(1, Math.Min(options.CreditBytes, Limits.MaxCreditBytes) / 2);
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.Opened,
                SceneVersion = Version,
                Session = welcome.Session,
                IsChanged = isChanged,
                MaxRadiusM = Limits.MaxRadiusM,
                HeldCount = welcome.HeldCount,
            });
            Drop(welcome.Dropped);
            List<HeldRow> notOffered = offer.OfferRest(welcome, outbox);
            // A server that takes no table cannot be told: what it does not know of is not held (10.2).
            Drop(notOffered.ConvertAll(row => row.Segment).ToArray());
            picks.Resend(outbox);
            group.Connected(Limits.Groups);
            LandingState landing = queued;
            queued = null;
            if (landing != null) SendLanding(landing);
        }

        /// <summary>Free what the server does not count as held.</summary>
        private void Drop(uint[] segments)
        {
            if (segments.Length == 0) return;
            foreach (uint segment in segments) holdings.Forget(segment);
            events.Enqueue(new StreamEvent { Kind = StreamEventKind.Dropped, Segments = segments });
        }

        private void OnError(ErrorMessage error)
        {
            // An error belongs to a pick, a group, an aim, a landing, or to the session as a whole: asked in this order.
            if ((picks.Refused(error) || group.Refused(error)) && !error.Fatal) return;
            aim.Refused(error.Generation);
            LandingState refused = error.Fatal ? null : transfers.Refused(error.Generation);
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.Refused,
                Code = error.Code,
                Message = error.Message,
                IsFatal = error.Fatal,
                Landing = refused == null ? (int?)null : refused.Number,
            });
        }

        private void OnNotice(NoticeMessage notice)
        {
            long? afterMs = notice.ReconnectAfterMs;
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.Notice,
                Notice = notice.Kind,
                SceneVersion = notice.Version,
                ReconnectAfterMs = afterMs.HasValue ? (int?)Math.Min(afterMs.Value, int.MaxValue) : null,
            });
        }

        /// <summary>Keep the newest landing for the next connection; what waited before is superseded.</summary>
        private void AwaitWelcome(LandingState landing)
        {
            if (queued != null) ReportSuperseded(queued, landing);
            queued = landing;
        }

        private void SendLanding(LandingState landing)
        {
            // Replace one that never left: however often the user lands, one land waits to be sent.
            if (unsent != null)
            {
                // At most one is there: what was handed out before has left the outbox.
                outbox.RemoveAll(message => message is LandMessage);
                if (transfers.Withdraw(unsent)) ReportSuperseded(unsent, landing);
            }
            SendEvictions();
            landing.Generation = NextGeneration();
            transfers.Ask(landing);
            outbox.Add(landing.Message((uint)landing.Generation, Limits.MaxRadiusM));
            unsent = landing;
        }

        private void ReportSuperseded(LandingState landing, LandingState by)
        {
            events.Enqueue(new StreamEvent { Kind = StreamEventKind.Superseded, Landing = landing.Number, By = by.Number });
        }

        private void SendEvictions()
        {
            // What may not be told now (6.7, rule 2) is told before the next land or aim.
            if (!transfers.AwaitsPlan) holdings.ReportEvictions(transfers.UnfinishedPlanIds, outbox);
        }

        private uint NextGeneration()
        {
            // Overflow throws: a generation that came twice would mix two landings up.
            generation = checked(generation + 1);
            return generation;
        }

        /// <summary>Count consumed chunk bytes, and grant them back in steps: one credit message per chunk would double the messages.</summary>
        private void Grant(int bytes)
        {
            consumedBytes += bytes;
            if (consumedBytes < creditStep) return;
            // One that was not sent yet grows: what waits must not grow with what comes.
            var waiting = (CreditMessage)outbox.Find(message => message is CreditMessage);
            if (waiting == null)
                outbox.Add(new CreditMessage { Bytes = consumedBytes });
            else
                waiting.Bytes += consumedBytes;
            consumedBytes = 0;
        }
    }
}
