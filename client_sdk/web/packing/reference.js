/**
 * The package's API reference, `dist/reference/*.md`: what each entry point exports, in the words of its comments.
 *
 * Made of the declarations that `tsc -p tsconfig.build.json` has written, so it says what whoever installs the package can
 * use, and nothing else. An export without a comment ends it: that is how CI sees one.
 */

import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { parseSync } from "vite";

const dist = new URL("../dist/", import.meta.url);
const { name: packageName, version } = JSON.parse(readFileSync(new URL("../package.json", import.meta.url), "utf8"));
const ENTRIES = ["core", "three", "element"];
const KINDS = { class: "Classes", function: "Functions", const: "Constants", type: "Types" };

/** Exports of a declaration file by name: `{name, kind, doc, code}`. */
function exportsOf(url, files = new Map()) {
  const known = files.get(url.href);
  if (known !== undefined) return known;
  const exported = new Map();
  files.set(url.href, exported);
  const text = readFileSync(url, "utf8");
  const { program, comments, errors } = parseSync(url.pathname, text);
  if (errors.length > 0) throw new Error(`${url.pathname}: ${errors[0].message}`);
  const imported = new Map();
  for (const node of program.body) {
    if (node.type === "ImportDeclaration") {
      for (const { local, imported: from } of node.specifiers) {
        if (from !== undefined) imported.set(local.name, { source: node.source.value, name: from.name });
      }
    } else if (node.type === "ExportAllDeclaration") {
      for (const [name, entry] of exportsOf(declared(url, node.source.value), files)) exported.set(name, entry);
    } else if (node.type === "ExportNamedDeclaration") {
      if (node.declaration) {
        for (const entry of entriesOf(node, text, comments)) exported.set(entry.name, entry);
      }
      for (const { local, exported: as } of node.specifiers) {
        const from = node.source ? { source: node.source.value, name: local.name } : imported.get(local.name);
        const entry = from && exportsOf(declared(url, from.source), files).get(from.name);
        if (!entry) throw new Error(`${url.pathname} exports ${as.name}, which is declared nowhere`);
        exported.set(as.name, { ...entry, name: as.name });
      }
    }
  }
  return exported;
}

/** The declarations of a module that is imported by this address. */
function declared(url, source) {
  return new URL(source.replace(/\.(js|ts)$/, ".d.ts"), url);
}

function entriesOf(node, text, comments) {
  const { declaration } = node;
  const names = declaration.declarations?.map(({ id }) => id.name) ?? [declaration.id.name];
  const kind =
    declaration.type === "ClassDeclaration"
      ? "class"
      : /Function/.test(declaration.type)
        ? "function"
        : declaration.type === "VariableDeclaration"
          ? "const"
          : "type";
  const code = text
    .slice(node.start, node.end)
    .replace(/^export (declare )?/, "")
    // What nobody outside can reach.
    .replaceAll(/^\s*(#private;|private .*;)\n/gm, "");
  return names.map((name) => ({ name, kind, doc: commentBefore(node.start, text, comments), code }));
}

/** The comment that stands right before a declaration, without its stars. */
function commentBefore(start, text, comments) {
  const comment = comments.findLast(({ type, end }) => type === "Block" && end <= start);
  if (comment === undefined || !comment.value.startsWith("*") || text.slice(comment.end, start).trim() !== "")
    return "";
  return comment.value
    .replace(/^\*/, "")
    .replaceAll(/^\s*\* ?/gm, "")
    .trim();
}

/** Markdown of a comment: links as code, tags as lists. */
function markdownOf(doc) {
  return doc
    .replaceAll(/\{@link ([^}]+)\}/g, "`$1`")
    .replaceAll(/^@param (\S+) (?:- )?/gm, "- `$1`: ")
    .replaceAll(/^@(returns|throws|example)\b ?/gm, (_all, tag) => `- *${tag}* `)
    .replace(/^- /m, "\n- ");
}

mkdirSync(new URL("reference/", dist), { recursive: true });
const bare = [];
for (const entry of ENTRIES) {
  const all = [...exportsOf(new URL(`${entry}/index.d.ts`, dist)).values()];
  all.sort((a, b) => a.name.localeCompare(b.name, "en"));
  bare.push(...all.filter(({ doc }) => doc === "").map(({ name }) => `${entry}: ${name}`));
  const lines = [`# ${packageName}/${entry} ${version}`, ""];
  for (const [kind, title] of Object.entries(KINDS)) {
    const some = all.filter((one) => one.kind === kind);
    if (some.length === 0) continue;
    lines.push(`## ${title}`, "");
    for (const { name, doc, code } of some) {
      lines.push(`### ${name}`, "", markdownOf(doc), "", "```ts", code, "```", "");
    }
  }
  writeFileSync(new URL(`reference/${entry}.md`, dist), lines.join("\n"));
}
if (bare.length > 0) throw new Error(`exports without a comment, expected one each: ${bare.join(", ")}`);
