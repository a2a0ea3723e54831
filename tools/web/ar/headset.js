// Without a marker: WebXR on phones and headsets. The object is put where the picture's middle meets a surface, and lit by the device's estimate.

import { Group, Mesh, MeshBasicMaterial, RingGeometry } from "three";
import { XREstimatedLight } from "three/addons/webxr/XREstimatedLight.js";
import { ENVIRONMENTS } from "tsuya/three";

/** Height of the object in metres for each side of the marker that it would have. */
const METRES = 0.1;
const WANTED = { requiredFeatures: ["hit-test"], optionalFeatures: ["light-estimation", "dom-overlay"], domOverlay: { root: document.body } };

/** Shows the button where the device can do it. */
export async function offerHeadset(button, page) {
  const able = await navigator.xr?.isSessionSupported?.("immersive-ar").catch(() => false);
  button.hidden = !able;
  if (able) button.addEventListener("click", () => begin(page).catch((error) => page.say("AR can't be started", error.message)));
}

async function begin({ state, place, size, say }) {
  if (!state.model) throw new Error("the object is not there yet");
  const { renderer, scene } = place;
  const session = await navigator.xr.requestSession("immersive-ar", WANTED);
  state.pictures?.stop();
  // The shadow is summed once: the estimate changes slowly, and phones have little time.
  place.resize(size() * METRES);
  place.shadow.update(renderer, place.meshes, place.radius, ENVIRONMENTS.studio.lobes, 0);
  renderer.xr.enabled = true;
  renderer.xr.setReferenceSpaceType("local");
  await renderer.xr.setSession(session);
  place.backdrop.visible = false;
  place.camera.matrixAutoUpdate = place.camera.matrixWorldAutoUpdate = true;
  // Everything that stands on the ground moves together.
  const ground = new Group().add(place.stand, place.shadow.ground);
  const ring = new Mesh(new RingGeometry(0.06, 0.075, 40).rotateX(-Math.PI / 2), new MeshBasicMaterial());
  ring.matrixAutoUpdate = false;
  scene.add(ground, ring);
  ground.visible = false;
  const light = estimate(renderer);
  const viewer = await session.requestReferenceSpace("viewer");
  const source = await session.requestHitTestSource({ space: viewer });
  session.addEventListener("select", () => {
    if (!ring.visible) return;
    ground.visible = true;
    ground.position.setFromMatrixPosition(ring.matrix);
  });
  renderer.setAnimationLoop((_, frame) => {
    const [hit] = frame.getHitTestResults(source);
    const pose = hit?.getPose(renderer.xr.getReferenceSpace());
    ring.visible = Boolean(pose) && !ground.visible;
    if (pose) ring.matrix.fromArray(pose.transform.matrix);
    const lobes = light();
    const { appearance } = state.model;
    if (appearance?.relightable) appearance.lighting = { environment: { lobes }, turn: 0 };
    place.stand.visible = place.shadow.ground.visible = true;
    renderer.render(scene, place.camera);
  });
  session.addEventListener("end", () => {
    renderer.setAnimationLoop(null);
    renderer.xr.enabled = false;
    source.cancel();
    scene.remove(ground, ring);
    scene.add(place.stand, place.shadow.ground);
    place.backdrop.visible = true;
    place.camera.matrixAutoUpdate = place.camera.matrixWorldAutoUpdate = false;
    place.resize(size());
    say("AR has ended", "Start the camera to use a marker.", true);
  });
}

/** The device's estimate as lobes: its main light, and what comes from everywhere; a studio where there is none. */
function estimate(renderer) {
  const estimated = new XREstimatedLight(renderer);
  let running = false;
  estimated.addEventListener("estimationstart", () => (running = true));
  estimated.addEventListener("estimationend", () => (running = false));
  return () => {
    if (!running) return ENVIRONMENTS.studio.lobes;
    const { directionalLight, lightProbe } = estimated;
    const axis = directionalLight.position.clone().normalize().toArray();
    const power = directionalLight.color.toArray().map((x) => x * directionalLight.intensity);
    // The constant term of the harmonics is the mean radiance.
    const mean = lightProbe.sh.coefficients[0].toArray().map((x) => Math.max(0.282095 * x * lightProbe.intensity, 0.02));
    return [
      { axis, sharpness: 40, amplitude: power.map((x) => (x * 40) / (2 * Math.PI)) },
      { axis: [0, 1, 0], sharpness: 0.3, amplitude: mean },
    ];
  };
}
