// What is drawn before the picture, in GLSL: captured views with their models and depth, layers of the array, depth from the lights.

/** Draws the stream's surface as a captured view's camera sees it: models and depth, row 0 at the top of the photograph. */
export const captureVertex = /* glsl */ `
in vec3 position;
in vec3 normal;
in vec2 atlas;
#if BEHIND
in float behind;
#endif
uniform vec4 rows[3];
uniform vec4 lens;
uniform vec2 size;
uniform vec2 range;
out vec3 vNormal;
out vec2 vAtlas;
out float vDepth;
void main() {
  vec4 p = vec4(position, 1.0);
  vec3 q = vec3(dot(rows[0], p), dot(rows[1], p), dot(rows[2], p));
  vNormal = normal;
  vAtlas = atlas;
  vDepth = q.z;
  vec2 at = lens.xy * q.xy + lens.zw * q.z;
  gl_Position = vec4(2.0 * at / size - q.z, (2.0 * range.x * range.y / (range.x - range.y)) + q.z * (range.y + range.x) / (range.y - range.x), q.z);
#if BEHIND
  // The mesh stands behind its finer surface near the far plane, and casts no shadow.
  if (behind > 0.5) gl_Position.z = SHADOW == 1 ? 2.0 * abs(gl_Position.w) : gl_Position.w - (gl_Position.w - gl_Position.z) / 64.0;
#endif
}
`;

export const captureFragment = /* glsl */ `
in vec3 vNormal;
in vec2 vAtlas;
in float vDepth;
uniform vec4 rows[3];
uniform vec4 lens;
uniform vec3 centre;
/** Depths are stored as (depth - x) / y. */
uniform vec2 depthScale;
uniform PointLight light;
uniform int kinds[2];
layout(location = 0) out vec4 first;
layout(location = 1) out vec4 second;
void main() {
  vec3 ray = vec3((gl_FragCoord.xy - lens.zw) / lens.xy, 1.0);
  vec3 point = centre + vDepth * (ray.x * rows[0].xyz + ray.y * rows[1].xyz + ray.z * rows[2].xyz);
  Geometry geometry = geometryOf(point, normalize(vNormal), centre, light);
  Parts parts = modelOf(mapsAt(vAtlas), geometry);
  vec3 both = parts.diffuse + parts.specular;
  vec3 a = kinds[0] == 0 ? parts.diffuse : kinds[0] == 1 ? parts.specular : both;
  vec3 b = kinds[1] == 0 ? parts.diffuse : kinds[1] == 1 ? parts.specular : both;
  first = vec4(a, (vDepth - depthScale.x) / depthScale.y);
  second = vec4(b, reachOf(0, point, geometry.cosLight));
}
`;

/** Puts one view into its layer: \`part\` 0 and 2 the photographs, the first with how far each pixel can be trusted; 1 and 3 the models. */
export const layerFragment = /* glsl */ `
uniform sampler2D photograph;
uniform sampler2D model;
/** a: share of the view's light. */
uniform sampler2D secondModel;
uniform ivec2 size;
/** Focal length in pixels, and what depths are stored relative to. */
uniform vec3 lens;
uniform int part;
/** To units of the white board. */
uniform vec3 scale;
layout(location = 0) out vec4 value;

float depthAt(ivec2 at) { return texelFetch(model, at, 0).a * lens.z + lens.y; }
bool covered(ivec2 at) { return texelFetch(model, at, 0).a > -1000.0; }
bool inside(ivec2 at) { return at.x >= 0 && at.y >= 0 && at.x < size.x && at.y < size.y; }

/** 0: says nothing, 1: beside an edge of depth, 4: neither. */
float stateAt(ivec2 at) {
  vec4 seen = texelFetch(photograph, at, 0);
  bool finite = all(lessThan(abs(seen.rgb), vec3(1e30)));
  if (!covered(at) || seen.a < 0.5 || !finite) return 0.0;
  float depth = depthAt(at), margin = 6.0 / abs(lens.x) * depth;
  for (int k = 0; k < 4; k++) {
    ivec2 beside = at + ivec2(k == 0 ? 1 : k == 1 ? -1 : 0, k == 2 ? 1 : k == 3 ? -1 : 0);
    if (inside(beside) && covered(beside) && abs(depthAt(beside) - depth) > margin) return 1.0;
  }
  return 4.0;
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  if (!inside(at)) discard;
  if (part == 1 || part == 3) {
    value = texelFetch(model, at, 0);
    return;
  }
  vec4 seen = texelFetch(photograph, at, 0);
  value = vec4(all(lessThan(abs(seen.rgb), vec3(1e30))) ? clamp(seen.rgb * scale, -60000.0, 60000.0) : vec3(0.0), 1.0);
  if (part == 2) return;
  // Steps to the nearest pixel that says nothing.
  float ring = 4.0;
  for (int y = -3; y <= 3; y++) {
    for (int x = -3; x <= 3; x++) {
      int steps = abs(x) + abs(y);
      ivec2 near = at + ivec2(x, y);
      if (steps <= 3 && inside(near)) ring = min(ring, stateAt(near) + float(steps));
    }
  }
  value.a = seen.a < 0.5 ? -1.0 : ring + 0.5 * clamp(texelFetch(secondModel, at, 0).a, 0.0, 1.0);
}
`;

export const fullVertex = /* glsl */ `
in vec3 position;
void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }
`;

/** Depth of the mesh from a light. */
export const shadowFragment = /* glsl */ `
in float vDepth;
uniform vec2 depthScale;
layout(location = 0) out vec4 value;
void main() { value = vec4((vDepth - depthScale.x) / depthScale.y, 0.0, 0.0, 1.0); }
`;
