using System;
using System.Collections.Generic;
using System.IO;
using System.IO.Compression;
using System.Linq;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// State of a client: commands and messages in, events and messages to send out. It outlives connections. No socket, no clock,
    /// no thread; one thread at a time. Section numbers are those of spec/protocol.md.
    /// </summary>
    /// <remarks>
    /// The service keeps no table of what the client has: every landing lists it. What a landing listed or received stays in memory until
    /// the landing is whole.
    /// </remarks>
    internal sealed class SessionCore
    {
        private const int MaxHave = 4096, MaxWithout = 64;

        /// <summary>Unanswered picks; then the oldest is refused here.</summary>
        private const int MaxPicks = 64;

        /// <summary>Failed deliveries of a segment after which it is left out (4, rule 8).</summary>
        private const int MaxFailures = 2;

        private readonly SessionOptions options;
        private readonly ISessionEvents events;
        private readonly List<byte[]> outbox = new List<byte[]>();
        // Neither whole nor over, oldest first. Only the last may become whole; the others go on if the service refuses it.
        private readonly List<Landing> open = new List<Landing>();
        private readonly SortedDictionary<uint, byte[]> picks = new SortedDictionary<uint, byte[]>();
        // Whole, but not decoded yet.
        private readonly Dictionary<ulong, byte[]> undecoded = new Dictionary<ulong, byte[]>();
        private readonly HashSet<ulong> shownKeys = new HashSet<ulong>();
        private Landing aim;
        // Of the segment that is on its way: its bytes, and how many have come. Null between two segments.
        private byte[] part;
        private ulong partKey;
        private int partBytes;
        private bool isGreeting, isGroupByUrl;
        private string groupOfUrl;
        private uint generation, requests;
        private int landings;
        private long takenBytes, grantedBytes, acknowledgedBytes, creditStep = 1;
        // Place of a credit in the outbox that is not sent yet, and its bytes.
        private int creditAt = -1;
        private long creditBytes;
        private double maxRadiusM = double.PositiveInfinity;
        private uint baseFaces, segmentCount;

        internal SessionCore(SessionOptions options, ISessionEvents events)
        {
            this.options = options;
            this.events = events;
            Cache = new SegmentCache(options.CacheBytes);
            Group = new GroupSession(this, events);
        }

        /// <summary>Payloads in memory.</summary>
        internal SegmentCache Cache { get; }

        /// <summary>Boxes of what the disk has, by key.</summary>
        internal Dictionary<ulong, Box> Disk { get; } = new Dictionary<ulong, Box>();

        internal GroupSession Group { get; }

        /// <summary>Scene version of the newest connection; null before the first.</summary>
        internal string Version { get; private set; }

        /// <summary>Whether the service has said welcome on the present connection.</summary>
        internal bool IsOpen { get; private set; }

        /// <summary>Messages per second that the service takes.</summary>
        internal double MaxMessagesPerS { get; private set; } = 1;

        /// <summary>Payload bytes received, on all connections, and those of them that were here already.</summary>
        internal long PayloadBytes { get; private set; }

        internal long RepeatedBytes { get; private set; }

        /// <summary>Whether an aim waits for <see cref="FlushAim"/>.</summary>
        internal bool HasAim => aim != null && IsOpen;

        /// <summary>Whether the service owes an answer.</summary>
        internal bool IsWaiting => isGreeting || picks.Count > 0 || (open.Count > 0 && open[open.Count - 1].Generation != null);

        /// <summary>Whether <see cref="TakeMessages"/> has something.</summary>
        internal bool HasMessages => outbox.Count > 0 || (IsOpen && open.Count > 0 && open[open.Count - 1].Generation == null);

        /// <summary>Whether the group that the user is in is reached by an address that names it alone, and the present one does not.</summary>
        internal bool NeedsGroupUrl => IsOpen && isGroupByUrl && Group.Name != null && Group.Name != groupOfUrl;

        /// <summary>Whether a join can be sent now.</summary>
        internal bool CanJoin => IsOpen && !NeedsGroupUrl;

        /// <summary>Keys of the newest landing that was whole.</summary>
        internal IEnumerable<ulong> ShownKeys => shownKeys;

        // ---- output

        /// <summary>
        /// Return, once, the messages to send. The land is made here, from what is held now: however often the user lands before, one is sent.
        /// </summary>
        internal List<byte[]> TakeMessages()
        {
            Landing newest = open.LastOrDefault();
            if (newest != null && newest.Generation == null && IsOpen)
            {
                List<ulong> have = HeldNear(newest);
                newest.Protected.Clear();
                newest.Protected.UnionWith(have);
                newest.Generation = ++generation;
                List<ulong> without = newest.GivenUp.Count == 0 ? null : newest.GivenUp.Keys.ToList();
                outbox.Add(ClientMessages.Land("land", generation, newest, RingOf(newest), have, without, takenBytes));
            }
            List<byte[]> messages = outbox.ToList();
            ClearOutbox();
            return messages;
        }

        /// <summary>Send a message with the next ones, where the connection is open.</summary>
        internal void Say(byte[] message)
        {
            if (IsOpen) outbox.Add(message);
        }

        // ---- connection

        /// <summary>A connection is there, by an address that names a group or none: the first message is hello.</summary>
        internal void Connected(string urlGroup = null)
        {
            groupOfUrl = urlGroup;
            ClearOutbox();
            IsOpen = false;
            isGreeting = true;
            generation = 0;
            takenBytes = acknowledgedBytes = 0;
            grantedBytes = options.CreditBytes;
            outbox.Add(ClientMessages.Hello(options.Client, options.Budgets, options.CreditBytes));
        }

        /// <summary>The connection is gone. The newest landing, picks and the seat in a group wait for the next one.</summary>
        internal void Lost()
        {
            IsOpen = isGreeting = false;
            ClearOutbox();
            part = null;
            if (open.Count > 1) open.RemoveRange(0, open.Count - 1);
            foreach (Landing landing in open) landing.AskAgain();
            Group.ConnectionLost();
        }

        /// <summary>Take one whole WebSocket message.</summary>
        /// <exception cref="WireException">The service sent what the protocol does not allow: close with 4400.</exception>
        internal void Receive(ArraySegment<byte> message)
        {
            if (Frame.IsFrame(message))
            {
                if (Frame.TryRead(message, out Frame frame)) OnFrame(frame);
                return;
            }
            ServerMessage read = ServerMessage.Read(message);
            if (read is Welcome)
                OnWelcome((Welcome)read);
            else if (read is Error)
                OnError((Error)read);
            else if (read != null && !IsOpen)
                throw new WireException("got " + read.GetType().Name + " first, expected welcome or error");
            else if (read is Plan)
                OnPlan((Plan)read);
            else if (read is Ready)
                OnReady((Ready)read);
            else if (read is Picked)
                OnPicked((Picked)read);
            else if (read is Notice)
                events.Noticed((Notice)read);
            else
                Group.Receive(read);
        }

        // ---- commands

        /// <summary>Ask for a landing; it replaces those that are not whole yet.</summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        internal Landing Land(Vec3 position, double radiusM, double? innerRadiusM, double? coarseRadiusM)
        {
            var landing = new Landing(landings + 1, position, radiusM, innerRadiusM, coarseRadiusM);
            landings++;
            aim = null;
            open.RemoveAll(one => one.Generation == null);
            open.Add(landing);
            return landing;
        }

        /// <summary>Be content with the inner set of a landing from now on.</summary>
        internal void Hurry(int number)
        {
            foreach (Landing landing in open.Where(one => one.Number == number)) landing.IsUrgent = true;
            Update();
        }

        /// <summary>Note where the user points; only the newest is kept until <see cref="FlushAim"/>.</summary>
        internal void Aim(Vec3 position, double radiusM, double? coarseRadiusM)
        {
            aim = new Landing(0, position, radiusM, null, coarseRadiusM);
        }

        /// <summary>Send the newest aim, if there is one and the connection is open.</summary>
        internal void FlushAim()
        {
            if (!HasAim) return;
            Landing place = aim;
            aim = null;
            outbox.Add(ClientMessages.Land("prefetch", ++generation, place, RingOf(place), HeldNear(place), null, takenBytes));
        }

        /// <summary>Ask what full detail has along a ray, or above and below a point; the number of the request.</summary>
        internal int Pick(Vec3 origin, Vec3? direction)
        {
            if (!origin.IsFinite || (direction.HasValue && !direction.Value.IsFinite))
                throw new ArgumentException("got a pick at " + origin + " along " + direction + ", expected finite numbers");
            uint request = NextRequest();
            picks[request] = ClientMessages.Pick(request, origin, direction);
            Say(picks[request]);
            if (picks.Count > MaxPicks)
            {
                uint oldest = picks.Keys.First();
                picks.Remove(oldest);
                events.Picked((int)oldest, null, "too_many");
            }
            return (int)request;
        }

        internal void Bye() { Say(ClientMessages.Bye()); }

        internal uint NextRequest() { return ++requests; }

        /// <summary>Refuse all unanswered picks: the connection is closed for good.</summary>
        internal void RefusePicks(string code)
        {
            List<uint> refused = picks.Keys.ToList();
            picks.Clear();
            foreach (uint request in refused) events.Picked((int)request, null, code);
        }

        // ---- what became of payloads

        /// <summary>A payload was decoded: it is whole.</summary>
        internal void Accept(ulong key, Box box, byte[] payload)
        {
            undecoded.Remove(key);
            Cache.Put(key, box, payload);
            foreach (Landing landing in open)
            {
                if (landing.Plan == null)
                    landing.Protected.Add(key);
                else if (landing.Waiting.Remove(key))
                    landing.HereBytes += payload.Length;
                landing.Restoring.Remove(key);
            }
            Trim();
            Update();
        }

        /// <summary>A payload that was received is damaged: a landing that needs it asks for it again.</summary>
        internal void Reject(ulong key)
        {
            undecoded.Remove(key);
            Update();
        }

        /// <summary>The disk does not have a segment after all.</summary>
        internal void LostOnDisk(ulong key)
        {
            Disk.Remove(key);
            foreach (Landing landing in open) landing.Restoring.Remove(key);
            Update();
        }

        /// <summary>
        /// A segment of a landing cannot be used here: the landing is asked for again without it. False where too many are left out already.
        /// </summary>
        internal bool Exclude(Landing landing, ulong key, uint id)
        {
            if (landing.GivenUp.ContainsKey(key)) return true;
            if (landing.GivenUp.Count >= MaxWithout) return false;
            landing.GivenUp[key] = id;
            landing.AskAgain();
            if (!open.Contains(landing)) open.Add(landing);
            return true;
        }

        // ---- messages

        private void OnWelcome(Welcome welcome)
        {
            if (IsOpen || !isGreeting) throw new WireException("got a second welcome, expected one");
            IsOpen = true;
            isGreeting = false;
            bool isChanged = Version != null && Version != welcome.Version;
            Version = welcome.Version;
            // Segments of the version before do not belong to this scene.
            if (isChanged) shownKeys.Clear();
            // Granted in halves: the service never runs dry while a grant is on its way (6).
            creditStep = Math.Max(1, Math.Min(options.CreditBytes, welcome.MaxCreditBytes) / 2);
            baseFaces = welcome.BaseFaces;
            segmentCount = welcome.SegmentCount;
            maxRadiusM = welcome.MaxRadiusM;
            MaxMessagesPerS = welcome.MaxMessagesPerS;
            isGroupByUrl = welcome.Groups == "query";
            outbox.AddRange(picks.Values);
            Group.Connected(welcome.Groups);
            events.Opened(welcome, isChanged);
        }

        private void OnError(Error error)
        {
            // The answer of a request: nothing else was refused, unless the connection ends with it.
            bool isAnswer = error.Request.HasValue && Group.Refused(error);
            if (error.Request.HasValue && picks.Remove(error.Request.Value))
            {
                isAnswer = true;
                events.Picked((int)error.Request.Value, null, error.Code);
            }
            if (isAnswer && !error.IsFatal) return;
            Landing refused = error.IsFatal || error.Generation == null ? null : open.Find(one => one.Generation == error.Generation);
            if (refused != null) open.Remove(refused);
            events.Refused(refused?.Number, error.Code, error.Message, error.IsFatal);
            Update(); // An older landing continues (4, rule 7).
        }

        private void OnPlan(Plan plan)
        {
            Landing landing = LandingOf("plan", plan.Generation);
            if (landing == null) return;
            // Now, since the bytes are the message's, whose memory is used again.
            landing.Hidden = Inflate(plan.Hidden);
            landing.InnerHidden = plan.InnerCount.HasValue ? Inflate(plan.InnerHidden) : null;
            for (int row = 0; row < plan.Show.Length; row++)
            {
                // One id for each payload: those of the coarser level follow those of full detail.
                if (plan.Show[row].IsCoarser) plan.Show[row].Id += segmentCount;
            }
            open.RemoveRange(0, open.IndexOf(landing));
            landing.Plan = plan;
            landing.Ready = null;
            landing.Waiting.Clear();
            landing.Restoring.Clear();
            landing.HereBytes = 0;
            foreach (PlanRow row in plan.Show)
            {
                if (Cache.Touch(row.Key))
                {
                    landing.HereBytes += row.PayloadBytes;
                    continue;
                }
                landing.Waiting.Add(row.Key);
                if (Disk.ContainsKey(row.Key) && !undecoded.ContainsKey(row.Key)) landing.Restoring.Add(row.Key);
            }
            Trim();
            List<ulong> restore = landing.Restoring.ToList();
            events.Planned(landing);
            foreach (ulong key in restore) events.RestoreNeeded(key);
            Update();
        }

        private void OnReady(Ready ready)
        {
            Landing landing = LandingOf("ready", ready.Generation);
            if (landing?.Plan == null) return;
            landing.Ready = ready;
            if (ready.Missing != null)
            {
                landing.Waiting.ExceptWith(ready.Missing);
                landing.Hidden = Inflate(ready.Hidden);
            }
            Update();
        }

        private void OnPicked(Picked picked)
        {
            if (picks.Remove(picked.Request)) events.Picked((int)picked.Request, picked.Hit, null);
        }

        private void OnFrame(Frame frame)
        {
            if (!IsOpen) throw new WireException("got payload first, expected welcome or error");
            TakeCredit(frame.Data.Count);
            if (frame.Offset == 0)
            {
                part = new byte[frame.Total];
                partKey = frame.Key;
                partBytes = 0;
            }
            if (part == null || frame.Key != partKey || frame.Total != part.Length || frame.Offset != partBytes)
            {
                string expected = part == null ? "the beginning of a segment" : "byte " + partBytes + " of " + partKey.ToString("x16");
                throw new WireException("got byte " + frame.Offset + " of " + frame.Key.ToString("x16") + ", expected " + expected);
            }
            Buffer.BlockCopy(frame.Data.Array, frame.Data.Offset, part, partBytes, frame.Data.Count);
            partBytes += frame.Data.Count;
            if (partBytes < part.Length) return;
            byte[] payload = part;
            part = null;
            if (Cache.Contains(frame.Key) || undecoded.ContainsKey(frame.Key))
            {
                RepeatedBytes += payload.Length;
                return;
            }
            undecoded[frame.Key] = payload;
            events.Arrived(frame.Key, payload);
        }

        private void TakeCredit(int bytes)
        {
            PayloadBytes += bytes;
            takenBytes += bytes;
            if (takenBytes > grantedBytes)
                throw new WireException("got " + takenBytes + " bytes of payload, expected at most " + grantedBytes);
            long granted = takenBytes - acknowledgedBytes;
            if (granted < creditStep) return;
            acknowledgedBytes = takenBytes;
            grantedBytes += granted;
            // A grant that waits to be sent is enlarged, so that the outbox stays bounded.
            creditBytes += granted;
            if (creditAt < 0)
            {
                creditAt = outbox.Count;
                outbox.Add(null);
            }
            outbox[creditAt] = ClientMessages.Credit(creditBytes);
        }

        private void ClearOutbox()
        {
            outbox.Clear();
            creditAt = -1;
            creditBytes = 0;
        }

        /// <summary>The landing that a message is about; null for one that is over.</summary>
        private Landing LandingOf(string message, uint messageGeneration)
        {
            if (messageGeneration > generation)
                throw new WireException("got " + message + " of generation " + messageGeneration + ", expected at most " + generation);
            return open.Find(landing => landing.Generation == messageGeneration);
        }

        // ---- landings

        /// <summary>Report the newest landing if it is whole; ask again for segments that are still missing when all was sent.</summary>
        private void Update()
        {
            Landing landing = open.LastOrDefault();
            if (landing?.Plan == null) return;
            if (landing.Waiting.Count == 0)
            {
                List<PlanRow> rows = landing.ShownRows();
                var missing = new SortedSet<uint>(landing.Plan.Show.Select(row => row.Id).Concat(landing.GivenUp.Values));
                missing.ExceptWith(rows.Select(row => row.Id));
                open.Clear();
                shownKeys.Clear();
                shownKeys.UnionWith(rows.Select(row => row.Key));
                Trim();
                events.Whole(landing, rows, missing.ToList());
                return;
            }
            if (landing.Ready != null && landing.Restoring.Count == 0 && !landing.Waiting.Any(undecoded.ContainsKey))
            {
                Retry(landing);
            }
            else if (landing.IsUrgent && landing.Plan.InnerCount.HasValue)
            {
                List<PlanRow> rows = landing.ShownRows(landing.Plan.InnerCount.Value);
                if (rows.Any(row => landing.Waiting.Contains(row.Key))) return;
                landing.IsUrgent = false;
                events.InnerWhole(landing, rows);
            }
        }

        /// <summary>Ask again for a landing after failed deliveries; give it up where more failed than may be left out (4, rule 8).</summary>
        private void Retry(Landing landing)
        {
            foreach (PlanRow row in landing.Plan.Show.Where(row => landing.Waiting.Contains(row.Key)))
            {
                landing.Failures.TryGetValue(row.Key, out int failures);
                landing.Failures[row.Key] = failures + 1;
                if (failures + 1 >= MaxFailures) landing.GivenUp[row.Key] = row.Id;
            }
            if (landing.GivenUp.Count <= MaxWithout)
            {
                landing.AskAgain();
                return;
            }
            open.Remove(landing);
            string message = "got " + landing.GivenUp.Count + " segments that cannot be decoded, expected at most " + MaxWithout;
            events.Refused(landing.Number, "damaged", message, false);
        }

        /// <summary>How far the coarser level is asked for: less of it is better than a landing that is refused.</summary>
        private double? RingOf(Landing place)
        {
            return place.CoarseRadiusM == null ? (double?)null : Math.Max(place.RadiusM, Math.Min(place.CoarseRadiusM.Value, maxRadiusM));
        }

        /// <summary>Keys of what is held near a place, nearest first.</summary>
        private List<ulong> HeldNear(Landing place)
        {
            double reachM = RingOf(place) ?? place.RadiusM;
            // What is not decoded yet has no box: it came for a place nearby, or is harmless.
            var near = undecoded.Keys.ToDictionary(key => key, key => 0.0);
            foreach (KeyValuePair<ulong, Box> held in Cache.Boxes.Concat(Disk))
            {
                double distanceM = held.Value.DistanceM(place.Position);
                // The service goes by the box of the finer level, from which that of a coarser one differs by a little.
                if (distanceM <= reachM + held.Value.DiagonalM) near[held.Key] = distanceM;
            }
            return near.OrderBy(held => held.Value).Select(held => held.Key).Take(MaxHave).ToList();
        }

        private void Trim()
        {
            if (Cache.IsFull) Cache.Trim(new HashSet<ulong>(open.SelectMany(landing => landing.Needs).Concat(shownKeys)));
        }

        /// <summary>Inflate hidden faces, to as many as the base has.</summary>
        private byte[] Inflate(ArraySegment<byte> packed)
        {
            var bits = new byte[(baseFaces + 7) / 8];
            try
            {
                using (
                    var stream = new GZipStream(new MemoryStream(packed.Array ?? Array.Empty<byte>(), packed.Offset, packed.Count, false),
                        CompressionMode.Decompress))
                {
                    int count = 0;
                    for (int read = -1; read != 0 && count < bits.Length; count += read)
                        read = stream.Read(bits, count, bits.Length - count);
                    if (count == bits.Length && stream.ReadByte() < 0) return bits;
                }
            }
            catch (Exception error) when (error is IOException || error is InvalidDataException)
            {
                throw new WireException("hidden faces are damaged (" + error.Message + ")");
            }
            throw new WireException("got another number of hidden faces, expected " + baseFaces);
        }
    }
}
