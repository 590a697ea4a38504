// Sorter (in the worker): the rows that are visible, from back to front.

const BUCKETS = 1 << 16;

class Sorter {
  #counts = new Uint32Array(BUCKETS + 1);

  constructor({ rows, moving, radius }, limit) {
    this.count = 0;
    this.positions = new Float32Array(3 * limit);
    this.alphas = new Uint8Array(limit);
    this.motion = moving ? new Float32Array(MOTION * limit) : null;
    this.radius = radius;
    this.#depths = new Float32Array(limit);
    this.#bits = new Uint32Array(this.#depths.buffer);
    this.#members = new Uint32Array(limit);
  }

  #depths;
  #bits;
  #members;

  add({ first, count, positions, alpha, motion }) {
    this.positions.set(positions, 3 * first);
    this.alphas.set(alpha, first);
    if (motion) this.motion.set(motion.subarray(0, MOTION * count), MOTION * first);
    this.count = first + count;
  }

  /** Position of a row at a time, and its opacity in steps of 1/255; 0 while it is absent. */
  #at(row, time, place) {
    place[0] = this.positions[3 * row];
    place[1] = this.positions[3 * row + 1];
    place[2] = this.positions[3 * row + 2];
    if (!this.motion) return this.alphas[row];
    const m = this.motion, k = MOTION * row;
    if (time < m[k + 2] || time >= m[k + 3]) return 0;
    const d = time - m[k], fade = d * m[k + 1];
    for (let axis = 0; axis < 3; axis++) {
      place[axis] += d * (m[k + 4 + axis] + d * (m[k + 7 + axis] + d * m[k + 10 + axis]));
    }
    return this.alphas[row] * Math.exp(-fade * fade);
  }

  /**
   * Rows in front of the camera, the farthest first, and their number; of the first
   * `most` rows. A counting sort over the bits of their depths: as integers, positive floats
   * keep their order, and equal steps of them are equal ratios, so that a far sky takes nothing
   * from the precision near by.
   */
  sort({ eye, forward, near, most, time }) {
    const { positions, motion } = this, count = Math.min(this.count, most);
    const depths = this.#depths, bits = this.#bits, members = this.#members;
    const [fx, fy, fz] = forward;
    const shift = fx * eye[0] + fy * eye[1] + fz * eye[2];
    const place = [0, 0, 0];
    let found = 0, low = 0xffffffff, high = 0;
    for (let row = 0; row < count; row++) {
      let depth;
      if (motion) {
        if (this.#at(row, time, place) < 1) continue;
        depth = fx * place[0] + fy * place[1] + fz * place[2] - shift;
      } else {
        depth = fx * positions[3 * row] + fy * positions[3 * row + 1]
          + fz * positions[3 * row + 2] - shift;
      }
      if (!(depth >= near)) continue;
      depths[found] = depth;
      const key = bits[found];
      if (key < low) low = key;
      if (key > high) high = key;
      members[found++] = row;
    }
    return this.#ordered(found, low, high);
  }

  #ordered(found, low, high) {
    const counts = this.#counts.fill(0), bits = this.#bits, members = this.#members;
    let drop = 0;
    while (((high - low) >>> drop) >= BUCKETS) drop++;
    const top = (high - low) >>> drop;
    for (let k = 0; k < found; k++) counts[top - ((bits[k] - low) >>> drop) + 1]++;
    for (let k = 1; k <= top; k++) counts[k] += counts[k - 1];
    const order = new Uint32Array(Math.ceil(found / ORDER) * ORDER);
    for (let k = 0; k < found; k++) {
      order[counts[top - ((bits[k] - low) >>> drop)]++] = members[k];
    }
    return { order, count: found };
  }

  /** The nearest place along a ray that looks solid; null if it meets nothing. */
  pick({ eye, direction, time }) {
    const place = [0, 0, 0];
    let nearest = Infinity;
    for (let row = 0; row < this.count; row++) {
      if (this.#at(row, time, place) < 64) continue;
      const away = minus(place, eye), depth = dot(away, direction);
      if (depth <= 0 || depth >= nearest) continue;
      if (length(plus(away, direction, -depth)) < 0.012 * depth) nearest = depth;
    }
    return nearest < Infinity ? plus(eye, direction, nearest) : null;
  }
}
