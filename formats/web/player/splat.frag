#version 300 es
precision highp float;

flat in vec4 tint;
in vec2 place;
out vec4 color;

void main() {
  float alpha = min(0.99, tint.a * exp(-0.5 * dot(place, place)));
  if (alpha < 1.0 / 255.0) discard;
  color = vec4(tint.rgb * alpha, alpha);
}
