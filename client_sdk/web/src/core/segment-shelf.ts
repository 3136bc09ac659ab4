/**
 * Where every known segment stands between payload and GPU, and what of it nobody needs.
 *
 * PURE. Which segments are needed is said from outside (residency.ts); what is not is *spare*, and bounded in bytes. What was
 * shown stays there as spare, for who comes back; it makes way for what an aim brings.
 */

import { InFlight, type InFlightLimits } from "./in-flight.ts";
import type { SegmentKey } from "./types.ts";

/** How much is done at once, and kept. */
export interface ShelfLimits extends InFlightLimits {
  /** GPU bytes of segments that are neither visible nor of the newest plan: what an aim brought, and what was left behind. */
  readonly spareBytes: number;
}

/** `held`: the payload is here. `decoded`: waits for, or under, upload. `resident`: can be drawn at once. */
export type Step = "held" | "decoding" | "decoded" | "uploaded" | "resident" | "failed";

interface Entry {
  step: Step;
  /** On the GPU, once decoded. */
  bytes: number;
  /** Newest landing when an aim brought it, or -1: it came for a landing. */
  aimedDuring: number;
  /** When it came or was decoded, as a running number. */
  usedAt: number;
}

/** Segments by key. */
export class SegmentShelf {
  readonly #limits: ShelfLimits;
  readonly #inFlight: InFlight;
  readonly #isNeeded: (segment: SegmentKey) => boolean;
  readonly #entries = new Map<SegmentKey, Entry>();
  #toFree: SegmentKey[] = [];
  #spareBytes = 0;
  /** Of {@link #spareBytes}, what aims brought since the newest swap. */
  #aimedBytes = 0;
  /** What the newest swap has shown. */
  #landing = -1;
  #tick = 0;

  /** @param isNeeded Whether a segment is visible, or wanted or kept by the newest plan. After it changes: {@link trim}. */
  constructor(limits: ShelfLimits, isNeeded: (segment: SegmentKey) => boolean) {
    this.#limits = limits;
    this.#inFlight = new InFlight(limits);
    this.#isNeeded = isNeeded;
  }

  get spareBytes(): number {
    return this.#spareBytes;
  }

  /** Whether an aim's segment may be decoded now. */
  get hasSpareRoom(): boolean {
    return this.#aimedBytes < this.#limits.spareBytes;
  }

  /** Segments being decoded, or decoded and not uploaded. */
  get inFlight(): number {
    return this.#inFlight.count;
  }

  get hasFrees(): boolean {
    return this.#toFree.length > 0;
  }

  /** Where a segment stands; undefined for one that is not known. */
  stepOf(segment: SegmentKey): Step | undefined {
    return this.#entries.get(segment)?.step;
  }

  /** A payload is here. `aimedDuring` is the newest landing if an aim brought it, else -1. True where it had failed before. */
  hold(segment: SegmentKey, aimedDuring: number): boolean {
    const entry = this.#entries.get(segment);
    if (!entry) {
      this.#entries.set(segment, { step: "held", bytes: 0, aimedDuring, usedAt: this.#nextTick() });
      return false;
    }
    // Never lowered: a landing keeps a segment by `isNeeded`, an aim by this number alone.
    entry.aimedDuring = Math.max(entry.aimedDuring, aimedDuring);
    return entry.step === "failed";
  }

  /** It came once more: perhaps whole this time. */
  forgive(segment: SegmentKey): void {
    const entry = this.#entries.get(segment);
    if (entry?.step === "failed") {
      entry.step = "held";
    }
  }

  /** Forget all, without freeing. */
  clear(): void {
    this.#entries.clear();
    this.#toFree = [];
    this.#inFlight.clear();
    this.#spareBytes = 0;
    this.#aimedBytes = 0;
    this.#landing = -1;
  }

  /** Start decoding a held segment, if there is room. */
  tryDecode(segment: SegmentKey): boolean {
    const entry = this.#entries.get(segment);
    if (entry?.step !== "held" || !this.#inFlight.hasRoom) {
      return false;
    }
    entry.step = "decoding";
    this.#inFlight.ask();
    return true;
  }

  /** Whether one more may be decoded. */
  get hasRoom(): boolean {
    return this.#inFlight.hasRoom;
  }

  /** A mesh of that many GPU bytes came. False where nobody needs it, and it came for no aim, or there is no spare room. */
  take(segment: SegmentKey, bytes: number): boolean {
    const entry = this.#entries.get(segment);
    if (entry?.step !== "decoding") {
      return false;
    }
    const isNeeded = this.#isNeeded(segment);
    if (!isNeeded && (entry.aimedDuring < 0 || this.#aimedBytes + bytes > this.#limits.spareBytes)) {
      // Its payload is here, and can be asked for again when there is room.
      entry.step = "held";
      this.#inFlight.dismiss();
      return false;
    }
    entry.step = "decoded";
    entry.bytes = bytes;
    entry.usedAt = this.#nextTick();
    this.#inFlight.wait(bytes);
    if (!isNeeded) this.trim();
    return true;
  }

  /** Decoding failed. */
  fail(segment: SegmentKey): void {
    const entry = this.#entries.get(segment);
    if (entry?.step === "decoding") {
      entry.step = "failed";
      this.#inFlight.dismiss();
    }
  }

  /** All of it is on the GPU. */
  uploaded(segment: SegmentKey): void {
    const entry = this.#entries.get(segment);
    if (entry?.step === "decoded") {
      entry.step = "uploaded";
      this.#inFlight.leave(entry.bytes);
    }
  }

  /** And it can be drawn without any further preparation. */
  warmed(segment: SegmentKey): void {
    const entry = this.#entries.get(segment);
    if (entry?.step === "uploaded") {
      entry.step = "resident";
    }
  }

  /** Any mesh that waits for its upload. */
  anyDecoded(): SegmentKey | null {
    for (const [segment, entry] of this.#entries) {
      if (entry.step === "decoded") {
        return segment;
      }
    }
    return null;
  }

  /** Meshes that wait, for no aim, and that nobody needs any more: they take memory and give nothing. */
  freeUnneededMeshes(): void {
    this.#freeIf((entry, segment) => entry.step === "decoded" && entry.aimedDuring < 0 && !this.#isNeeded(segment));
  }

  /** After a swap: what it hid is the last to make way, and what waits for earlier landings and aims is not uploaded. */
  leaveBehind(landing: number, hidden: Iterable<SegmentKey>): void {
    this.#landing = landing;
    for (const segment of hidden) {
      const entry = this.#entries.get(segment);
      if (entry) entry.usedAt = this.#nextTick();
    }
    this.#freeIf(
      (entry, segment) => entry.step === "decoded" && entry.aimedDuring < landing && !this.#isNeeded(segment),
    );
  }

  /** Whether an aim brought it since this landing was asked for. */
  isAimedSince(segment: SegmentKey, landing: number): boolean {
    return (this.#entries.get(segment)?.aimedDuring ?? -1) >= landing;
  }

  /** Everything on the GPU is gone without being freed; the payloads are here. */
  loseGpu(): void {
    this.#freeIf(() => true);
    // Nothing to give back: the context took it along.
    this.#toFree = [];
  }

  /** Keys whose GPU memory, or waiting mesh, is to be freed; each is told once. */
  takeFreed(): SegmentKey[] {
    const freed = this.#toFree;
    this.#toFree = [];
    return freed;
  }

  /** Count what is spare anew, and free of it what was left behind, longest ago first, then what aims brought, until it fits. */
  trim(): void {
    const spare = [...this.#entries].filter(([segment, entry]) => isOnGpu(entry) && !this.#isNeeded(segment));
    const isAimed = (entry: Entry): boolean => entry.aimedDuring >= 0 && entry.aimedDuring >= this.#landing;
    const sum = (bytes: number, [, entry]: [SegmentKey, Entry]): number => bytes + entry.bytes;
    this.#spareBytes = spare.reduce(sum, 0);
    spare.sort((a, b) => Number(isAimed(a[1])) - Number(isAimed(b[1])) || a[1].usedAt - b[1].usedAt);
    for (const [segment, entry] of spare) {
      if (this.#spareBytes <= this.#limits.spareBytes) {
        break;
      }
      this.#spareBytes -= entry.bytes;
      this.#free(segment, entry);
    }
    this.#aimedBytes = spare.filter(([, entry]) => isOnGpu(entry) && isAimed(entry)).reduce(sum, 0);
  }

  #freeIf(shouldFree: (entry: Entry, segment: SegmentKey) => boolean): void {
    for (const [segment, entry] of this.#entries) {
      if (isOnGpu(entry) && shouldFree(entry, segment)) {
        this.#free(segment, entry);
      }
    }
    this.trim();
  }

  #free(segment: SegmentKey, entry: Entry): void {
    if (entry.step === "decoded") {
      this.#inFlight.leave(entry.bytes);
    }
    entry.step = "held"; // The payload is still here.
    this.#toFree.push(segment);
  }

  #nextTick(): number {
    this.#tick += 1;
    return this.#tick;
  }
}

/** Or on its way there, with memory of its own. */
function isOnGpu(entry: Entry): boolean {
  return entry.step === "decoded" || entry.step === "uploaded" || entry.step === "resident";
}
