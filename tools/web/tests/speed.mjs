// How long a view takes in the page and in native code: printed, not asserted, since it depends on what else the machine does.
// TSUYA_SPEED_CAPTURE is the capture to encode, default the sample; TSUYA_SPEED_TARGET how fine, default "--quality 75".

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { launch, PAGE } from "./support/browser.mjs";
import { serve } from "./support/server.mjs";

const web = fileURLToPath(new URL("..", import.meta.url));
const root = join(web, "../..");
const program = process.env.TSUYA ?? join(root, "target/release/tsuya");
/** Most bytes of the module, compressed. */
const LARGEST = 300_000;

function run(command, args, options = {}) {
  const { status, stdout, stderr, error } = spawnSync(command, args, { encoding: "utf8", ...options });
  if (error || status !== 0) throw new Error(`${command} ${args.join(" ")}: ${error?.message ?? stderr}`);
  return stdout;
}

test("the module is small", () => {
  const size = gzipSync(readFileSync(join(web, "src/tsuya.wasm")), { level: 9 }).length;
  console.log(`# tsuya.wasm: ${size} bytes gzipped`);
  assert.ok(size <= LARGEST, `${size} bytes, at most ${LARGEST}`);
});

const capture = process.env.TSUYA_SPEED_CAPTURE ?? join(root, "tests/data/sample-spot");
const target = (process.env.TSUYA_SPEED_TARGET ?? "--quality 75").split(" ");

for (const decoding of ["0", "1", "2"]) {
  test(`time of a view, --faster-decoding ${decoding}`, async () => {
    const folder = mkdtempSync(join(tmpdir(), "tsuya-speed-"));
    const file = join(folder, "measured.tsuya");
    run(program, ["encode", capture, "-o", file, ...target, "--faster-decoding", decoding]);
    const bytes = readFileSync(file);
    const server = await serve(web, new Map([["/page.html", PAGE], ["/file.tsuya", bytes]]));
    const browser = await launch();
    try {
      const { page } = await browser.open(server.address);
      const { times, pixels } = await page.evaluate(async () => {
        const bytes = await (await fetch("/file.tsuya")).arrayBuffer();
        const times = [];
        let pixels = 0;
        // The first round warms up; references are decoded when a view's turn comes.
        for (let round = 0; round < 5; round++) {
          const file = await tsuya.openTsuya(bytes);
          await file.mesh();
          let k = 0;
          for await (const { milliseconds, width, height } of file.decodeViews({ format: "half", reuse: true })) {
            if (round > 0) times[k] = Math.min(times[k] ?? Infinity, milliseconds);
            pixels = width * height;
            k++;
          }
          file.close();
        }
        return { times, pixels };
      });
      const native = JSON.parse(
        run("cargo", ["run", "--profile", "web", "--quiet", "--manifest-path", join(web, "wasm/Cargo.toml"), "--example", "native", "--", file], {
          env: { ...process.env, CARGO_TARGET_DIR: join(process.env.CARGO_TARGET_DIR ?? join(root, "target"), "web") },
        }),
      );
      console.log(`# --faster-decoding ${decoding}: ${bytes.length} bytes, views of ${pixels} pixels`);
      const tell = (name, times) => {
        const sorted = [...times].sort((a, b) => a - b);
        const mean = times.reduce((a, b) => a + b) / times.length;
        const [median, most] = [sorted[sorted.length >> 1], sorted.at(-1)];
        console.log(`#   ${name}: mean ${mean.toFixed(1)} ms, median ${median.toFixed(1)}, longest ${most.toFixed(1)}`);
      };
      tell("in the page", times);
      tell("native, one thread", native);
      assert.equal(times.length, native.length);
    } finally {
      await browser.close();
      server.end();
      rmSync(folder, { recursive: true, force: true });
    }
  });
}
