/**
 * Who may import whom: core <- three <- (xr <- app <- study, element), and what of core may do I/O.
 *
 * Read off the import statements: a layer that leaks is found here, not in a page that no longer runs in a worker.
 */

import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, relative, sep } from "node:path";
import { fileURLToPath } from "node:url";
import { describe, expect, it } from "vitest";

const SRC = fileURLToPath(new URL("../src/", import.meta.url));
const FILES = readdirSync(SRC, { recursive: true, encoding: "utf-8" })
  .map((path) => path.split(sep).join("/"))
  .filter((path) => path.endsWith(".ts"));

/** What a part may import of ours besides itself. */
const MAY_IMPORT: Readonly<Record<string, readonly string[]>> = {
  core: [],
  three: ["core"],
  xr: ["core", "three"],
  element: ["core", "three"],
  app: ["core", "three", "xr"],
  study: ["core", "three", "xr", "app"],
};

/** Packages by part; `app` takes what it needs of these through the others, but three.js for its controls. */
const PACKAGES: Readonly<Record<string, readonly string[]>> = {
  core: [],
  three: ["three"],
  xr: ["three"],
  element: ["three"],
  app: ["three"],
  study: ["three"],
};

/** Within core: what a folder may import of core besides itself. Files directly in core belong to no folder. */
const MAY_IMPORT_IN_CORE: Readonly<Record<string, readonly string[]>> = {
  wire: [],
  payload: [],
  scene: ["payload"],
  extras: ["wire", "payload", "scene"],
  session: ["wire", "extras"],
  transcoder: [],
  client: ["wire", "payload", "scene", "extras", "session", "transcoder"],
};

/** Core's shells; everything else in core is pure: no I/O, no clock, no timers, no chance. */
const SHELLS = [/^core\/client\//, /^core\/scene\/(http|list|load)\.ts$/, /^core\/extras\/strokes\.ts$/];

/** What a pure file must not name. Names behind a dot or before a colon are members and fields. */
const IMPURE =
  /(?<![.\w"'`])(fetch|WebSocket|Worker|XMLHttpRequest|localStorage|sessionStorage|indexedDB|setTimeout|setInterval|requestAnimationFrame|queueMicrotask|createImageBitmap|performance|navigator|document|window|postMessage|crypto)\b(?!['"`?]?:)|\bDate\.now\b|\bnew Date\b|\bMath\.random\b/;

interface Import {
  readonly from: string;
  /** A path below src, or a package. */
  readonly target: string;
  readonly isOurs: boolean;
}

/** Its version is said to the server, and on the page. */
const PACKAGE_JSON = "../package.json";

const IMPORTS = FILES.flatMap(importsOf).filter(({ target }) => target !== PACKAGE_JSON);

it("finds the source, and its imports", () => {
  for (const layer of Object.keys(MAY_IMPORT)) expect(FILES.some((path) => path.startsWith(`${layer}/`))).toBe(true);
  expect(IMPORTS.length).toBeGreaterThan(FILES.length);
});

describe("imports", () => {
  it("are of files that are there, with their ending", () => {
    const ours = IMPORTS.filter((imported) => imported.isOurs);
    expect(ours.filter(({ target }) => target.endsWith(".ts") && !FILES.includes(target))).toEqual([]);
    // The transcoder is no source of ours: the build writes it (packing/transcoder.js).
    const written = /^core\/transcoder\/basis_transcoder\.(js|wasm)$/;
    expect(ours.filter(({ target }) => !/\.(ts|css|svg)(\?|$)/.test(target) && !written.test(target))).toEqual([]);
  });

  it("go from part to part in one direction", () => {
    const wrong = IMPORTS.filter(({ from, target, isOurs }) => {
      const [layer, targetLayer] = [partOf(from), partOf(target)];
      return isOurs && layer !== targetLayer && !MAY_IMPORT[layer]?.includes(targetLayer);
    });
    expect(wrong).toEqual([]);
  });

  it("go from folder to folder of core in one direction", () => {
    const wrong = IMPORTS.filter(({ from, target }) => {
      const [folder, targetFolder] = [coreFolderOf(from), coreFolderOf(target)];
      if (folder === null || targetFolder === null || folder === targetFolder) return false;
      return !MAY_IMPORT_IN_CORE[folder]?.includes(targetFolder);
    });
    expect(wrong).toEqual([]);
  });

  it("go in no circle", () => {
    const edges = new Map(FILES.map((path) => [path, [] as string[]]));
    for (const { from, target } of IMPORTS) if (edges.has(target)) edges.get(from)!.push(target);
    expect(circleIn(edges)).toEqual([]);
    expect(circleIn(new Map([...edges, ["a", ["b"]], ["b", ["a"]]]))).toEqual(["a", "b", "a"]);
  });

  it("are of the packages of their part", () => {
    const wrong = IMPORTS.filter(({ from, target, isOurs }) => {
      return !isOurs && !PACKAGES[partOf(from)]?.includes(packageOf(target));
    });
    expect(wrong).toEqual([]);
  });
});

describe("core", () => {
  const pure = FILES.filter((path) => path.startsWith("core/") && !SHELLS.some((shell) => shell.test(path)));

  it.each(pure)("%s does no I/O and has no clock", (path) => {
    expect(IMPURE.exec(codeOf(path))?.[0]).toBeUndefined();
  });

  it("notices what is impure", () => {
    for (const text of ["await fetch(url)", "const t = performance.now();", "setTimeout(f, 1)", "x = Math.random()"]) {
      expect(text).toMatch(IMPURE);
    }
    for (const text of ["reader.fetch(url)", "{ window: 3 }", "readonly performance: number"]) {
      expect(text).not.toMatch(IMPURE);
    }
  });
});

function importsOf(path: string): Import[] {
  const text = readFileSync(join(SRC, path), "utf-8");
  const matches = [
    ...text.matchAll(/^(?:import|export)\s[^;"']*?from\s+"([^"]+)"/gm),
    ...text.matchAll(/^import\s+"([^"]+)"/gm),
    ...text.matchAll(/\bimport\(\s*"([^"]+)"\s*\)/g),
    ...text.matchAll(/new URL\("(\.[^"]+)", import\.meta\.url\)/g),
  ];
  return matches.map(([, target]) => {
    if (!target!.startsWith(".")) return { from: path, target: target!, isOurs: false };
    const below = relative(SRC, join(SRC, dirname(path), target!));
    return { from: path, target: below.split(sep).join("/"), isOurs: true };
  });
}

/** One circle of imports, types included, from a file back to itself; empty where there is none. */
function circleIn(edges: ReadonlyMap<string, readonly string[]>): readonly string[] {
  const finished = new Set<string>();
  const follow = (file: string, path: readonly string[]): readonly string[] => {
    if (path.includes(file)) return [...path.slice(path.indexOf(file)), file];
    if (finished.has(file)) return [];
    for (const target of edges.get(file)!) {
      const circle = follow(target, [...path, file]);
      if (circle.length > 0) return circle;
    }
    finished.add(file);
    return [];
  };
  for (const file of edges.keys()) {
    const circle = follow(file, []);
    if (circle.length > 0) return circle;
  }
  return [];
}

function partOf(path: string): string {
  return path.split("/")[0]!;
}

function coreFolderOf(path: string): string | null {
  const [part, folder, file] = path.split("/");
  return part === "core" && file !== undefined ? folder! : null;
}

function packageOf(target: string): string {
  return target
    .split("/")
    .slice(0, target.startsWith("@") ? 2 : 1)
    .join("/");
}

/** The text without comments and strings, so that prose may say "document". */
function codeOf(path: string): string {
  return readFileSync(join(SRC, path), "utf-8")
    .replace(/\/\*[\s\S]*?\*\//g, "")
    .replace(/\/\/.*$/gm, "")
    .replace(/"(?:[^"\\\n]|\\.)*"/g, '""');
}
