// The viewer's page in a real browser: pictures against the program's own, damage, the page's ways.

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, afterEach, before, test } from "node:test";
import { NodeIO } from "@gltf-transform/core";
import { EXTMeshoptCompression, KHRONOS_EXTENSIONS } from "@gltf-transform/extensions";
import { MeshoptEncoder } from "meshoptimizer";
import { serve } from "./support/server.mjs";
import { at, closeAll, closeBrowser, drawn, drop, editGlb, messageOf, open, psnr, rendered, root, tsuya, view } from "./support/viewer.mjs";

const EXTENSION = "TSUYA_materials_appearance";
const [stream, glb, finer] = [at("spot.tsuya"), at("spot.glb"), at("finer.tsuya")];
const report = (name, figure, least) => {
  console.log(`# ${name}: ${figure.toFixed(2)} dB`);
  assert.ok(figure >= least, `${name}: ${figure} dB, at least ${least} expected`);
};

before(() => {
  tsuya("encode", join(root, "tests/data/sample-spot"), "-o", stream, "--refine", "none");
  tsuya("gltf", "export", stream, "-o", glb);
  tsuya("encode", join(root, "tests/data/sample-spot"), "-o", finer);
});
after(closeAll);
afterEach(closeBrowser);

/** Compares captured, relit and new views with the program's. */
async function compare(page, name, { file = stream, least = 40, ofModel = 40 } = {}) {
  const { white, light, intensity } = await page.evaluate(() => {
    const { file } = window.tsuyaViewer.state.model.appearance;
    return { white: file.facts.white, light: [2, 3, 2], intensity: file.views[0].light.intensity };
  });
  // The program's pictures are whole, masks or not.
  const page_ = (place, options) => drawn(page, place, { cutByMasks: false, ...options });
  for (const number of [0, 5]) {
    report(`${name}, view ${number}`, psnr(await page_(number), rendered(file, white, "--view", String(number))), least);
  }
  const model = await page_(5, { layers: { residual: false } });
  report(`${name}, model in view 5`, psnr(model, rendered(file, white, "--view", "5", "--layers", "model")), ofModel);
  // What photographs under other lights have beyond the model the program takes from more of them.
  const modelOnly = { layers: { residual: false } };
  const lit = await page_(3, { ...modelOnly, lighting: { points: [{ position: light, intensity }] } });
  report(`${name}, relit`, psnr(lit, rendered(file, white, "--view", "3", "--light", "2,3,2", "--layers", "model")), 35);
  return { white, intensity, page_ };
}

/** Compares a view between the captured ones: `--camera` looks upright from a place to the middle. */
async function compareBetween(page, name, { white, page_, file = stream }) {
  const [eye, focal] = [[0.5, 1.2, 4], 64 / Math.tan((16 * Math.PI) / 180)];
  const between = await page.evaluate((eye) => {
    const { views } = window.tsuyaViewer.state.model.appearance.file;
    const unit = (v) => v.map((x) => x / Math.hypot(...v));
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const up = views.reduce((sum, { camera }) => sum.map((x, i) => x - camera.rotation[1][i]), [0, 0, 0]);
    const forward = unit(eye.map((x) => -x));
    const right = unit(cross(forward, up));
    const rotation = [right, cross(forward, right), forward];
    return { rotation, translation: rotation.map((row) => -row.reduce((sum, x, i) => sum + x * eye[i], 0)) };
  }, eye);
  const camera = { width: 128, height: 128, focal: [focal, focal], principal: [64, 64], ...between };
  const options = ["--camera=0.5,1.2,4,0,0,0", "--fov=32", "--size=128x128", "--samples=1"];
  report(`${name}, between views`, psnr(await page_(camera), rendered(file, white, ...options)), 38);
}

test("a .tsuya file looks as the program renders it", async () => {
  const server = await view(stream);
  const { page, complaints } = await open(server.address);
  assert.equal(await page.title(), "spot.tsuya – tsuya");
  const { white, intensity, page_ } = await compare(page, ".tsuya");
  const lights = [{ position: [2, 3, 2], intensity }, { position: [-2, 1, 0], intensity: [20, 20, 20] }];
  const two = await page_(3, { layers: { residual: false }, lighting: { points: lights } });
  report("two lights", psnr(two, rendered(stream, white, "--view", "3", "--light=2,3,2", "--light=-2,1,0,20", "--layers", "model")), 35);
  await compareBetween(page, ".tsuya", { white, page_ });
  assert.deepEqual(complaints, []);
  await page.close();
  server.end();
});

test("a finer surface with GGX lobes looks as the program renders it", async () => {
  const server = await view(finer);
  const { page, complaints } = await open(server.address);
  const has = await page.evaluate(() => {
    const { appearance } = window.tsuyaViewer.state.model;
    return [appearance.ggx, appearance.geometry.index.count > 3 * appearance.source.indices.length];
  });
  assert.deepEqual(has, [true, true]);
  const pictures = await compare(page, "finer surface", { file: finer, ofModel: 35 });
  await compareBetween(page, "finer surface", { file: finer, ...pictures });
  // A document's mesh has silhouettes of its own.
  const document = at("finer.glb");
  tsuya("gltf", "export", finer, "-o", document);
  await drop(page, ["finer.glb", readFileSync(document)]);
  await page.waitForFunction(() => window.tsuyaViewer.state.model?.appearance?.surface === null);
  report("GLB of it", psnr(await pictures.page_(7), rendered(finer, pictures.white, "--view", "7"), Math.min), 40);
  assert.deepEqual(complaints, []);
  await page.close();
  server.end();
});

/** What another program makes of the GLB: compressed and without the appearance, which is put into it again. */
async function compressed() {
  const [small, again] = [at("small.glb"), at("again.glb")];
  await MeshoptEncoder.ready;
  const extensions = [...KHRONOS_EXTENSIONS, EXTMeshoptCompression];
  const io = new NodeIO().registerExtensions(extensions).registerDependencies({ "meshopt.encoder": MeshoptEncoder });
  const document = await io.read(glb);
  const { QUANTIZE: method } = EXTMeshoptCompression.EncoderMethod;
  document.createExtension(EXTMeshoptCompression).setRequired(true).setEncoderOptions({ method });
  await io.write(small, document);
  tsuya("gltf", "inject", small, stream, "-o", again);
  return again;
}

test("so does a GLB, one with its stream beside it, and one that was compressed", async () => {
  const external = at("beside.glb");
  tsuya("gltf", "export", stream, "-o", external, "--external");
  for (const [name, file] of [["GLB", glb], ["GLB, stream beside", external], ["GLB, compressed", await compressed()]]) {
    const server = await view(file);
    const { page, complaints } = await open(server.address);
    await page.waitForFunction(() => window.tsuyaViewer.state.model?.appearance);
    if (file === glb) {
      await compare(page, name);
    } else {
      const white = await page.evaluate(() => window.tsuyaViewer.state.model.appearance.file.facts.white);
      const found = await drawn(page, 7, { cutByMasks: false });
      report(name, psnr(found, rendered(stream, white, "--view", "7")), 40);
    }
    assert.deepEqual(complaints, []);
    await page.close();
    server.end();
  }
});

const withSum = (json, binary) => {
  const { bufferView } = json.extensions[EXTENSION].appearances[0];
  const { byteOffset = 0, byteLength } = json.bufferViews[bufferView];
  const bytes = binary.subarray(byteOffset, byteOffset + byteLength);
  return { bytes, sign: () => (json.extensions[EXTENSION].appearances[0].sha256 = createHash("sha256").update(bytes).digest("hex")) };
};

/** A picture of light from all around as Radiance HDR: `value` of a direction. */
function radianceHdr(width, height, value) {
  const pixels = Buffer.alloc(4 * width * height);
  for (let k = 0; k < width * height; k++) {
    const [theta, phi] = [(Math.PI * (Math.floor(k / width) + 0.5)) / height, (2 * Math.PI * ((k % width) + 0.5)) / width];
    const colour = value([Math.sin(theta) * Math.sin(phi), Math.cos(theta), -Math.sin(theta) * Math.cos(phi)]);
    const exponent = Math.ceil(Math.log2(Math.max(...colour, 1e-9)) + 1e-9);
    pixels.set([...colour.map((c) => Math.min(Math.floor((c / 2 ** exponent) * 256), 255)), exponent + 128], 4 * k);
  }
  return Buffer.concat([Buffer.from(`#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y ${height} +X ${width}\n`), pixels]);
}

test("surroundings of one's own light it, with its own shadows", async () => {
  const [baked, picture] = [at("baked.tsuya"), at("surroundings.hdr")];
  tsuya("bake", stream, "-o", baked);
  const lamps = [[0.6, 0.64, 0.48, 14], [-0.8, 0.36, -0.48, 6]];
  const light = ([x, y, z]) => lamps.reduce((sum, [a, b, c, bright], k) => {
    const lamp = bright * Math.exp(30 * (a * x + b * y + c * z - 1));
    return [sum[0] + lamp, sum[1] + lamp * (k ? 0.6 : 1), sum[2] + lamp * (k ? 0.3 : 0.9)];
  }, y > 0 ? [0.3, 0.35, 0.5] : [0.1, 0.09, 0.08]);
  writeFileSync(picture, radianceHdr(128, 64, light));
  const server = await view(baked);
  const { page, complaints } = await open(server.address);
  await drop(page, ["broken.hdr", Buffer.from("#?RADIANCE")]);
  await messageOf(page, /broken\.hdr can't be used as surroundings/);
  await drop(page, ["surroundings.hdr", readFileSync(picture)]);
  await page.waitForFunction(() => window.tsuyaViewer.state.light === "own");
  const environmentOf = () => page.evaluate(async () => {
    const { appearance } = window.tsuyaViewer.state.model;
    await appearance.loadVisibility();
    return window.tsuyaViewer.state.environments.own;
  });
  // Radiance 1 is white in both. Where the normal between the vertices' turns away from the camera the program shows nothing.
  // Spherical Gaussians and direct light only, as in the browser.
  const compareAround = async (name, file) => {
    const environment = await environmentOf();
    const wanted = rendered(file, [1, 1, 1], "--view", "3", "--env", picture, "--samples", "1", "--evaluator", "sg");
    const figure = async (shadows) => psnr(await drawn(page, 3, { cutByMasks: false, lighting: { environment, turn: 0 }, shadows }), wanted, Math.min);
    const [with_, without] = [await figure(true), await figure(false)];
    report(name, with_, 28);
    assert.ok(with_ > without + 0.7, `${without} dB without the object's shadows`);
  };
  await compareAround("own surroundings", baked);
  // Highlights are one lobe for the five, here.
  const bakedFiner = at("baked-finer.tsuya");
  tsuya("bake", finer, "-o", bakedFiner);
  await drop(page, ["baked-finer.tsuya", readFileSync(bakedFiner)]);
  await page.waitForFunction(() => window.tsuyaViewer.state.model?.appearance?.surface);
  await compareAround("own surroundings, finer surface", bakedFiner);
  // The browser's complaint of the broken picture is its loader's.
  assert.deepEqual(complaints.filter((text) => !/HDRLoader/.test(text)), []);
  await page.close();
  server.end();
});

test("what can't be used is said, and the document's own material is shown", async () => {
  const server = await view(stream);
  const { page, complaints } = await open(server.address);
  const bytes = readFileSync(glb);
  const cases = {
    "damaged, seen by its sum": [/isn't shown: it is damaged[^]*SHA-256/, (json, binary) => (withSum(json, binary).bytes[9000] ^= 16)],
    "damaged, the sum right": [
      /isn't shown: it is damaged/,
      (json, binary) => {
        const { bytes, sign } = withSum(json, binary);
        bytes[5200] ^= 16;
        sign();
      },
    ],
    "cut": [
      /isn't shown: it is damaged[^]*bytes/,
      (json) => (json.bufferViews[json.extensions[EXTENSION].appearances[0].bufferView].byteLength -= 1000),
    ],
    "of another mesh": [
      /belongs to another mesh/,
      (json, binary) => {
        const accessor = json.accessors[json.meshes[0].primitives[0].attributes.POSITION];
        const { byteOffset = 0 } = json.bufferViews[accessor.bufferView];
        for (let k = 0; k < accessor.count; k++) {
          const place = byteOffset + 12 * k;
          const y = binary.readFloatLE(place + 4);
          binary.writeFloatLE(binary.readFloatLE(place) + 0.2 * Math.sin(9 * y), place);
        }
      },
    ],
    "of a later version": [/made for a later version[^]*version 2/, (json) => (json.extensions[EXTENSION].version = 2)],
    "a stream of a later version": [
      /made for a later version|0\.9/,
      (json, binary) => {
        const { bytes, sign } = withSum(json, binary);
        bytes.writeUInt16LE(9, 10);
        sign();
      },
    ],
    "missing": [
      /isn't shown: it is missing[^]*absent\.tsuya/,
      (json) => {
        const entry = json.extensions[EXTENSION].appearances[0];
        delete entry.bufferView;
        entry.uri = "absent.tsuya";
      },
    ],
    "leading elsewhere": [
      /link to it is wrong/,
      (json) => {
        const entry = json.extensions[EXTENSION].appearances[0];
        delete entry.bufferView;
        entry.uri = "../../etc/passwd";
      },
    ],
    "dropped by another program": [/isn't shown: it is missing[^]*inject/, (json) => delete json.extensions],
  };
  for (const [name, [pattern, edit]] of Object.entries(cases)) {
    await drop(page, [`${name.replace(/\W+/g, "-")}.glb`, editGlb(bytes, edit)]);
    const said = await (await messageOf(page, pattern)).jsonValue();
    const shown = await page.evaluate(() => {
      const { model } = window.tsuyaViewer.state;
      const materials = [];
      model.root.traverse((mesh) => mesh.isMesh && materials.push(mesh.material.type));
      return { materials, reason: document.getElementById("status").textContent };
    });
    assert.deepEqual(shown.materials, ["MeshPhysicalMaterial"], name);
    assert.match(shown.reason, /document's own material/, name);
    console.log(`# ${name}: ${said.replace(/\s+/g, " ").slice(0, 150)}`);
  }
  // The fallback is a picture, not a hole.
  const lit = await page.evaluate(async () => {
    const { state, stage } = window.tsuyaViewer;
    const image = await createImageBitmap(await stage.screenshot());
    const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    let lit = 0;
    for (let k = 0; k < data.length; k += 4) lit += data[k + 3] > 250 && data[k] + data[k + 1] + data[k + 2] > 90;
    return lit / (image.width * image.height);
  });
  console.log(`# the fallback covers ${(100 * lit).toFixed(1)} % of the picture`);
  assert.ok(lit > 0.05 && lit < 0.6, `${lit}`);

  // The same of .tsuya files; what was shown before stays.
  const file = readFileSync(stream);
  const changed = (place, bit = 16) => {
    const copy = Buffer.from(file);
    copy[place] ^= bit;
    return copy;
  };
  for (const [name, content, pattern] of [
    ["no-signature.tsuya", changed(0), /no-signature\.tsuya can't be shown/],
    ["cut.tsuya", file.subarray(0, 3000), /cut\.tsuya can't be shown/],
    ["mesh.tsuya", changed(2500), /mesh\.tsuya can't be shown/],
    ["later.tsuya", changed(10, 8), /later\.tsuya can't be shown[^]*0\.9/],
    ["empty.glb", Buffer.alloc(0), /empty\.glb can't be shown/],
    ["picture.png", Buffer.from("png"), /picture\.png can't be shown/],
  ]) {
    await drop(page, [name, content]);
    await messageOf(page, pattern);
  }
  assert.deepEqual(complaints, []);
  await page.close();
  server.end();
});

test("a view that can't be decoded leaves the others", async () => {
  const server = await view(stream);
  const { page, complaints } = await open(server.address);
  await page.waitForFunction(() => window.tsuyaViewer.state.model?.appearance);
  const offset = await page.evaluate(() => {
    const { file } = window.tsuyaViewer.state.model.appearance;
    const last = file.order.at(-1);
    return { view: last.view, at: last.offset + Math.floor(last.bytes / 2) };
  });
  const bytes = readFileSync(stream);
  bytes[offset.at] ^= 255;
  await drop(page, ["one-view.tsuya", bytes]);
  await page.waitForFunction(() => window.tsuyaViewer.state.model?.name === "one-view.tsuya");
  const found = await drawn(page, offset.view, { cutByMasks: false });
  assert.ok(found.pixels.some((x) => x > 0.1), "nothing is shown");
  await messageOf(page, new RegExp(`View ${offset.view} can't be decoded`));
  assert.deepEqual(complaints, []);
  await page.close();
  server.end();
});

test("keys, layers, lights, facts, saving, a phone's window, a static site", async () => {
  const site = at("site");
  tsuya("view", glb, "--export", site, "--assets", join(root, "tools/web/dist"));
  const server = await serve(site);
  const { page, complaints } = await open(`${server.address}/index.html?ranges=no`, { width: 390, height: 844 });
  await page.waitForFunction(() => window.tsuyaViewer.state.model?.appearance);
  const inside = await page.evaluate(() => ({
    wide: document.documentElement.scrollWidth,
    beyond: [...document.querySelectorAll("nav button, nav select, nav input")].filter((e) => {
      const { left, right, bottom } = e.getBoundingClientRect();
      return left < 0 || right > innerWidth || bottom > innerHeight;
    }).length,
  }));
  assert.deepEqual(inside, { wide: 390, beyond: 0 });
  // Fewer pixels to draw.
  await page.setViewportSize({ width: 240, height: 300 });
  await page.locator("#picture").focus();
  const state = () => page.evaluate(() => ({ layer: window.tsuyaViewer.state.layer, light: window.tsuyaViewer.state.light, stops: window.tsuyaViewer.state.stops, captured: window.tsuyaViewer.state.captured }));
  await page.keyboard.press("2");
  assert.equal((await state()).layer, "model");
  assert.equal(await page.locator('[data-layer="model"]').getAttribute("aria-pressed"), "true");
  await page.keyboard.press("]");
  await page.keyboard.press("]");
  assert.equal((await state()).captured, 1);
  await page.keyboard.press("+");
  assert.equal((await state()).stops, 0.25);
  await page.keyboard.press("l");
  assert.equal((await state()).light, "lamp");
  const [before] = await page.evaluate(() => window.tsuyaViewer.state.pointer);
  await page.mouse.move(90, 60);
  // The event comes with the next picture.
  await page.waitForFunction((before) => window.tsuyaViewer.state.pointer[0] !== before, before);
  const place = () => page.evaluate(() => window.tsuyaViewer.stage.camera.position.toArray());
  const stood = await place();
  await page.keyboard.press("ArrowLeft");
  assert.notDeepEqual(await place(), stood);
  await page.keyboard.press("i");
  assert.match(await page.locator("#facts").innerText(), /Views\s+36 of 128 × 128[^]*Stated error\s+37\.\d dB[^]*Lights\s+known/);
  await page.keyboard.press("Escape");
  assert.equal(await page.locator("#facts").isVisible(), false);
  const [download] = await Promise.all([page.waitForEvent("download"), page.keyboard.press("s")]);
  assert.equal(download.suggestedFilename(), "spot.png");
  const picture = at("saved.png");
  await download.saveAs(picture);
  assert.deepEqual([...readFileSync(picture).subarray(1, 4)], [...Buffer.from("PNG")]);
  await page.keyboard.press("r");
  assert.equal((await state()).stops, 0);
  assert.deepEqual(complaints, []);
  await page.close();
  server.end();
});
