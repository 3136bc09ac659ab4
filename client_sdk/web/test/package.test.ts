/**
 * The package as it is installed: packed by npm, unpacked into an empty Vite project, imported by its exports, built.
 *
 * Dependencies are linked from here, not installed: no test asks a registry.
 */

import { execFileSync } from "node:child_process";
import {
  existsSync,
  mkdirSync,
  mkdtempSync,
  readdirSync,
  readFileSync,
  rmSync,
  symlinkSync,
  writeFileSync,
} from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "vite";
import { afterAll, beforeAll, expect, test } from "vitest";

const HERE = fileURLToPath(new URL("../", import.meta.url));
let project = "";

/** Build a module in the project; returns its chunks by name. */
async function built(source: string): Promise<Map<string, string>> {
  writeFileSync(join(project, "main.ts"), source);
  rmSync(join(project, "out"), { recursive: true, force: true });
  await build({
    root: project,
    configFile: false,
    logLevel: "error",
    worker: { format: "es" },
    build: { outDir: "out", target: "es2022", rolldownOptions: { input: join(project, "main.ts") } },
  });
  const folder = join(project, "out", "assets");
  return new Map(readdirSync(folder).map((name) => [name, readFileSync(join(folder, name), "utf8")]));
}

/** What the README writes in TypeScript, one after the other: the later goes on from the earlier. */
function exampleOf(readme: string): string {
  const text = readFileSync(join(HERE, readme), "utf8");
  return [...text.matchAll(/```ts\n([\s\S]*?)```/g)].map(([, code]) => code).join("");
}

beforeAll(() => {
  project = mkdtempSync(join(tmpdir(), "terraport-package-"));
  execFileSync("npm", ["pack", "--pack-destination", project], { cwd: HERE, stdio: "pipe" });
  const [packed] = readdirSync(project);
  const modules = join(project, "node_modules");
  mkdirSync(join(modules, "@terraport"), { recursive: true });
  execFileSync("tar", ["-xzf", join(project, packed!), "-C", project]);
  execFileSync("mv", [join(project, "package"), join(modules, "@terraport", "client")]);
  for (const name of ["three", "@types"]) {
    symlinkSync(join(HERE, "node_modules", name), join(modules, name));
  }
}, 240_000);

afterAll(() => rmSync(project, { recursive: true, force: true }));

test("the example of the README is built, and typed", async () => {
  const example = exampleOf("README.md");
  const chunks = await built(example);
  for (const worker of ["stream.worker", "scene.worker"]) {
    expect([...chunks.keys()].some((name) => name.startsWith(worker))).toBe(true);
  }
  // By the types of the newest version of three.js that the package allows, and of the oldest.
  const oldest = join(HERE, "node_modules", "types-three-oldest");
  for (const paths of [{}, ...(existsSync(oldest) ? [{ three: [oldest], "three/*": [join(oldest, "*")] }] : [])]) {
    checkTypes(paths);
  }
}, 240_000);

/** Check `main.ts` by the compiler, with some modules found elsewhere. */
function checkTypes(paths: object): void {
  const config = {
    compilerOptions: {
      paths,
      target: "ES2022",
      module: "ESNext",
      moduleResolution: "Bundler",
      lib: ["ES2023", "DOM", "DOM.Iterable"],
      types: [],
      strict: true,
      skipLibCheck: false,
      noEmit: true,
    },
    files: ["main.ts"],
  };
  writeFileSync(join(project, "tsconfig.json"), JSON.stringify(config));
  const tsc = join(HERE, "node_modules", "typescript", "bin", "tsc");
  execFileSync(process.execPath, [tsc, "-p", project], { stdio: "inherit" });
}

test("the example of the element is built", async () => {
  const chunks = await built(readFileSync(join(HERE, "examples/element/main.ts"), "utf8"));
  expect([...chunks.values()].some((text) => text.includes('"terraport-scene"'))).toBe(true);
}, 240_000);

test("what is not used is not in the bundle", async () => {
  const chunks = await built(
    'import { parseSceneUrl } from "@terraport/client/core"; console.log(parseSceneUrl("x"));',
  );
  // A bundler copies the transcoder of textures that a worker would fetch, used or not; nobody loads it.
  expect([...chunks.keys()].filter((name) => !name.endsWith(".wasm"))).toHaveLength(1);
  expect([...chunks].find(([name]) => name.endsWith(".js"))![1].length).toBeLessThan(10_000);
}, 240_000);

test("it brings no source, no test, no page", () => {
  const folder = join(project, "node_modules", "@terraport", "client");
  expect(readdirSync(folder).sort()).toEqual(["LICENSE", "README.md", "dist", "package.json"]);
  expect(existsSync(join(folder, "dist", "app"))).toBe(false);
});

test("it comes with a reference of every export, made of the declarations", () => {
  const packed = join(project, "node_modules", "@terraport", "client", "dist");
  const named = (entry: string): string[] =>
    [...readFileSync(join(packed, "reference", `${entry}.md`), "utf8").matchAll(/^### (\S+)$/gm)].map(
      ([, name]) => name!,
    );
  expect(named("core")).toEqual(expect.arrayContaining(["openStream", "SceneFiles", "StreamEvent"]));
  expect(named("three")).toEqual(expect.arrayContaining(["Terrain", "standNear", "ViewMode"]));
  expect(named("element")).toEqual(["TerraportScene", "TerraportSceneEventMap"]);
  // Nothing that whoever installs it cannot reach, and the comment of what he can.
  const three = readFileSync(join(packed, "reference", "three.md"), "utf8");
  expect(three).not.toMatch(/#private|private /);
  expect(three).toContain("Show the landing that is presentable, in this frame: flags only.");
});
