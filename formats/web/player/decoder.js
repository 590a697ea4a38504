// Decoder (in the worker): from the pieces of a scene file to arrays for textures.
// The layout of the file is described in formats/web/scene_file.py.

/** Bytes of a stream, as many at a time as wanted. */
class Bytes {
  #reader;
  #parts = [];
  #ready = 0;
  passed = 0;

  constructor(stream) {
    this.#reader = stream.getReader();
  }

  /** The next bytes; null if the stream has ended. */
  async take(count, progress = () => {}) {
    while (this.#ready < count) {
      const { value, done } = await this.#reader.read();
      if (done) return null;
      this.#parts.push(value);
      this.#ready += value.length;
      progress(this.passed + this.#ready);
    }
    const taken = new Uint8Array(count);
    let filled = 0;
    while (filled < count) {
      const part = this.#parts[0], wanted = count - filled;
      taken.set(part.subarray(0, wanted), filled);
      filled += Math.min(part.length, wanted);
      if (part.length > wanted) this.#parts[0] = part.subarray(wanted);
      else this.#parts.shift();
    }
    this.#ready -= count;
    this.passed += count;
    return taken;
  }
}

/** Read a file: calls found.header, found.block and found.progress; ends after `limit` rows. */
async function decode(stream, found) {
  const bytes = new Bytes(stream);
  const cut = () => new Error("The scene is cut short: its file ends too early.");
  const start = await bytes.take(8);
  if (!start) throw cut();
  if (String.fromCharCode(...start.subarray(0, 4)) !== "gsws") {
    throw new Error("This is no scene file of gsfw.");
  }
  const text = await bytes.take(new DataView(start.buffer).getUint32(4, true));
  if (!text) throw cut();
  const header = JSON.parse(new TextDecoder().decode(text));
  if (header.version !== 1) {
    throw new Error(`The scene has version ${header.version}; this player reads version 1.`);
  }
  const limit = found.header(header);
  const coefficients = (header.degree + 1) ** 2 - 1;
  const size = 20 + 3 * coefficients + (header.moving ? 3 * MOTION : 0);
  const all = limit * size;
  const progress = (passed) => found.progress(Math.min(1, passed / all));
  for (let first = 0; first < limit; first += header.block) {
    const count = Math.min(header.block, header.rows - first);
    const content = await bytes.take(count * size, progress);
    if (!content) throw cut();
    found.block(block(content, first, count, coefficients, header.moving));
  }
}

/** The arrays of a block, padded to whole rows of the textures. */
function block(content, first, count, coefficients, moving) {
  const padded = Math.ceil(count / ROW) * ROW;
  const positions = new Float32Array(3 * count);
  readPlanes(content, 0, count, 3, positions);
  const base = new Uint32Array(8 * padded);
  const floats = new Float32Array(base.buffer);
  const plane = (index) => content.subarray(index * count, (index + 1) * count);
  const [alpha, red, green, blue, one, two, three, q0, q1, q2, q3] =
    Array.from({ length: 11 }, (_, index) => plane(9 + index));
  for (let i = 0; i < count; i++) {
    floats.set(positions.subarray(3 * i, 3 * i + 3), 8 * i);
    base[8 * i + 3] = red[i] | (green[i] << 8) | (blue[i] << 16) | (alpha[i] << 24);
    base[8 * i + 4] = q0[i] | (q1[i] << 8) | (q2[i] << 16) | (q3[i] << 24);
    base[8 * i + 5] = one[i] | (two[i] << 8) | (three[i] << 16);
  }
  const sh = harmonics(content.subarray(20 * count), count, padded, coefficients);
  let motion = null;
  if (moving) {
    motion = new Float32Array(MOTION * padded);
    readPlanes(content, (20 + 3 * coefficients) * count, count, MOTION, motion);
  }
  return { first, count, positions, alpha: alpha.slice(), base, sh, motion };
}

/** Numbers of three bytes, plane by plane, to columns of an array. */
function readPlanes(content, start, count, columns, into) {
  const words = new Uint32Array(into.buffer);
  for (let column = 0; column < columns; column++) {
    const high = start + column * count;
    const middle = high + columns * count, low = middle + columns * count;
    for (let i = 0, at = column; i < count; i++, at += columns) {
      words[at] = (content[high + i] << 24) | (content[middle + i] << 16) | (content[low + i] << 8);
    }
  }
}

/** SH coefficients, one in a word, four in a texel. */
function harmonics(content, count, padded, coefficients) {
  const width = 4 * Math.ceil(coefficients / 4);
  const words = new Uint32Array(width * padded);
  for (let k = 0; k < coefficients; k++) {
    const red = 3 * k * count, green = red + count, blue = green + count;
    for (let i = 0, at = k; i < count; i++, at += width) {
      words[at] = content[red + i] | (content[green + i] << 8) | (content[blue + i] << 16);
    }
  }
  return words;
}
