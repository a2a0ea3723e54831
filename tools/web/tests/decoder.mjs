// The decoder in a real browser: its pictures against the program's, what it fetches, what it says of files that are wrong.

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { FloatType } from "three";
import { EXRLoader } from "three/addons/loaders/EXRLoader.js";
import { launch, PAGE } from "./support/browser.mjs";
import { serve } from "./support/server.mjs";

const web = fileURLToPath(new URL("..", import.meta.url));
const root = join(web, "../..");
/** The program; the environment variable TSUYA names another one. */
const program = process.env.TSUYA ?? join(root, "target/release/tsuya");
const folder = mkdtempSync(join(tmpdir(), "tsuya-decoder-"));

function tsuya(...args) {
  const { status, stdout, stderr, error } = spawnSync(program, args, { encoding: "utf8", maxBuffer: 1 << 28 });
  if (error || status !== 0) throw new Error(`tsuya ${args.join(" ")}: ${error?.message ?? stderr}`);
  return stdout;
}

let browser, server, page, complaints, info, bytes;
const files = new Map([["/page.html", PAGE]]);

before(async () => {
  const file = join(folder, "spot.tsuya");
  tsuya("encode", join(root, "tests/data/sample-spot"), "-o", file, "--refine", "none");
  tsuya("decode", file, "-o", join(folder, "decoded"));
  info = JSON.parse(tsuya("info", file, "--json"));
  bytes = readFileSync(file);
  files.set("/spot.tsuya", bytes);
  files.set("/around.bin", Buffer.concat([Buffer.alloc(1000), bytes, Buffer.alloc(500)]));
  server = await serve(web, files);
  browser = await launch();
  ({ page, complaints } = await browser.open(server.address));
  // What the tests below call in the page.
  await page.evaluate(() => {
    window.sha = async (array) => {
      const sum = await crypto.subtle.digest("SHA-256", array);
      return [...new Uint8Array(sum)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
    };
    // Without the fourth channel.
    window.colours = (pixels) => {
      const out = new Float32Array((pixels.length / 4) * 3);
      for (let k = 0; k < pixels.length / 4; k++) for (let c = 0; c < 3; c++) out[3 * k + c] = pixels[4 * k + c];
      return out;
    };
    window.failure = async (work) => {
      try {
        await work();
        return null;
      } catch ({ name, message, kind, section, offset }) {
        return { name, message, kind, section, offset };
      }
    };
  });
});

after(async () => {
  await browser?.close();
  server?.end();
  rmSync(folder, { recursive: true, force: true });
});

/** Red, green and blue of a picture that the program wrote, from the top left. */
function picture(path, decoded = "decoded") {
  const file = readFileSync(join(folder, decoded, path));
  const { data, width, height } = new EXRLoader().setDataType(FloatType).parse(new Uint8Array(file).buffer);
  const channels = data.length / width / height;
  const colours = new Float32Array(width * height * 3);
  for (let k = 0; k < width * height; k++) {
    // The loader has the lowest row first.
    const from = channels * ((height - 1 - Math.floor(k / width)) * width + (k % width));
    for (let c = 0; c < 3; c++) colours[3 * k + c] = data[from + c];
  }
  return { colours, width, height };
}

const sum = (array) => createHash("sha256").update(new Uint8Array(array.buffer)).digest("hex");

test("facts, views and mesh are those that the program tells of", async () => {
  const found = await page.evaluate(async () => {
    const file = await tsuya.openTsuya("/spot.tsuya");
    const { facts, views, order } = file;
    const mesh = await file.mesh();
    const unit = mesh.normals.reduce((most, _, k, n) => (k % 3 ? most : Math.max(most, Math.abs(Math.hypot(n[k], n[k + 1], n[k + 2]) - 1))), 0);
    const counts = { triangles: mesh.indices.length / 3, vertices: mesh.sourceVertexCount, cut: mesh.positions.length / 3 };
    const largest = mesh.indices.reduce((a, b) => Math.max(a, b), 0);
    const absent = [await file.visibility(), await file.light(), await file.materials()];
    file.close();
    return { facts, views, order, counts, unit, largest, absent, uvs: [...mesh.uvs.slice(0, 600)] };
  });
  assert.equal(found.facts.version, info.version);
  assert.equal(found.facts.profile, "predictive");
  assert.deepEqual(found.facts.statedError, info.achieved_error);
  assert.deepEqual(found.facts.metadata, info.metadata);
  assert.deepEqual(found.facts.components, info.components);
  assert.deepEqual(found.facts.white, info.white);
  assert.equal(found.facts.sectionsComplete, true);
  assert.deepEqual(found.facts.sections.map((s) => [s.tag, s.offset]), info.sections.map((s) => [s.tag, s.offset]));
  assert.deepEqual(
    found.views.map(({ name, camera, light }) => ({ name, width: camera.width, height: camera.height, light })),
    info.views,
  );
  assert.equal(found.order.length, info.views.length);
  assert.deepEqual(found.order[0].needs, []);
  assert.equal(found.counts.triangles, info.mesh.triangles);
  assert.equal(found.counts.vertices, info.mesh.vertices);
  assert.ok(found.counts.cut >= found.counts.vertices && found.largest === found.counts.cut - 1);
  assert.ok(found.unit < 1e-5, `normals are off unit length by ${found.unit}`);
  assert.ok(found.uvs.every((x) => x >= 0 && x <= 1) && new Set(found.uvs).size > 100);
  assert.deepEqual(found.absent, [null, null, []]);
});

test("every view and every map is the program's, bit for bit", async () => {
  const sums = await page.evaluate(async () => {
    const file = await tsuya.openTsuya("/spot.tsuya");
    const sums = {};
    for await (const { index, width, height, mask, images } of file.decodeViews()) {
      const alpha = images.diffuse.every((value, k) => k % 4 !== 3 || value === mask[(k - 3) / 4]);
      sums[file.views[index].name] = [width, height, alpha, await sha(colours(images.diffuse)), await sha(colours(images.specular))];
    }
    const { diffuse, specular } = await file.reflectance();
    // Texels between the charts are filled for the renderer's filters.
    const cut = (map) => colours(map).map((value, k) => (diffuse[4 * Math.floor(k / 3) + 3] === 1 ? value : 0));
    const maps = [await sha(cut(diffuse)), await sha(cut(specular))];
    file.close();
    const used = Array.from({ length: diffuse.length / 4 }, (_, k) => diffuse[4 * k + 3]).join("");
    return { sums, maps, used };
  });
  assert.equal(Object.keys(sums.sums).length, 36);
  const differing = [];
  for (const [name, [width, height, alpha, ...found]] of Object.entries(sums.sums)) {
    const stem = name.replace(/\.\w+$/, "");
    const [diffuse, specular] = ["diffuse", "specular"].map((kind) => picture(`${kind}/${stem}.exr`));
    assert.deepEqual([width, height, alpha], [diffuse.width, diffuse.height, true]);
    if (found[0] !== sum(diffuse.colours) || found[1] !== sum(specular.colours)) differing.push(name);
  }
  assert.deepEqual(differing, []);
  const map = (kind) => sum(picture(`maps/${kind}.exr`).colours.map((value, k) => (sums.used[Math.floor(k / 3)] === "1" ? value : 0)));
  assert.deepEqual(sums.maps, [map("diffuse"), map("specular")]);
});

test("a finer surface and its lobes are the program's, bit for bit", async () => {
  const path = join(folder, "finer.tsuya");
  tsuya("encode", join(root, "tests/data/sample-spot"), "-o", path);
  tsuya("decode", path, "-o", join(folder, "finer"));
  files.set("/finer.tsuya", readFileSync(path));
  const found = await page.evaluate(async () => {
    const file = await tsuya.openTsuya("/finer.tsuya");
    const [mesh, surface, { diffuse, lobes }] = await Promise.all([file.mesh(), file.surface(), file.reflectance()]);
    file.close();
    const plain = await tsuya.openTsuya("/spot.tsuya?ranges=no&rate=20000");
    const absent = [await plain.surface(), plain.progress.received / plain.progress.total, (await plain.reflectance()).lobes];
    plain.close();
    const { positions, normals, uvs, indices, between } = surface;
    const corners = new Float32Array(3 * indices.length);
    indices.forEach((vertex, k) => corners.set(positions.subarray(3 * vertex, 3 * vertex + 3), 3 * k));
    const unit = normals.reduce((most, _, k, n) => (k % 3 ? most : Math.max(most, Math.abs(Math.hypot(n[k], n[k + 1], n[k + 2]) - 1))), 0);
    const whole = between.weights.reduce((most, _, k, w) => (k % 3 ? most : Math.max(most, Math.abs(w[k] + w[k + 1] + w[k + 2] - 1))), 0);
    const own = (weights) => weights.map((value, k) => (diffuse[4 * Math.floor(k / 3) + 3] === 1 ? value : 0));
    return {
      absent, unit, whole,
      corners: await sha(corners),
      counts: [mesh.indices.length / 3, indices.length / 3, positions.length / 3, uvs.length / 2, between.vertices.length / 3],
      within: between.vertices.every((vertex) => vertex < mesh.sourceVertexCount) && uvs.every((x) => x >= 0 && x <= 1),
      roughness: lobes.map(({ roughness }) => roughness),
      lobes: await Promise.all(lobes.map(({ weights }) => sha(own(weights)))),
      used: Array.from({ length: diffuse.length / 4 }, (_, k) => diffuse[4 * k + 3]).join(""),
    };
  });
  assert.deepEqual(found.absent, [null, found.absent[1], []]);
  assert.ok(found.absent[1] < 0.6, `${found.absent[1]} of a file was read to know that it has no finer surface`);
  assert.ok(found.unit < 1e-5 && found.whole < 1e-5 && found.within);
  const [triangles, finer, vertices, ...others] = found.counts;
  assert.ok([4, 16, 64, 256, 1024, 4096].includes(finer / triangles), `${finer} triangles of ${triangles}`);
  assert.deepEqual(others, [vertices, vertices]);
  assert.equal(found.corners, sum(cornersOfPly(readFileSync(join(folder, "finer/surface.ply")))));
  assert.deepEqual(found.roughness, [0.05, 0.09, 0.16, 0.28, 0.5]);
  const cut = (lobe) => picture(`maps/lobe-${lobe}.exr`, "finer").colours.map((value, k) => (found.used[Math.floor(k / 3)] === "1" ? value : 0));
  assert.deepEqual(found.lobes, [0, 1, 2, 3, 4].map((lobe) => sum(cut(lobe))));
});

/** Positions of all triangles' corners, of a PLY file as the program writes them. */
function cornersOfPly(file) {
  const end = file.indexOf("end_header\n") + 11;
  const head = file.subarray(0, end).toString();
  assert.match(head, /format binary_little_endian[^]*property float x\nproperty float y\nproperty float z\nelement face \d+\nproperty list uchar u?int/);
  const [vertices, faces] = ["vertex", "face"].map((kind) => Number(head.match(new RegExp(`element ${kind} (\\d+)`))[1]));
  const corners = new Float32Array(9 * faces);
  for (let k = 0; k < 3 * faces; k++) {
    const vertex = file.readUInt32LE(end + 12 * vertices + 13 * Math.floor(k / 3) + 1 + 4 * (k % 3));
    for (let i = 0; i < 3; i++) corners[3 * k + i] = file.readFloatLE(end + 12 * vertex + 4 * i);
  }
  return corners;
}

test("captures of every kind, in every profile and mode, in any order, bit for bit", async () => {
  const modes = ["0", "1", "2"].map((level) => ["--faster-decoding", level]);
  modes.push(["--profile", "wavelet-texture"]);
  for (const capture of ["dome", "unpolarised", "lens", "sizes"]) {
    for (const [number, mode] of modes.entries()) {
      const name = `${capture}-${number}`;
      const path = join(folder, `${name}.tsuya`);
      tsuya("encode", join(root, "tests/data", capture), "-o", path, ...mode);
      tsuya("decode", path, "-o", join(folder, name));
      files.set(`/${name}.tsuya`, readFileSync(path));
      const found = await page.evaluate(async (url) => {
        const file = await tsuya.openTsuya(url);
        const sums = [];
        const count = file.views.length;
        // Some permutation of the views: 7 divides none of the captures' counts.
        for (let k = 0; k < count; k++) {
          const index = (7 * k + 3) % count;
          const { images } = await file.view(index);
          for (const [kind, pixels] of Object.entries(images)) sums.push([file.views[index].name, kind, await sha(colours(pixels))]);
        }
        file.close();
        return sums;
      }, `/${name}.tsuya`);
      assert.ok(found.length >= 10 || capture === "lens");
      const differing = found.filter(([view, kind, value]) => {
        const stem = view.replace(/\.\w+$/, "");
        return value !== sum(picture(kind === "combined" ? `${stem}.exr` : `${kind}/${stem}.exr`, name).colours);
      });
      assert.deepEqual(differing, [], name);
    }
  }
});

test("half floats, single components, one view again, and all ways to hand a file over", async () => {
  const found = await page.evaluate(async () => {
    const whole = await (await fetch("/spot.tsuya")).arrayBuffer();
    const around = new Blob([new Uint8Array(1000), whole, new Uint8Array(500)]);
    const range = { offset: 1000, length: whole.byteLength };
    const ways = [
      [whole, {}],
      [new Uint8Array(whole), { worker: false }],
      [new Blob([whole]), {}],
      [around, { range }],
      [new URL("/spot.tsuya", location.href), { worker: false }],
      ["/spot.tsuya?ranges=no", {}],
      ["/spot.tsuya?ranges=no&unknown", {}],
      ["/around.bin", { range }],
      ["/around.bin?ranges=no", { range }],
    ];
    const sums = [];
    for (const [source, options] of ways) {
      const file = await tsuya.openTsuya(source, options);
      sums.push(await sha((await file.view(7)).images.diffuse));
      await file.verify();
      file.close();
    }
    // Nothing is read twice.
    const blob = await tsuya.openTsuya(new Blob([whole]));
    for await (const view of blob.decodeViews({ components: [] })) void view;
    const { received } = blob.progress;
    blob.close();
    const file = await tsuya.openTsuya(whole);
    const [exact, half, again] = await Promise.all([
      file.view(5),
      file.view(5, { format: "half", components: ["diffuse"] }),
      file.view(5, { components: ["specular"] }),
    ]);
    const value = (h) => (h >> 15 ? -1 : 1) * ((h >> 10) & 31 ? 2 ** (((h >> 10) & 31) - 25) * (1024 + (h & 1023)) : 2 ** -24 * (h & 1023));
    let error = 0;
    half.images.diffuse.forEach((h, k) => {
      const right = exact.images.diffuse[k];
      error = Math.max(error, Math.abs(value(h) - right) / Math.max(Math.abs(right), 6.2e-5));
    });
    const same = (await sha(exact.images.specular)) === (await sha(again.images.specular));
    // The views are the same where arrays are used again, and only then empty.
    const listed = async (options) => {
      const views = [];
      const sums = [];
      for await (const view of file.decodeViews({ format: "half", ...options })) {
        sums.push(await sha(view.images.diffuse), await sha(view.images.specular), await sha(view.mask));
        views.push(view);
      }
      return { sums: sums.join(), empty: views.filter((view) => view.images.diffuse.length + view.mask.length === 0).length };
    };
    const [kept, reused] = [await listed({}), await listed({ reuse: true })];
    const into = await file.view(5, { reuse: exact });
    const reuse = {
      same: kept.sums === reused.sums && (await sha(into.images.specular)) === (await sha(again.images.specular)),
      empty: [kept.empty, reused.empty, exact.mask.length],
      views: file.views.length,
    };
    file.close();
    return { reuse, sums, received, length: whole.byteLength, error, same, kinds: [Object.keys(half.images), Object.keys(again.images)] };
  });
  assert.equal(new Set(found.sums).size, 1);
  assert.ok(found.received <= found.length, `${found.received} bytes read of ${found.length}`);
  assert.ok(found.error < 2 ** -11 + 1e-9, `half floats are off by ${found.error}`);
  assert.ok(found.same);
  assert.ok(found.reuse.same);
  assert.deepEqual(found.reuse.empty, [0, found.reuse.views - 1, 0]);
  assert.deepEqual(found.kinds, [["diffuse"], ["specular"]]);
});

test("only what is needed is fetched", async () => {
  server.asked.length = 0;
  const { total, needed } = await page.evaluate(async () => {
    const file = await tsuya.openTsuya("/spot.tsuya");
    const wanted = new Set([file.order.at(-1).view]);
    await file.view(file.order.at(-1).view);
    let needed = 0;
    for (const { view, needs, bytes } of [...file.order].reverse()) {
      if (!wanted.has(view)) continue;
      needed += bytes;
      needs.forEach((other) => wanted.add(other));
    }
    const { total, received } = file.progress;
    file.close();
    return { total, received, needed };
  });
  const sent = server.asked.filter(({ path }) => path === "/spot.tsuya");
  const length = sent.reduce((sum, { start, end }) => sum + end - start, 0);
  console.log(`# one view of ${total} bytes: ${sent.length} requests, ${length} bytes; the view and what it is predicted from have ${needed}`);
  assert.equal(total, bytes.length);
  // The first request is for 32 KiB; beyond it what views need, gaps of at most 1 KiB between them, and directory and trailer.
  assert.ok(length < 32768 + needed + 1024 * sent.length && length < 0.8 * total, `${length} bytes of ${total} were sent`);
});

test("the first view is there before half of a slow file is", async () => {
  for (const query of ["rate=20000", "rate=20000&ranges=no"]) {
    const shares = await page.evaluate(async (query) => {
      const file = await tsuya.openTsuya(`/spot.tsuya?${query}`);
      const mesh = await file.mesh().then(() => file.progress.received);
      const views = [];
      for await (const _ of file.decodeViews({ views: file.order.slice(0, 3).map(({ view }) => view) })) views.push(file.progress.received);
      const total = file.progress.total;
      file.close();
      return { mesh: mesh / total, views: views.map((received) => received / total) };
    }, query);
    console.log(`# ${query}: mesh after ${(100 * shares.mesh).toFixed(0)} % of the file, views after ${shares.views.map((x) => (100 * x).toFixed(0)).join(", ")} %`);
    assert.ok(shares.mesh < 0.4 && shares.views[0] < 0.5, JSON.stringify(shares));
  }
});

test("files that are wrong, missing or not for this version are told apart", async () => {
  const changed = (edit) => {
    const copy = Buffer.from(bytes);
    return edit(copy) ?? copy;
  };
  const plan = info.sections.find(({ tag }) => tag === "PLAN");
  const mesh = info.sections.find(({ tag }) => tag === "MESH");
  const cases = {
    "/future.tsuya": [changed((b) => void b.writeUInt16LE(9, 10)), "unsupported", /version 0\.9/],
    "/cut.tsuya": [bytes.subarray(0, 50000), "format", /cut or extended/],
    "/empty.tsuya": [Buffer.alloc(0), "format", /file, byte 0/],
    "/text.tsuya": [Buffer.from("<!doctype html>".repeat(50)), "format", /not a \.tsuya file/],
    "/crlf.tsuya": [changed((b) => void (b[4] = 0x0a)), "format", /text mode/],
    "/mesh.tsuya": [changed((b) => void (b[mesh.offset + 500] ^= 8)), "format", /section MESH.*CRC-32/],
    "/view.tsuya": [changed((b) => void (b[plan.offset + plan.bytes - 100] ^= 8)), "format", /section PLAN.*checksum of view/],
    "/long.tsuya": [Buffer.concat([bytes, Buffer.alloc(3)]), "format", /cut or extended/],
    "/none.tsuya": [null, "io", /none\.tsuya: 404/],
  };
  for (const [path, [content]] of Object.entries(cases)) if (content) files.set(path, content);
  const found = await page.evaluate(async (paths) => {
    const found = {};
    for (const path of paths) {
      found[path] = await failure(async () => {
        const file = await tsuya.openTsuya(path);
        try {
          await file.mesh();
          for await (const _ of file.decodeViews());
        } finally {
          file.close();
        }
      });
    }
    return found;
  }, Object.keys(cases));
  for (const [path, [, kind, pattern]] of Object.entries(cases)) {
    assert.equal(found[path]?.name, "TsuyaError", path);
    assert.equal(found[path].kind, kind, `${path}: ${found[path].message}`);
    assert.match(found[path].message, pattern);
    assert.ok(found[path].message.includes(path), found[path].message);
  }
  assert.equal(found["/view.tsuya"].section, "PLAN");
  // A cut file that comes from its start gives what stands before the cut.
  const cut = await page.evaluate(async () => {
    const file = await tsuya.openTsuya("/cut.tsuya?ranges=no");
    const views = [];
    const error = await failure(async () => {
      for await (const { index } of file.decodeViews()) views.push(index);
    });
    const other = await failure(() => file.view(99));
    file.close();
    return { views, error, other, after: await failure(() => file.view(0)) };
  });
  assert.ok(cut.views.length > 5 && cut.views.length < 36);
  assert.match(cut.error.message, /ends early/);
  assert.match(cut.other.message, /view 99 does not exist/);
  assert.equal(cut.after.name, "AbortError");
  const broken = await page.evaluate(async () => [
    await failure(async () => (await tsuya.openTsuya("/spot.tsuya?ranges=no&break=30000")).verify()),
    await failure(async () => (await tsuya.openTsuya("/spot.tsuya?break=10000")).verify()),
    await failure(() => tsuya.openTsuya("http://127.0.0.1:9/x.tsuya")),
    await failure(() => tsuya.openTsuya("/spot.tsuya", { memoryMib: 1 }).then((file) => file.view(0))),
    await failure(() => tsuya.openTsuya(5)),
    await failure(() => tsuya.openTsuya("/spot.tsuya", { wasm: "/none.wasm" })),
  ]);
  assert.deepEqual(broken.map((error) => error?.kind), ["io", "io", "io", "limits", "parameter", "io"]);
});

test("no damaged byte makes the decoder fail", async () => {
  const counts = await page.evaluate(async () => {
    const whole = new Uint8Array(await (await fetch("/spot.tsuya")).arrayBuffer());
    const wasm = await WebAssembly.compileStreaming(fetch("/src/tsuya.wasm"));
    const counts = { right: 0 };
    let state = 1;
    const random = (below) => {
      state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
      return Math.floor((state / 2 ** 32) * below);
    };
    for (let round = 0; round < 400; round++) {
      const copy = whole.slice();
      // Mostly where everything is decided: heads, mesh and views.
      const place = random(whole.length < 1 || round % 2 ? whole.length : 12000);
      copy[place] ^= 1 << random(8);
      if (round % 8 === 0) copy[random(whole.length)] = random(256);
      const error = await failure(async () => {
        const file = await tsuya.openTsuya(copy, { wasm, worker: false, memoryMib: 256 });
        await file.mesh();
        await file.reflectance();
        await file.view(file.order[0].view);
        file.close();
      });
      counts[error?.kind ?? "right"] = (counts[error?.kind ?? "right"] ?? 0) + 1;
      if (error?.kind === "internal") return { ...counts, round, error };
    }
    return counts;
  });
  console.log(`# 400 damaged files: ${JSON.stringify(counts)}`);
  assert.equal(counts.internal, undefined, JSON.stringify(counts));
  assert.ok(counts.format > 100);
});

test("what is under way can be given up", async () => {
  const found = await page.evaluate(async () => {
    const file = await tsuya.openTsuya("/spot.tsuya?rate=40000");
    const [opening, looking] = [new AbortController(), new AbortController()];
    const last = file.order.at(-1).view;
    const given = failure(() => file.view(last, { signal: looking.signal }));
    const began = performance.now();
    looking.abort(new DOMException("enough", "AbortError"));
    const first = [await given, performance.now() - began];
    // The file goes on.
    const width = (await file.view(file.order[0].view)).width;
    const closed = failure(() => file.view(last));
    file.close();
    const unopened = failure(() => tsuya.openTsuya("/spot.tsuya?rate=2000", { signal: opening.signal }));
    setTimeout(() => opening.abort(), 50);
    return { first, width, closed: await closed, unopened: await unopened };
  });
  assert.equal(found.first[0].message, "enough");
  assert.ok(found.first[1] < 1000);
  assert.equal(found.width, 128);
  assert.equal(found.closed.name, "AbortError");
  assert.equal(found.unopened.name, "AbortError");
});

test("nothing was complained of", () => assert.deepEqual(complaints, []));
