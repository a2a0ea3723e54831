// The page that puts the object on a marker, in a real browser with a camera that plays a rendered video.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, afterEach, before, test } from "node:test";
import { at, closeAll, closeBrowser, drop, messageOf, openPage, root, tsuya, view } from "./support/viewer.mjs";
import { BLOCK, DIGITS, FOCAL, HEIGHT, WIDTH, poseAt, writeVideo } from "./support/video.mjs";

const stream = at("room.tsuya");
const video = at("marker.y4m");
const FRAMES = 80;
/** Frames that show no marker, and those that cut it off. */
const [EMPTY, CUT] = [60, 70];
const poses = Array.from({ length: FRAMES }, (_, k) => {
  if (k >= CUT) return poseAt(0.3, 0.7, 4, [-2.2, 0]);
  if (k >= EMPTY) return null;
  return poseAt(0.02 * k - 0.4, 0.75 + 0.25 * Math.sin(0.1 * k), 4.5 + 1.2 * Math.cos(0.13 * k), [0.3 * Math.sin(0.11 * k), 0.45]);
});

before(() => {
  tsuya("encode", join(root, "tests/data/sample-spot"), "-o", stream);
  writeVideo(video, poses);
});
after(closeAll);
afterEach(closeBrowser);

const CAMERA = ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream", `--use-file-for-fake-video-capture=${video}`];

async function room(parameters, args) {
  const server = await view(stream);
  const address = new URL(`ar/index.html?${new URLSearchParams(parameters)}`, server.address);
  const { page, complaints } = await openPage(address.href, { width: 1040, height: 600 }, args);
  await page.waitForFunction(() => window.tsuyaRoom);
  await page.evaluate(() => window.tsuyaRoom.opened);
  return { page, complaints, server };
}

const angle = (a, b) => {
  const trace = a.reduce((sum, row, i) => sum + row.reduce((s, x, j) => s + x * b[i][j], 0), 0);
  return (Math.acos(Math.min((trace - 1) / 2, 1)) * 180) / Math.PI;
};
const project = ({ rotation, translation }, [x, y]) => {
  const p = rotation.map((row, i) => row[0] * x + row[1] * y + translation[i]);
  return [(FOCAL * p[0]) / p[2] + WIDTH / 2, (FOCAL * p[1]) / p[2] + HEIGHT / 2];
};
const CORNERS = [[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]];

test("the object is locked to the marker, and goes with it", async () => {
  const { page, complaints, server } = await room({ focal: FOCAL, size: 1.3 }, CAMERA);
  // Every record with the number that its picture says.
  await page.evaluate(([digits, block]) => {
    const { state } = window.tsuyaRoom;
    window.seen = [];
    state.records.push = (record) => {
      const { context } = state.pictures;
      const bits = Array.from({ length: digits }, (_, k) => (context.getImageData((k + 0.5) * block, block / 2, 1, 1).data[0] > 128 ? 1 << k : 0));
      window.seen.push({ frame: bits.reduce((a, b) => a + b, 0), ...record });
    };
  }, [DIGITS, BLOCK]);
  await page.click("#start");
  const enough = (least) => [new Set(seen.filter(({ shown }) => shown).map(({ frame }) => frame)).size >= least, seen.some(({ frame }) => frame >= 60 && frame < 70), seen.some(({ frame }) => frame >= 70)].every(Boolean);
  await page.waitForFunction(enough, 15);
  const seen = await page.evaluate(() => window.seen);
  let [locked, beside, turn, far, moving] = [0, 0, 0, 0, 0];
  for (const { frame, marker, corners, pose, shown } of seen) {
    const truth = poses[frame];
    if (!truth || frame >= CUT) {
      assert.ok(!shown && !corners, `frame ${frame}: something is shown without a whole marker`);
      continue;
    }
    if (!shown) continue;
    moving++;
    CORNERS.forEach((corner, k) => {
      const gap = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
      locked = Math.max(locked, gap(corners[k], marker.corners[k]));
      beside = Math.max(beside, gap(corners[k], project(truth, corner)));
    });
    turn = Math.max(turn, angle(pose.rotation, truth.rotation));
    const gap = Math.hypot(...pose.translation.map((x, i) => x - truth.translation[i]));
    far = Math.max(far, gap / Math.hypot(...truth.translation));
  }
  const missed = seen.filter(({ frame, shown }) => frame < EMPTY && !shown).length;
  const times = [0, 1, 2].map((k) => seen.map(({ milliseconds }) => milliseconds[k]).sort((a, b) => a - b)[seen.length >> 1]);
  console.log(`# ${moving} pictures with the marker (${missed} more missed it): drawn corners at most ${locked.toFixed(2)} pixels from the marker's,`);
  console.log(`# ${beside.toFixed(2)} from where they are; pose within ${turn.toFixed(2)} degrees and ${(100 * far).toFixed(2)} % of the distance`);
  console.log(`# median milliseconds: marker and pose ${times[0].toFixed(1)}, light ${times[1].toFixed(1)}, picture ${times[2].toFixed(1)} (software renderer)`);
  assert.ok(locked < 2 && beside < 2 && turn < 1.5 && far < 0.02);
  assert.ok(missed <= 0.1 * moving, `${missed} of ${moving} pictures missed the marker`);
  if (process.env.TSUYA_SCREENSHOT) {
    await page.waitForFunction(() => {
      const { state } = window.tsuyaRoom;
      const { frame, shown } = window.seen.at(-1) ?? {};
      return shown && frame > 25 && state.model.appearance.complete && (state.pictures.stopped = true);
    });
    writeFileSync(process.env.TSUYA_SCREENSHOT, await page.screenshot());
    await page.evaluate(() => window.tsuyaRoom.startCamera());
  }
  // Once the marker is gone the picture is the camera's alone.
  await page.waitForFunction(() => document.getElementById("status").innerText === "No marker in the picture");
  assert.deepEqual(complaints, []);
  server.end();
});

test("another number, another family and no camera are said", async () => {
  const { page, server } = await room({ focal: FOCAL, number: 9 }, CAMERA);
  await page.click("#start");
  await page.waitForFunction(() => /Marker 7 is in the picture, 9 is not/.test(document.getElementById("status").innerText));
  assert.equal(await page.evaluate(() => window.tsuyaRoom.place.stand.visible), false);
  await page.selectOption("#family", "tag36h11");
  await page.waitForFunction(() => /No marker/.test(document.getElementById("status").innerText));
  await closeBrowser();
  server.end();
  for (const [args, reason] of [
    [["--use-fake-device-for-media-stream", "--deny-permission-prompts"], /may not use the camera/],
    [["--deny-permission-prompts"], /may not use the camera|there is no camera/],
  ]) {
    const { page, server } = await room({}, args);
    await page.click("#start");
    await page.waitForFunction(() => !document.getElementById("message").hidden);
    assert.match(await page.innerText("#message"), reason);
    assert.ok(await page.isVisible("#start"), "the camera can be tried again");
    await closeBrowser();
    server.end();
  }
});

test("of two objects one is shown, and a broken one leaves it", async () => {
  const { page, complaints, server } = await room({}, CAMERA);
  const shown = () => page.evaluate(() => [window.tsuyaRoom.state.model.name, window.tsuyaRoom.place.stand.children.length, document.getElementById("title").innerText]);
  assert.deepEqual(await shown(), ["room.tsuya", 1, "room.tsuya"]);
  const bytes = readFileSync(stream);
  await drop(page, ["first.tsuya", bytes], ["second.tsuya", bytes]);
  await messageOf(page, /first\.tsuya is shown[^]*one object at a time/);
  assert.deepEqual(await shown(), ["first.tsuya", 1, "first.tsuya"]);
  await drop(page, ["broken.tsuya", bytes.subarray(0, 3000)]);
  await messageOf(page, /broken\.tsuya can't be shown/);
  assert.deepEqual(await shown(), ["first.tsuya", 1, "first.tsuya"]);
  assert.deepEqual(complaints, []);
  await closeBrowser();
  server.end();
});
