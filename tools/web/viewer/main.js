// The page: files, buttons, keys.

import { Matrix4, Vector3 } from "three";
import { ALL_LAYERS, ENVIRONMENTS, environmentOfLobes } from "tsuya/three";
import { factsOf, showFacts } from "./facts.js";
import { REASONS, openFile } from "./open.js";
import { element, hush, isObject, keep, passOn, say, wantedFile } from "./page.js";
import { Stage } from "./stage.js";
import { isPicture, readSurroundings } from "./surroundings.js";
import { centre } from "./three/views.js";

const canvas = element("picture");
const LAYERS = {
  photograph: { ...ALL_LAYERS },
  model: { ...ALL_LAYERS, residual: false },
  residual: { ...ALL_LAYERS, model: false },
  diffuse: { ...ALL_LAYERS, specular: false },
  specular: { ...ALL_LAYERS, diffuse: false },
};
const CAPTURE = "capture-";
const LAMP = "lamp";

const state = { model: null, layer: "photograph", light: `${CAPTURE}0`, stops: 0, pointer: [0.35, 0.45], captured: -1, environments: { ...ENVIRONMENTS }, own: null };
let opening = null;
let stage = null;

function showStatus() {
  const { model } = state;
  const appearance = model?.appearance;
  let text = "";
  if (model?.reason) text = `Shown with the document's own material: ${model.reason}`;
  else if (model?.loading) text = "Loading the measured appearance";
  else if (appearance && !appearance.complete) text = `Decoding views: ${appearance.decoded} of ${appearance.file.views.length}`;
  else if (appearance && state.captured >= 0) text = `View ${state.captured}: ${appearance.file.views[state.captured].name}`;
  if (element("status").textContent !== text) element("status").textContent = text;
  // The rest of a file comes when it is looked at.
  if (appearance?.complete) showProgress(null);
}

/** Shows how much of a file is there; 1 or nothing hides it. */
function showProgress(share) {
  element("progress").hidden = share === null || share >= 1;
  element("progress").value = share ?? 0;
}

/** Takes a file of the visitor's: an object, or surroundings for the one that is shown. */
async function take(file) {
  if (!isPicture(file.name)) return open(file, file.name);
  try {
    state.own = await readSurroundings(file);
  } catch (error) {
    return say(`${file.name} can't be used as surroundings`, error.message);
  }
  state.environments.own = state.own;
  const { model } = state;
  offerLights(model?.appearance ?? null);
  if (!model) say("Surroundings taken", "They are offered as light for the object that is opened next.", true);
  else if (model.appearance && !model.appearance.relightable) say(`${file.name} isn't shown`, "The capture's lights are unknown, so the object can't be relit.");
  else setLight("own");
}

/** Opens an address or a file, instead of what is shown. */
async function open(source, name) {
  opening?.abort();
  opening = new AbortController();
  const { signal } = opening;
  hush();
  element("empty").hidden = true;
  element("title").textContent = name;
  element("status").textContent = "Opening";
  document.title = `${name} – tsuya`;
  try {
    const model = await openFile(source, name, { signal, onStatus: heard, onProgress: showProgress });
    if (signal.aborted) return model.dispose();
    replace(model);
    await model.ready;
  } catch (error) {
    if (signal.aborted) return;
    showProgress(null);
    element("status").textContent = "";
    element("empty").hidden = Boolean(state.model);
    if (state.model) element("title").textContent = state.model.name;
    say(`${name} can't be shown`, error.message);
  }
}

/** Hears what becomes of a GLB's appearance. */
function heard(model, { state: what, appearance, error }) {
  model.loading = what === "loading";
  if (error) say(`The measured appearance isn't shown: ${REASONS[error.reason] ?? "it can't be used"}`, error.message);
  if (appearance) {
    follow(appearance);
    if (state.model === model) adopt(model);
  }
  showStatus();
  stage.invalidate();
}

function replace(model) {
  const before = state.model;
  state.model = model;
  state.captured = -1;
  state.environments = { ...ENVIRONMENTS, ...(state.own && { own: state.own }) };
  stage.show(model.root, model);
  before?.dispose();
  if (model.appearance) {
    if (model.kind === "tsuya") follow(model.appearance);
    adopt(model);
  } else {
    offerLights(null);
  }
  surround();
  refresh();
}

/** Light for materials of three.js' own, where one is shown. */
function surround() {
  const { appearance } = state.model ?? {};
  if (appearance?.file.views.length || appearance?.atlasSize) return;
  stage.surround(state.environments[state.light] ?? ENVIRONMENTS.studio);
}

function follow(appearance) {
  appearance.addEventListener("change", () => stage.invalidate());
  appearance.addEventListener("error", ({ error, view }) => {
    say(`View ${view} can't be decoded`, `${error.message}. The picture is made of the others and the model.`);
    stage.invalidate();
  });
}

/** Takes a model's appearance into the page. */
function adopt(model) {
  const { appearance } = model;
  state.light = `${CAPTURE}0`;
  offerLights(appearance);
  stage.home = model.first;
  stage.reset();
  if (!appearance.relightable && appearance.file.views.length) {
    element("light").title = "The capture's lights are unknown, so the object can't be relit";
  }
  // Behind the photographs: comes after the first picture.
  appearance.file.light().then((light) => {
    if (!light?.lobes.length || state.model !== model) return;
    state.environments.file = environmentOfLobes(light.lobes);
    offerLights(appearance);
  }, () => {});
  appearance.loadVisibility().catch((error) => say("The object throws no shadows on itself", error.message, true));
  refresh();
}

function offerLights(appearance) {
  const select = element("light");
  const options = [];
  if (appearance) {
    const numbers = [...new Set(appearance.lightNumbers)].sort((a, b) => a - b);
    const title = (n) => (numbers.length > 1 ? `As photographed, light ${n + 1}` : "As photographed");
    options.push(...numbers.slice(0, 12).map((n) => [`${CAPTURE}${n}`, title(n)]));
    if (!numbers.length) options.push([`${CAPTURE}0`, "As photographed"]);
    if (appearance.relightable) options.push([LAMP, "Lamp at the pointer"]);
  }
  if (!appearance || appearance.relightable) {
    options.push(...Object.entries(state.environments).map(([key, { title }]) => [key, title]));
  }
  select.replaceChildren(...options.map(([value, title]) => new Option(title, value)));
  if (!options.some(([value]) => value === state.light)) state.light = options[0][0];
  select.value = state.light;
  select.disabled = options.length < 2;
}

/** Brings the page's state into the picture. */
function refresh() {
  const appearance = state.model?.appearance;
  if (appearance) {
    appearance.layers = { ...LAYERS[state.layer] };
    appearance.signedResidual = state.layer === "residual";
    appearance.exposure = 2 ** state.stops;
    if (state.light.startsWith(CAPTURE)) appearance.lighting = { capture: Number(state.light.slice(CAPTURE.length)) };
    else if (state.light === LAMP) appearance.lighting = { points: [lamp(appearance)] };
    else appearance.lighting = { environment: state.environments[state.light], turn: 0 };
  }
  stage.renderer.toneMappingExposure = 2 ** state.stops;
  stage.scene.environmentIntensity = 2 ** state.stops;
  canvas.classList.toggle("lamp", state.light === LAMP);
  const photographs = appearance?.file.views.length > 0;
  const around = appearance && !state.light.startsWith(CAPTURE) && state.light !== LAMP;
  for (const button of document.querySelectorAll("[data-layer]")) {
    const { layer } = button.dataset;
    button.setAttribute("aria-pressed", String(Boolean(appearance) && layer === state.layer));
    const hidden = layer === "residual" && around;
    button.disabled = !appearance || hidden || (layer !== "photograph" && !appearance.atlasSize && layer !== "residual") || (layer === "residual" && !photographs);
  }
  element("exposure").value = String(state.stops);
  document.querySelector('[data-act="screenshot"]').disabled = !state.model;
  document.querySelector('[data-act="reset"]').disabled = !state.model;
  showStatus();
  if (state.model && !element("facts").hidden) showFacts(element("facts").firstElementChild, factsOf(state.model));
  stage.invalidate();
}

/** The capture's light, moved to the pointer: the canvas is a hemisphere before the object. */
function lamp(appearance) {
  const mesh = appearance.bound[0];
  const [x, y] = state.pointer;
  const across = Math.min(Math.hypot(x, y), 0.98);
  const scale = across / Math.max(Math.hypot(x, y), 1e-9);
  const direction = new Vector3(x * scale, y * scale, Math.sqrt(1 - across * across)).transformDirection(stage.camera.matrixWorld);
  const toStream = new Matrix4().copy(mesh.matrixWorld).invert().premultiply(mesh.userData.tsuya.toStream);
  direction.transformDirection(toStream).multiplyScalar(appearance.lightDistance);
  const { intensity } = appearance.file.views.find((view) => view.light)?.light ?? { intensity: [1, 1, 1] };
  const position = new Vector3(...appearance.shape.middle).add(direction).toArray();
  return { position, intensity };
}

function setLayer(layer) {
  const button = document.querySelector(`[data-layer="${layer}"]`);
  if (button.disabled) return;
  state.layer = layer;
  refresh();
}

function setLight(light) {
  state.light = light;
  element("light").value = light;
  surround();
  if (state.environments[light] && state.layer === "residual") state.layer = "photograph";
  refresh();
}

/** Looks from a captured view's place. */
function lookFrom(step) {
  const { appearance } = state.model ?? {};
  const count = appearance?.file.views.length;
  if (!count) return;
  state.captured = (state.captured + step + count) % count;
  const [mesh, view] = [appearance.bound[0], appearance.file.views[state.captured]];
  const place = new Vector3(...centre(view.camera)).applyMatrix4(mesh.userData.tsuya.toStream.clone().invert());
  const captured = state.captured;
  stage.look(place.applyMatrix4(mesh.matrixWorld));
  state.captured = captured;
  if (state.light.startsWith(CAPTURE)) setLight(`${CAPTURE}${appearance.lightNumbers[captured]}`);
  showStatus();
}

function panel(name) {
  for (const id of ["facts", "keys"]) {
    const shown = id === name && element(id).hidden;
    element(id).hidden = !shown;
    document.querySelector(`[data-act="${id}"]`).setAttribute("aria-expanded", String(shown));
  }
  refresh();
}

const acts = {
  open: () => element("chooser").click(),
  reset: () => {
    state.captured = -1;
    state.stops = 0;
    stage.reset();
    refresh();
    showStatus();
  },
  screenshot: async () => state.model && keep(await stage.screenshot(), state.model.name),
  facts: () => panel("facts"),
  keys: () => panel("keys"),
};

function stops(change) {
  state.stops = Math.min(Math.max(state.stops + change, -3), 3);
  refresh();
}

function nextLight() {
  const values = [...element("light").options].map((option) => option.value);
  setLight(values[(values.indexOf(state.light) + 1) % values.length]);
}

const keys = {
  ...Object.fromEntries(Object.keys(LAYERS).map((layer, k) => [String(k + 1), () => setLayer(layer)])),
  arrowleft: () => stage.turn(-0.1, 0),
  arrowright: () => stage.turn(0.1, 0),
  arrowup: () => stage.turn(0, 0.1),
  arrowdown: () => stage.turn(0, -0.1),
  pageup: () => stage.turn(0, 0, 1.15),
  pagedown: () => stage.turn(0, 0, 1 / 1.15),
  "[": () => lookFrom(-1),
  "]": () => lookFrom(1),
  "+": () => stops(0.25),
  "=": () => stops(0.25),
  "-": () => stops(-0.25),
  l: nextLight,
  r: acts.reset,
  s: acts.screenshot,
  i: acts.facts,
  o: acts.open,
  h: acts.keys,
  "?": acts.keys,
  escape: () => {
    hush();
    panel(null);
  },
};

function listen() {
  document.addEventListener("keydown", (event) => {
    const inControl = /^(SELECT|INPUT)$/.test(event.target.tagName) && event.key !== "Escape";
    const act = keys[event.key.toLowerCase()];
    if (event.ctrlKey || event.metaKey || event.altKey || inControl || !act) return;
    if (!state.model && !["o", "h", "escape"].includes(event.key.toLowerCase())) return;
    event.preventDefault();
    act();
  });
  document.addEventListener("click", ({ target }) => {
    const button = target.closest("button");
    if (button?.dataset.act) acts[button.dataset.act]();
    if (button?.dataset.layer) setLayer(button.dataset.layer);
  });
  element("message-close").addEventListener("click", hush);
  element("light").addEventListener("change", ({ target }) => setLight(target.value));
  element("exposure").addEventListener("input", ({ target }) => {
    state.stops = Number(target.value);
    refresh();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (state.light !== LAMP || (event.buttons && event.pointerType === "mouse")) return;
    const { width, height, left, top } = canvas.getBoundingClientRect();
    const size = Math.min(width, height);
    state.pointer = [(2 * (event.clientX - left) - width) / size, (height - 2 * (event.clientY - top)) / size];
    refresh();
  });
  stage.controls.addEventListener("start", () => (state.captured = -1));
  element("chooser").addEventListener("change", ({ target }) => {
    const [file] = target.files;
    target.value = "";
    if (file) take(file);
  });
  const stop = (event) => event.preventDefault();
  document.addEventListener("dragover", (event) => {
    stop(event);
    document.body.classList.add("dropping");
  });
  document.addEventListener("dragleave", (event) => event.relatedTarget ?? document.body.classList.remove("dropping"));
  document.addEventListener("drop", (event) => {
    stop(event);
    document.body.classList.remove("dropping");
    const [file] = event.dataTransfer.files;
    if (file && (isObject(file.name) || isPicture(file.name))) take(file);
    else if (file) say(`${file.name} can't be shown`, "Files named .tsuya, .glb or .gltf can be, and .hdr or .exr as surroundings.");
  });
}

/** Opens what the page was made for. */
async function first() {
  const wanted = await wantedFile(document.baseURI);
  if (wanted) return open(wanted.address, wanted.name);
  element("empty").hidden = false;
  refresh();
}

function start() {
  try {
    stage = new Stage(canvas, {
      onDraw({ moving }) {
        const { appearance } = state.model ?? {};
        if (!appearance) return;
        appearance.cubic = !moving;
        // The lamp keeps its place before the camera.
        if (state.light === LAMP) appearance.lighting = { points: [lamp(appearance)] };
      },
      onDrawn: showStatus,
    });
  } catch (error) {
    say("This browser can't draw the object", `WebGL 2 is needed: ${error.message}`);
    return;
  }
  listen();
  passOn(element("room"));
  offerLights(null);
  // For tests and the curious.
  window.tsuyaViewer = { state, stage, open, setLayer, setLight, opened: first() };
}

start();
