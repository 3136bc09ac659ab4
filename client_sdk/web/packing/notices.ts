/**
 * Writes `third-party.txt`: the licences of what is in the page, by what the bundler put in. A package without a licence
 * text, or with a licence that is not on the list, ends the build.
 */

import { existsSync, readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import type { Plugin } from "vite";

/** Licences that ask for no more than their text to travel with the code. */
const ALLOWED: ReadonlySet<string> = new Set(["MIT", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "ISC", "0BSD"]);

const PACKAGE = /^(.*\/node_modules\/(?:@[^/]+\/)?[^/]+)\//;

interface PackageFacts {
  readonly name: string;
  readonly version: string;
  readonly license?: string;
}

/** Folder of the package that a module belongs to; null for our own. */
function packageFolder(moduleId: string): string | null {
  // Rolldown writes names of modules that it makes itself with a NUL in front.
  return PACKAGE.exec(moduleId.replaceAll("\\", "/").replace(/^\0/, ""))?.[1] ?? null;
}

/** Name, version, licence and its text. */
function notice(folder: string): string {
  const facts = JSON.parse(readFileSync(join(folder, "package.json"), "utf8")) as PackageFacts;
  const licence = facts.license ?? "none";
  if (!ALLOWED.has(licence)) throw new Error(`${facts.name} states the licence ${licence}, expected one on the list`);
  const file = readdirSync(folder).find((name) => /^(licen[cs]e|copying)/i.test(name));
  if (file === undefined) throw new Error(`${facts.name} brings no licence text`);
  const texts = [file, "NOTICE"].map((name) => join(folder, name)).filter((path) => existsSync(path));
  const body = texts.map((path) => readFileSync(path, "utf8").trim()).join("\n\n");
  return `${facts.name} ${facts.version} (${licence})\n\n${body}\n`;
}

/** The plugin, and its twin for workers, which Vite bundles apart. */
export function notices(): { page: Plugin; worker: Plugin } {
  const folders = new Set<string>();
  const collect = (bundle: Record<string, { type: string; moduleIds?: readonly string[] }>): void => {
    for (const chunk of Object.values(bundle)) {
      for (const moduleId of chunk.moduleIds ?? []) {
        const folder = packageFolder(moduleId);
        if (folder !== null) folders.add(folder);
      }
    }
  };
  return {
    worker: {
      name: "terraport-notices-worker",
      apply: "build",
      generateBundle: (_options, bundle) => collect(bundle),
    },
    page: {
      name: "terraport-notices",
      apply: "build",
      generateBundle(_options, bundle) {
        collect(bundle);
        const head = "The terraport viewer (Apache-2.0) contains code of these packages.\n";
        const source = [head, ...[...folders].sort().map(notice)].join(`\n${"-".repeat(80)}\n\n`);
        this.emitFile({ type: "asset", fileName: "third-party.txt", source });
      },
    },
  };
}
