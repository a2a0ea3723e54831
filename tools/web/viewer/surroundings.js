// Surroundings of the visitor's own: a latitude-longitude picture, Radiance HDR or OpenEXR.

import { FloatType } from "three";
import { EXRLoader } from "three/addons/loaders/EXRLoader.js";
import { HDRLoader } from "three/addons/loaders/HDRLoader.js";
import { environmentOfPicture } from "tsuya/three";

export const isPicture = (name) => /\.(hdr|exr)$/i.test(name);

/** Reads a picture as an environment. */
export async function readSurroundings(file) {
  const loader = /\.exr$/i.test(file.name) ? new EXRLoader() : new HDRLoader();
  const { data, width, height } = loader.setDataType(FloatType).parse(await file.arrayBuffer());
  if (width !== 2 * height) throw new Error(`It has ${width} × ${height} pixels; twice as many columns as rows are needed.`);
  const channels = data.length / (width * height);
  const rows = new Float32Array(4 * width * height);
  for (let y = 0; y < height; y++) {
    // The loader of EXR gives the lowest row first.
    const from = loader instanceof EXRLoader ? height - 1 - y : y;
    for (let x = 0; x < width; x++) {
      for (let c = 0; c < 3; c++) rows[4 * (y * width + x) + c] = data[channels * (from * width + x) + Math.min(c, channels - 1)];
    }
  }
  const environment = environmentOfPicture({ data: rows, width, height }, file.name);
  if (!environment.lobes.length) throw new Error("No light comes from it.");
  return environment;
}
