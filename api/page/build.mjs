// Builds the pages of operator and archive into built/ and built-archive/: `node build.mjs`; with `--check` compares with
// what stands there.
import { build } from "esbuild";
import { threeReduction } from "./three-reduction.mjs";
import { mkdirSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { basename, dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const target = join(here, "built");
const archiveTarget = join(here, "built-archive");

/** Takes the indentation off the sources, most of which stands in templates, where a line break alone says the same. */
const unindented = {
  name: "unindented",
  setup(build) {
    build.onLoad({ filter: /\/sources\/.*\.ts$/ }, ({ path }) => ({
      contents: readFileSync(path, "utf8").replace(/\n[ \t]+/g, "\n"),
      loader: "ts",
    }));
  },
};

const usual = {
  bundle: true,
  minify: true,
  target: ["es2022"],
  legalComments: "none",
  charset: "utf8",
  outdir: target,
  write: false,
  banner: { js: "/* Licences of what is bundled (lit BSD-3-Clause; three, uPlot MIT): /page/licences.txt */" },
};
// The cell's view is a file of its own, read when it is first shown: STOP shall not wait for three.js.
const page = await build({
  ...usual,
  entryPoints: { page: join(here, "sources/main.ts"), "cell-view": join(here, "sources/drawing/cell-view.ts") },
  format: "esm",
  splitting: true,
  chunkNames: "shared",
  plugins: [threeReduction, unindented],
});
const worker = await build({
  ...usual,
  entryPoints: { "event-worker": join(here, "sources/connection/event-worker.ts") },
  format: "iife",
  plugins: [unindented],
});
// The archive's page is a bundle of its own: it is read without a cell, and STOP shall not wait for it.
const archive = await build({
  ...usual,
  entryPoints: { archive: join(here, "sources/archive/archive-page.ts") },
  format: "esm",
  outdir: archiveTarget,
  plugins: [unindented],
});
const bundles = new Map([
  [target, await bundle([page, worker], "page.css", "index.html", ["lit", "three", "uplot"])],
  [archiveTarget, await bundle([archive], "archive.css", "archive.html", ["lit", "uplot"])],
]);

/** The files of a bundle by name: scripts, style sheet, page, icon, licences. */
async function bundle(built, sheet, index, libraries) {
  const styles = await build({
    entryPoints: [join(here, "sources", sheet)],
    bundle: true,
    minify: true,
    outdir: target,
    write: false,
  });
  const files = new Map();
  for (const { path, contents } of [...built, styles].flatMap((one) => one.outputFiles))
    files.set(basename(path), contents);
  files.set("index.html", readFileSync(join(here, "sources", index)));
  files.set("icon.svg", readFileSync(join(here, "sources", "icon.svg")));
  files.set("licences.txt", Buffer.from(licences(libraries)));
  return files;
}

/** The licence texts of the bundled libraries. */
function licences(libraries) {
  return libraries
    .flatMap((name) => (name === "lit" ? ["lit", "lit-element", "lit-html", "@lit/reactive-element"] : [name]))
    .map((name) => {
      const folder = join(here, "node_modules", name);
      const text = readFileSync(
        join(
          folder,
          readdirSync(folder).find((file) => /^licen[sc]e/i.test(file)),
        ),
        "utf8",
      );
      return `${name}\n${"-".repeat(name.length)}\n\n${text.trim()}\n`;
    })
    .join("\n\n");
}

const stale = [];
for (const [folder, files] of bundles) {
  if (process.argv.includes("--check")) {
    const known = readdirSync(folder);
    stale.push(...[...files].filter(([name, content]) => !isSame(join(folder, name), content)).map(([name]) => name));
    stale.push(...known.filter((name) => !files.has(name)));
    continue;
  }
  mkdirSync(folder, { recursive: true });
  for (const [name, content] of files) {
    writeFileSync(join(folder, name), content);
    console.log(`${basename(folder).padEnd(14)} ${name.padEnd(20)} ${content.length.toLocaleString("en")} bytes`);
  }
}
if (stale.length) {
  console.error(`what stands in api/page is not what the sources give: ${stale.join(", ")}. Run: make page`);
  process.exit(1);
}
if (process.argv.includes("--check")) console.log("both bundles are what the sources give");

function isSame(path, content) {
  try {
    return readFileSync(path).equals(Buffer.from(content));
  } catch {
    return false;
  }
}
