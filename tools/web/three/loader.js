// The glTF extension TSUYA_materials_appearance for GLTFLoader.

import { LoaderUtils } from "three";
import { Appearance } from "./appearance.js";
import { fitMesh, textureTransform } from "./binding.js";

export const EXTENSION = "TSUYA_materials_appearance";
const VERSION = 1;
const MIME_TYPE = "model/vnd.tsuya";
/** three.js' names of sets of texture coordinates. */
const SETS = ["uv", "uv1", "uv2", "uv3"];

/** Why a document is shown without its appearance. */
export class AppearanceError extends Error {
  /** `version`, `missing`, `damaged`, `unsupported`, `other-mesh` or `document`. */
  constructor(reason, message, cause) {
    super(message, { cause });
    this.name = "AppearanceError";
    this.reason = reason;
  }
}

/**
 * `loader.register((parser) => new TsuyaAppearance(parser, options))`. Meshes show the document's own material until their appearance is there,
 * and keep it where there is none that can be used.
 *
 * Options: `onStatus({state, appearance, index, error})` is told of every change, with the states `loading`, `ready` (`appearance` is shown) and
 * `fallback` (`error` says why); `decoder` are options of `openTsuya`. `gltf.userData.tsuya` holds `{ready}`, a promise of the list of
 * appearances (null for those that can't be used).
 */
export class TsuyaAppearance {
  constructor(parser, { onStatus = () => {}, decoder = {} } = {}) {
    this.name = EXTENSION;
    this.parser = parser;
    this.onStatus = onStatus;
    this.decoder = decoder;
  }

  /** Called by the loader when the document's own scene is there. */
  async afterRoot(gltf) {
    const { json } = this.parser;
    const root = json.extensions?.[EXTENSION];
    if (!root) {
      // The root's entry was dropped, or half of a document came.
      const linked = (json.materials ?? []).some((material) => material.extensions?.[EXTENSION] || material.extras?.[EXTENSION]);
      const message = "the link to the measured appearance is there, the appearance was dropped by another program (tsuya gltf inject puts it back)";
      if (linked) this.fallback(null, new AppearanceError("missing", message));
      return;
    }
    if ((root.version ?? 1) !== VERSION) {
      const message = `${EXTENSION} of version ${root.version}; this viewer knows version ${VERSION}`;
      this.fallback(null, new AppearanceError("version", message));
      return;
    }
    const list = Array.isArray(root.appearances) ? root.appearances : [];
    const ready = Promise.all(list.map((_, index) => this.load(gltf, index)));
    gltf.userData.tsuya = { ready };
  }

  fallback(index, error) {
    this.onStatus({ state: "fallback", appearance: null, index, error });
    return null;
  }

  /** Loads one appearance and binds what is linked to it; null, after saying why, where that can't be done. */
  async load(gltf, index) {
    const entry = this.parser.json.extensions[EXTENSION].appearances[index];
    if (entry.mimeType !== undefined && entry.mimeType !== MIME_TYPE) return null;
    const bound = this.meshes(gltf, index);
    if (!bound.length) return null;
    this.onStatus({ state: "loading", appearance: null, index, error: null });
    let appearance = null;
    try {
      const bytes = await this.bytes(entry);
      // The document's mesh is that of the file: what a finer surface has beyond it stays in the residual.
      appearance = await Appearance.open(bytes, { ...this.decoder, surface: false });
      this.bind(appearance, bound);
    } catch (error) {
      appearance?.dispose();
      return this.fallback(index, explained(error));
    }
    this.onStatus({ state: "ready", appearance, index, error: null });
    return appearance;
  }

  /** Meshes whose material is linked to an appearance, with the link. */
  meshes(gltf, index) {
    const found = [];
    const { associations, json } = this.parser;
    for (const scene of gltf.scenes) {
      scene.traverse((mesh) => {
        if (!mesh.isMesh || found.some((other) => other.mesh === mesh)) return;
        const number = associations.get(mesh.material)?.materials;
        const link = json.materials?.[number]?.extensions?.[EXTENSION];
        if (link?.appearance === index) found.push({ mesh, link });
      });
    }
    return found;
  }

  /** The stream's bytes, compared with what the document says of them. */
  async bytes(entry) {
    const { bufferView, uri, levels, sha256 } = entry;
    let bytes;
    if (bufferView !== undefined && uri === undefined) {
      bytes = await this.parser.getDependency("bufferView", bufferView);
    } else if (typeof uri === "string" && bufferView === undefined) {
      bytes = await this.fetch(uri);
    } else {
      throw new AppearanceError("document", "the appearance must have either a bufferView or a uri");
    }
    if (levels !== undefined) {
      const ascending = Array.isArray(levels) && levels.every((level, k) => Number.isInteger(level) && level > (levels[k - 1] ?? 0));
      if (!ascending) throw new AppearanceError("document", "the appearance's levels are not ascending lengths");
      if (levels.at(-1) !== bytes.byteLength) {
        throw new AppearanceError("damaged", `the appearance has ${bytes.byteLength} bytes, the document says ${levels.at(-1)}`);
      }
    }
    // Only pages from secure places may compute it.
    if (sha256 !== undefined && globalThis.crypto?.subtle) {
      const sum = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
      const digits = Array.from(sum, (byte) => byte.toString(16).padStart(2, "0")).join("");
      if (digits !== String(sha256).toLowerCase()) {
        throw new AppearanceError("damaged", "the appearance is not the one that the document names: its SHA-256 differs");
      }
    }
    return bytes;
  }

  async fetch(uri) {
    let path = null;
    try {
      path = decodeURIComponent(uri);
    } catch {
      // Said below.
    }
    const plain = path?.split("/").every((part) => part !== "" && part !== ".." && !/[\\:\0]/.test(part));
    if (!plain) throw new AppearanceError("document", `the appearance's uri ${uri.slice(0, 60)} leads out of the document's folder`);
    const { manager, path: folder, requestHeader, withCredentials } = this.parser.options;
    const address = manager.resolveURL(LoaderUtils.resolveURL(uri, folder));
    let answer;
    try {
      answer = await fetch(address, { headers: requestHeader ?? {}, credentials: withCredentials ? "include" : "same-origin" });
    } catch (error) {
      throw new AppearanceError("missing", `${path} can't be fetched: ${error.message}`, error);
    }
    if (!answer.ok) throw new AppearanceError("missing", `${path} is not there (the server answers ${answer.status})`);
    return answer.arrayBuffer();
  }

  bind(appearance, bound) {
    const atlas = appearance.atlas();
    if (!atlas) throw new AppearanceError("unsupported", "the appearance has no atlas, which texture coordinates could lead to");
    const bindings = bound.map(({ mesh, link }) => {
      const transform = link.extensions?.KHR_texture_transform;
      const name = SETS[transform?.texCoord ?? link.texCoord ?? 0];
      return { mesh, name, transform: textureTransform(transform) };
    });
    const [{ name, transform }] = bindings;
    const maps = fitMesh(bindings.map(({ mesh }) => mesh.geometry), name, transform, atlas);
    if (!maps) throw new AppearanceError("other-mesh", "the appearance is that of another mesh: the surfaces do not fit on each other");
    bindings.forEach(({ mesh, name, transform }, k) => {
      mesh.geometry.setAttribute("atlas", mesh.geometry.attributes[name]);
      if (!mesh.geometry.attributes.normal) mesh.geometry.computeVertexNormals();
      appearance.bind(mesh, { toStream: maps[k], atlasTransform: transform });
    });
  }
}

/** What went wrong, with a reason. */
function explained(error) {
  if (error instanceof AppearanceError) return error;
  const reason = { format: "damaged", unsupported: "version", io: "missing" }[error.kind] ?? "unsupported";
  return new AppearanceError(reason, error.message, error);
}
