// The object's shadow on the ground: what it takes of the light there, summed over directions (the ratio of spec/rendering.md, "Shadow on the
// ground", for light that is the same all over the ground).

import {
  AddEquation,
  CustomBlending,
  DoubleSide,
  HalfFloatType,
  LessDepth,
  Matrix4,
  Mesh,
  OneFactor,
  OrthographicCamera,
  PlaneGeometry,
  RedFormat,
  Scene,
  ShaderMaterial,
  SrcColorFactor,
  Vector3,
  WebGLRenderTarget,
  ZeroFactor,
} from "three";
import { directionsOf } from "./light.js";

const SIDE = 256;
const DIRECTIONS = 64;
/** Half the side of the ground that can be dark, in radii of the object. */
const REACH = 3;
const camera = new OrthographicCamera();

/** Ground in y = 0 about the origin that darkens what is behind it. */
export class GroundShadow {
  constructor() {
    this.target = new WebGLRenderTarget(SIDE, SIDE, { type: HalfFloatType, format: RedFormat, generateMipmaps: false });
    // The mesh laid flat along a direction; every pixel counts once for each.
    this.flat = new ShaderMaterial({
      uniforms: { toWorld: { value: new Matrix4() }, direction: { value: new Vector3() }, reach: { value: 1 }, weight: { value: 0 } },
      vertexShader: `
        uniform mat4 toWorld;
        uniform vec3 direction;
        uniform float reach;
        void main() {
          vec3 p = (toWorld * vec4(position, 1.0)).xyz;
          vec2 at = p.xz - direction.xz * (max(p.y, 0.0) / direction.y);
          gl_Position = vec4(at.x / reach, -at.y / reach, 0.0, 1.0);
        }`,
      fragmentShader: "uniform float weight; void main() { gl_FragColor = vec4(weight); }",
      side: DoubleSide,
      blending: CustomBlending,
      blendEquation: AddEquation,
      blendSrc: OneFactor,
      blendDst: OneFactor,
      toneMapped: false,
    });
    // Of equal depths only the first is drawn.
    this.flat.depthFunc = LessDepth;
    this.caster = new Mesh(undefined, this.flat);
    this.caster.frustumCulled = false;
    this.scene = new Scene().add(this.caster);
    const material = new ShaderMaterial({
      uniforms: { shadow: { value: this.target.texture }, strength: { value: 1 } },
      vertexShader: "varying vec2 at; void main() { at = uv; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }",
      // The photograph behind is in display values.
      fragmentShader: `
        uniform sampler2D shadow;
        uniform float strength;
        varying vec2 at;
        void main() {
          vec2 edge = smoothstep(0.0, 0.1, at) * smoothstep(0.0, 0.1, 1.0 - at);
          float dark = strength * edge.x * edge.y * texture2D(shadow, at).r;
          gl_FragColor = vec4(vec3(pow(clamp(1.0 - dark, 0.0, 1.0), 1.0 / 2.2)), 1.0);
        }`,
      blending: CustomBlending,
      blendSrc: ZeroFactor,
      blendDst: SrcColorFactor,
      depthWrite: false,
      transparent: true,
      toneMapped: false,
    });
    this.ground = new Mesh(new PlaneGeometry(2, 2).rotateX(-Math.PI / 2), material);
    this.ground.renderOrder = -1;
  }

  /**
   * Sums the shadow of meshes within `radius` of the origin under lobes of light turned about y. Nothing is done where all is as before.
   */
  update(renderer, meshes, radius, lobes, turn) {
    const key = [lobes, turn, radius, ...meshes.flatMap(({ geometry, matrixWorld }) => [geometry, ...matrixWorld.elements])];
    if (this.key?.length === key.length && this.key.every((value, k) => value === key[k])) return;
    this.key = key;
    const reach = REACH * radius;
    this.ground.scale.setScalar(reach);
    const { uniforms } = this.flat;
    uniforms.reach.value = reach;
    const [before, { autoClear }] = [renderer.getRenderTarget(), renderer];
    renderer.autoClear = false;
    renderer.setRenderTarget(this.target);
    renderer.setClearColor(0, 0);
    renderer.clear();
    for (const { direction, weight } of directionsOf(lobes, turn, DIRECTIONS)) {
      // Light along the ground throws no shadow that ends here.
      if (direction.y < 0.08) continue;
      uniforms.direction.value.copy(direction);
      uniforms.weight.value = weight;
      renderer.clearDepth();
      for (const { geometry, matrixWorld } of meshes) {
        this.caster.geometry = geometry;
        uniforms.toWorld.value.copy(matrixWorld);
        this.flat.uniformsNeedUpdate = true;
        renderer.render(this.scene, camera);
      }
    }
    renderer.setRenderTarget(before);
    renderer.autoClear = autoClear;
  }

  dispose() {
    this.target.dispose();
    this.flat.dispose();
    this.ground.geometry.dispose();
    this.ground.material.dispose();
  }
}
