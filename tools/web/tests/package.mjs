// The package as it is packed: in Node, as plain modules, and in pages that Vite, esbuild and webpack make of it.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { cpSync, mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import * as esbuild from "esbuild";
import * as vite from "vite";
import webpack from "webpack";
import { launch, PAGE } from "./support/browser.mjs";
import { serve } from "./support/server.mjs";

const web = fileURLToPath(new URL("..", import.meta.url));
const sample = join(web, "../../spec/vectors/ring-small.tsuya");
const folder = mkdtempSync(join(tmpdir(), "tsuya-package-"));
const app = join(folder, "app");
const installed = join(app, "node_modules/tsuya");

/** What every environment does: decodes a view, and tells of it. */
const SOURCE = `
import { openTsuya } from "tsuya";
const digest = async (array) => {
  const sum = await crypto.subtle.digest("SHA-256", array.slice());
  return [...new Uint8Array(sum)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
};
export async function decoded(source) {
  const file = await openTsuya(source);
  const view = await file.view(1);
  const sums = await Promise.all(Object.values(view.images).map(digest));
  file.close();
  return [file.views[1].name, ...sums].join(" ");
}
`;
const MAIN = `
import { decoded } from "./decoded.js";
import { TsuyaAppearance } from "tsuya/three";
window.plugin = typeof TsuyaAppearance;
decoded("ring-small.tsuya").then((found) => { window.found = found; }, (error) => { window.found = String(error.stack); });
`;

function run(command, args, cwd) {
  const { status, stdout, stderr, error } = spawnSync(command, args, { cwd, encoding: "utf8" });
  assert.ok(!error && status === 0, `${command} ${args.join(" ")}: ${error?.message ?? stderr}`);
  return stdout.trim();
}

let browser, expected;

before(async () => {
  const archive = run("npm", ["pack", "--silent", "--pack-destination", folder], web);
  mkdirSync(join(installed, ".."), { recursive: true });
  run("tar", ["-xzf", join(folder, archive.split("\n").at(-1)), "-C", folder], folder);
  cpSync(join(folder, "package"), installed, { recursive: true });
  symlinkSync(join(web, "node_modules/three"), join(app, "node_modules/three"));
  writeFileSync(join(app, "package.json"), JSON.stringify({ name: "app", private: true, type: "module" }));
  writeFileSync(join(app, "decoded.js"), SOURCE);
  writeFileSync(join(app, "main.js"), MAIN);
  writeFileSync(join(app, "index.html"), `<!doctype html><link rel="icon" href="data:,"><script type="module" src="./main.js"></script>`);
  // Loaded by its place, as the decoder's own tests do, in this process.
  writeFileSync(join(app, "node.mjs"), `
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import { decoded } from "./decoded.js";
const path = process.argv[2];
const found = [await decoded(pathToFileURL(path)), await decoded(readFileSync(path)), await decoded(new Blob([readFileSync(path)]))];
const wrong = await decoded(path).catch((error) => error.message);
const missing = await decoded(new URL("file:///none.tsuya")).catch((error) => [error.name, error.kind]);
console.log(JSON.stringify({ found, wrong, missing }));
`);
  browser = await launch();
});

after(async () => {
  await browser?.close();
  rmSync(folder, { recursive: true, force: true });
});

/** What the page of a folder finds. */
async function inBrowser(site) {
  cpSync(sample, join(site, "ring-small.tsuya"));
  const server = await serve(site, new Map([["/page.html", PAGE]]));
  try {
    const { page, complaints } = await browser.open(server.address, "/index.html", "found");
    const found = await page.evaluate(() => ({ found: window.found, plugin: window.plugin }));
    await page.close();
    assert.deepEqual(complaints, []);
    assert.equal(found.plugin, "function");
    return found.found;
  } finally {
    server.end();
  }
}

test("the archive is whole, and without the module there is none", () => {
  const names = readdirSync(installed);
  for (const name of ["README.md", "LICENSE-MIT", "LICENSE-APACHE", "package.json", "src", "three"]) assert.ok(names.includes(name), name);
  assert.ok(readFileSync(join(installed, "src/tsuya.wasm")).subarray(0, 4).equals(Buffer.from("\0asm")));
  const bare = join(folder, "bare");
  mkdirSync(join(bare, "src"), { recursive: true });
  cpSync(join(web, "prepack"), join(bare, "prepack"));
  const { status, stderr } = spawnSync(join(bare, "prepack"), { encoding: "utf8" });
  assert.equal(status, 1);
  assert.match(stderr, /tools\/web\/build/);
});

test("Node", () => {
  const { found, wrong, missing } = JSON.parse(run(process.execPath, ["node.mjs", sample], app));
  expected = found[0];
  assert.match(expected, /^\S+( [0-9a-f]{64}){2}$/);
  assert.deepEqual(found, [expected, expected, expected]);
  assert.match(wrong, /pathToFileURL/);
  assert.deepEqual(missing, ["TsuyaError", "io"]);
});

test("plain modules, by an import map", async () => {
  const site = join(folder, "plain");
  cpSync(app, site, { recursive: true, dereference: true });
  const imports = { tsuya: "./node_modules/tsuya/src/tsuya.js", "tsuya/three": "./node_modules/tsuya/three/index.js", three: "./node_modules/three/build/three.module.js", "three/addons/": "./node_modules/three/examples/jsm/" };
  const page = readFileSync(join(site, "index.html"), "utf8");
  writeFileSync(join(site, "index.html"), page.replace("<script", `<script type="importmap">${JSON.stringify({ imports })}</script><script`));
  assert.equal(await inBrowser(site), expected);
});

test("Vite", async () => {
  const site = join(folder, "vite");
  await vite.build({ root: app, base: "./", logLevel: "error", build: { outDir: site } });
  assert.equal(await inBrowser(site), expected);
});

test("esbuild, the worker as an entry of its own", async () => {
  const site = join(folder, "esbuild");
  await esbuild.build({
    entryPoints: { main: join(app, "main.js"), worker: join(installed, "src/worker.js") },
    bundle: true, format: "esm", outdir: site, logLevel: "error",
  });
  cpSync(join(installed, "src/tsuya.wasm"), join(site, "tsuya.wasm"));
  cpSync(join(app, "index.html"), join(site, "index.html"));
  assert.equal(await inBrowser(site), expected);
});

test("webpack", async () => {
  const site = join(folder, "webpack");
  const stats = await new Promise((resolve, reject) => {
    webpack({ mode: "production", context: app, entry: "./main.js", output: { path: site } }, (error, stats) => error ? reject(error) : resolve(stats));
  });
  assert.ok(!stats.hasErrors(), stats.toString());
  writeFileSync(join(site, "index.html"), `<!doctype html><link rel="icon" href="data:,"><script src="main.js"></script>`);
  assert.equal(await inBrowser(site), expected);
});
