// A headset without a machine: sessions of WebXR whose images a test asks for. Each layer has a
// framebuffer of its own, in which the eyes lie beside one another, away from its edges.

const WIDTH = 160, HEIGHT = 120, EDGE = 8;

window.headset = {
  kinds: ["immersive-vr"],
  refusal: null,  // Message with which sessions are refused.
  incompatible: false,
  visibility: "visible",
  inputs: [],
  session: null,
  scales: [],  // Of the framebuffers so far.
  now: 0,

  /** Let one image be drawn; eyes and head have a matrix, and eyes a projection, by columns. */
  image(head, eyes, milliseconds = 1000 / 72) {
    this.now += milliseconds;
    const transform = (matrix) => {
      const [x, y, z] = matrix.slice(12);
      return { matrix: new Float32Array(matrix), position: { x, y, z, w: 1 } };
    };
    const views = eyes.map(({ matrix, projection }, index) =>
      ({ index, transform: transform(matrix), projectionMatrix: new Float32Array(projection) }));
    const pose = head && { transform: transform(head), views };
    const { session } = this, called = session.waiting;
    session.waiting = [];
    for (const action of called) action(this.now, { session, getViewerPose: () => pose });
  },

  /** The pixels of every eye, rgba from the lowest row, once the splats are in order. */
  async look(head, eyes) {
    this.image(head, eyes, 0);
    await page.scene.settled();
    this.image(head, eyes, 0);
    const layer = this.session.renderState.baseLayer, { gl } = layer;
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
    return eyes.map((_, index) => {
      const { x, y, width, height } = layer.getViewport({ index });
      const pixels = new Uint8Array(4 * width * height);
      gl.readPixels(x, y, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      return { width, height, pixels: Array.from(pixels) };
    });
  },
};

class Session extends EventTarget {
  waiting = [];
  renderState = { baseLayer: null };
  get inputSources() { return headset.inputs; }
  get visibilityState() { return headset.visibility; }
  async requestReferenceSpace(type) { return { type }; }
  requestAnimationFrame(action) { this.waiting.push(action); }
  updateRenderState(state) { Object.assign(this.renderState, state); }
  async end() {
    this.waiting = [];
    headset.session = null;
    this.dispatchEvent(new Event("end"));
  }
}

window.XRWebGLLayer = class {
  constructor(session, gl, { framebufferScaleFactor: scale }) {
    Object.assign(this, { gl, framebuffer: gl.createFramebuffer() });
    this.size = [WIDTH, HEIGHT].map((pixels) => Math.round(scale * pixels));
    headset.scales.push(scale);
    const bound = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.bindRenderbuffer(gl.RENDERBUFFER, gl.createRenderbuffer());
    const [width, height] = this.size;
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, 2 * width + 3 * EDGE, height + 2 * EDGE);
    gl.framebufferRenderbuffer(
      gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, gl.getParameter(gl.RENDERBUFFER_BINDING));
    gl.bindFramebuffer(gl.FRAMEBUFFER, bound);
  }
  getViewport({ index }) {
    const [width, height] = this.size;
    return { x: EDGE + index * (width + EDGE), y: EDGE, width, height };
  }
};

WebGL2RenderingContext.prototype.makeXRCompatible = async () => {
  if (headset.incompatible) throw new Error("no way from this card to the headset.");
};

Object.defineProperty(navigator, "xr", {
  value: Object.assign(new EventTarget(), {
    isSessionSupported: async (mode) => headset.kinds.includes(mode),
    async requestSession() {
      if (headset.refusal) throw new Error(headset.refusal);
      headset.session = new Session();
      return headset.session;
    },
  }),
});
