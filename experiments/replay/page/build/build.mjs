/**
 * Makes ../bundle from ../source and three.js; `make replay-page` runs it. Only those who change
 * the page's scripts need node: what it makes is committed.
 *
 * Every bundle begins with a digest of what it was made from, which a test compares.
 */

import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const page = dirname(here);
const libraries = join(here, "node_modules");

/** SHA-256 over names and contents of all sources, in the order of their names. */
function digestOfSources() {
  const names = readdirSync(join(page, "source"), { recursive: true })
    .map((name) => `source/${name.replaceAll("\\", "/")}`)
    .filter((name) => name.endsWith(".js"));
  const digest = createHash("sha256");
  for (const name of [...names, "build/build.mjs", "build/package.json"].sort()) {
    const content = readFileSync(join(page, name), "utf8").replaceAll("\r\n", "\n");
    digest.update(`${name}\n${content}\n`);
  }
  return digest.digest("hex");
}

const common = {
  bundle: true,
  minify: true,
  format: "iife",
  target: ["chrome100", "firefox113", "safari16.4"],
  charset: "ascii",
  legalComments: "inline",
  nodePaths: [libraries],
  banner: { js: `/* sources: sha256 ${digestOfSources()} */` },
};

await build({ ...common, entryPoints: [join(page, "source/main.js")], outfile: join(page, "bundle/page.js") });
await build({
  ...common,
  entryPoints: [join(page, "source/scene/index.js")],
  globalName: "orchidScene",
  outfile: join(page, "bundle/scene.js"),
});
const { version } = JSON.parse(readFileSync(join(libraries, "three/package.json"), "utf8"));
const licence = readFileSync(join(libraries, "three/LICENSE"), "utf8");
writeFileSync(join(page, "bundle/THIRD_PARTY_LICENSES.txt"), `three.js ${version}\n\n${licence.trim()}\n`);
