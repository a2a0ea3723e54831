// The model at a surface point, and what lights reach it, in GLSL: spec/rendering.md. All places are in the stream's world, all colours linear
// radiance in units of the white board.

/** Point lights that a picture may have. */
export const LIGHTS = 4;
/** GGX lobes of a texel, in files that have them: the fifteen weights lie in four layers of a texture. */
export const GGX_LOBES = 5;

/**
 * The fitted reflectance and a point light: Lambert, and Torrance-Sparrow with a Gaussian of the half vector's angle. With `GGX` lobes of fixed
 * roughness above a diffuse layer under a dielectric surface in place of these.
 */
export const reflectance = /* glsl */ `
struct PointLight { vec3 position; vec3 intensity; };
/** sinHalf: of the angle alpha between normal and half vector; grazing: Schlick's (1 - cos)^5 between half vector and light. */
struct Geometry { vec3 irradiance; float cosLight; float cosView; float alpha; float sinHalf; float grazing; };
struct Maps {
  vec3 diffuse;
  vec3 specular;
  float sigma;
#if GGX
  vec3 weights[5];
#endif
};
struct Parts { vec3 diffuse; vec3 specular; };

uniform sampler2D diffuseMap;
uniform sampler2D specularMap;
uniform bool relightable;
uniform bool hasSpecular;
/** What the maps were multiplied with. */
uniform vec3 unit;
#if GGX
uniform sampler2DArray lobeMap;
uniform float lobeRoughness[5];
const float NORMAL_REFLECTANCE = 0.04;

/** Share of the light that passes the surface above the diffuse layer at the cosine of an angle. */
float transmission(float cosine) {
  float x = 1.0 - clamp(cosine, 0.0, 1.0), squared = x * x;
  return (1.0 - NORMAL_REFLECTANCE) * (1.0 - squared * squared * x);
}

/** How much more than along the normal the lobes reflect at grazing incidence. */
vec3 grazingGain(Maps maps) {
  vec3 sum = vec3(0.0);
  for (int k = 0; k < 5; k++) sum += maps.weights[k];
  return max(1.0 / max(sum / unit, NORMAL_REFLECTANCE) - 1.0, 0.0);
}

/** Radiance of the lobes for an irradiance of 1; light and view are above the surface. */
vec3 lobesOf(Maps maps, Geometry g) {
  float view = max(g.cosView, 0.05);
  vec3 sum = vec3(0.0);
  for (int k = 0; k < 5; k++) {
    float a = lobeRoughness[k] * lobeRoughness[k], rest = 1.0 - a;
    // Of 1 - rest cos^2 little would be left at the peak of a narrow lobe.
    float t = a + rest * g.sinHalf * g.sinHalf;
    float lightRoot = sqrt(a + rest * g.cosLight * g.cosLight), viewRoot = sqrt(a + rest * view * view);
    sum += maps.weights[k] * (a / (3.14159265358979 * t * t) * (g.cosLight / (g.cosLight + lightRoot)) / (view + viewRoot));
  }
  return sum * (1.0 + grazingGain(maps) * g.grazing);
}
#endif

Geometry geometryOf(vec3 point, vec3 normal, vec3 eye, PointLight light) {
  vec3 toLight = light.position - point;
  float squared = dot(toLight, toLight);
  vec3 l = squared > 0.0 ? toLight * inversesqrt(squared) : vec3(0.0);
  vec3 v = normalize(eye - point);
  vec3 h = l + v;
  Geometry g;
  g.irradiance = squared > 0.0 ? light.intensity / squared : vec3(0.0);
  g.cosLight = dot(normal, l);
  g.cosView = dot(normal, v);
  // Exact for small angles, which acos is not.
  g.alpha = atan(length(cross(normal, h)), dot(normal, h));
  float twice = length(h);
  g.sinHalf = twice > 0.0 ? length(cross(normal, h)) / twice : 1.0;
  float x = 1.0 - clamp(0.5 * twice, 0.0, 1.0);
  g.grazing = x * x * x * x * x;
  return g;
}

Maps mapsAt(vec2 at) {
  vec4 specular = texture(specularMap, at);
  Maps maps;
  maps.diffuse = texture(diffuseMap, at).rgb;
  maps.specular = specular.rgb;
  maps.sigma = specular.a;
#if GGX
  vec4 layers[4];
  for (int k = 0; k < 4; k++) layers[k] = texture(lobeMap, vec3(at, float(k)));
  maps.weights[0] = layers[0].rgb;
  maps.weights[1] = vec3(layers[0].a, layers[1].rg);
  maps.weights[2] = vec3(layers[1].ba, layers[2].r);
  maps.weights[3] = layers[2].gba;
  maps.weights[4] = layers[3].rgb;
#endif
  return maps;
}

Parts modelOf(Maps maps, Geometry g) {
  if (!relightable) return Parts(maps.diffuse, vec3(0.0));
  vec3 diffuse = maps.diffuse * g.irradiance * max(g.cosLight, 0.0);
  vec3 specular = vec3(0.0);
#if GGX
  diffuse *= transmission(g.cosLight) * transmission(g.cosView);
  if (g.cosLight > 0.0 && g.cosView > 0.0) specular = lobesOf(maps, g) * g.irradiance;
#else
  if (hasSpecular && g.cosLight > 0.0 && g.cosView > 0.0 && maps.sigma > 0.0) {
    float x = g.alpha / maps.sigma;
    specular = maps.specular * g.irradiance * exp(-0.5 * x * x) / max(g.cosView, 0.05);
  }
#endif
  return Parts(diffuse, specular);
}
`;

/** What lights reach of a surface. */
export const shadow = /* glsl */ `
#define LIGHTS ${LIGHTS}
/** Depth maps of the lights, side by side. */
uniform sampler2D shadowMaps;
uniform vec4 shadowRows[3 * LIGHTS];
/** Focal length in pixels (0 without shadows), then what depths are stored relative to. */
uniform vec3 shadowLens[LIGHTS];
const float SHADOW_SIDE = 1024.0;
float shadowAt(ivec2 at, int light, float nearest) {
  float depth = texelFetch(shadowMaps, at + ivec2(light * int(SHADOW_SIDE), 0), 0).r;
  return depth <= 0.0 || depth * shadowLens[light].z + shadowLens[light].y > nearest ? 1.0 : 0.0;
}

/** Share of a light that reaches a surface point: bilinear between four depth tests. */
float reachOf(int light, vec3 point, float cosLight) {
  vec3 lens = shadowLens[light];
  if (lens.x <= 0.0) return 1.0;
  vec4 p = vec4(point, 1.0);
  vec3 q = vec3(dot(shadowRows[3 * light], p), dot(shadowRows[3 * light + 1], p), dot(shadowRows[3 * light + 2], p));
  if (q.z <= 0.0) return 1.0;
  vec2 at = lens.x * q.xy / q.z + 0.5 * SHADOW_SIDE - 0.5;
  vec2 corner = floor(at);
  if (any(lessThan(corner, vec2(0.0))) || any(greaterThanEqual(corner + 1.0, vec2(SHADOW_SIDE)))) return 1.0;
  vec2 part = at - corner;
  float nearest = q.z - 5.0 * q.z / lens.x / clamp(cosLight, 0.2, 1.0);
  ivec2 c = ivec2(corner);
  float upper = mix(shadowAt(c, light, nearest), shadowAt(c + ivec2(1, 0), light, nearest), part.x);
  float lower = mix(shadowAt(c + ivec2(0, 1), light, nearest), shadowAt(c + ivec2(1, 1), light, nearest), part.x);
  return mix(upper, lower, part.y);
}
`;
