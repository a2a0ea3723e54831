// The scene on a marker: spec/placing.md, "The chain of frames". The world has y up and the marker's middle as its origin.

import {
  Box3,
  Group,
  Matrix4,
  Mesh,
  PerspectiveCamera,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
  SRGBColorSpace,
  CanvasTexture,
  LinearFilter,
  Vector3,
  WebGLRenderer,
} from "three";
import { GroundShadow } from "./shadow.js";

/** Marker to world: for one that lies on the ground, and for one that stands. */
const WORLD_OF_MARKER = {
  lying: new Matrix4().set(1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1),
  standing: new Matrix4(),
};

/** What is seen behind: the picture that the pose was found in, as it is. */
function backdrop() {
  const material = new ShaderMaterial({
    uniforms: { picture: { value: null } },
    vertexShader: "varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 1.0, 1.0); }",
    fragmentShader: "uniform sampler2D picture; varying vec2 at; void main() { gl_FragColor = vec4(texture2D(picture, at).rgb, 1.0); }",
    depthTest: false,
    depthWrite: false,
    toneMapped: false,
  });
  const mesh = new Mesh(new PlaneGeometry(2, 2), material);
  mesh.frustumCulled = false;
  mesh.renderOrder = -2;
  return mesh;
}

export class Place {
  constructor(canvas) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = SRGBColorSpace;
    this.renderer.autoClear = true;
    this.scene = new Scene();
    this.backdrop = backdrop();
    this.shadow = new GroundShadow();
    this.stand = new Group();
    this.scene.add(this.backdrop, this.stand, this.shadow.ground);
    this.camera = new PerspectiveCamera();
    this.camera.matrixAutoUpdate = false;
    this.camera.matrixWorldAutoUpdate = false;
    this.orientation = "lying";
    this.model = null;
  }

  /** Shows an object as large as `size` (its height), standing on the origin. */
  show(model, size) {
    this.stand.clear();
    this.model = model;
    this.stand.add(model.root);
    this.resize(size);
  }

  resize(size) {
    if (!this.model) return;
    const { root } = this.model;
    root.scale.setScalar(1);
    root.position.set(0, 0, 0);
    root.updateMatrixWorld(true);
    const box = new Box3().setFromObject(root, true);
    const extent = box.getSize(new Vector3());
    const scale = size / Math.max(extent.y, 1e-9);
    root.scale.setScalar(scale);
    root.position.set((-scale * (box.min.x + box.max.x)) / 2, -scale * box.min.y, (-scale * (box.min.z + box.max.z)) / 2);
    root.updateMatrixWorld(true);
    this.radius = (scale * extent.length()) / 2;
    this.meshes = [];
    root.traverse((mesh) => mesh.isMesh && this.meshes.push(mesh));
  }

  /** The picture behind everything. */
  behind(canvas) {
    const { uniforms } = this.backdrop.material;
    if (uniforms.picture.value?.image !== canvas || this.width !== canvas.width || this.height !== canvas.height) {
      uniforms.picture.value?.dispose();
      const texture = new CanvasTexture(canvas);
      Object.assign(texture, { minFilter: LinearFilter, generateMipmaps: false });
      uniforms.picture.value = texture;
      [this.width, this.height] = [canvas.width, canvas.height];
      this.renderer.setSize(canvas.width, canvas.height, false);
    }
    uniforms.picture.value.needsUpdate = true;
  }

  /** Puts the camera where a pose has it. `lens` is that of the picture. */
  look({ rotation, translation }, { focal, principal }) {
    // Camera of marker, with x right, y up and z backward.
    const signs = [1, -1, -1];
    const [a, b, c] = rotation.map((row, i) => [...row, translation[i]].map((x) => signs[i] * x));
    const viewMatrix = new Matrix4().set(...a, ...b, ...c, 0, 0, 0, 1);
    viewMatrix.multiply(WORLD_OF_MARKER[this.orientation].clone().invert());
    const { camera, width, height } = this;
    camera.matrixWorldInverse.copy(viewMatrix);
    camera.matrixWorld.copy(viewMatrix).invert();
    const distance = new Vector3().setFromMatrixPosition(camera.matrixWorld).length();
    const [near, far] = [Math.max(distance - 4 * this.radius, 0.01 * distance), distance + 4 * this.radius];
    const depth = far - near;
    camera.projectionMatrix.set(
      (2 * focal[0]) / width, 0, 1 - (2 * principal[0]) / width, 0,
      0, (2 * focal[1]) / height, (2 * principal[1]) / height - 1, 0,
      0, 0, -(far + near) / depth, (-2 * far * near) / depth,
      0, 0, -1, 0,
    );
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  }

  /** Where in the picture a point of the marker is drawn, in pixels. */
  drawn(point) {
    const p = new Vector3(...point).applyMatrix4(WORLD_OF_MARKER[this.orientation]).project(this.camera);
    return [((p.x + 1) / 2) * this.width, ((1 - p.y) / 2) * this.height];
  }

  /** Draws; without `visible` the picture behind alone. */
  draw({ visible, light, shadow = true }) {
    this.stand.visible = visible && this.model !== null;
    this.shadow.ground.visible = this.stand.visible && shadow;
    if (this.shadow.ground.visible) this.shadow.update(this.renderer, this.meshes, this.radius, light.lobes, light.turn);
    this.renderer.render(this.scene, this.camera);
  }

  screenshot() {
    return new Promise((resolve) => this.renderer.domElement.toBlob(resolve, "image/png"));
  }
}
