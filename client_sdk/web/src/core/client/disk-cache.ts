/**
 * Payloads on disk, so that a reload, or a visit on another day, loads nothing twice.
 *
 * In the browser's Cache storage, in bundles, over all scenes of this origin within one bound of bytes:
 * the oldest bundle goes first. What cannot be kept (no such storage, a full disk, a page without a secure context) is not:
 * nothing here fails.
 */

import { crc32 } from "../payload/crc32.ts";
import type { CachedSegment } from "../session/cache.ts";
import type { Bounds, SegmentKey } from "../types.ts";

const STORAGE = "terraport-payload-2";
/** Written when so much has come, or nothing more for so long. */
const BUNDLE_BYTES = 8 * 1024 * 1024;
const QUIET_MS = 1500;
/** A visit begins by then at the latest, with what was read so far. */
const RESTORE_MS = 1500;

/** Payloads of one scene on disk. */
export class DiskCache {
  readonly #sceneUrl: string;
  readonly #maxBytes: number;
  /** Keys of what is on disk for this scene, or about to be. */
  readonly #kept = new Set<SegmentKey>();
  #waiting: CachedSegment[] = [];
  #waitingBytes = 0;
  #timer: ReturnType<typeof setTimeout> | null = null;

  /** @param maxBytes - bound on the bytes of all scenes together. */
  constructor(sceneUrl: string, maxBytes: number) {
    this.#sceneUrl = sceneUrl;
    this.#maxBytes = maxBytes;
  }

  /** Read the payloads of this scene, at most so many bytes of the newest; those come last. */
  async restore(maxBytes: number): Promise<readonly CachedSegment[]> {
    const entries: CachedSegment[] = [];
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
        for (const entry of readBundle(new Uint8Array(await response.arrayBuffer()))) {
          if (this.#kept.has(entry.key)) continue;
          this.#kept.add(entry.key);
          entries.push(entry);
        }
      }
    } catch {
      // No storage: nothing was kept.
    }
    return entries.reverse();
  }

  /** Write a payload soon. */
  put(entry: CachedSegment): void {
    if (this.#kept.has(entry.key) || entry.payload.byteLength > this.#maxBytes) return;
    this.#kept.add(entry.key);
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

/** Size of the head, and its CRC-32. */
const PREFIX_BYTES = 8;

type Row = readonly [key: SegmentKey, length: number, bounds: Bounds | null];

/**
 * Write payloads in one run of bytes: the size of the head and its CRC-32 (u32, little-endian), the head (JSON), the payloads in
 * its order.
 */
function writeBundle(entries: readonly CachedSegment[]): Uint8Array<ArrayBuffer> {
  const rows = entries.map(({ key, payload, bounds }): Row => [key, payload.length, bounds]);
  const head = new TextEncoder().encode(JSON.stringify(rows));
  const size = entries.reduce((sum, { payload }) => sum + payload.length, PREFIX_BYTES + head.length);
  const bundle = new Uint8Array(size);
  const view = new DataView(bundle.buffer);
  view.setUint32(0, head.length, true);
  view.setUint32(4, crc32(head), true);
  bundle.set(head, PREFIX_BYTES);
  let at = PREFIX_BYTES + head.length;
  for (const { payload } of entries) {
    bundle.set(payload, at);
    at += payload.length;
  }
  return bundle;
}

/**
 * Read a bundle, as far as it is whole; nothing where its head is damaged. Payloads have checksums of their own, which decoding
 * checks: a damaged one is dropped then, and loaded again.
 */
function readBundle(bundle: Uint8Array<ArrayBuffer>): readonly CachedSegment[] {
  if (bundle.length < PREFIX_BYTES) return [];
  const view = new DataView(bundle.buffer);
  let at = PREFIX_BYTES + view.getUint32(0, true);
  const head = bundle.subarray(PREFIX_BYTES, at);
  if (crc32(head) !== view.getUint32(4, true)) return [];
  const entries: CachedSegment[] = [];
  for (const [key, length, bounds] of JSON.parse(new TextDecoder().decode(head)) as readonly Row[]) {
    // Copied: a view would keep the whole bundle in memory as long as one of its segments is.
    const payload = bundle.slice(at, at + length);
    at += length;
    if (payload.length === length) entries.push({ key, payload, bounds });
  }
  return entries;
}
