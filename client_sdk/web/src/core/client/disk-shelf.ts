/**
 * Payloads on disk, so that a reload, or a visit on another day, loads nothing twice.
 *
 * In the browser's Cache storage, in bundles ({@link writeBundle}), over all scenes of this origin within one bound of bytes:
 * the oldest bundle goes first. What cannot be kept (no such storage, a full disk, a page without a secure context) is not:
 * nothing here fails. Whoever may read the browser's profile may read it, as the browser's own cache.
 */

import type { CachedSegment } from "../session/cache.ts";
import { readBundle, writeBundle } from "../session/kept-bundle.ts";

const STORAGE = "terraport-payload-1";
/** Written when so much has come, or nothing more for so long. */
const BUNDLE_BYTES = 8 * 1024 * 1024;
const QUIET_MS = 1500;
/** A visit begins by then at the latest: what was read so far counts. */
const RESTORE_MS = 1500;

/** Kept payloads of one scene. */
export class DiskShelf {
  readonly #sceneUrl: string;
  readonly #maxBytes: number;
  readonly #xxh3: (bytes: Uint8Array) => bigint;
  /** Hashes of what is on disk for this scene, or about to be. */
  readonly #kept = new Set<bigint>();
  #waiting: CachedSegment[] = [];
  #waitingBytes = 0;
  #timer: ReturnType<typeof setTimeout> | null = null;

  /** @param maxBytes - bound on what is kept of all scenes together. */
  constructor(sceneUrl: string, maxBytes: number, xxh3: (bytes: Uint8Array) => bigint) {
    this.#sceneUrl = sceneUrl;
    this.#maxBytes = maxBytes;
    this.#xxh3 = xxh3;
  }

  /** What was kept of this scene, the newest first, at most so many bytes of it. */
  async restore(maxBytes: number): Promise<readonly CachedSegment[]> {
    const entries = new Map<number, CachedSegment>();
    const endMs = performance.now() + RESTORE_MS;
    let bytes = 0;
    try {
      const cache = await caches.open(STORAGE);
      const bundles = bundlesOf(await cache.keys()).filter(({ sceneUrl }) => sceneUrl === this.#sceneUrl);
      for (const { request, size } of bundles.reverse()) {
        if (bytes + size > maxBytes || performance.now() > endMs) break;
        const response = await cache.match(request);
        if (response === undefined) continue;
        bytes += size;
        for (const entry of readBundle(new Uint8Array(await response.arrayBuffer()), this.#xxh3)) {
          this.#kept.add(entry.facts.xxh3);
          // The newest is the one of the newest version.
          if (!entries.has(entry.facts.segment)) entries.set(entry.facts.segment, entry);
        }
      }
    } catch {
      // No storage: nothing was kept.
    }
    return [...entries.values()];
  }

  /** Keep a payload that came; soon, not now. */
  put(entry: CachedSegment): void {
    if (this.#kept.has(entry.facts.xxh3) || entry.payload.byteLength > this.#maxBytes) return;
    this.#kept.add(entry.facts.xxh3);
    this.#waiting.push(entry);
    this.#waitingBytes += entry.payload.byteLength;
    if (this.#timer !== null) clearTimeout(this.#timer);
    if (this.#waitingBytes >= BUNDLE_BYTES) void this.#write();
    else this.#timer = setTimeout(() => void this.#write(), QUIET_MS);
  }

  /** Write what waits. */
  async #write(): Promise<void> {
    if (this.#timer !== null) clearTimeout(this.#timer);
    this.#timer = null;
    const entries = this.#waiting;
    this.#waiting = [];
    this.#waitingBytes = 0;
    if (entries.length === 0) return;
    try {
      const bundle = writeBundle(entries);
      const cache = await caches.open(STORAGE);
      await cache.put(bundleUrl(this.#sceneUrl, Date.now(), bundle.byteLength), new Response(bundle));
      let over = -this.#maxBytes;
      const bundles = bundlesOf(await cache.keys());
      for (const { size } of bundles) over += size;
      for (const { request, size } of bundles) {
        if (over <= 0) break;
        await cache.delete(request);
        over -= size;
      }
    } catch {
      // A full disk, or no storage: the next visit loads it again.
    }
  }
}

/** Time and size are in the name: listing the names is enough to decide what goes. */
function bundleUrl(sceneUrl: string, timeMs: number, size: number): string {
  return `${sceneUrl}/kept?time=${timeMs}&size=${size}`;
}

interface Bundle {
  readonly request: Request;
  readonly sceneUrl: string;
  readonly timeMs: number;
  readonly size: number;
}

/** Bundles of all scenes, the oldest first. */
function bundlesOf(requests: readonly Request[]): Bundle[] {
  const bundles = requests.map((request) => {
    const url = new URL(request.url);
    const sceneUrl = `${url.origin}${url.pathname.replace(/\/kept$/, "")}`;
    return {
      request,
      sceneUrl,
      timeMs: Number(url.searchParams.get("time")),
      size: Number(url.searchParams.get("size")),
    };
  });
  return bundles.sort((a, b) => a.timeMs - b.timeMs);
}
