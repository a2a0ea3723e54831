// Files that can be shown: .tsuya, and glTF with or without an appearance.

import { Box3, Group, MeshStandardMaterial, Sphere, Vector3 } from "three";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { openTsuya } from "tsuya";
import { Appearance, TsuyaAppearance } from "tsuya/three";
import { centre } from "./three/views.js";

/** Words for why a GLB is shown with its own material. */
export const REASONS = {
  version: "made for a later version",
  missing: "it is missing",
  damaged: "it is damaged",
  unsupported: "it can't be used here",
  "other-mesh": "it belongs to another mesh",
  document: "the document's link to it is wrong",
};

/**
 * Opens a file. `source` is an address (`URL`) or a `File`. Gives `{name, kind, root, middle, radius, first, appearance}`; `onStatus` hears of
 * appearances that come later, or don't.
 */
export async function openFile(source, name, { onStatus, onProgress, signal }) {
  return /\.(glb|gltf)$/i.test(name)
    ? openGltf(source, name, { onStatus, onProgress, signal })
    : openStream(source, name, { onProgress, signal });
}

async function openStream(source, name, { onProgress, signal }) {
  const file = await openTsuya(source, { signal, onProgress: ({ received, total }) => onProgress?.(total ? received / total : null) });
  const appearance = await Appearance.open(file);
  const root = new Group();
  root.quaternion.copy(appearance.upright);
  const [mesh, { middle, radius }] = [appearance.mesh(), appearance.shape];
  // Without photographs and maps there is only the shape.
  if (!appearance.atlasSize && !file.views.length) mesh.material = new MeshStandardMaterial({ color: 0xb8b4ac, roughness: 0.6 });
  root.add(mesh);
  return {
    name,
    kind: "tsuya",
    root,
    appearance,
    bytes: source.size ?? file.progress.total,
    ...placed(root, middle, radius),
    first: firstPlace(appearance, root),
    dispose: () => appearance.dispose(),
  };
}

async function openGltf(source, name, { onStatus, onProgress, signal }) {
  const isFile = source instanceof Blob;
  const answer = isFile ? source : await fetch(source, { signal });
  if (!isFile && !answer.ok) throw new Error(`the server answers ${answer.status}`);
  const data = await answer.arrayBuffer();
  onProgress?.(1);
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
  const model = { name, kind: "glb", appearance: null, reason: null, bytes: data.byteLength };
  const appearances = [];
  const told = (status) => {
    if (status.appearance) {
      appearances.push(status.appearance);
      model.appearance ??= status.appearance;
      model.first = firstPlace(status.appearance, status.appearance.bound[0], true);
    }
    if (status.error) model.reason = REASONS[status.error.reason] ?? status.error.message;
    onStatus?.(model, status);
  };
  loader.register((parser) => new TsuyaAppearance(parser, { onStatus: told }));
  const folder = isFile ? "" : new URL(".", new URL(source, document.baseURI)).href;
  const gltf = await loader.parseAsync(data, folder);
  const root = new Group().add(gltf.scene);
  root.updateMatrixWorld(true);
  const sphere = new Box3().setFromObject(root).getBoundingSphere(new Sphere());
  let triangles = 0;
  root.traverse((mesh) => {
    if (mesh.isMesh) triangles += (mesh.geometry.index?.count ?? mesh.geometry.attributes.position.count) / 3;
  });
  if (!triangles) throw new Error("the document has no mesh");
  return Object.assign(model, {
    gltf,
    root,
    triangles,
    middle: sphere.center,
    radius: sphere.radius,
    ready: gltf.userData.tsuya?.ready ?? Promise.resolve([]),
    dispose() {
      appearances.forEach((appearance) => appearance.dispose());
      root.traverse((mesh) => mesh.geometry?.dispose());
    },
  });
}

function placed(root, middle, radius) {
  root.updateMatrixWorld(true);
  return { middle: new Vector3(...middle).applyMatrix4(root.matrixWorld), radius };
}

/** Where the first captured camera stands in the scene's world; null without views. */
function firstPlace(appearance, object, bound = false) {
  const view = appearance.file.views[0];
  if (!view || !object) return null;
  const place = new Vector3(...centre(view.camera));
  if (bound) place.applyMatrix4(object.userData.tsuya.toStream.clone().invert());
  return place.applyMatrix4(object.matrixWorld);
}

