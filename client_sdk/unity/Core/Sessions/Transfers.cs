using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>
    /// Landings and prefetches on their way: plans and frames in, events and answers out. The part of
    /// <see cref="ClientSession"/> that decides what is received, held, pinned and shown. Section numbers in comments are those
    /// of spec/wire-protocol.md.
    /// </summary>
    internal sealed class Transfers
    {
        private readonly Budgets budgets;
        private readonly Holdings holdings;
        private readonly List<WireMessage> outbox;
        private readonly Queue<StreamEvent> events;
        private readonly Assembler assembler;
        // Sent, and without a plan yet, oldest first.
        private readonly List<LandingState> awaitingPlan = new List<LandingState>();
        // Segments whose hash was wrong once, since the newest plan or prefetch: an aim gives up after the second time.
        private readonly HashSet<uint> retried = new HashSet<uint>();
        private readonly AimCounts aims = new AimCounts();
        // The landing whose plan came last, until it is superseded; it stays after it is ready.
        private LandingState current;
        private PrefetchState prefetch;
        // Shown perhaps, since a deadline passed: the newest declared inner set.
        private uint[] inner = new uint[0];
        // Kept beside what is shown: of the newest plan (6.6, rule 3).
        private uint[] nearby = new uint[0];
        // Chunk bytes taken, and those of them that belong to segments which were held already.
        private long payloadBytes;
        private long repeatedBytes;

        internal Transfers(Budgets budgets, Holdings holdings, PayloadPool pool, List<WireMessage> outbox, Queue<StreamEvent> events)
        {
            this.budgets = budgets ?? new Budgets();
            this.holdings = holdings;
            this.outbox = outbox;
            this.events = events;
            assembler = new Assembler(pool);
        }

        /// <summary>Ids that the last ready landing shows, ascending.</summary>
        internal uint[] Visible { get; private set; } = new uint[0];

        /// <summary>What has been counted over all connections.</summary>
        internal StreamStats Stats
        {
            get {
                return new StreamStats {
                    PayloadBytes = payloadBytes,
                    RepeatedBytes = repeatedBytes,
                    HeldSegments = holdings.Cache.Count,
                    HeldBytes = holdings.Cache.Bytes,
                    AimedLandings = aims.Landings,
                    AimHits = aims.Hits,
                    PrefetchedBytes = aims.PrefetchedBytes,
                    UsedPrefetchedBytes = aims.UsedBytes,
                };
            }
        }

        /// <summary>Generation of the newest aim of which everything has come; -1 for none.</summary>
        internal long CompletedAimGeneration { get; private set; } = -1;

        /// <summary>The newest landing that is not ready; null for none.</summary>
        internal LandingState Unfinished
        {
            get {
                if (awaitingPlan.Count > 0) return awaitingPlan[awaitingPlan.Count - 1];
                return current != null && !current.IsReady ? current : null;
            }
        }

        /// <summary>Whether a land has no plan yet: then nothing may be evicted (6.7, rule 2).</summary>
        internal bool AwaitsPlan => awaitingPlan.Count > 0;

        /// <summary>Ids of the plan that is not ready: these must not be evicted (6.7, rule 2). Null for none.</summary>
        internal HashSet<uint> UnfinishedPlanIds => current != null && !current.IsReady ? current.PlannedIds : null;

        /// <summary>Segments that are partly here.</summary>
        internal int PartialSegments => assembler.Count;

        /// <summary>Note that a landing was sent.</summary>
        internal void Ask(LandingState landing) { awaitingPlan.Add(landing); }

        /// <summary>Forget a landing that was never sent; whether it had not ended before.</summary>
        internal bool Withdraw(LandingState landing) { return awaitingPlan.Remove(landing); }

        /// <summary>Forget a landing that the server refused; an older one goes on (6.5, rule 5). Null where it was none.</summary>
        internal LandingState Refused(uint? generation)
        {
            int index = generation.HasValue ? awaitingPlan.FindIndex(landing => landing.Generation == generation.Value) : -1;
            if (index < 0) return null;
            LandingState refused = awaitingPlan[index];
            awaitingPlan.RemoveAt(index);
            PinAndTrim();
            return refused;
        }

        /// <summary>Forget partial payloads (10.2); the newest landing that is not ready, to ask again, or null.</summary>
        internal LandingState ConnectionLost()
        {
            assembler.Clear();
            prefetch = null;
            CompletedAimGeneration = -1;
            LandingState newest = Unfinished;
            if (current != null && !current.IsReady && current != newest) ReportSuperseded(current.Number, newest.Number);
            foreach (LandingState landing in awaitingPlan)
            {
                if (landing != newest) ReportSuperseded(landing.Number, newest.Number);
            }
            current = null;
            awaitingPlan.Clear();
            Pin();
            return newest;
        }

        /// <summary>Show nothing: the served version is another one, so the ids mean other segments (5.4).</summary>
        internal void HideAll()
        {
            Visible = new uint[0];
            inner = new uint[0];
            nearby = new uint[0];
            PinAndTrim();
        }

        /// <summary>Give all memory back: the session is of no use any more.</summary>
        internal void Free() { assembler.Clear(); }

        /// <summary>Take the plan of the oldest landing that has none.</summary>
        internal void OnPlan(PlanMessage plan)
        {
            // Plans come in the order of the lands that are not superseded before: else the server is broken.
            if (awaitingPlan.Count == 0 || awaitingPlan[0].Generation != plan.Generation)
            {
                string expected = awaitingPlan.Count == 0 ? "none" : awaitingPlan[0].Generation.ToString();
                throw new ProtocolViolationException("got a plan of generation " + plan.Generation + ", expected " + expected);
            }
            // A server that does not know the bound says nothing of it.
            if (plan.TotalGpuBytes > budgets.MaxGpuBytes)
            {
                throw new ProtocolViolationException(
                    "got " + plan.TotalGpuBytes + " GPU bytes, expected at most " + budgets.MaxGpuBytes + " (6.2)");
            }
            LandingState landing = awaitingPlan[0];
            awaitingPlan.RemoveAt(0);
            // 1. The new plan takes the place of the landing and of the aim before it (6.5, 7).
            EndCurrent(landing.Number);
            current = landing;
            prefetch = null;
            nearby = plan.Nearby;
            retried.Clear();
            landing.Begin(plan);
            // 2. Chunks of segments that both plans load stay; the server goes on where it stopped.
            assembler.KeepOnly(landing.Facts);
            aims.Planned(plan.Keep, plan.Load.Length > 0);
            // 3. What the plan counts on as held is made recent; what is not here after all is asked for below.
            var absent = new List<uint>();
            foreach (uint segment in plan.Keep)
            {
                if (holdings.Cache.Touch(segment)) continue;
                SegmentFacts crossed;
                // Rejected already, and on its way again in this generation (6.4, rule 7).
                if (landing.Crossed.TryGetValue(segment, out crossed))
                    landing.ExpectAgain(crossed);
                else
                    absent.Add(segment);
            }
            // 4. The plan's ids are pinned before anything may be evicted again.
            PinAndTrim();
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.Planned,
                Landing = landing.Number,
                Plan = landing.FactsOf(plan),
            });
            // Behind the event: a listener learns of the plan before of anything that belongs to it.
            foreach (uint segment in absent) AskAgain(landing, segment);
        }

        /// <summary>Take one of the (one or more) ready of the present landing (6.4).</summary>
        internal void OnReady(ReadyMessage ready)
        {
            if (current == null || current.Generation != ready.Generation)
            {
                string expected = current == null ? "none" : current.Generation.ToString();
                throw new ProtocolViolationException("got ready of generation " + ready.Generation + ", expected " + expected);
            }
            current.IsReadySeen = true;
            current.Missing.Clear();
            current.Missing.UnionWith(ready.Missing);
            FinishIfComplete();
        }

        /// <summary>Pass on the declared inner set, as soon as all of it is here.</summary>
        internal void OnDegraded(DegradedMessage degraded)
        {
            if (current == null || current.IsReady || current.Generation != degraded.Generation) return;
            // A copy: the message's array must not change under whoever holds the message.
            var segments = (uint[])degraded.Segments.Clone();
            Array.Sort(segments);
            current.Inner = segments;
            DegradeIfWhole(current);
        }

        /// <summary>End a landing or a prefetch: no more frames of it come, or never a plan (6.3, 6.5).</summary>
        internal void OnSuperseded(SupersededMessage message)
        {
            if (prefetch != null && prefetch.Generation == message.Generation)
            {
                prefetch = null;
            }
            else if (current != null && current.Generation == message.Generation)
            {
                EndCurrent(awaitingPlan.Count > 0 ? awaitingPlan[0].Number : current.Number);
                current = null;
            }
            else if (awaitingPlan.Count > 0 && awaitingPlan[0].Generation == message.Generation)
            {
                LandingState unplanned = awaitingPlan[0];
                awaitingPlan.RemoveAt(0);
                ReportSuperseded(unplanned.Number, awaitingPlan.Count > 0 ? awaitingPlan[0].Number : unplanned.Number);
            }
        }

        /// <summary>Begin to take what an aim brings.</summary>
        internal void OnPrefetch(PrefetchMessage message)
        {
            prefetch = new PrefetchState(message);
            aims.Prefetching();
            retried.Clear();
            assembler.KeepOnly(prefetch.Facts);
            ReportAim(StreamEventKind.Prefetching, prefetch);
            EndPrefetchIfDone(prefetch);
        }

        /// <summary>Take one chunk; check the hash when it was the last one (4, rule 4). Allocates nothing in steady state.</summary>
        internal void OnFrame(PayloadFrame frame)
        {
            // 1. For which landing or aim, and is the segment one of its own.
            LandingState landing = current != null && current.Generation == frame.Generation ? current : null;
            PrefetchState ahead = prefetch != null && prefetch.Generation == frame.Generation ? prefetch : null;
            SegmentFacts facts = Expected(frame, landing, ahead);
            // 2. Counted, also where it is wrong in the end: it used the line.
            int bytes = frame.Chunk.Count;
            if (landing != null) landing.PayloadBytes += bytes;
            payloadBytes += bytes;
            if (holdings.Cache.Contains(frame.Segment)) repeatedBytes += bytes;
            // 3. Put together; most chunks end here.
            PayloadBuffer payload = assembler.Take(frame, facts.Length);
            if (payload == null) return;
            // 4. The hash is the only proof that the payload is the one of the index: nothing unverified is held.
            if (Xxh3.Hash64(payload.Data, 0, payload.Length) != facts.Xxh3)
            {
                payload.Release();
                Reject(frame.Generation, facts, "hash_mismatch");
                if (landing == null) GiveUpSecondTime(ahead, frame.Segment);
                return;
            }
            holdings.Put(facts, payload);
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.Arrived,
                Landing = landing == null ? (int?)null : landing.Number,
                Facts = facts,
            });
            // 5. Between a land and its plan nothing may be evicted, since the plan may count on it (6.7, rule 2).
            if (!AwaitsPlan) Trim();
            if (landing != null)
            {
                landing.Waiting.Remove(frame.Segment);
                DegradeIfWhole(landing);
                FinishIfComplete();
            }
            else
            {
                aims.Arrived(frame.Segment, facts.Length);
                ahead.Waiting.Remove(frame.Segment);
                EndPrefetchIfDone(ahead);
            }
        }

        private static SegmentFacts Expected(PayloadFrame frame, LandingState landing, PrefetchState ahead)
        {
            if (landing == null && ahead == null)
            {
                throw new ProtocolViolationException("got a frame of generation " + frame.Generation + ", which no landing or aim has now");
            }
            SegmentFacts facts;
            if ((landing != null ? landing.Facts : ahead.Facts).TryGetValue(frame.Segment, out facts)) return facts;
            throw new ProtocolViolationException(
                "got segment " + frame.Segment + ", which generation " + frame.Generation + " does not load");
        }

        /// <summary>Ask for a segment of keep that is not here after all (6.4, rule 4).</summary>
        private void AskAgain(LandingState landing, uint segment)
        {
            SegmentFacts facts;
            if (!holdings.TryGetFacts(segment, out facts))
            {
                throw new ProtocolViolationException("plan " + landing.Generation + " keeps segment " + segment + ", which was never held");
            }
            landing.ExpectAgain(facts);
            Reject((uint)landing.Generation, facts, "lost");
        }

        /// <summary>Tell that a segment is not held; for a landing under way that crosses on the wire.</summary>
        private void Reject(uint generation, SegmentFacts facts, string reason)
        {
            holdings.Forget(facts.Segment);
            foreach (LandingState landing in awaitingPlan) landing.Crossed[facts.Segment] = facts;
            outbox.Add(new RejectMessage { Generation = generation, Segment = facts.Segment, Reason = reason });
        }

        /// <summary>Stop waiting for it: a prefetch is sent once more, then no more (6.4, rule 4).</summary>
        private void GiveUpSecondTime(PrefetchState ahead, uint segment)
        {
            if (retried.Add(segment)) return;
            ahead.Waiting.Remove(segment);
            EndPrefetchIfDone(ahead);
        }

        private void EndCurrent(int by)
        {
            if (current != null && !current.IsReady) ReportSuperseded(current.Number, by);
        }

        private void DegradeIfWhole(LandingState landing)
        {
            uint[] declared = landing.Inner;
            if (declared == null) return;
            foreach (uint segment in declared)
            {
                if (landing.Waiting.Contains(segment) || !landing.PlannedIds.Contains(segment)) return;
            }
            landing.Inner = null;
            inner = declared;
            events.Enqueue(new StreamEvent { Kind = StreamEventKind.Degraded, Landing = landing.Number, Segments = declared });
        }

        private void FinishIfComplete()
        {
            if (current == null || current.IsReady || !current.IsComplete) return;
            current.IsReady = true;
            // Visible changes here alone, and all at once: what is shown never mixes two landings.
            Visible = current.Shown();
            inner = new uint[0];
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.Ready,
                Landing = current.Number,
                Segments = Visible,
                Missing = current.NotShown(),
                Bytes = current.PayloadBytes,
            });
            PinAndTrim();
        }

        private void EndPrefetchIfDone(PrefetchState ahead)
        {
            if (ahead.Waiting.Count > 0) return;
            CompletedAimGeneration = ahead.Generation;
            ReportAim(StreamEventKind.Prefetched, ahead);
        }

        private void ReportAim(StreamEventKind kind, PrefetchState ahead)
        {
            events.Enqueue(new StreamEvent { Kind = kind, Count = ahead.Facts.Count, Bytes = ahead.Bytes });
        }

        private void ReportSuperseded(int landing, int by)
        {
            events.Enqueue(new StreamEvent { Kind = StreamEventKind.Superseded, Landing = landing, By = by });
        }

        /// <summary>Pin what is shown, may be shown, or is needed by the plan on its way; nothing else.</summary>
        private void Pin()
        {
            holdings.Cache.UnpinAll();
            holdings.Cache.Pin(Visible);
            holdings.Cache.Pin(inner);
            holdings.Cache.Pin(nearby);
            if (UnfinishedPlanIds != null) holdings.Cache.Pin(UnfinishedPlanIds);
        }

        /// <summary>Pin anew, then evict down to the bound, where that is allowed now.</summary>
        private void PinAndTrim()
        {
            Pin();
            if (!AwaitsPlan) Trim();
        }

        /// <summary>Evict down to the bound, and say what went.</summary>
        private void Trim()
        {
            uint[] segments = holdings.Trim();
            if (segments != null) events.Enqueue(new StreamEvent { Kind = StreamEventKind.Dropped, Segments = segments });
        }
    }
}
