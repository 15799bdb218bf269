// Builds the operator's page: `node build.mjs` writes built/, `node build.mjs --check` compares with what stands there.
import { build } from "esbuild";
import { threeReduction } from "./three-reduction.mjs";
import { mkdirSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const target = join(here, "built");

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
const outputs = [...page.outputFiles, ...worker.outputFiles];
const files = new Map(outputs.map((file) => [file.path.slice(target.length + 1), file.contents]));
const styles = await build({
  entryPoints: [join(here, "sources/page.css")],
  bundle: true,
  minify: true,
  outdir: target,
  write: false,
});
for (const file of styles.outputFiles) files.set(file.path.slice(target.length + 1), file.contents);
for (const name of ["index.html", "icon.svg"]) files.set(name, readFileSync(join(here, "sources", name)));
files.set("licences.txt", Buffer.from(licences()));

/** The licence texts of the bundled libraries. */
function licences() {
  return ["lit", "lit-element", "lit-html", "@lit/reactive-element", "three", "uplot"]
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

if (process.argv.includes("--check")) {
  const stale = [...files].filter(([name, content]) => !isSame(join(target, name), content)).map(([name]) => name);
  const extra = readdirSync(target).filter((name) => !files.has(name));
  if (stale.length || extra.length) {
    console.error(`api/page/built is not what the sources give: ${[...stale, ...extra].join(", ")}. Run: make page`);
    process.exit(1);
  }
  console.log("api/page/built is what the sources give");
} else {
  mkdirSync(target, { recursive: true });
  for (const [name, content] of files) writeFileSync(join(target, name), content);
  for (const [name, content] of files) console.log(`${name.padEnd(20)} ${content.length.toLocaleString("en")} bytes`);
}

function isSame(path, content) {
  try {
    return readFileSync(path).equals(Buffer.from(content));
  } catch {
    return false;
  }
}
