// Stage: where the room of a visitor with a headset is in the scene.

class Stage {
  /**
   * The visitor's head is at the camera, and looks where it does, but level.
   * @param head pose of the head in the room, of WebXR.
   * @param metre units of the scene that are a metre of the room.
   */
  constructor({ position, axes, up }, head, metre) {
    this.up = up;
    this.metre = metre;
    const from = level(axesOf(head), [0, 1, 0]), to = level(axes, up);
    // Directions of the room's x, y and z in the scene.
    this.axes = [0, 1, 2].map((k) =>
      to.reduce((sum, axis, i) => plus(sum, axis, from[i][k]), [0, 0, 0]));
    this.#hold(head, position);
  }

  /** Place and axes of an eye or a head in the scene, as a camera has them. */
  seen(pose) {
    return {
      position: plus(this.origin, this.#direction(placeOf(pose)), this.metre),
      axes: axesOf(pose).map((axis) => this.#direction(axis)),
    };
  }

  /** Turn the visitor to the left, by an angle in radians. */
  turn(head, angle) {
    const { position } = this.seen(head);
    this.axes = this.axes.map((axis) => turned(axis, this.up, angle));
    this.#hold(head, position);
  }

  /** Make the scene larger, by a factor; the head stays where it is. */
  enlarge(head, factor) {
    const { position } = this.seen(head);
    this.metre /= factor;
    this.#hold(head, position);
  }

  /** Move the visitor, in metres, by the axes of the head. */
  fly(head, right, forward) {
    const { axes } = this.seen(head);
    const moved = plus(times(axes[0], right), axes[2], forward);
    this.origin = plus(this.origin, moved, this.metre);
  }

  #direction(vector) {
    return this.axes.reduce((sum, axis, k) => plus(sum, axis, vector[k]), [0, 0, 0]);
  }

  /** Put the room where its head is at a position of the scene. */
  #hold(head, position) {
    this.origin = plus(position, this.#direction(placeOf(head)), -this.metre);
  }
}

const placeOf = ({ position: { x, y, z } }) => [x, y, z];

/** Axes of a pose of WebXR as cameras have them: to the right, down, forward. */
const axesOf = ({ matrix: m }) => [
  [m[0], m[1], m[2]], [-m[4], -m[5], -m[6]], [-m[8], -m[9], -m[10]],
];

/** The heading of some axes without their pitch and roll: to the right, up, forward. */
function level([, down, forward], up) {
  const flat = (direction) => plus(direction, up, -dot(direction, up));
  let ahead = flat(forward);
  // Straight down, the upper edge of the image is ahead; straight up, the lower one.
  if (length(ahead) < 0.05) ahead = flat(times(down, dot(forward, up)));
  ahead = unit(ahead);
  return [cross(ahead, up), up, ahead];
}
