// Bundles the player into one script, one style sheet and the licences of what the script contains.
import { build } from "esbuild";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const HERE = dirname(fileURLToPath(import.meta.url));
const OUT = join(HERE, "..", "src", "skillplan", "views", "report", "player");
// A page holds the bundle inside an element, which these would end.
const ENDS_AN_ELEMENT = /<\/script|<\/style|<!--/i;

/** Returns the packages under node_modules that ended up in the bundle. */
function bundledPackages(metafile) {
  const names = new Set();
  for (const path of Object.keys(metafile.inputs)) {
    const found = /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path);
    if (found) names.add(found[1]);
  }
  return [...names].sort();
}

/** Returns name, version and licence text of each package. */
async function licences(names) {
  const parts = [];
  for (const name of names) {
    const folder = join(HERE, "node_modules", name);
    const { version } = JSON.parse(await readFile(join(folder, "package.json"), "utf-8"));
    const text = await readFile(join(folder, "LICENSE"), "utf-8");
    parts.push(`${name} ${version}\n\n${text.trim()}\n`);
  }
  return `player.js contains code of these packages.\n\n${parts.join("\n")}`;
}

const result = await build({
  absWorkingDir: HERE,
  entryPoints: { player: "src/main.ts", "player-style": "src/player.css" },
  bundle: true,
  format: "iife",
  target: "es2022",
  minify: true,
  legalComments: "none",
  metafile: true,
  outdir: OUT,
  write: false,
});
const written = Object.fromEntries(
  result.outputFiles.map((file) => [file.path.endsWith(".css") ? "player.css" : "player.js", file]),
);
for (const [name, file] of Object.entries(written)) {
  if (ENDS_AN_ELEMENT.test(file.text)) throw new Error(`${name} would end the page's element`);
}
await mkdir(OUT, { recursive: true });
await writeFile(join(OUT, "player.css"), written["player.css"].text);
await writeFile(join(OUT, "LICENCES.txt"), await licences(bundledPackages(result.metafile)));
// The script last: where it is, all is there.
await writeFile(join(OUT, "player.js"), written["player.js"].text);
console.log(`player.js: ${Math.round(written["player.js"].contents.length / 1000)} kB`);
