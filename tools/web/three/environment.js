// Light from all around as spherical Gaussians, with the shadows that the object's own visibility makes: spec/rendering.md, "In the browser".

import { DataArrayTexture, FloatType, LinearFilter, RGBAFormat, Vector3 } from "three";
import { lobesOfPicture } from "./lobes.js";
import { normalize } from "./views.js";

/** Lobes that an environment may have. */
export const LOBES = 12;
/** Vectors of four terms of visibility that are used. */
export const MOST_TERMS = 24;

export const environment = /* glsl */ `
#define LOBES ${LOBES}
/** Axis with sharpness, and amplitude, of each lobe: amplitude exp(sharpness (axis . direction - 1)). */
uniform vec4 lobeAxis[LOBES];
uniform vec3 lobeAmplitude[LOBES];
uniform int lobeCount;
#if VISIBILITY > 0
varying vec4 vOcclusion[VISIBILITY];
uniform sampler2DArray visibilityBases;
uniform float visibilitySize;
#endif
uniform bool selfShadows;
const float PI = 3.14159265358979;

/** Signed angle to the border of what is free, positive where the direction is. */
float distanceTowards(vec3 d) {
#if VISIBILITY > 0
  if (selfShadows) {
    d /= abs(d.x) + abs(d.y) + abs(d.z);
    vec2 fold = vec2(d.x < 0.0 ? -1.0 : 1.0, d.z < 0.0 ? -1.0 : 1.0) * (1.0 - abs(d.zx));
    vec2 square = d.y >= 0.0 ? d.xz : fold;
    vec2 at = ((square + 1.0) * 0.5 * visibilitySize + 1.0) / (visibilitySize + 2.0);
    float sum = texture(visibilityBases, vec3(at, float(VISIBILITY))).r;
    for (int k = 0; k < VISIBILITY; k++) sum += dot(vOcclusion[k], texture(visibilityBases, vec3(at, float(k))));
    return clamp(sum, -0.5 * PI, 0.5 * PI);
  }
#endif
  return 0.5 * PI;
}

/** (1 - exp(-x)) / x */
float falling(float x) { return x > 1e-3 ? (1.0 - exp(-x)) / x : 1.0 - 0.5 * x; }

/** Share of a lobe that a half space at this signed angle leaves (Wang's fit). */
float shareOf(float sharpness, float free) {
  float l = log(max(sharpness, 1e-3));
  float k = ((0.204 * l - 0.892) * l + 2.995) * l + 0.067;
  return 1.05 / (1.0 + exp(-k * free)) - 0.025;
}

struct Product { vec3 axis; float sharpness; float integral; };

/** The product of two lobes, a lobe again, and its integral. */
Product productOf(vec4 a, vec4 b) {
  float large = max(a.w, b.w), small = min(a.w, b.w);
  if (large <= 0.0) return Product(a.xyz, 0.0, 4.0 * PI);
  float ratio = small / large, cosine = clamp(dot(a.xyz, b.xyz), -1.0, 1.0);
  vec3 sum = (a.w * a.xyz + b.w * b.xyz) / large;
  float size = length(sum);
  float exponent = 2.0 * small * (cosine - 1.0) / (sqrt(max(2.0 * ratio * cosine + ratio * ratio + 1.0, 0.0)) + ratio + 1.0);
  float sharpness = large * size;
  float integral = exponent < -20.0 ? 0.0 : exp(exponent) * 4.0 * PI * falling(2.0 * sharpness);
  return Product(size > 1e-6 ? sum / size : a.xyz, sharpness, integral);
}

/** Irradiance by a lobe of amplitude 1 on a surface that nothing shades (S. Hill's fit; Pettineo 2016). */
float irradianceOf(vec4 lobe, vec3 normal) {
  float sharpness = max(lobe.w, 0.05), cosine = dot(lobe.xyz, normal);
  float once = exp(-sharpness), twice = once * once, inverse = 1.0 / sharpness;
  float scale = 1.0 + 2.0 * twice - inverse, bias = (once - twice) * inverse - twice;
  float x = sqrt(max(1.0 - scale, 1e-6)), near = 0.36 * cosine, width = x / 1.44;
  float y = abs(near) <= width ? (near + width) * (near + width) / x : clamp(cosine, 0.0, 1.0);
  return max(scale * y + bias, 0.0) * 4.0 * PI * falling(2.0 * sharpness);
}

Parts environmentOf(vec3 point, vec3 normal, Maps maps) {
  vec3 outgoing = normalize(eye - point);
  float facing = dot(normal, outgoing);
  vec3 irradiance = vec3(0.0), shine = vec3(0.0);
  // exp(-alpha^2 / (2 sigma^2)) as a lobe of half vectors, turned into one of directions; a wide one is too bright by nearly the factor.
  bool shiny = hasSpecular && facing > 0.0 && maps.sigma > 0.0;
  float squared = maps.sigma * maps.sigma;
  vec4 reflected = vec4(reflect(-outgoing, normal), 1.0 / squared / (4.0 * max(facing, 0.05)));
  float wide = 1.0 / (1.0 + 1.7 * squared);
  for (int k = 0; k < lobeCount; k++) {
    // What the object blocks of the light above the horizon, about where light times cosine is most.
    Product lit = productOf(vec4(normal, 2.133), lobeAxis[k]);
    float above = asin(clamp(dot(lit.axis, normal), -1.0, 1.0));
    float open = max(shareOf(lit.sharpness, above), 0.02);
    float share = clamp(shareOf(lit.sharpness, min(distanceTowards(lit.axis), above)) / open, 0.0, 1.0);
    irradiance += lobeAmplitude[k] * (share * irradianceOf(lobeAxis[k], normal));
    if (shiny) {
      Product mirrored = productOf(reflected, lobeAxis[k]);
      float free = min(distanceTowards(mirrored.axis), asin(clamp(dot(mirrored.axis, normal), -1.0, 1.0)));
      shine += lobeAmplitude[k] * (clamp(shareOf(mirrored.sharpness, free), 0.0, 1.0) * mirrored.integral * wide);
    }
  }
#if GGX
  // Through the surface above the diffuse layer: in at all angles, the mean weighted by the cosine, out at one. Highlights are those of the
  // nearest single lobe.
  irradiance *= 0.9142857 * transmission(facing);
#endif
  return Parts(maps.diffuse * irradiance, shiny ? maps.specular * shine / max(facing, 0.05) : vec3(0.0));
}
`;

const lobe = (x, y, z, sharpness, r, g, b) => ({ axis: normalize([x, y, z]), sharpness, amplitude: [r, g, b] });

/** Environments to choose from, +Y up. Their light is made up, of a few lamps and what is between them. */
export const ENVIRONMENTS = {
  studio: {
    title: "Studio",
    lobes: [
      lobe(0, 1, 0, 0.3, 0.35, 0.36, 0.38),
      lobe(0.7, 0.7, 0.5, 30, 7, 6.8, 6.4),
      lobe(-0.9, 0.35, 0.3, 12, 1.6, 1.8, 2.1),
      lobe(0.1, 0.4, -1, 60, 5, 5, 5),
      lobe(0, -1, 0, 1.5, 0.12, 0.11, 0.1),
    ],
  },
  overcast: {
    title: "Overcast sky",
    lobes: [lobe(0, 1, 0, 1.1, 1.25, 1.3, 1.4), lobe(0, -1, 0, 1.2, 0.28, 0.25, 0.2)],
  },
  evening: {
    title: "Evening sun",
    lobes: [
      lobe(-0.8, 0.28, 0.55, 260, 90, 52, 24),
      lobe(-0.8, 0.25, 0.5, 5, 1.3, 0.72, 0.36),
      lobe(0.3, 1, -0.2, 1.2, 0.34, 0.46, 0.72),
      lobe(0, -1, 0, 1.2, 0.16, 0.12, 0.09),
    ],
  },
  windows: {
    title: "Two windows",
    lobes: [
      lobe(1, 0.25, 0.15, 40, 8.5, 9, 9.8),
      lobe(0.8, 0.3, -0.65, 40, 5.5, 5.9, 6.5),
      lobe(-1, 0.1, 0.2, 2, 0.32, 0.28, 0.23),
      lobe(0, 1, 0, 0.5, 0.22, 0.21, 0.2),
      lobe(0, -1, 0, 2, 0.16, 0.12, 0.08),
    ],
  },
};

/** An environment of a file's lobes (`Light.lobes`): seven numbers each. */
export function environmentOfLobes(lobes, title = "From the file") {
  const found = [];
  for (let k = 0; k + 7 <= lobes.length; k += 7) {
    found.push({ axis: [...lobes.slice(k, k + 3)], sharpness: lobes[k + 3], amplitude: [...lobes.slice(k + 4, k + 7)] });
  }
  const power = (l) => (l.amplitude[0] + l.amplitude[1] + l.amplitude[2]) / (1 + l.sharpness);
  return { title, lobes: found.sort((a, b) => power(b) - power(a)).slice(0, LOBES) };
}

/** An environment of a latitude-longitude picture (`lobesOfPicture`). */
export const environmentOfPicture = (picture, title) => ({ title, lobes: lobesOfPicture(picture, LOBES) });

/** Sets the lobes, turned by `turn` (a vector's function) and brighter by `scale`. */
export function setEnvironment(uniforms, { lobes }, turn, scale) {
  lobes.slice(0, LOBES).forEach(({ axis, sharpness, amplitude }, k) => {
    const { x, y, z } = turn(new Vector3(...axis));
    uniforms.lobeAxis.value[k].set(x, y, z, sharpness);
    uniforms.lobeAmplitude.value[k].set(...amplitude).multiply(scale);
  });
  uniforms.lobeCount.value = Math.min(lobes.length, LOBES);
}

/** Cell of a grid that may lie one step beyond the square, where the sphere goes on mirrored. */
function wrap(column, row, size) {
  const last = size - 1;
  const inside = (x) => x >= 0 && x <= last;
  if (!inside(column)) [column, row] = [Math.min(Math.max(column, 0), last), last - row];
  if (!inside(row)) [column, row] = [last - column, Math.min(Math.max(row, 0), last)];
  return row * size + column;
}

/** Visibility's bases as layers of four terms, the mean in the last, each with a border. */
export function visibilityTexture({ size, terms, bases }, vectors) {
  const pitch = size + 2;
  const data = new Float32Array(pitch * pitch * (vectors + 1) * 4);
  for (let row = -1; row <= size; row++) {
    for (let column = -1; column <= size; column++) {
      const cell = wrap(column, row, size) * (1 + terms);
      const at = (row + 1) * pitch + column + 1;
      for (let k = 0; k < 4 * vectors && k < terms; k++) {
        data[((k >> 2) * pitch * pitch + at) * 4 + (k & 3)] = bases[cell + 1 + k];
      }
      data[(vectors * pitch * pitch + at) * 4] = bases[cell];
    }
  }
  const texture = new DataArrayTexture(data, pitch, pitch, vectors + 1);
  // Halves can be filtered everywhere.
  Object.assign(texture, { format: RGBAFormat, type: FloatType, internalFormat: "RGBA16F", minFilter: LinearFilter, magFilter: LinearFilter });
  texture.needsUpdate = true;
  return texture;
}

