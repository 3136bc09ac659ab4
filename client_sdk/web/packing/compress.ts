/** Writes `NAME.br` and `NAME.gz` beside what they make smaller; the service sends them as they are. */

import { readdirSync, readFileSync, statSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";
import type { Plugin } from "vite";

const TEXT = /\.(css|html|js|json|svg|txt|wasm|webmanifest)$/;

/** Below it a packet more or less is all there is to save. */
const MIN_BYTES = 1024;

/** A twin must be at most so large a part of the file. */
const MAX_SHARE = 0.95;

/** Brotli takes a second for all of it at its best, once; what is sent is sent for ever. */
function twins(data: Buffer): [ending: string, data: Buffer][] {
  const size = constants.BROTLI_PARAM_SIZE_HINT;
  return [
    [".br", brotliCompressSync(data, { params: { [constants.BROTLI_PARAM_QUALITY]: 11, [size]: data.length } })],
    [".gz", gzipSync(data, { level: 9 })],
  ];
}

/** The plugin: compresses everything in the output folder when the build has written it. */
export function compress(): Plugin {
  return {
    name: "terraport-compress",
    apply: "build",
    writeBundle({ dir }) {
      const folder = dir ?? ".";
      for (const name of readdirSync(folder, { recursive: true, encoding: "utf8" })) {
        const path = join(folder, name);
        if (!TEXT.test(name) || !statSync(path).isFile()) continue;
        const data = readFileSync(path);
        if (data.length < MIN_BYTES) continue;
        for (const [ending, packed] of twins(data)) {
          if (packed.length <= MAX_SHARE * data.length) writeFileSync(path + ending, packed);
        }
      }
    },
  };
}
