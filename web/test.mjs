// Bundles the tests under test/ and runs them; where they are bundled is gone afterwards.
import { build } from "esbuild";
import { spawnSync } from "node:child_process";
import { mkdtemp, readdir, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";

const HERE = fileURLToPath(new URL(".", import.meta.url));
const scratch = await mkdtemp(join(tmpdir(), "player-tests-"));
try {
  const names = await readdir(join(HERE, "test"));
  await build({
    absWorkingDir: HERE,
    entryPoints: names.map((name) => join("test", name)),
    bundle: true,
    format: "esm",
    platform: "node",
    outdir: scratch,
    outExtension: { ".js": ".mjs" },
  });
  const found = (await readdir(scratch)).map((name) => join(scratch, name));
  const done = spawnSync(process.execPath, ["--test", "--test-reporter=dot", ...found], {
    stdio: "inherit",
  });
  process.exitCode = done.status ?? 1;
} finally {
  await rm(scratch, { recursive: true });
}
