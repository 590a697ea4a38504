// Controls: mouse, touch and keys move the camera; the page hears of the other keys.

const TAP = 6;  // Pixels that a click or tap may move.
const TWICE = 320;  // Milliseconds between the taps of a double one.
const GLIDE = 0.12;  // Seconds in which a movement that was let go falls to 1/e.

class Controls {
  #camera;
  #canvas;
  #pointers = new Map();
  #speed = [0, 0];  // Radians a second, of a drag that was let go.
  #last = { time: 0, x: 0, y: 0 };
  #keys = new Set();
  #released = new Set();  // They count until the next image, so that a short press does.

  /** @param heard called with "moved", with "focus" and a place, or with a key. */
  constructor(canvas, camera, heard) {
    this.#canvas = canvas;
    this.#camera = camera;
    this.heard = heard;
    const on = (name, action) => canvas.addEventListener(name, action, { passive: false });
    on("pointerdown", (event) => this.#down(event));
    on("pointermove", (event) => this.#move(event));
    on("pointerup", (event) => this.#up(event));
    on("pointercancel", (event) => this.#pointers.delete(event.pointerId));
    on("wheel", (event) => this.#wheel(event));
    on("contextmenu", (event) => event.preventDefault());
    document.addEventListener("keydown", (event) => this.#key(event));
    document.addEventListener("keyup", ({ key }) => this.#released.add(key.toLowerCase()));
    window.addEventListener("blur", () => this.#keys.clear());
  }

  /** Go on with what keys and glides move; true while something moves. */
  advance(seconds) {
    return this.#glide(seconds) | this.#held(seconds);
  }

  #glide(seconds) {
    if (!this.#speed.some((speed) => Math.abs(speed) > 0.01)) return false;
    this.#camera.orbit(...times(this.#speed, seconds));
    this.#speed = times(this.#speed, Math.exp(-seconds / GLIDE));
    return true;
  }

  #held(seconds) {
    if (!this.#keys.size) return false;
    const step = seconds * (this.#keys.has("shift") ? 3 : 1);
    const towards = (more, less) => step * (this.#keys.has(more) - this.#keys.has(less));
    const turn = [towards("arrowright", "arrowleft"), towards("arrowup", "arrowdown")];
    const walk = [towards("d", "a"), towards("q", "e"), towards("w", "s")];
    const zoom = towards("-", "+") + towards("_", "=");
    if (turn.some(Boolean)) this.#camera.orbit(1.2 * turn[0], 1.2 * turn[1]);
    if (walk.some(Boolean)) this.#camera.move(...times(walk, 0.7));
    if (zoom) this.#camera.zoom(Math.exp(zoom));
    for (const key of this.#released) this.#keys.delete(key);
    this.#released.clear();
    return turn.some(Boolean) || walk.some(Boolean) || Boolean(zoom);
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) {
      return;
    }
    const key = event.key.toLowerCase(), role = event.target.tagName;
    const own = role === "INPUT" ? ["arrowleft", "arrowright", "arrowup", "arrowdown"]
      : role === "BUTTON" ? [" ", "enter"] : [];
    if (own.includes(key)) return;
    if (/^(arrow(left|right|up|down)|[wasdqe+=_-]|shift)$/.test(key)) {
      this.#keys.add(key);
      this.#released.delete(key);
      if (key !== "shift") event.preventDefault();
      this.heard("moved");
    } else if (this.heard("key", key)) {
      event.preventDefault();
    }
  }

  #down(event) {
    this.#canvas.focus({ preventScroll: true });
    this.#canvas.setPointerCapture(event.pointerId);
    const { clientX: x, clientY: y } = event;
    const pans = event.button > 0 || event.shiftKey || event.ctrlKey;
    this.#pointers.set(event.pointerId, { x, y, from: [x, y], pans, time: event.timeStamp });
    this.#speed = [0, 0];
  }

  #move(event) {
    const pointer = this.#pointers.get(event.pointerId);
    if (!pointer) return;
    const before = this.#pinch();
    const moved = [event.clientX - pointer.x, event.clientY - pointer.y];
    const seconds = Math.max(1e-3, (event.timeStamp - pointer.time) / 1000);
    Object.assign(pointer, { x: event.clientX, y: event.clientY, time: event.timeStamp });
    if (this.#pointers.size === 2) {
      const after = this.#pinch();
      this.#camera.zoom(before.spread / after.spread);
      this.#pan(after.x - before.x, after.y - before.y);
    } else if (pointer.pans) {
      this.#pan(...moved);
    } else if (this.#pointers.size === 1) {
      const angles = [-moved[0], moved[1]].map((pixels) => pixels * Math.PI / this.#reach());
      this.#camera.orbit(...angles);
      this.#speed = calm() ? [0, 0] : times(angles, 0.6 / Math.max(seconds, 0.008));
    }
    this.heard("moved");
  }

  #up(event) {
    const pointer = this.#pointers.get(event.pointerId);
    this.#pointers.delete(event.pointerId);
    if (!pointer) return;
    if (event.timeStamp - pointer.time > 60) this.#speed = [0, 0];  // Held still before.
    const { clientX: x, clientY: y, timeStamp: time } = event;
    if (Math.hypot(x - pointer.from[0], y - pointer.from[1]) > TAP || pointer.pans) return;
    this.#speed = [0, 0];
    const near = Math.hypot(x - this.#last.x, y - this.#last.y) < 5 * TAP;
    if (near && time - this.#last.time < TWICE) this.heard("focus", x, y);
    this.#last = { time, x, y };
  }

  /** Middle and distance of two fingers. */
  #pinch() {
    if (this.#pointers.size !== 2) return null;
    const [a, b] = this.#pointers.values();
    return {
      x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, spread: Math.max(1, Math.hypot(a.x - b.x, a.y - b.y)),
    };
  }

  /** Move the scene under the pointer, at the depth of the target. */
  #pan(x, y) {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    const { focal } = this.#camera.projection(width, height);
    this.#camera.move(-x / focal[0], -y / focal[1], 0);
  }

  #wheel(event) {
    if (window !== window.top && !document.hasFocus()) return;  // The page around scrolls.
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode ? 30 : 1);
    this.#camera.zoom(Math.exp(Math.max(-0.5, Math.min(0.5, pixels * 0.0012))));
    this.heard("moved");
  }

  #reach() { return Math.min(this.#canvas.clientWidth, this.#canvas.clientHeight) || 1; }
}

/** True if the visitor asks for less motion. */
const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;
