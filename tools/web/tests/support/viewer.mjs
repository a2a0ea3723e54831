// What the viewer's tests share: the program, a browser, pictures and their errors.

import { spawn, spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";
import { FloatType } from "three";
import { EXRLoader } from "three/addons/loaders/EXRLoader.js";

const web = fileURLToPath(new URL("../..", import.meta.url));
export const root = join(web, "../..");
export const dist = join(web, "dist");
/** The program; the environment variable TSUYA names another one. */
const program = process.env.TSUYA ?? join(root, "target/release/tsuya");

export const folder = mkdtempSync(join(tmpdir(), "tsuya-viewer-"));
export const at = (name) => join(folder, name);

/** Runs the program. */
export function tsuya(...args) {
  const { status, stderr, error } = spawnSync(program, args, { encoding: "utf8" });
  if (error || status !== 0) throw new Error(`tsuya ${args.join(" ")}: ${error?.message ?? stderr}`);
}

/** Servers that still run, those of a test that failed too. */
const servers = new Set();

/** `tsuya view` of a file; `{address, end}`. */
export function view(file) {
  const server = spawn(program, ["view", file, "--no-open", "--assets", dist], { stdio: ["ignore", "pipe", "inherit"] });
  servers.add(server);
  return new Promise((resolve, reject) => {
    server.once("error", reject);
    server.once("exit", (code) => reject(new Error(`tsuya view ended with ${code}`)));
    server.stdout.once("data", (line) => resolve({ address: String(line).split(" ")[0].trim(), end: () => server.kill() }));
  });
}

let context = null;

/** A page at an address, and what it complains of; `args` are the browser's, of the first page. */
export async function openPage(address, viewport, args = []) {
  context ??= await chromium.launchPersistentContext(at("profile"), {
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    headless: true,
    viewport,
    args: [
      "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
      "--disable-sync", "--enable-unsafe-swiftshader", ...args,
    ],
  });
  const page = await context.newPage();
  await page.setViewportSize(viewport);
  page.setDefaultTimeout(180000);
  const complaints = [];
  page.on("pageerror", (error) => complaints.push(error.stack));
  page.on("console", (message) => {
    // Reading pixels back is slow, as the driver says; tests do.
    const text = message.text();
    if (["error", "warning"].includes(message.type()) && !/ReadPixels|status of 404/.test(text)) complaints.push(text);
  });
  // The pages say themselves when they are ready.
  await page.goto(address, { waitUntil: "commit" });
  return { page, complaints };
}

/** The viewer with its file open. */
export async function open(address, viewport = { width: 220, height: 180 }) {
  const { page, complaints } = await openPage(address, viewport);
  await page.waitForFunction(() => window.tsuyaViewer);
  const message = await page.evaluate(async () => {
    await window.tsuyaViewer.opened;
    return window.tsuyaViewer.state.model ? null : document.getElementById("message").innerText;
  });
  if (message !== null) throw new Error(message);
  return { page, complaints };
}

/** Ends the browser; the next page opens in a new one. */
export async function closeBrowser() {
  await context?.close();
  context = null;
}

export async function closeAll() {
  await closeBrowser();
  servers.forEach((server) => server.kill());
  rmSync(folder, { recursive: true, force: true });
}

/** Drops files onto a page: `[name, bytes]` of each. */
export async function drop(page, ...files) {
  await page.evaluate(
    (files) => {
      const dataTransfer = new DataTransfer();
      for (const [name, base64] of files) dataTransfer.items.add(new File([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))], name));
      document.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
    },
    files.map(([name, bytes]) => [name, bytes.toString("base64")]),
  );
}

export const messageOf = (page, pattern) =>
  page.waitForFunction(
    (pattern) => {
      const { hidden, innerText } = document.getElementById("message");
      return !hidden && new RegExp(pattern).test(innerText) && innerText;
    },
    pattern.source,
  );

/** Radiance in units of the white board as the page draws it from a captured view (or any camera). */
export async function drawn(page, view, { lighting = { capture: 0 }, layers = {}, ...options } = {}) {
  const values = await page.evaluate(
    async ({ view, lighting, layers, options }) => {
      const { state, stage } = window.tsuyaViewer;
      const { appearance } = state.model;
      const all = { diffuse: true, specular: true, model: true, residual: true };
      Object.assign(appearance, { lighting, layers: { ...all, ...layers }, signedResidual: false, exposure: 1, cubic: true, ...options });
      const camera = typeof view === "number" ? appearance.file.views[view].camera : view;
      const radiance = await stage.radiance(appearance, camera);
      return [camera.width, camera.height, ...radiance];
    },
    { view, lighting, layers, options },
  );
  const [width, height, ...pixels] = values;
  return { width, height, pixels };
}

/** The picture that `tsuya render` makes, in units of the white board. */
export function rendered(file, white, ...args) {
  const path = at(`picture-${Math.random()}.exr`);
  tsuya("render", file, "-o", path, ...args);
  const bytes = readFileSync(path);
  const { data, width, height } = new EXRLoader().setDataType(FloatType).parse(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
  const channels = data.length / width / height;
  const pixels = new Array(width * height * 4).fill(0);
  for (let k = 0; k < width * height; k++) {
    // The loader has the lowest row first.
    const from = channels * ((height - 1 - Math.floor(k / width)) * width + (k % width));
    for (let c = 0; c < 3; c++) pixels[4 * k + c] = data[from + c] / white[c];
  }
  return { width, height, pixels };
}

/** Image PSNR in dB of the square-root signal, over all pixels where one of the pictures shows something, or where both do. */
export function psnr(a, b, where = Math.max) {
  let sum = 0;
  let count = 0;
  for (let k = 0; k < a.pixels.length; k += 4) {
    const [p, q] = [a.pixels.slice(k, k + 3), b.pixels.slice(k, k + 3)];
    if (where(Math.max(...p), Math.max(...q)) <= 0) continue;
    p.forEach((x, c) => (sum += (Math.sqrt(Math.max(x, 0)) - Math.sqrt(Math.max(q[c], 0))) ** 2));
    count += 3;
  }
  if (!count) throw new Error("nothing to compare: both pictures are black");
  return -10 * Math.log10(sum / count);
}

/** A GLB's JSON changed by `edit`, which gets the binary chunk, too. */
export function editGlb(bytes, edit) {
  const length = bytes.readUInt32LE(12);
  const json = JSON.parse(bytes.subarray(20, 20 + length).toString());
  const binary = Buffer.from(bytes.subarray(20 + length + 8));
  edit(json, binary);
  let text = Buffer.from(JSON.stringify(json));
  text = Buffer.concat([text, Buffer.alloc((4 - (text.length % 4)) % 4, " ")]);
  const head = Buffer.alloc(20);
  head.write("glTF");
  [2, 28 + text.length + binary.length, text.length, 0x4e4f534a].forEach((x, k) => head.writeUInt32LE(x, 4 + 4 * k));
  const chunk = Buffer.alloc(8);
  chunk.writeUInt32LE(binary.length, 0);
  chunk.writeUInt32LE(0x004e4942, 4);
  return Buffer.concat([head, text, chunk, binary]);
}
