// Scene: the worker, the renderer and the camera of one file, and what is to be drawn next.

class Scene {
  #worker;
  #background = null;
  #sorting = false;
  #wanted = 0;  // Number of the newest view, and of the one that the order is of.
  #sorted = 0;
  #picks = new Map();
  #waiting = [];

  /**
   * @param heard called with "header", "progress", "block", "complete" or "error".
   * @throws Error if the browser cannot show scenes.
   */
  constructor(canvas, heard) {
    this.canvas = canvas;
    this.heard = heard;
    this.time = 0;
    this.head = null;  // Of a visitor with a headset, who sees the scene instead of the page.
    this.milliseconds = 0;
    this.renderer = new Renderer(canvas);
    if (typeof DecompressionStream === "undefined") {
      throw new Error("This browser is too old to unpack the scene. Chrome and Edge can since "
        + "version 80, Firefox since 113, Safari since 16.4.");
    }
    const budget = Math.min(budgetOf(new URLSearchParams(location.search)), this.renderer.capacity);
    const source = `"use strict";const BUDGET=${budget};${WORKER_SOURCE}`;
    const address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
    this.#worker = new Worker(address);
    this.#worker.onmessage = ({ data }) => this.#take(data);
    this.#worker.onerror = (event) => heard("error", `The scene cannot be read: ${event.message}`);
  }

  /** Read the pieces of the file, until all that is wanted is there. */
  async read(pieces) {
    try {
      for await (const content of pieces) {
        if (this.complete) return;
        const owned = typeof content === "string" ? [] : [content.buffer];
        this.#worker.postMessage({ kind: "piece", content }, owned);
      }
      this.#worker.postMessage({ kind: "end" });
    } catch (error) {
      this.heard("error", error.message);
    }
  }

  get background() { return this.#background || this.header?.background || [0, 0, 0]; }
  set background(color) { this.#background = color; }

  /** Look again: the camera, the time or the canvas is another. */
  change() {
    this.#wanted += 1;
    this.#sort();
  }

  /** A promise of an image of the present view, sorted for it. */
  settled() {
    this.change();
    return new Promise((resolve) => { this.#waiting.push({ number: this.#wanted, resolve }); });
  }

  draw() {
    if (!this.camera || this.head) return;
    const { width, height } = this.canvas, { axes, position, near } = this.camera;
    const lens = this.camera.projection(width, height);
    const eye = { axes, position, near, ...lens, part: [0, 0, width, height] };
    this.renderer.draw([eye], this.time, [...this.background, 1]);
  }

  /** Draw for a headset; the order is that of the head. */
  drawFor(eyes, framebuffer, transparent) {
    const background = transparent ? [0, 0, 0, 0] : [...this.background, 1];
    this.renderer.draw(eyes, this.time, background, framebuffer);
  }

  /** A promise of the point of the scene at a place of the canvas, or of null. */
  pick(x, y) {
    const { clientWidth, clientHeight } = this.canvas, { axes, position } = this.camera;
    const { focal, middle } = this.camera.projection(clientWidth, clientHeight);
    const slopes = [(x - middle[0]) / focal[0], (y - middle[1]) / focal[1], 1];
    const direction = unit(slopes.reduce((sum, part, k) => plus(sum, axes[k], part), [0, 0, 0]));
    const number = this.#wanted + Math.random();
    this.#worker.postMessage({ kind: "pick", number, eye: position, direction, time: this.time });
    return new Promise((resolve) => { this.#picks.set(number, resolve); });
  }

  #sort() {
    if (this.#sorting || !this.camera || this.#sorted === this.#wanted) return;
    this.#sorting = true;
    const { position: eye, axes, near, most = this.limit } = this.head || this.camera;
    const { time } = this, number = this.#wanted;
    this.#worker.postMessage({ kind: "sort", number, eye, forward: axes[2], near, most, time });
  }

  #take(data) {
    switch (data.kind) {
      case "header":
        this.header = data.header;
        this.limit = data.limit;
        this.camera = new Camera(data.header);
        try {
          this.renderer.prepare(data.header, data.limit);
        } catch (error) {
          this.heard("error", error.message);
          return;
        }
        break;
      case "block":
        this.renderer.add(data);
        this.change();
        break;
      case "order":
        this.#sorting = false;
        this.#sorted = data.number;
        this.renderer.follow(data.order, data.count);
        this.milliseconds = data.milliseconds;
        this.#settle();
        this.#sort();
        break;
      case "picked":
        this.#picks.get(data.number)(data.point);
        this.#picks.delete(data.number);
        break;
      case "complete":
        this.complete = true;
    }
    this.heard(data.kind, data.text ?? data.part);
  }

  #settle() {
    const ready = this.#waiting.filter(({ number }) => number <= this.#sorted);
    if (!ready.length) return;
    this.#waiting = this.#waiting.filter((waiting) => !ready.includes(waiting));
    this.draw();
    for (const { resolve } of ready) resolve();
  }
}

/** Largest number of splats: ?budget=N, or by the kind of the device. */
function budgetOf(query) {
  const given = Number(query.get("budget"));
  if (given > 0) return given;
  const small = matchMedia("(pointer: coarse)").matches || (navigator.deviceMemory || 8) <= 2;
  return small ? 1_000_000 : 8_000_000;
}
