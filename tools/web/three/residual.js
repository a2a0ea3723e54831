// What photographs have beyond the model at a surface point, in GLSL: spec/rendering.md.

/** Captured views that a surface point may look at. */
export const CANDIDATES = 8;

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
