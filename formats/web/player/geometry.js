// Vectors are arrays of three numbers; rotations are three rows; quaternions are wxyz.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, b, factor = 1) => a.map((value, k) => value + factor * b[k]);
const minus = (a, b) => plus(a, b, -1);
const times = (a, factor) => a.map((value) => value * factor);
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
const length = (a) => Math.hypot(...a);
const unit = (a) => times(a, 1 / Math.max(length(a), 1e-30));

/** A vector turned around a unit axis (Rodrigues). */
function turned(a, axis, angle) {
  const cosine = Math.cos(angle);
  const along = plus(times(a, cosine), cross(axis, a), Math.sin(angle));
  return plus(along, axis, dot(axis, a) * (1 - cosine));
}

/** The quaternion of a rotation. */
function quaternion([[a, b, c], [d, e, f], [g, h, i]]) {
  const squares = [1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i];
  const largest = squares.indexOf(Math.max(...squares));
  const all = [
    [squares[0], h - f, c - g, d - b],
    [h - f, squares[1], b + d, c + g],
    [c - g, b + d, squares[2], f + h],
    [d - b, c + g, f + h, squares[3]],
  ][largest];
  return times4(all, 1 / Math.hypot(...all));
}

const times4 = (q, factor) => q.map((value) => value * factor);

/** The rotation of a unit quaternion. */
function rows([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
}

/** The rotation a part of the way from one to another. */
function between(from, to, part) {
  const a = quaternion(from);
  let b = quaternion(to);
  if (a.reduce((sum, value, k) => sum + value * b[k], 0) < 0) b = times4(b, -1);
  const mixed = a.map((value, k) => value + part * (b[k] - value));
  return rows(times4(mixed, 1 / Math.hypot(...mixed)));
}
