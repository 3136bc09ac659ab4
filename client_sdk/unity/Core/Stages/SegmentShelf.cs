using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// Where every known segment stands between payload and GPU, and what of it nobody needs. Which segments are needed is said
    /// from outside (<see cref="Residency"/>); what is not is spare, and bounded in bytes.
    /// </summary>
    internal sealed class SegmentShelf
    {
        private readonly long maxSpareBytes;
        private readonly InFlight inFlight;
        private readonly Func<uint, bool> isNeeded;
        // Invariant: SpareBytes is the sum over entries on the GPU, or decoded for it, that isNeeded refuses.
        private readonly Dictionary<uint, Entry> entries = new Dictionary<uint, Entry>();
        private readonly List<uint> toFree = new List<uint>();
        // Reused by Trim, which runs at every landing.
        private readonly List<KeyValuePair<uint, Entry>> scratch = new List<KeyValuePair<uint, Entry>>();
        // A running number instead of a clock: ages are only compared.
        private long tick;

        /// <remarks>isNeeded: Whether a segment is visible, or wanted or kept by the newest plan. After it changes: Trim.</remarks>
        internal SegmentShelf(StageOptions options, Func<uint, bool> isNeeded)
        {
            maxSpareBytes = options.SpareGpuBytes;
            inFlight = new InFlight(options.MaxInFlight, options.MaxInFlightBytes);
            this.isNeeded = isNeeded;
        }

        /// <summary>GPU bytes of what is there, or decoded for it, and not needed now.</summary>
        internal long SpareBytes { get; private set; }

        /// <summary>Whether an aim's segment may be decoded now.</summary>
        internal bool HasSpareRoom => SpareBytes < maxSpareBytes;

        /// <summary>Segments being decoded, or decoded and not uploaded.</summary>
        internal int InFlightCount => inFlight.Count;

        /// <summary>Whether one more may be decoded.</summary>
        internal bool HasRoom => inFlight.HasRoom;

        /// <summary>Where a segment stands; Unknown where nothing is known of it.</summary>
        internal SegmentStep StepOf(uint segment)
        {
            Entry entry;
            return entries.TryGetValue(segment, out entry) ? entry.Step : SegmentStep.Unknown;
        }

        /// <summary>A payload is here; the newest landing if an aim brought it, else -1. True where it had failed before.</summary>
        internal bool Hold(uint segment, int aimedDuring)
        {
            Entry entry;
            if (!entries.TryGetValue(segment, out entry))
            {
                entries[segment] = new Entry { Step = SegmentStep.Held, AimedDuring = aimedDuring, UsedAt = ++tick };
                return false;
            }
            // The newest aim counts: it is what the user may land on next.
            entry.AimedDuring = Math.Max(entry.AimedDuring, aimedDuring);
            return entry.Step == SegmentStep.Failed;
        }

        /// <summary>A payload that failed to decode came once more: try it again.</summary>
        internal void Forgive(uint segment)
        {
            Entry entry;
            if (Is(segment, SegmentStep.Failed, out entry))
            {
                entry.Step = SegmentStep.Held;
            }
        }

        /// <summary>The payload is gone. What is on the GPU stays; what is needed and not there counts as failed.</summary>
        internal void Drop(uint segment)
        {
            SegmentStep step = StepOf(segment);
            // A swap must not wait for it for ever: it counts as missing, and its base stays.
            if (step == SegmentStep.Held && isNeeded(segment))
            {
                entries[segment].Step = SegmentStep.Failed;
            }
            else if (step == SegmentStep.Held || step == SegmentStep.Failed)
            {
                entries.Remove(segment);
            }
        }

        /// <summary>Forget all; the caller frees what the renderer has.</summary>
        internal void Clear()
        {
            entries.Clear();
            toFree.Clear();
            inFlight.Clear();
            SpareBytes = 0;
        }

        /// <summary>Start decoding a held segment, if there is room.</summary>
        internal bool TryDecode(uint segment)
        {
            Entry entry;
            if (!inFlight.HasRoom || !Is(segment, SegmentStep.Held, out entry))
            {
                return false;
            }
            entry.Step = SegmentStep.Decoding;
            inFlight.BeginDecode();
            return true;
        }

        /// <summary>
        /// A decoded mesh came; true where it is to be uploaded. False where nobody needs it and it came for no aim, or there is no
        /// spare room.
        /// </summary>
        internal bool Take(uint segment, long bytes)
        {
            Entry entry;
            if (!Is(segment, SegmentStep.Decoding, out entry))
            {
                return false;
            }
            bool isStillNeeded = isNeeded(segment);
            // Nobody needs it any more: the payload stays, the mesh goes back to the pool.
            if (!isStillNeeded && (entry.AimedDuring < 0 || SpareBytes + bytes > maxSpareBytes))
            {
                entry.Step = SegmentStep.Held;
                inFlight.DropDecode();
                return false;
            }
            entry.Step = SegmentStep.Decoded;
            entry.Bytes = bytes;
            entry.UsedAt = ++tick;
            inFlight.Queue(bytes);
            SpareBytes += isStillNeeded ? 0 : bytes;
            return true;
        }

        /// <summary>It cannot be decoded, uploaded, or drawn; what there was of it is freed by the caller.</summary>
        internal void Fail(uint segment)
        {
            Entry entry;
            if (!entries.TryGetValue(segment, out entry))
            {
                return;
            }
            if (entry.Step == SegmentStep.Decoding)
            {
                inFlight.DropDecode();
            }
            else if (entry.Step == SegmentStep.Decoded)
            {
                inFlight.Dequeue(entry.Bytes);
            }
            else if (entry.Step != SegmentStep.Uploaded)
            {
                return;
            }
            // While it was decoding, its bytes were not counted yet.
            SpareBytes -= entry.Step == SegmentStep.Decoding || isNeeded(segment) ? 0 : entry.Bytes;
            entry.Step = SegmentStep.Failed;
            entry.Bytes = 0;
        }

        /// <summary>A segment's whole mesh is on the GPU: it is no longer in flight.</summary>
        internal void Uploaded(uint segment)
        {
            Entry entry;
            if (Is(segment, SegmentStep.Decoded, out entry))
            {
                entry.Step = SegmentStep.Uploaded;
                inFlight.Dequeue(entry.Bytes);
            }
        }

        /// <summary>An uploaded segment can be drawn without any further preparation.</summary>
        internal void Warmed(uint segment)
        {
            Entry entry;
            if (Is(segment, SegmentStep.Uploaded, out entry))
            {
                entry.Step = SegmentStep.Resident;
            }
        }

        /// <summary>Meshes that wait, for no aim, and that nobody needs any more: they take memory and give nothing.</summary>
        internal void FreeUnneededMeshes()
        {
            FreeIf((segment, entry) => entry.Step == SegmentStep.Decoded && entry.AimedDuring < 0 && !isNeeded(segment));
        }

        /// <summary>After a swap: what it hid, and whatever came for earlier landings and aims.</summary>
        internal void FreeAfterSwap(int landing, HashSet<uint> hidden)
        {
            FreeIf((segment, entry) => !isNeeded(segment) && (hidden.Contains(segment) || entry.AimedDuring < landing));
        }

        /// <summary>Whether an aim brought it since this landing was asked for.</summary>
        internal bool IsAimedSince(uint segment, int landing)
        {
            Entry entry;
            return entries.TryGetValue(segment, out entry) && entry.AimedDuring >= landing;
        }

        /// <summary>Ids whose GPU memory, or waiting mesh, is to be freed; each is told once.</summary>
        internal void TakeFreed(List<uint> target)
        {
            target.AddRange(toFree);
            toFree.Clear();
        }

        /// <summary>Count what is spare anew, and free of it what was used longest ago until the rest fits.</summary>
        internal void Trim()
        {
            scratch.Clear();
            SpareBytes = 0;
            foreach (KeyValuePair<uint, Entry> pair in entries)
            {
                if (IsOnGpu(pair.Value) && !isNeeded(pair.Key))
                {
                    scratch.Add(pair);
                    SpareBytes += pair.Value.Bytes;
                }
            }
            // Oldest first: what was aimed at long ago is least likely to be landed in.
            scratch.Sort((left, right) => left.Value.UsedAt.CompareTo(right.Value.UsedAt));
            for (int at = 0; at < scratch.Count && SpareBytes > maxSpareBytes; at++)
            {
                SpareBytes -= scratch[at].Value.Bytes;
                Free(scratch[at].Key, scratch[at].Value);
            }
        }

        /// <summary>Whether it takes memory as a mesh: on the GPU, or decoded and on its way there.</summary>
        private static bool IsOnGpu(Entry entry)
        {
            return entry.Step == SegmentStep.Decoded || entry.Step == SegmentStep.Uploaded || entry.Step == SegmentStep.Resident;
        }

        private bool Is(uint segment, SegmentStep step, out Entry entry)
        {
            return entries.TryGetValue(segment, out entry) && entry.Step == step;
        }

        private void FreeIf(Func<uint, Entry, bool> shouldFree)
        {
            foreach (KeyValuePair<uint, Entry> pair in entries)
            {
                // Free changes entries, not the dictionary: it can be enumerated meanwhile.
                if (IsOnGpu(pair.Value) && shouldFree(pair.Key, pair.Value))
                {
                    Free(pair.Key, pair.Value);
                }
            }
            Trim();
        }

        private void Free(uint segment, Entry entry)
        {
            if (entry.Step == SegmentStep.Decoded)
            {
                inFlight.Dequeue(entry.Bytes);
            }
            entry.Step = SegmentStep.Held; // The payload is still here.
            toFree.Add(segment);
        }

        private sealed class Entry
        {
            internal SegmentStep Step;

            /// <summary>GPU bytes of its mesh; 0 before it was decoded.</summary>
            internal long Bytes;

            /// <summary>Newest landing when an aim brought it, or -1: it came for a landing.</summary>
            internal int AimedDuring;

            /// <summary>When it came or was decoded, as a running number.</summary>
            internal long UsedAt;
        }
    }
}
