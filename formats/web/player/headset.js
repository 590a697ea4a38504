// Headset: sessions of WebXR, in which the scene is around the visitor, or in the visitor's room.

const MODES = { vr: "immersive-vr", ar: "immersive-ar" };
const AWAY = 2;  // Metres from the first view to what it looks at, if the file names no metre.
const SPEED = 1.5;  // Metres a second, with the stick pushed fully.
const SNAP = Math.PI / 6;  // Radians of a turn.
const DEAD = 0.2;  // Part of a stick's way in which it counts as at rest.
const RATES = { vr: 72, ar: 30 };  // Images a second, if the session does not say.
const SLOW = 1.5;  // Images that take longer than their time by this factor are too slow.
const LEVELS = [  // Scale of the images and part of the splats, from the best to the fastest.
  [1, 1], [0.8, 1], [0.65, 1], [0.65, 0.5], [0.5, 0.5], [0.5, 0.25],
];

class Headset {
  #scene;
  #kind;
  #space;
  #stage;
  #before;
  #turned = false;
  #times = [];  // Milliseconds of the latest images.
  #level = 0;

  /**
   * @param heard called with "offered" and the kinds of sessions that this machine has, with
   *   "passed" and seconds, with "left", or with "refused" and a message.
   */
  constructor(scene, heard) {
    this.#scene = scene;
    this.heard = heard;
    navigator.xr?.addEventListener("devicechange", () => this.#offer());
    this.#offer();
  }

  async #offer() {
    const offered = [];
    for (const [kind, mode] of Object.entries(MODES)) {
      if (await navigator.xr?.isSessionSupported(mode).catch(() => false)) offered.push(kind);
    }
    this.heard("offered", offered);
  }

  /** Enter a session of a kind; leave it if there is one. */
  async toggle(kind) {
    if (this.session) return this.leave();
    if (this.#kind) return;  // One is on its way.
    this.#kind = kind;
    const name = kind.toUpperCase();
    let problem = (text) => `the browser or the device refused it (${text}). Allow ${name} for `
      + `this page, check that the device is on and no other page uses it, and press ${name} again.`;
    try {
      this.session = await navigator.xr.requestSession(MODES[kind]);
      this.session.addEventListener("end", () => this.#left());
      this.#space = await this.session.requestReferenceSpace("local");
      problem = (text) => `the graphics card of this page does not serve the device (${text}). `
        + "Let the browser use the card that the device is connected to, and reload the page.";
      await this.#scene.renderer.context.makeXRCompatible();
      this.#begin();
    } catch (error) {
      this.heard("refused", `${name} did not start: ${problem(error.message.replace(/\.$/, ""))}`);
      if (this.session) this.leave();
      else this.#kind = null;
    }
  }

  /** End the session, if there is one. */
  leave() {
    this.session?.end().catch(() => {});
  }

  #begin() {
    const { session } = this;
    if (!session) return;  // It ended meanwhile.
    this.#stage = null;
    this.#before = undefined;
    this.#times = [];
    this.#allocate();
    // The trigger, or a tap, brings the visitor back to the view of the page.
    session.addEventListener("select", () => { this.#stage = null; });
    session.requestAnimationFrame((now, frame) => this.#frame(now, frame));
  }

  #left() {
    this.session = null;
    this.#kind = null;
    this.#scene.head = null;
    this.heard("left");
  }

  /** Images of the size of the present level, from the next one on. */
  #allocate() {
    this.session.updateRenderState({
      baseLayer: new XRWebGLLayer(this.session, this.#scene.renderer.context, {
        antialias: false, depth: false, framebufferScaleFactor: LEVELS[this.#level][0],
      }),
    });
  }

  #frame(now, frame) {
    const { session } = this, { camera, header, limit } = this.#scene;
    session.requestAnimationFrame((...next) => this.#frame(...next));
    const passed = now - (this.#before ?? now), seconds = Math.min(0.1, passed / 1000);
    this.#before = now;
    const pose = frame.getViewerPose(this.#space);
    if (!pose) return;
    const metre = header.metre || camera.views[0].distance / AWAY;
    this.#stage ??= new Stage(camera, pose.transform, metre);
    this.#steer(pose.transform, seconds);
    this.heard("passed", seconds);
    // Blocks follow one another by importance; in a block, rows are in the order of space.
    const most = header.block * Math.ceil(limit * LEVELS[this.#level][1] / header.block);
    this.#scene.head = { ...this.#stage.seen(pose.transform), near: camera.near, most };
    this.#scene.change();
    const layer = session.renderState.baseLayer;
    const eyes = pose.views.map((view) => this.#eye(view, layer.getViewport(view)));
    this.#scene.drawFor(eyes, layer.framebuffer, this.#kind === "ar");
    this.#pace(passed);
  }

  /** What the renderer needs of a view: the session's own matrices, in pixels. */
  #eye({ transform, projectionMatrix: p }, { x, y, width, height }) {
    return {
      ...this.#stage.seen(transform),
      near: this.#scene.camera.near,
      focal: [p[0] * width / 2, p[5] * height / 2],
      middle: [(1 - p[8]) * width / 2, (1 + p[9]) * height / 2],
      part: [x, y, width, height],
    };
  }

  /** The right stick turns by steps and changes the size; any other one moves. */
  #steer(head, seconds) {
    for (const { gamepad, handedness } of this.session.inputSources) {
      const [padX, padY, x = padX, y = padY] = gamepad?.axes ?? [];
      const [right, down] = [x, y].map((way) => (Math.abs(way) > DEAD ? way : 0));
      if (handedness !== "right") {
        this.#stage.fly(head, SPEED * right * seconds, -SPEED * down * seconds);
      } else if (Math.abs(down) > Math.abs(right)) {
        this.#stage.enlarge(head, Math.exp(-down * seconds));
      } else if (Math.abs(right) > 0.7 && !this.#turned) {
        this.#stage.turn(head, -Math.sign(right) * SNAP);
        this.#turned = true;
      } else if (!right) {
        this.#turned = false;
      }
    }
  }

  /** Take the next level if the images of the latest second were too slow. */
  #pace(milliseconds) {
    if (this.session.visibilityState !== "visible") return;
    this.#times.push(milliseconds);
    const sum = this.#times.reduce((a, b) => a + b);
    if (this.#times.length < 10 || sum < 1000) return;
    const median = this.#times.sort((a, b) => a - b)[this.#times.length >> 1];
    this.#times = [];
    const rate = this.session.frameRate || RATES[this.#kind];
    if (median < SLOW * 1000 / rate || this.#level === LEVELS.length - 1) return;
    this.#level += 1;
    this.#allocate();
  }
}
