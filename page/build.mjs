// Bundle the page into programs/web/built: the same bytes from the same sources and lock file.
// `node build.mjs --check` writes nothing, and fails if the built files differ from what it would write.

import { build } from "esbuild";
import { mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "../programs/web/built");
const copied = ["index.html", "enter.html", "icon.svg"];
const kept = "troubleshooting.html";  // written by docs/reference.py

const bundled = await build({
  absWorkingDir: here,
  entryPoints: { page: "src/main.js", scene: "src/scene.js", "page.css": "src/styles.css" },
  entryNames: "[name]",
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  target: ["chrome105", "firefox110", "safari16"],
  external: ["./scene.js"],
  // Mesh loaders, since no mesh is served to this page.
  alias: Object.fromEntries(["STLLoader", "ColladaLoader"].map((name) => [
    `three/examples/jsm/loaders/${name}.js`, join(here, "src/no_meshes.js"),
  ])),
  legalComments: "eof",
  charset: "utf8",
  write: false,
  logLevel: "warning",
});

const files = new Map();
for (const file of bundled.outputFiles) {
  files.set(file.path.slice(out.length + 1).replace("page.css.css", "page.css"), Buffer.from(file.contents));
}
const libraries = ["three", "uplot", "urdf-loader"];
const licences = await Promise.all(libraries.map(async (name) => {
  const folder = join(here, "node_modules", name);
  const { version, license } = JSON.parse(await readFile(join(folder, "package.json"), "utf8"));
  const text = await readFile(join(folder, "LICENSE"), "utf8").catch(() => "");
  return `${name} ${version}, ${license}\n\n${text}`.trim();
}));
files.set("licences.txt", Buffer.from(`${licences.join("\n\n")}\n`));
for (const name of copied) files.set(name, await readFile(join(here, "src", name)));
files.set(kept, await readFile(join(out, kept)));

if (process.argv.includes("--check")) {
  const there = new Set(await readdir(out).catch(() => []));
  const wrong = [];
  for (const [name, bytes] of files) {
    const found = there.has(name) ? await readFile(join(out, name)) : null;
    if (found === null || !found.equals(bytes)) wrong.push(name);
  }
  for (const name of there) if (!files.has(name)) wrong.push(name);
  if (wrong.length) {
    console.error(`programs/web/built: not what page/ gives: ${wrong.join(", ")}; run make web`);
    process.exit(1);
  }
  console.log(`programs/web/built: ${files.size} files are what page/ gives`);
} else {
  await rm(out, { recursive: true, force: true });
  await mkdir(out, { recursive: true });
  for (const [name, bytes] of files) await writeFile(join(out, name), bytes);
  console.log(`programs/web/built: ${[...files.keys()].join(", ")}`);
}
