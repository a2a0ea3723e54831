// Maps on the atlas as textures.

import { ClampToEdgeWrapping, DataArrayTexture, DataTexture, FloatType, LinearFilter, RGBAFormat } from "three";

/** A map on the atlas: four numbers for each texel. */
export function atlasTexture(data, width, height) {
  const texture = new DataTexture(data, width, height, RGBAFormat, FloatType);
  // Halves can be filtered everywhere, and are finer than the maps' own steps.
  Object.assign(texture, { internalFormat: "RGBA16F", minFilter: LinearFilter, magFilter: LinearFilter });
  Object.assign(texture, { wrapS: ClampToEdgeWrapping, wrapT: ClampToEdgeWrapping, needsUpdate: true });
  return texture;
}

/** Weights of the lobes, three numbers each, one after the other in four layers of four. */
export function lobeTexture(lobes, width, height, scale) {
  const data = new Float32Array(16 * width * height);
  lobes.forEach(({ weights }, lobe) => {
    for (let k = 0; k < weights.length; k++) {
      const place = 3 * lobe + (k % 3);
      data[4 * ((place >> 2) * width * height + Math.floor(k / 3)) + (place & 3)] = weights[k] * scale[k % 3];
    }
  });
  const texture = new DataArrayTexture(data, width, height, 4);
  Object.assign(texture, { format: RGBAFormat, type: FloatType, internalFormat: "RGBA16F", minFilter: LinearFilter, magFilter: LinearFilter });
  Object.assign(texture, { wrapS: ClampToEdgeWrapping, wrapT: ClampToEdgeWrapping, needsUpdate: true });
  return texture;
}
