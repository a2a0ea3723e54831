// What a surface point shows, in GLSL, of the model (`reflectance.js`) and of photographs (`residual.js`): spec/rendering.md.

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
