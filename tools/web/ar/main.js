// The page: a camera, a marker, the object on it.

import { ENVIRONMENTS, environmentOfLobes } from "tsuya/three";
import { openFile } from "../open.js";
import { element, hush, isObject, keep, passOn, say, wantedFile } from "../page.js";
import { CameraPictures, cameras } from "./camera.js";
import { irradiance, lobesOfFisheye } from "./light.js";
import { Place } from "./place.js";
import { markerCorners, poseOf } from "./pose.js";
import { FAMILIES, Tracker, paperColour } from "./tracker.js";
import { offerHeadset } from "./headset.js";

const query = new URLSearchParams(location.search);
const SECOND = "camera-";
/** Reflectance of the paper that markers are printed on, and of the white board that appearances are in units of. */
const PAPER = 0.8;
const BOARD = 0.95;
/** Share by which the exposure follows the picture. */
const FOLLOW = 0.2;
/** Pixels by which a marker's corners may lie beside the pose that was found. */
const MOST_ERROR = 4;

const state = {
  model: null,
  pictures: null,
  around: null,
  tracker: null,
  pose: null,
  gain: null,
  light: "studio",
  environments: { ...ENVIRONMENTS },
  /** What came of the last pictures, the newest last. */
  records: [],
};
let place = null;

const status = (text) => element("status").textContent !== text && (element("status").textContent = text);

/** Height of the object in sides of the marker. */
const size = () => 2 ** Number(element("size").value);
const turn = () => (Number(element("turn").value) * Math.PI) / 180;

/** Focal length and middle of the picture, in pixels. */
function lens(width, height) {
  const given = Number(query.get("focal"));
  const focal = given > 0 ? given : width / 2 / Math.tan((Number(element("lens").value) * Math.PI) / 360);
  return { focal: [focal, focal], principal: [width / 2, height / 2] };
}

/** One picture of the camera: marker, pose, light, drawing. */
function step() {
  const began = performance.now();
  const picture = state.pictures.read();
  if (!picture) return;
  place.behind(state.pictures.canvas);
  const found = state.tracker.find(picture);
  const wanted = element("number").value;
  const marker = found.find(({ id }) => wanted === "" || id === Number(wanted));
  const optics = lens(picture.width, picture.height);
  const pose = marker ? poseOf(marker.corners, 1, optics, state.pose) : null;
  state.pose = pose && pose.error < MOST_ERROR ? pose : null;
  const posed = performance.now();
  const light = lightNow();
  if (state.pose) {
    place.look(state.pose, optics);
    expose(picture, marker.corners, light);
  }
  const lit = performance.now();
  place.draw({ visible: state.pose !== null, light });
  const drawn = performance.now();
  // Where the scene draws the marker's corners is what the object is locked to.
  const corners = state.pose ? markerCorners(1).map((point) => place.drawn(point)) : null;
  state.records.push({ marker, corners, pose: state.pose, shown: place.stand.visible, milliseconds: [posed - began, lit - posed, drawn - lit] });
  if (state.records.length > 300) state.records.shift();
  if (state.pose) status("");
  else if (marker) status(`Marker ${marker.id} is seen, but fits no place: is the lens right?`);
  else if (found.length) status(`Marker ${found.map(({ id }) => id).join(", ")} is in the picture, ${wanted} is not`);
  else status("No marker in the picture");
}

/** Lobes of the light and their turn. */
function lightNow() {
  if (state.around) {
    const picture = state.around.read(256);
    // A few times a second; the shadow is summed anew each time.
    if (picture && performance.now() - (state.lookedAround ?? -Infinity) > 250) {
      state.lookedAround = performance.now();
      state.lobes = lobesOfFisheye(picture);
    }
    if (state.lobes?.length) return { lobes: state.lobes, turn: turn() };
  }
  return { lobes: (state.environments[state.light] ?? ENVIRONMENTS.studio).lobes, turn: turn() };
}

/** Light and exposure of the object: the paper's colour in the picture says how bright and of what colour things are. */
function expose(picture, corners, light) {
  const { appearance } = state.model;
  if (!appearance) return;
  const paper = paperColour(picture, corners);
  const ground = irradiance(light.lobes);
  if (paper) {
    // A white board under radiance of 1 all around is 1.
    const wanted = paper.map((value, c) => value / Math.max((ground[c] / Math.PI) * (PAPER / BOARD), 1e-6));
    state.gain = state.gain ? state.gain.map((gain, c) => gain + FOLLOW * (wanted[c] - gain)) : wanted;
  }
  const gain = state.gain ?? [1, 1, 1];
  if (!appearance.relightable) {
    appearance.exposure = (gain[0] + gain[1] + gain[2]) / 3;
    return;
  }
  const lobes = light.lobes.map((lobe) => ({ ...lobe, amplitude: lobe.amplitude.map((a, c) => a * gain[c]) }));
  appearance.lighting = { environment: { lobes }, turn: light.turn };
}

async function startCamera(id = null) {
  state.pictures?.stop();
  state.pictures = null;
  state.pose = null;
  try {
    const pictures = await CameraPictures.start(id, Number(query.get("width")) || 640, Number(query.get("height")) || 480);
    state.pictures = pictures;
    element("empty").hidden = true;
    hush();
    pictures.run(() => {
      if (pictures.ended) return lost();
      step();
    });
    await offerCameras();
  } catch (error) {
    lost(error);
  }
}

/** No camera: no picture either. */
function lost(error = new Error("the camera gives no more pictures")) {
  state.pictures?.stop();
  state.pictures = null;
  state.pose = null;
  place.renderer.clear();
  element("empty").hidden = false;
  status("");
  say("There is no picture", error.message);
}

async function offerCameras() {
  const found = await cameras();
  element("camera").replaceChildren(...found.map(({ id, title }) => new Option(title, id)));
  const used = state.pictures?.stream.getVideoTracks()[0]?.getSettings().deviceId;
  if (used) element("camera").value = used;
  offerLights(found.filter(({ id }) => id && id !== used));
}

function offerLights(others = []) {
  const options = Object.entries(state.environments).map(([key, { title }]) => [key, title]);
  options.push(...others.map(({ id, title }) => [`${SECOND}${id}`, `Fisheye: ${title}`]));
  element("light").replaceChildren(...options.map(([value, title]) => new Option(title, value)));
  if (!options.some(([value]) => value === state.light)) state.light = options[0][0];
  element("light").value = state.light;
}

async function setLight(light) {
  state.light = light;
  state.around?.stop();
  state.around = null;
  state.lobes = null;
  if (!light.startsWith(SECOND)) return;
  try {
    state.around = await CameraPictures.start(light.slice(SECOND.length), 320, 240);
  } catch (error) {
    state.light = "studio";
    element("light").value = state.light;
    say("The second camera can't be used", error.message);
  }
}

/** Opens an address or a file, instead of what is shown. */
async function open(source, name) {
  state.opening?.abort();
  const { signal } = (state.opening = new AbortController());
  hush();
  status("Opening");
  try {
    const onProgress = (share) => {
      // Photographs come as they are needed.
      element("progress").hidden = share === null || share >= 1 || state.model?.name === name;
      element("progress").value = share ?? 0;
    };
    const onStatus = (model, { error }) => error && say("The measured appearance isn't shown", error.message);
    const model = await openFile(source, name, { signal, onProgress, onStatus });
    if (signal.aborted) return model.dispose();
    const before = state.model;
    state.model = model;
    state.environments = { ...ENVIRONMENTS };
    offerLights();
    element("title").textContent = name;
    place.show(model, size());
    before?.dispose();
    await model.ready;
    if (signal.aborted) return;
    status("");
    element("progress").hidden = true;
    adopt(model);
  } catch (error) {
    if (signal.aborted) return;
    status("");
    element("progress").hidden = true;
    say(`${name} can't be shown`, error.message);
  }
}

function adopt(model) {
  const { appearance } = model;
  if (!appearance) return;
  if (!appearance.relightable) say("This object keeps the light it was photographed in", "The capture's lights are unknown, so it can't be relit.", true);
  appearance.cubic = false;
  appearance.loadVisibility().catch((error) => say("The object throws no shadows on itself", error.message, true));
  appearance.file.light().then((light) => {
    if (!light?.lobes.length || state.model !== model) return;
    state.environments.file = environmentOfLobes(light.lobes);
    offerLights();
  }, () => {});
}

/** Opens what the page was made for. */
async function first() {
  const wanted = await wantedFile(new URL("..", document.baseURI));
  if (wanted) return open(wanted.address, wanted.name);
  say("There is no object", "Drop a .tsuya or .glb file here, or start this page from the viewer.");
}

function listen() {
  element("message-close").addEventListener("click", hush);
  element("start").addEventListener("click", () => startCamera());
  element("camera").addEventListener("change", ({ target }) => startCamera(target.value));
  element("light").addEventListener("change", ({ target }) => setLight(target.value));
  element("size").addEventListener("input", () => place.resize(size()));
  element("orientation").addEventListener("change", ({ target }) => (place.orientation = target.value));
  element("family").addEventListener("change", ({ target }) => (state.tracker = new Tracker(target.value)));
  element("save").addEventListener("click", async () => keep(await place.screenshot(), state.model?.name));
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", async (event) => {
    event.preventDefault();
    const [file, ...others] = [...event.dataTransfer.files].filter(({ name }) => isObject(name));
    if (!file) return say("That can't be shown", "Files named .tsuya, .glb or .gltf can be.");
    await open(file, file.name);
    if (others.length && state.model?.name === file.name) say(`${file.name} is shown`, "There is one object at a time.", true);
  });
  passOn(element("back"));
}

function start() {
  try {
    place = new Place(element("picture"));
  } catch (error) {
    say("This browser can't draw the object", `WebGL 2 is needed: ${error.message}`);
    return;
  }
  element("family").replaceChildren(...Object.entries(FAMILIES).map(([key, { title }]) => new Option(title, key)));
  const family = FAMILIES[query.get("family")] ? query.get("family") : Object.keys(FAMILIES)[0];
  element("family").value = family;
  state.tracker = new Tracker(family);
  if (query.get("number")) element("number").value = query.get("number");
  if (Number(query.get("size")) > 0) element("size").value = String(Math.log2(Number(query.get("size"))));
  offerLights();
  listen();
  offerHeadset(element("headset"), { state, place, size, say });
  // For tests and the curious.
  window.tsuyaRoom = { state, place, startCamera, setLight, opened: first() };
}

start();
