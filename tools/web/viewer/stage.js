// Canvas, camera and the loop that draws when something changed.

import {
  EquirectangularReflectionMapping,
  DataTexture,
  FloatType,
  LinearFilter,
  Matrix4,
  PerspectiveCamera,
  PMREMGenerator,
  Quaternion,
  RGBAFormat,
  Scene,
  SRGBColorSpace,
  Vector3,
  WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const FIELD_OF_VIEW = 32;
/** Milliseconds after the last movement until the picture is drawn in full quality. */
const REST = 180;
/** A frame that takes longer than this is drawn with fewer pixels while things move. */
const SLOW = 45;

/** A camera of three.js that sees as a captured one; the picture has `width * height` pixels. */
export function capturedCamera(view, upright, width = view.width, height = view.height) {
  const camera = new PerspectiveCamera();
  const scale = Math.min(width / view.width, height / view.height);
  const place = (principal, old, now) => (principal - old / 2) * scale + now / 2;
  const [fx, fy] = view.focal.map((focal) => focal * scale);
  const [cx, cy] = [place(view.principal[0], view.width, width), place(view.principal[1], view.height, height)];
  const [right, down, forward] = view.rotation;
  const [x, y, z] = view.translation;
  // Rows of the view matrix: right, up, backward.
  camera.matrixWorldInverse.set(...right, x, ...down.map((v) => -v), -y, ...forward.map((v) => -v), -z, 0, 0, 0, 1);
  camera.matrixWorldInverse.multiply(new Matrix4().makeRotationFromQuaternion(upright.clone().invert()));
  camera.matrixWorld.copy(camera.matrixWorldInverse).invert();
  camera.matrixWorld.decompose(camera.position, camera.quaternion, camera.scale);
  camera.userData.lens = [(2 * fx) / width, (2 * fy) / height, 1 - (2 * cx) / width, (2 * cy) / height - 1];
  return camera;
}

/** Gives a captured camera its planes of clipping. */
function setClipping(camera, near, far) {
  const [a, b, c, d] = camera.userData.lens;
  const depth = far - near;
  camera.projectionMatrix.set(a, 0, c, 0, 0, b, d, 0, 0, 0, -(far + near) / depth, (-2 * far * near) / depth, 0, 0, -1, 0);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
}

/** A view of the appearance has come, or can't be decoded. */
function nextChange(appearance) {
  return new Promise((resolve) => {
    const done = () => {
      for (const type of ["change", "error"]) appearance.removeEventListener(type, done);
      resolve();
    };
    for (const type of ["change", "error"]) appearance.addEventListener(type, done);
  });
}

export class Stage {
  constructor(canvas, { onDraw = () => {}, onDrawn = () => {} } = {}) {
    this.canvas = canvas;
    this.onDraw = onDraw;
    this.onDrawn = onDrawn;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, premultipliedAlpha: false });
    this.renderer.outputColorSpace = SRGBColorSpace;
    this.renderer.setClearAlpha(0);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
    this.controls = new OrbitControls(this.camera, canvas);
    Object.assign(this.controls, { enableDamping: true, dampingFactor: 0.12, zoomToCursor: true, screenSpacePanning: true });
    this.controls.addEventListener("start", () => (this.dragging = true));
    this.controls.addEventListener("end", () => (this.dragging = false));
    this.controls.addEventListener("change", () => this.move());
    this.root = null;
    this.middle = new Vector3();
    this.radius = 1;
    this.share = 1;
    this.moved = -Infinity;
    this.busy = false;
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  /** Something changed: draws soon. */
  invalidate() {
    if (!this.busy) this.frame ??= requestAnimationFrame((now) => this.draw(now));
  }

  /** The camera moved: draws in less quality until it rests. */
  move() {
    this.moved = performance.now();
    this.invalidate();
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas;
    const ratio = Math.min(window.devicePixelRatio || 1, 2) * this.share;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(Math.max(clientWidth, 1), Math.max(clientHeight, 1), false);
    this.camera.aspect = Math.max(clientWidth, 1) / Math.max(clientHeight, 1);
    this.camera.updateProjectionMatrix();
    this.invalidate();
  }

  draw(now) {
    this.frame = null;
    const moving = this.controls.update() || this.dragging || performance.now() - this.moved < REST;
    // Of a slow card every second pixel of every second row, until things rest.
    const took = now - (this.last ?? -Infinity);
    if (moving && this.wasMoving && took < 1000) this.pace = 0.7 * (this.pace ?? took) + 0.3 * took;
    const share = moving && this.pace > SLOW ? 0.5 : 1;
    if (share !== this.share) {
      this.share = share;
      this.resize();
    }
    this.last = now;
    this.wasMoving = moving;
    const distance = this.camera.position.distanceTo(this.middle);
    this.camera.near = Math.max(distance - 1.5 * this.radius, 0.002 * this.radius);
    this.camera.far = distance + 1.5 * this.radius;
    this.camera.updateProjectionMatrix();
    this.onDraw({ moving, camera: this.camera });
    this.renderer.render(this.scene, this.camera);
    this.onDrawn();
    if (moving) this.invalidate();
  }

  /** Shows another object: `first` is the camera to begin with, a captured one or none. */
  show(root, { middle, radius, first = null }) {
    if (this.root) this.scene.remove(this.root);
    this.root = root;
    this.scene.add(root);
    root.updateMatrixWorld(true);
    this.middle.copy(middle);
    this.radius = radius;
    this.home = first;
    this.reset();
  }

  /** Back to the first view. */
  reset() {
    this.look(this.home ?? this.middle.clone().add(new Vector3(0.5, 0.35, 1).setLength(4 * this.radius)));
  }

  /** Looks at the object's middle from a place; as far as is needed to see all of it. */
  look(place) {
    const half = (Math.PI / 180) * (FIELD_OF_VIEW / 2);
    const least = (1.05 * this.radius) / Math.sin(Math.atan(Math.tan(half) * Math.min(1, this.camera.aspect)));
    const away = place.clone().sub(this.middle);
    this.camera.position.copy(this.middle).add(away.setLength(Math.max(least, 1e-9)));
    this.controls.target.copy(this.middle);
    this.controls.minDistance = 0.05 * this.radius;
    this.controls.maxDistance = 40 * this.radius;
    this.controls.update();
    this.invalidate();
  }

  /** Turns the camera about the object: right and up in radians, nearer by a factor. */
  turn(right, up, nearer = 1) {
    const away = this.camera.position.clone().sub(this.controls.target);
    const axis = new Vector3().crossVectors(this.camera.up, away).normalize();
    const upward = away.angleTo(this.camera.up);
    const lift = Math.min(Math.max(up, upward - 3.1), upward - 0.04);
    away.applyAxisAngle(axis, -lift).applyAxisAngle(this.camera.up, right).multiplyScalar(1 / nearer);
    this.camera.position.copy(this.controls.target).add(away);
    this.controls.update();
    this.move();
  }

  /** Light from all around for materials of three.js' own, from an environment of lobes. */
  surround({ lobes }) {
    if (this.lobes === lobes) return;
    this.lobes = lobes;
    const [width, height] = [128, 64];
    const data = new Float32Array(width * height * 4);
    const direction = new Vector3();
    const axes = lobes.map(({ axis }) => new Vector3(...axis));
    for (let k = 0; k < width * height; k++) {
      // Row 0 is the bottom.
      const [longitude, latitude] = [((k % width) / width - 0.5) * 2 * Math.PI, (Math.floor(k / width) + 0.5) / height * Math.PI];
      direction.set(Math.sin(latitude) * Math.cos(longitude), -Math.cos(latitude), Math.sin(latitude) * Math.sin(longitude));
      lobes.forEach(({ sharpness, amplitude }, l) => {
        const value = Math.exp(sharpness * (axes[l].dot(direction) - 1));
        for (let c = 0; c < 3; c++) data[4 * k + c] += amplitude[c] * value;
      });
      data[4 * k + 3] = 1;
    }
    const texture = new DataTexture(data, width, height, RGBAFormat, FloatType, EquirectangularReflectionMapping);
    Object.assign(texture, { internalFormat: "RGBA16F", minFilter: LinearFilter, magFilter: LinearFilter, needsUpdate: true });
    const generator = new PMREMGenerator(this.renderer);
    this.around?.dispose();
    this.around = generator.fromEquirectangular(texture);
    this.scene.environment = this.around.texture;
    generator.dispose();
    texture.dispose();
    this.invalidate();
  }

  /**
   * Radiance in units of the white board from a captured camera: `width * height * 4` numbers from the upper left, the fourth 1 where the object
   * is. Draws until all captured views that matter are there; the page's own pictures, of another camera, wait.
   */
  async radiance(appearance, view, { width, height } = {}) {
    const camera = capturedCamera(view, this.root.getWorldQuaternion(new Quaternion()), width, height);
    [width, height] = [width ?? view.width, height ?? view.height];
    const distance = camera.position.distanceTo(this.middle);
    setClipping(camera, Math.max(distance - 1.2 * this.radius, 1e-3 * distance), distance + 1.2 * this.radius);
    camera.matrixAutoUpdate = false;
    camera.matrixWorldAutoUpdate = false;
    const target = new WebGLRenderTarget(width, height, { type: FloatType, generateMipmaps: false });
    const values = new Float32Array(width * height * 4);
    const draw = () => {
      this.renderer.setRenderTarget(target);
      this.renderer.clear();
      this.renderer.render(this.scene, camera);
      this.renderer.setRenderTarget(null);
    };
    cancelAnimationFrame(this.frame);
    this.frame = null;
    this.busy = true;
    try {
      for (draw(); appearance && !appearance.complete; draw()) {
        while (!appearance.complete) {
          await nextChange(appearance);
          appearance.upload(this.renderer);
        }
      }
      this.renderer.readRenderTargetPixels(target, 0, 0, width, height, values);
    } finally {
      this.busy = false;
      target.dispose();
    }
    const flipped = new Float32Array(values.length);
    for (let y = 0; y < height; y++) flipped.set(values.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    this.invalidate();
    return flipped;
  }

  /** The picture as PNG; what is beside the object is transparent. */
  async screenshot() {
    this.share = 1;
    this.resize();
    this.renderer.render(this.scene, this.camera);
    return new Promise((resolve) => this.canvas.toBlob(resolve, "image/png"));
  }
}
