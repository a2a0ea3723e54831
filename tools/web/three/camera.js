// A three.js camera in the stream's world.

import { Matrix3, Matrix4, Vector3, Vector4 } from "three";
import { dot } from "./views.js";

/** Rotation and translation, as of a captured camera, of a three.js camera in the stream's world. */
export function cameraFrame(toStream, eye) {
  const axis = (x, y, z) => new Vector3(x, y, z).transformDirection(toStream).toArray();
  const rotation = [axis(1, 0, 0), axis(0, -1, 0), axis(0, 0, -1)];
  return { rotation, translation: rotation.map((row) => -dot(row, eye.toArray())) };
}

/** From a pixel to its ray, depth 1, in the stream's world. */
export function setRays(rays, renderer, camera, fromWorld) {
  const viewport = renderer.getCurrentViewport(new Vector4());
  const p = camera.projectionMatrix.elements;
  // Pixel to the camera's axes.
  const [sx, sy] = [2 / viewport.z / p[0], 2 / viewport.w / p[5]];
  const x = (-2 * viewport.x) / viewport.z - 1 + p[8];
  const y = (-2 * viewport.y) / viewport.w - 1 + p[9];
  rays.set(sx, 0, x / p[0], 0, sy, y / p[5], 0, 0, -1);
  const linear = new Matrix3().setFromMatrix4(new Matrix4().multiplyMatrices(fromWorld, camera.matrixWorld));
  rays.premultiply(linear);
}
