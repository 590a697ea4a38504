// Renderer: splats as quads on a canvas, from back to front, over a background.

class Renderer {
  #gl;
  #uniforms = {};
  #textures = {};
  #count = 0;

  /** @throws Error if the browser has no WebGL 2. */
  constructor(canvas) {
    this.canvas = canvas;
    this.#gl = canvas.getContext("webgl2", {
      alpha: false, antialias: false, depth: false, powerPreference: "high-performance",
    });
    if (!this.#gl) {
      throw new Error("This browser cannot draw the scene: it has no WebGL 2, or it is turned off. "
        + "Any browser since 2022 has it; look for hardware acceleration in the settings.");
    }
  }

  /** Number of splats that the textures of this machine hold. */
  get capacity() {
    return this.#gl.getParameter(this.#gl.MAX_TEXTURE_SIZE) * ROW;
  }

  /** Reserve the textures of a scene. */
  prepare(header, limit) {
    const gl = this.#gl, height = Math.ceil(limit / ROW);
    this.header = header;
    this.#program(header);
    const words = { format: gl.RGBA32UI, as: gl.RGBA_INTEGER, type: gl.UNSIGNED_INT };
    const numbers = { format: gl.RGBA32F, as: gl.RGBA, type: gl.FLOAT };
    const coefficients = (header.degree + 1) ** 2 - 1;
    this.#texture("base", 0, 2, height, words);
    if (coefficients) this.#texture("harmonics", 1, Math.ceil(coefficients / 4), height, words);
    if (header.moving) this.#texture("motion", 2, 5, height, numbers);
    const rows = { format: gl.R32UI, as: gl.RED_INTEGER, type: gl.UNSIGNED_INT };
    this.#texture("order", 3, ORDER / ROW, Math.ceil(limit / ORDER), rows);
    this.#quads();
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  /** Take over a block of the file. */
  add({ first, base, sh, motion }) {
    const height = base.length / (8 * ROW);
    this.#fill("base", first / ROW, height, base);
    this.#fill("harmonics", first / ROW, height, sh);
    this.#fill("motion", first / ROW, height, motion);
  }

  /** Draw these rows from now on, the farthest first; the array is padded to whole lines. */
  follow(order, count) {
    this.#fill("order", 0, order.length / ORDER, order);
    this.#count = count;
  }

  get count() { return this.#count; }

  /** The context, for what a headset needs of it. */
  get context() { return this.#gl; }

  /**
   * Draw what some eyes see, each in its part of a framebuffer: x, y, width and height in pixels.
   * @param background red, green, blue, and how much it hides of what is behind the page.
   * @param framebuffer null for the canvas.
   */
  draw(eyes, time, background, framebuffer = null) {
    const gl = this.#gl, at = this.#uniforms;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.clearColor(...background);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (!this.#count) return;
    gl.uniform1f(at.time, time);
    gl.uniform1ui(at.count, this.#count);
    const groups = Math.ceil(this.#count / GROUP);
    for (const { axes, position, near, focal, middle, part } of eyes) {
      gl.viewport(...part);
      gl.uniformMatrix3fv(at.rotation, true, axes.flat());
      gl.uniform3fv(at.eye, position);
      gl.uniform2fv(at.focal, focal);
      gl.uniform2fv(at.middle, middle);
      gl.uniform2f(at.size, part[2], part[3]);
      gl.uniform1f(at.near, near);
      gl.drawElementsInstanced(gl.TRIANGLES, 6 * GROUP, gl.UNSIGNED_SHORT, 0, groups);
    }
  }

  #program(header) {
    const gl = this.#gl, program = gl.createProgram();
    const moving = header.moving ? "#define MOVING\n" : "";
    const sizes = { ROW, ORDER, GROUP };
    const named = Object.entries(sizes).map(([name, size]) => `#define ${name} ${size}u\n`);
    const defines = `${named.join("")}#define DEGREE ${header.degree}\n${moving}`;
    const sources = [[gl.VERTEX_SHADER, SPLAT_VERT], [gl.FRAGMENT_SHADER, SPLAT_FRAG]];
    for (const [kind, source] of sources) {
      const shader = gl.createShader(kind), [first, ...rest] = source.split("\n");
      gl.shaderSource(shader, `${first}\n${defines}${rest.join("\n")}`);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
        throw new Error(`The graphics driver refuses a shader: ${gl.getShaderInfoLog(shader)}`);
      }
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    const names = ["base", "harmonics", "motion", "rotation", "eye", "focal", "middle", "size",
      "near", "time", "order", "count", "colorSteps", "scaleSteps", "shStep", "compensated"];
    for (const name of names) this.#uniforms[name] = gl.getUniformLocation(program, name);
    gl.uniform2f(this.#uniforms.colorSteps, header.color_low, header.color_step);
    gl.uniform2f(this.#uniforms.scaleSteps, header.scale_low, header.scale_step);
    gl.uniform1f(this.#uniforms.shStep, header.sh_step);
    gl.uniform1i(this.#uniforms.compensated, header.antialiased);
  }

  /** The corners of the quads of one instance, as triangles. */
  #quads() {
    const gl = this.#gl, corners = [0, 1, 2, 2, 1, 3];
    const indices = Uint16Array.from({ length: 6 * GROUP }, (_, index) =>
      4 * Math.floor(index / 6) + corners[index % 6]);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
  }

  #texture(name, slot, width, height, { format, as, type }) {
    const gl = this.#gl, texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + slot);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width * ROW, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.uniform1i(this.#uniforms[name], slot);
    this.#textures[name] = { slot, width: width * ROW, as, type };
  }

  #fill(name, row, height, content) {
    const gl = this.#gl, texture = this.#textures[name];
    if (!texture) return;
    gl.activeTexture(gl.TEXTURE0 + texture.slot);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, row, texture.width, height, texture.as, texture.type,
      content);
  }
}
