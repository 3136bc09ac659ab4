/**
 * After `tsc -p tsconfig.build.json`: what the compiler leaves of our own in `dist`, made right for whoever installs it.
 *
 * It rewrites the endings of imports, not those of the workers' addresses; and the version is written in, since not every
 * bundler takes names out of a JSON file.
 */

import { copyFileSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { prepareTranscoder } from "./transcoder.js";

const dist = new URL("../dist/", import.meta.url);
const { version } = JSON.parse(readFileSync(new URL("../package.json", import.meta.url), "utf8"));

for (const name of readdirSync(dist, { recursive: true, encoding: "utf8" })) {
  if (!name.endsWith(".js")) continue;
  const file = new URL(name, dist);
  const text = readFileSync(file, "utf8");
  const right = text
    .replaceAll(/(new URL\("\.\/[\w-]+\.worker)\.ts"/g, '$1.js"')
    .replace(/^import \{ version \} from "[./]*package\.json";$/m, `const version = ${JSON.stringify(version)};`);
  if (right !== text) writeFileSync(file, right);
}

// What no compiler takes along; npm packs a licence that lies beside package.json.
copyFileSync(new URL("../../../LICENSE", import.meta.url), new URL("../LICENSE", import.meta.url));
prepareTranscoder();
mkdirSync(new URL("core/transcoder/", dist), { recursive: true });
for (const name of ["basis_transcoder.js", "basis_transcoder.wasm"]) {
  copyFileSync(new URL(`../src/core/transcoder/${name}`, import.meta.url), new URL(`core/transcoder/${name}`, dist));
}
