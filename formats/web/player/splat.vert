#version 300 es
// One splat as a quad around its ellipse: Kerbl et al. 2023, equations 5 and 6, with the constants
// of gsfw's own rasterizers (core/numerics.py).
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp sampler2D;

uniform usampler2D order;      // Rows from back to front; the first `count` are drawn.
uniform uint count;
uniform usampler2D base;
uniform usampler2D harmonics;
uniform sampler2D motion;
uniform mat3 rotation;         // From the world to the camera: x right, y down, z forward.
uniform vec3 eye;              // Relative to the origin of the file, as all positions.
uniform vec2 focal, middle, size;  // Pixels.
uniform float near, time;
uniform vec2 colorSteps, scaleSteps;  // Low end and step.
uniform float shStep;
uniform bool compensated;

flat out vec4 tint;
out vec2 place;                // In standard deviations from the centre.

const float ALPHA_MIN = 1.0 / 255.0;
const float DILATION = 0.3;
const float MARGIN = 0.3;
const float COMPENSATION_MIN = 0.005;
const float SHORTEST = 1e-12;

uint row;

ivec2 texel(uint width, uint index) {
  return ivec2((row % ROW) * width + index, row / ROW);
}

vec3 bytes(uint word) {
  return vec3(word & 255u, (word >> 8) & 255u, (word >> 16) & 255u);
}

vec4 smallestThree(uint word) {
  uint largest = word >> 30;
  vec3 three = (vec3((word >> 20) & 1023u, (word >> 10) & 1023u, word & 1023u) / 511.0 - 1.0)
      * 0.70710678;
  float rest = sqrt(max(0.0, 1.0 - dot(three, three)));
  if (largest == 0u) return vec4(rest, three);
  if (largest == 1u) return vec4(three.x, rest, three.yz);
  if (largest == 2u) return vec4(three.xy, rest, three.z);
  return vec4(three, rest);
}

mat3 matrix(vec4 q) {          // Of a unit quaternion, wxyz.
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(
      1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
      2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
      2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

#if DEGREE > 0
// What the view adds to the colour, in direction d from the camera.
vec3 shade(vec3 d) {
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  float basis[24];
  basis[0] = -0.4886025119 * y;
  basis[1] = 0.4886025119 * z;
  basis[2] = -0.4886025119 * x;
#if DEGREE > 1
  basis[3] = 1.0925484306 * x * y;
  basis[4] = -1.0925484306 * y * z;
  basis[5] = 0.3153915653 * (2.0 * zz - xx - yy);
  basis[6] = -1.0925484306 * x * z;
  basis[7] = 0.5462742153 * (xx - yy);
#endif
#if DEGREE > 2
  basis[8] = -0.5900435899 * y * (3.0 * xx - yy);
  basis[9] = 2.8906114426 * x * y * z;
  basis[10] = -0.4570457995 * y * (4.0 * zz - xx - yy);
  basis[11] = 0.3731763326 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
  basis[12] = -0.4570457995 * x * (4.0 * zz - xx - yy);
  basis[13] = 1.4453057213 * z * (xx - yy);
  basis[14] = -0.5900435899 * x * (xx - 3.0 * yy);
#endif
#if DEGREE > 3
  basis[15] = 2.5033429418 * x * y * (xx - yy);
  basis[16] = -1.7701307698 * y * z * (3.0 * xx - yy);
  basis[17] = 0.9461746958 * x * y * (7.0 * zz - 1.0);
  basis[18] = -0.6690465436 * y * z * (7.0 * zz - 3.0);
  basis[19] = 0.1057855469 * (zz * (35.0 * zz - 30.0) + 3.0);
  basis[20] = -0.6690465436 * x * z * (7.0 * zz - 3.0);
  basis[21] = 0.4730873479 * (xx - yy) * (7.0 * zz - 1.0);
  basis[22] = -1.7701307698 * x * z * (xx - 3.0 * yy);
  basis[23] = 0.6258357354 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy));
#endif
  const uint coefficients = uint((DEGREE + 1) * (DEGREE + 1) - 1);
  const uint width = (coefficients + 3u) / 4u;
  vec3 sum = vec3(0.0);
  for (uint group = 0u; group < width; group++) {
    uvec4 words = texelFetch(harmonics, texel(width, group), 0);
    for (uint k = 0u; k < 4u && group * 4u + k < coefficients; k++) {
      int word = int(words[k]);
      vec3 coefficient = vec3((word << 24) >> 24, (word << 16) >> 24, (word << 8) >> 24);
      sum += basis[group * 4u + k] * coefficient;
    }
  }
  return sum * shStep;
}
#endif

void main() {
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);  // Outside, until the splat is found to be visible.
  place = vec2(0.0);
  tint = vec4(0.0);

  uint number = uint(gl_InstanceID) * GROUP + uint(gl_VertexID) / 4u;
  if (number >= count) return;
  row = texelFetch(order, ivec2(number % ORDER, number / ORDER), 0).x;
  uvec4 first = texelFetch(base, texel(2u, 0u), 0);
  uvec2 second = texelFetch(base, texel(2u, 1u), 0).xy;
  vec3 center = uintBitsToFloat(first.xyz);
  float opacity = float(first.w >> 24) / 255.0;
  vec4 quaternion = smallestThree(second.x);
  vec3 logScale = scaleSteps.x + scaleSteps.y * bytes(second.y);

#ifdef MOVING
  vec4 when = texelFetch(motion, texel(5u, 0u), 0);  // Centre, 1 / width, begin, end.
  if (time < when.z || time >= when.w) return;
  vec4 a = texelFetch(motion, texel(5u, 1u), 0);
  vec4 b = texelFetch(motion, texel(5u, 2u), 0);
  vec4 c = texelFetch(motion, texel(5u, 3u), 0);
  vec4 e = texelFetch(motion, texel(5u, 4u), 0);
  float d = time - when.x, fade = d * when.y;
  center += d * (a.xyz + d * (vec3(a.w, b.xy) + d * vec3(b.zw, c.x)));
  opacity *= exp(-fade * fade);
  quaternion += d * vec4(c.yzw, e.x);
  // A quaternion that passes through 0 has no direction there.
  quaternion = length(quaternion) < SHORTEST ? vec4(1.0, 0.0, 0.0, 0.0) : normalize(quaternion);
  logScale += d * e.yzw;
#endif

  vec3 seen = rotation * (center - eye);
  if (seen.z < near) return;
  vec3 scale = exp(logScale);
  mat3 axes = rotation * matrix(quaternion);
  axes[0] *= scale.x;
  axes[1] *= scale.y;
  axes[2] *= scale.z;
  vec2 slope = seen.xy / seen.z;
  vec2 beyond = MARGIN * 0.5 * size / focal;
  // Linearised far outside the image, a splat would smear across it.
  vec2 held = clamp(slope, -middle / focal - beyond, (size - middle) / focal + beyond);
  vec2 zoom = focal / seen.z;
  vec3 across = zoom.x * (transpose(axes)[0] - held.x * transpose(axes)[2]);
  vec3 down = zoom.y * (transpose(axes)[1] - held.y * transpose(axes)[2]);
  vec3 normal = cross(across, down);
  float xx = dot(across, across), xy = dot(across, down), yy = dot(down, down);
  float area = dot(normal, normal);
  float dilated = area + DILATION * (xx + yy) + DILATION * DILATION;
  if (compensated) opacity *= sqrt(max(area / dilated, COMPENSATION_MIN * COMPENSATION_MIN));
  if (!(opacity >= ALPHA_MIN)) return;
  xx += DILATION;
  yy += DILATION;

  float reach = sqrt(2.0 * log(opacity / ALPHA_MIN));
  vec2 pixel = focal * slope + middle;
  vec2 extent = reach * sqrt(vec2(xx, yy));
  if (any(greaterThan(pixel - extent, size)) || any(lessThan(pixel + extent, vec2(0.0)))) return;

  float half_ = 0.5 * (xx - yy), turn = length(vec2(half_, xy));
  float large = 0.5 * (xx + yy) + turn, small = dilated / large;
  vec2 axis = vec2(1.0, 0.0);
  if (turn > 1e-6 * large) {
    axis = normalize(half_ >= 0.0 ? vec2(half_ + turn, xy) : vec2(xy, turn - half_));
  }
  vec2 corner = vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) * 2.0 - 1.0;
  place = corner * reach;
  pixel += place.x * sqrt(large) * axis + place.y * sqrt(small) * vec2(-axis.y, axis.x);
  gl_Position = vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);

  vec3 color = colorSteps.x + colorSteps.y * bytes(first.w);
#if DEGREE > 0
  color += shade(normalize(center - eye));
#endif
  tint = vec4(max(color, 0.0), opacity);
}
