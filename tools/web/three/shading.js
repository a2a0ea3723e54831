// What a surface point shows, in GLSL: spec/rendering.md. All places are in the stream's world, all colours linear radiance in units of
// the white board.

/** Point lights that a picture may have. */
export const LIGHTS = 4;
/** Captured views that a surface point may look at. */
export const CANDIDATES = 8;

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

/** Captured views read at a surface point: photograph and model of each, as `captured.js` prepares them. */
export const residual = /* glsl */ `
#define CANDIDATES ${CANDIDATES}
/** A surface point is hidden from a view where the mesh is nearer by this many pixel widths. */
const float MARGIN = 6.0;

/** Of each candidate: rows of the rotation with the translation, focal lengths and principal point, centre, size and layer. */
uniform vec4 viewRows[3 * CANDIDATES];
uniform vec4 viewLens[CANDIDATES];
uniform vec3 viewCentre[CANDIDATES];
uniform vec3 viewSize[CANDIDATES];
/** Depths are stored as (depth - x) / y. */
uniform vec2 viewDepth[CANDIDATES];
uniform int candidates;
uniform int blended;
uniform bool cubic;
/** Light of each candidate. */
uniform PointLight viewLight[CANDIDATES];
/** rgb: photograph of the first component; a: steps from what says nothing, 0 to 4, plus half the share of the light; -1 beside the mask. */
uniform sampler2DArray firstPhotograph;
/** rgb: model of the first component; a: depth. */
uniform sampler2DArray firstModel;
uniform sampler2DArray secondPhotograph;
uniform sampler2DArray secondModel;

/** Photograph and model by component, and the share of the view's light that reaches the place. */
struct Shown { vec3 photograph[2]; vec3 model[2]; float reach; };
const int UNSEEN = 0;
const int CUT = 1;
const int SEEN = 2;

struct Texel { vec4 photograph; vec4 model; bool near; bool readable; };

Texel texelOf(ivec2 at, int k, float depth, float margin) {
  ivec3 size = ivec3(viewSize[k]);
  Texel t;
  t.near = false;
  t.readable = false;
  if (at.x < 0 || at.y < 0 || at.x >= size.x || at.y >= size.y) return t;
  t.photograph = texelFetch(firstPhotograph, ivec3(at, size.z), 0);
  t.model = texelFetch(firstModel, ivec3(at, size.z), 0);
  t.near = t.model.a > -1000.0 && abs(t.model.a * viewDepth[k].y + viewDepth[k].x - depth) < margin;
  t.readable = t.near && t.photograph.a >= 1.0;
  return t;
}

void addTexel(inout Shown sum, inout float confidence, Texel t, ivec2 at, int k, float weight) {
  sum.photograph[0] += weight * t.photograph.rgb;
  sum.model[0] += weight * t.model.rgb;
  if (COMPONENTS > 1) {
    ivec3 place = ivec3(at, int(viewSize[k].z));
    sum.photograph[1] += weight * texelFetch(secondPhotograph, place, 0).rgb;
    sum.model[1] += weight * texelFetch(secondModel, place, 0).rgb;
  }
  float steps = floor(t.photograph.a);
  confidence += weight * 0.25 * steps;
  sum.reach += weight * 2.0 * (t.photograph.a - steps);
}

vec4 catmullRom(float t) {
  float t2 = t * t, t3 = t2 * t;
  return 0.5 * vec4(-t + 2.0 * t2 - t3, 2.0 - 5.0 * t2 + 3.0 * t3, t + 4.0 * t2 - 3.0 * t3, t3 - t2);
}

/** What candidate k shows at a surface point: cubic between pixels where all around can be read, else bilinear. */
int look(int k, vec3 point, bool colours, out Shown shown, out float confidence) {
  shown = Shown(vec3[2](vec3(0.0), vec3(0.0)), vec3[2](vec3(0.0), vec3(0.0)), 0.0);
  confidence = 0.0;
  vec4 p = vec4(point, 1.0);
  vec3 q = vec3(dot(viewRows[3 * k], p), dot(viewRows[3 * k + 1], p), dot(viewRows[3 * k + 2], p));
  if (q.z <= 0.0) return UNSEEN;
  vec2 at = viewLens[k].xy * q.xy / q.z + viewLens[k].zw;
  if (!(all(greaterThan(at, vec2(0.0))) && all(lessThan(at, viewSize[k].xy)))) return UNSEEN;
  ivec2 corner = ivec2(floor(at - 0.5));
  vec2 part = at - 0.5 - vec2(corner);
  float margin = MARGIN * q.z / abs(viewLens[k].x);
  if (cubic && colours) {
    vec4 columns = catmullRom(part.x), rows = catmullRom(part.y);
    bool all16 = true;
    for (int j = 0; j < 4 && all16; j++) {
      for (int i = 0; i < 4; i++) {
        ivec2 place = corner + ivec2(i - 1, j - 1);
        Texel t = texelOf(place, k, q.z, margin);
        if (!t.readable) { all16 = false; break; }
        addTexel(shown, confidence, t, place, k, columns[i] * rows[j]);
      }
    }
    shown.reach = clamp(shown.reach, 0.0, 1.0);
    if (all16) return SEEN;
    shown = Shown(vec3[2](vec3(0.0), vec3(0.0)), vec3[2](vec3(0.0), vec3(0.0)), 0.0);
    confidence = 0.0;
  }
  float total = 0.0;
  bool cut = true;
  for (int i = 0; i < 4; i++) {
    ivec2 offset = ivec2(i & 1, i >> 1);
    float weight = (offset.x == 1 ? part.x : 1.0 - part.x) * (offset.y == 1 ? part.y : 1.0 - part.y);
    Texel t = texelOf(corner + offset, k, q.z, margin);
    if (t.readable) {
      total += weight;
      if (colours) addTexel(shown, confidence, t, corner + offset, k, weight);
    }
    if (weight >= 1e-6 && !(t.near && t.photograph.a < 0.0)) cut = false;
  }
  if (total > 0.02) {
    for (int c = 0; c < 2; c++) {
      shown.photograph[c] /= total;
      shown.model[c] /= total;
    }
    shown.reach /= total;
    confidence = max(confidence, 1e-4);
    return SEEN;
  }
  return cut ? CUT : UNSEEN;
}

/** What is seen at a surface point: up to three views with weights that sum to 1. */
struct Sight { Shown shown[3]; float weight[3]; int count; bool cut; };

float angleBetween(vec3 a, vec3 b) { return atan(length(cross(a, b)), dot(a, b)); }

Sight sightOf(vec3 point, vec3 eye) {
  Sight s;
  s.count = 0;
  s.cut = false;
  vec3 wanted = eye - point;
  float angles[CANDIDATES];
  int order[CANDIDATES];
  for (int k = 0; k < candidates; k++) {
    float a = angleBetween(viewCentre[k] - point, wanted);
    int j = k;
    for (; j > 0 && angles[j - 1] > a; j--) {
      angles[j] = angles[j - 1];
      order[j] = order[j - 1];
    }
    angles[j] = a;
    order[j] = k;
  }
  // Angles of those that see the point; the one after those interpolated sets where weights end.
  float seen[4];
  float confidences[3];
  int found = 0;
  for (int k = 0; k < candidates && found <= blended; k++) {
    Shown shown;
    float confidence;
    int sight = look(order[k], point, found < blended, shown, confidence);
    if (sight == SEEN) {
      seen[found] = angles[k];
      if (found < blended) {
        s.shown[found] = shown;
        confidences[found] = confidence;
      }
      found++;
      // At a captured camera that view alone.
      if (seen[0] < 1e-6) break;
    } else if (sight == CUT && found == 0) {
      s.cut = true;
    }
  }
  s.count = min(found, blended);
  if (s.count == 0) return s;
  float total = 0.0;
  bool exact = seen[0] < 1e-6;
  float last = max(found > blended ? seen[blended] : 1.5 * seen[found - 1], 1e-9);
  for (int k = 0; k < s.count; k++) {
    float weight = exact ? (k == 0 ? 1.0 : 0.0) : max(1.0 - seen[k] / last, 1e-9) / seen[k];
    s.weight[k] = weight * confidences[k];
    total += s.weight[k];
  }
  for (int k = 0; k < s.count; k++) s.weight[k] /= total;
  return s;
}

const int FREE = 0;
const int NEGATIVE = 1;
const int ALL = 2;

/** The residual of a component where its model is the given one; scaled by the irradiance, a bounded one at most by the models' ratio. */
vec3 residualOf(Sight s, int component, vec3 model, vec3 irradiance, int bound) {
  if (s.count == 0) return vec3(0.0);
  vec3 sum = vec3(0.0);
  for (int k = 0; k < s.count; k++) {
    vec3 photograph = s.shown[k].photograph[component], captured = s.shown[k].model[component];
    vec3 rest = photograph - captured;
    for (int c = 0; c < 3; c++) {
      bool bounded = bound == ALL || (bound == NEGATIVE && rest[c] < 0.0);
      float scale = bounded && captured[c] > 0.0 ? min(irradiance[c], model[c] / captured[c]) : irradiance[c];
      float radiance = model[c] + scale * rest[c];
      sum[c] += s.weight[k] * sign(radiance) * sqrt(abs(radiance));
    }
  }
  return sum * abs(sum) - model;
}

/** Smallest cosine to a light under which a surface is lit in full. */
const float GRAZING = 0.2;
/** Smallest cosine to its camera at which a photograph counts in full. */
const float EDGE = 0.35;
/** Lit shares below this are alike. */
const float DARK = 0.05;
/** Distance within which a photograph tells what shines where no light falls. */
const float NEARLY_SAME = 0.2;
/** Distances, by component, from which on photographs say nothing. */
uniform float farthest[2];

/** How unlike directions to light and camera are, for diffuse reflection or for highlights. */
float unlike(vec3 light, vec3 view, vec3 otherLight, vec3 otherView, bool diffuse) {
  vec3 l = light - otherLight, v = view - otherView, h = normalize(light + view) - normalize(otherLight + otherView);
  return sqrt(diffuse ? dot(l, l) + dot(v, v) : dot(h, h) + 0.01 * (dot(l, l) + dot(v, v)));
}

/** Each component's radiance under a light and from a camera that were not captured: spec/rendering.md, "Point lights". */
struct Lit { vec3 radiance[2]; bool cut; };

Lit between(vec3 point, vec3 normal, vec3 eye, PointLight light, float reach, vec3 models[2], int parts[2]) {
  vec3 gap = light.position - point, l = normalize(gap), v = normalize(eye - point);
  vec3 irradiance = light.intensity / dot(gap, gap) * unit;
  float lit = reach * clamp(dot(l, normal) / GRAZING, 0.0, 1.0);
  Lit result;
  float totals[2] = float[2](0.0, 0.0);
  for (int c = 0; c < COMPONENTS; c++) {
    totals[c] = parts[c] == 0 ? 0.0625 : 6.25;
    result.radiance[c] = totals[c] * sqrt(max(models[c], 0.0));
  }
  float nearestSeen = 10.0, nearestCut = 10.0;
  for (int k = 0; k < candidates; k++) {
    vec3 otherGap = viewLight[k].position - point, otherLight = normalize(otherGap), otherView = normalize(viewCentre[k] - point);
    float apart[2], near[2];
    bool counts = false;
    for (int c = 0; c < COMPONENTS; c++) {
      apart[c] = max(unlike(l, v, otherLight, otherView, parts[c] == 0), 1e-6);
      near[c] = max(1.0 / apart[c] - 1.0 / farthest[c], 0.0);
      counts = counts || near[c] > 0.0;
    }
    counts = counts && (blended > 1 || k == 0);
    Shown shown;
    float confidence, away = angleBetween(viewCentre[k] - point, v);
    int sight = look(k, point, counts, shown, confidence);
    if (sight == CUT) nearestCut = min(nearestCut, away);
    if (sight != SEEN) continue;
    nearestSeen = min(nearestSeen, away);
    if (!counts) continue;
    vec3 otherIrradiance = viewLight[k].intensity / dot(otherGap, otherGap) * unit;
    float facing = clamp(dot(otherView, normal) / EDGE, 0.1, 1.0);
    float otherLit = shown.reach * clamp(dot(otherLight, normal) / GRAZING, 0.0, 1.0);
    float alike = 1.0 - abs(lit - otherLit), share = min((lit + DARK) / (otherLit + DARK), 1.0);
    for (int c = 0; c < COMPONENTS; c++) {
      bool diffuse = parts[c] == 0;
      float weight = near[c] * near[c] * alike * alike * confidence * facing * facing;
      float least = diffuse ? 0.02 : 0.005;
      vec3 here = max(min(0.5 * lit / DARK, 1.0), 1.0 - min(apart[c] / NEARLY_SAME, 1.0)) * least * irradiance;
      vec3 there = least * otherIrradiance;
      vec3 expected = shown.model[c] * shown.reach + there;
      vec3 radiance = (models[c] + here) * ((shown.photograph[c] + there) / max(expected, 1e-20)) - here;
      radiance = mix(models[c], radiance, share);
      for (int i = 0; i < 3; i++) {
        float value = expected[i] > 0.0 ? radiance[i] : models[c][i];
        result.radiance[c][i] += weight * sign(value) * sqrt(abs(value));
      }
      totals[c] += weight;
    }
  }
  for (int c = 0; c < COMPONENTS; c++) {
    vec3 mean = result.radiance[c] / totals[c];
    result.radiance[c] = mean * abs(mean);
  }
  result.cut = nearestCut < nearestSeen;
  return result;
}
`;

/** A mesh in the stream's world, seen by any camera. */
export const vertex = /* glsl */ `
/** From the mesh's own positions to the stream's world, and what that does to normals. */
uniform mat4 toStream;
uniform mat3 normalToStream;
/** From the mesh's texture coordinates to the atlas. */
uniform mat3 atlasTransform;
attribute vec2 atlas;
varying vec3 vPoint;
varying vec3 vNormal;
varying vec2 vAtlas;
varying float vDepth;
#if BEHIND
/** 1 of the mesh that is drawn where its finer surface is not. */
attribute float behind;
#endif
#if VISIBILITY > 0
// Weights of the visibility's terms, four by four.
OCCLUSION_ATTRIBUTES
varying vec4 vOcclusion[VISIBILITY];
#endif

void main() {
  vPoint = (toStream * vec4(position, 1.0)).xyz;
  vNormal = normalToStream * normal;
  vAtlas = (atlasTransform * vec3(atlas, 1.0)).xy;
#if VISIBILITY > 0
  OCCLUSION_ASSIGNMENTS
#endif
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  vDepth = -seen.z;
  gl_Position = projectionMatrix * seen;
#if BEHIND
  // Near the far plane.
  if (behind > 0.5) gl_Position.z = gl_Position.w - (gl_Position.w - gl_Position.z) / 64.0;
#endif
}
`;

/** A picture's pixel: model and residual under the capture's light, point lights, or an environment. */
export const fragment = /* glsl */ `
varying vec3 vPoint;
varying vec3 vNormal;
varying vec2 vAtlas;
varying float vDepth;

/** From a pixel to its ray in the stream's world, depth 1. */
uniform mat3 rays;
uniform bool perspective;
/** 0: the capture's light, 1: point lights, 2: from all around, 3: the capture's light, from where no view was captured. */
uniform int lighting;
uniform PointLight captureLight;
uniform PointLight lights[LIGHTS];
uniform int lightCount;
/** What each component is: 0 diffuse, 1 specular, 2 both together. */
uniform int kinds[2];
uniform bool showDiffuse;
uniform bool showSpecular;
uniform bool showModel;
uniform bool showResidual;
/** Shows the residual about a middle grey. */
uniform bool signedResidual;
uniform bool cutByMasks;
uniform float exposure;
vec3 partOf(Parts parts, int kind) {
  return kind == 0 ? parts.diffuse : kind == 1 ? parts.specular : parts.diffuse + parts.specular;
}

void main() {
  vec3 point = perspective ? eye + vDepth * (rays * vec3(gl_FragCoord.xy, 1.0)) : vPoint;
  vec3 normal = normalize(vNormal);
  Maps maps = mapsAt(vAtlas);
  Sight sight;
  sight.count = 0;
  sight.cut = false;
  if (lighting != 3 && (showResidual || cutByMasks)) sight = sightOf(point, eye);
  if (sight.cut && cutByMasks) discard;
  Geometry underCapture = geometryOf(point, normal, eye, captureLight);
  Parts captured = modelOf(maps, underCapture);
  vec3 sum = vec3(0.0);
  if (lighting == 3) {
    float reach = reachOf(0, point, underCapture.cosLight);
    vec3 models[2] = vec3[2](vec3(0.0), vec3(0.0)), values[2] = models;
    int parts[2] = kinds;
    // A photograph of both together has a residual of both only.
    for (int k = 0; k < COMPONENTS; k++) {
      if (kinds[k] == 2 && showDiffuse != showSpecular) parts[k] = showDiffuse ? 0 : 1;
      models[k] = reach * partOf(captured, parts[k]);
    }
    Lit lit = between(point, normal, eye, captureLight, reach, models, parts);
    if (lit.cut && cutByMasks) discard;
    for (int k = 0; k < COMPONENTS; k++) {
      bool whole = parts[k] == kinds[k];
      if (whole && !(kinds[k] == 1 ? showSpecular : showDiffuse)) continue;
      vec3 radiance = whole && showResidual ? lit.radiance[k] : models[k];
      values[k] = showModel ? radiance : radiance - models[k];
    }
    sum = signedResidual ? values[0] + values[1] : max(values[0], 0.0) + max(values[1], 0.0);
  } else
#if ENVIRONMENT
  if (lighting == 2) {
    Parts around = environmentOf(point, normal, maps);
    if (showResidual && kinds[0] != 1) {
      vec3 model = partOf(captured, kinds[0]), dim = vec3(0.02);
      vec3 shown = max(model + residualOf(sight, 0, model, vec3(1.0), FREE), 0.0);
      around.diffuse *= sight.count > 0 ? clamp((shown + dim) / (model + dim), 0.5, 2.0) : vec3(1.0);
    }
    if (showDiffuse) sum += around.diffuse;
    if (showSpecular) sum += around.specular;
  } else
#endif
  {
    vec3 values[2] = vec3[2](vec3(0.0), vec3(0.0));
    int count = lighting == 0 ? 1 : lightCount;
    for (int j = 0; j < count; j++) {
      Parts parts = captured;
      vec3 ratio = vec3(1.0);
      float reach = 1.0;
      if (lighting == 1) {
        Geometry lit = geometryOf(point, normal, eye, lights[j]);
        if (lit.cosLight <= 0.0) continue;
        parts = modelOf(maps, lit);
        reach = reachOf(j, point, lit.cosLight);
        float fade = min(lit.cosLight / GRAZING, 1.0);
        for (int c = 0; c < 3; c++)
          ratio[c] = underCapture.irradiance[c] > 0.0 ? fade * lit.irradiance[c] / underCapture.irradiance[c] : 0.0;
      }
      for (int k = 0; k < COMPONENTS; k++) {
        int kind = kinds[k], part = kind;
        bool whole = kind == 1 ? showSpecular : showDiffuse;
        // A photograph of both together has a residual of both only.
        if (kind == 2 && showDiffuse != showSpecular) {
          part = showDiffuse ? 0 : 1;
          whole = false;
        }
        if (part == kind && !whole) continue;
        vec3 model = partOf(parts, part);
        int bound = lighting == 1 ? ALL : kind == 1 ? NEGATIVE : FREE;
        vec3 value = showModel ? model : vec3(0.0);
        if (showResidual && whole) value += residualOf(sight, k, model, ratio, bound);
        values[k] += reach * value;
      }
    }
    sum = signedResidual ? values[0] + values[1] : max(values[0], 0.0) + max(values[1], 0.0);
  }
  sum *= exposure;
  if (signedResidual) sum = 0.2140 + 0.5 * sum;
  gl_FragColor = vec4(sum, 1.0);
  #include <tonemapping_fragment>
  #include <colorspace_fragment>
}
`;
