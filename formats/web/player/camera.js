// Camera: a pose in the file's world, and the point that it turns around.

class Camera {
  /** @param scene header of the file. */
  constructor(scene) {
    this.origin = scene.origin;
    this.near = 0.005 * scene.radius || 1e-3;
    this.views = scene.views.map((view) => this.#view(view));
    const about = scene.target ? minus(scene.target, scene.origin) : [0, 0, 0];
    this.up = upDirection(scene.up) || this.#meanUp();
    if (!this.views.length) this.views = [this.#outside(scene.radius)];
    for (const view of this.views) {
      const ahead = dot(minus(about, view.position), view.axes[2]);
      view.distance = Math.max(ahead, 0.3 * scene.radius, 1e-3);
    }
    this.take(this.views[0]);
  }

  /** Go to a view at once; a path to another one ends. */
  take(view) {
    this.position = view.position;
    this.axes = view.axes;
    this.distance = view.distance;
    this.lens = view.lens;
    this.exact = view.exact || false;
    this.path = null;
  }

  /** Travel to a view in some seconds; 0 for at once. */
  travel(view, seconds) {
    if (seconds <= 0) return this.take(view);
    const from = { position: this.position, axes: this.axes, distance: this.distance };
    this.exact = false;
    this.path = { from, to: view, seconds, passed: 0 };
  }

  /** Advance a journey; true while there is one. */
  advance(seconds) {
    if (!this.path) return false;
    const { from, to } = this.path;
    this.path.passed += seconds;
    const part = Math.min(1, this.path.passed / this.path.seconds);
    const eased = part * part * (3 - 2 * part);
    this.axes = between(from.axes, to.axes, eased);
    this.distance = from.distance + eased * (to.distance - from.distance);
    this.position = plus(from.position, minus(to.position, from.position), eased);
    if (part === 1) this.take(to);
    return true;
  }

  get target() {
    return plus(this.position, this.axes[2], this.distance);
  }

  /** Turn around the target: angles in radians, to the right and upwards. */
  orbit(right, up) {
    const target = this.target;
    this.#leave();
    const steep = Math.acos(Math.max(-1, Math.min(1, dot(this.axes[2], this.up))));
    const tilt = Math.max(steep - Math.PI + 0.05, Math.min(steep - 0.05, -up));
    this.axes = this.axes.map((axis) => turned(axis, this.axes[0], tilt));
    this.axes = this.axes.map((axis) => turned(axis, this.up, right));
    this.position = plus(target, this.axes[2], -this.distance);
  }

  /** Move, in multiples of the distance to the target: right, down, forward. */
  move(right, down, forward) {
    this.#leave();
    const step = [right, down, forward].map((part) => part * this.distance);
    step.forEach((part, k) => { this.position = plus(this.position, this.axes[k], part); });
  }

  /** Change the distance to the target by a factor. */
  zoom(factor) {
    const target = this.target;
    this.#leave();
    this.distance = Math.max(this.distance * factor, 4 * this.near);
    this.position = plus(target, this.axes[2], -this.distance);
  }

  /** A view that looks at a point from half of its distance, or from the present one. */
  towards(point) {
    const away = minus(point, this.position);
    const forward = unit(away);
    const right = unit(cross(forward, this.up));
    const distance = Math.max(Math.min(this.distance, 0.6 * length(away)), 4 * this.near);
    return {
      axes: [right, cross(forward, right), forward],
      distance,
      position: plus(point, forward, -distance),
      lens: this.lens,
    };
  }

  /** Focal lengths and principal point on a canvas of some pixels. */
  projection(width, height) {
    const [fx, fy, cx, cy] = this.lens.pixels;
    const [w, h] = this.lens.size;
    if (this.exact) return { focal: [fx, fy], middle: [cx, cy] };
    const zoom = fitted(w, h, width, height);
    return {
      focal: [fx * zoom, fy * zoom],
      middle: [width / 2 + (cx - w / 2) * zoom, height / 2 + (cy - h / 2) * zoom],
    };
  }

  /** The view of a camera in the data's world. */
  #view({ world_to_camera, lens, size }) {
    const axes = world_to_camera.slice(0, 3).map((row) => row.slice(0, 3));
    const shift = world_to_camera.map((row) => row[3]);
    const place = [0, 1, 2].map((k) => -(axes[0][k] * shift[0] + axes[1][k] * shift[1]
      + axes[2][k] * shift[2]));
    return { axes, position: minus(place, this.origin), lens: { pixels: lens, size } };
  }

  /** The view of exactly this camera, for an image of its own size. */
  exactly(world_to_camera, intrinsics, width, height) {
    const lens = [intrinsics[0][0], intrinsics[1][1], intrinsics[0][2], intrinsics[1][2]];
    const view = this.#view({ world_to_camera, lens, size: [width, height] });
    return { ...view, distance: this.distance, exact: true };
  }

  /** A view of a scene without cameras, from a little above. */
  #outside(radius) {
    const level = Math.abs(this.up[2]) > 0.5 ? [0, 1, 0] : [0, 0, 1];
    const forward = unit(plus(level, this.up, -0.35));
    const right = unit(cross(forward, this.up));
    return {
      axes: [right, cross(forward, right), forward],
      position: times(forward, -4 * (radius || 1)),
      lens: { pixels: [800, 800, 480, 360], size: [960, 720] },
    };
  }

  #meanUp() {
    const sum = this.views.reduce((up, view) => minus(up, view.axes[1]), [0, 0, 0]);
    return length(sum) > 1e-6 ? unit(sum) : [0, -1, 0];
  }

  #leave() {
    this.exact = false;
    this.path = null;
  }
}

/** "-y" as a vector; null unless it is an axis. */
function upDirection(name) {
  const found = /^([+-]?)([xyz])$/.exec(name);
  if (!found) return null;
  const up = [0, 0, 0];
  up["xyz".indexOf(found[2])] = found[1] === "-" ? -1 : 1;
  return up;
}

/** Scale at which all of an image is on a canvas; beside it, the canvas shows more of the scene. */
function fitted(width, height, canvasWidth, canvasHeight) {
  return Math.min(canvasWidth / width, canvasHeight / height);
}
