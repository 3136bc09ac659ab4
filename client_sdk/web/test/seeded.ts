/** Chance that comes again: a failing case of a fuzz test is found by its seed. */

/** A generator of whole numbers below a bound (mulberry32, Tommy Ettinger, 2017). */
export function seeded(seed: number): (below: number) => number {
  let state = seed >>> 0;
  return (below) => {
    state = (state + 0x6d2b79f5) >>> 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return ((mixed ^ (mixed >>> 14)) >>> 0) % below;
  };
}

/** A copy with a few bytes changed, cut, doubled or put in. */
export function mutated(bytes: Uint8Array, chance: (below: number) => number): Uint8Array<ArrayBuffer> {
  let data = new Uint8Array(bytes);
  for (let step = 1 + chance(4); step > 0; step -= 1) {
    const at = chance(data.length + 1);
    const end = Math.min(data.length, at + chance(16));
    switch (chance(6)) {
      case 0:
        data = data.slice(0, at);
        break;
      case 1:
        data = joined(data.subarray(0, at), data.subarray(end));
        break;
      case 2:
        data = joined(data.subarray(0, end), data.subarray(at));
        break;
      case 3:
        data = joined(
          data.subarray(0, at),
          Uint8Array.from({ length: 1 + chance(8) }, () => chance(256)),
          data.subarray(at),
        );
        break;
      default:
        if (at < data.length) data[at] = chance(3) === 0 ? EDGES[chance(EDGES.length)]! : data[at]! ^ (1 << chance(8));
    }
  }
  return data;
}

/** Bytes that mean something somewhere: ends of ranges, msgpack's lengths, quotes. */
const EDGES = [0x00, 0x01, 0x7f, 0x80, 0x90, 0xc0, 0xc1, 0xc6, 0xdb, 0xdd, 0xdf, 0xe0, 0xff, 0x22, 0x5c, 0x7b];

function joined(...chunks: readonly Uint8Array[]): Uint8Array<ArrayBuffer> {
  const joinedBytes = new Uint8Array(chunks.reduce((total, chunk) => total + chunk.length, 0));
  let at = 0;
  for (const chunk of chunks) {
    joinedBytes.set(chunk, at);
    at += chunk.length;
  }
  return joinedBytes;
}
