// Page: the frame loop, and everything around the canvas.

const IDLE = 3500;  // Milliseconds without a movement after which the page hides its controls.
const JOURNEY = 0.9;  // Seconds from one view to another.
const FRAMES_A_SECOND = 30;  // Of a moving scene, but it takes from 2 to 60 seconds.

class Page {
  #scene;
  #controls;
  #headset;
  #changed = true;
  #playing = false;
  #view = 0;
  #backgrounds = 0;
  #idle = 0;
  #passing = false;
  #recent = [];  // Times of the latest frames.

  constructor(pieces) {
    this.canvas = document.querySelector("canvas");
    this.loaded = new Promise((resolve) => { this.#done = resolve; });
    try {
      this.#scene = new Scene(this.canvas, (kind, value) => this.#heard(kind, value));
    } catch (error) {
      this.#problem(error.message);
      return;
    }
    this.#headset = new Headset(this.#scene, (kind, value) => this.#heard(kind, value));
    this.canvas.addEventListener("webglcontextlost", () => {
      this.#headset.leave();
      this.#problem("The graphics card has dropped the scene. Reload the page to go on.");
    });
    new ResizeObserver(() => this.#resize()).observe(this.canvas);
    this.#resize();
    this.#buttons();
    this.#scene.read(pieces);
    requestAnimationFrame((now) => this.#frame(now, now));
  }

  #done;

  get scene() { return this.#scene; }
  get rate() {
    const [first, last] = [this.#recent[0], this.#recent.at(-1)];
    return last > first ? (1000 * (this.#recent.length - 1)) / (last - first) : 0;
  }

  /** Stop at a time in [0, 1]; a promise of the image. */
  goTo(time) {
    this.#play(false);
    this.#scene.time = time;
    this.#showTime();
    return this.#scene.settled();
  }

  /** Fix the canvas at a size in pixels; null lets it fill the page again. */
  fix(size) {
    this.fixed = size;
    this.#resize();
  }

  #frame(now, before) {
    requestAnimationFrame((next) => this.#frame(next, now));
    const { camera, head } = this.#scene, seconds = Math.min(0.1, (now - before) / 1000);
    if (!camera || head) return;
    const moved = camera.advance(seconds) | this.#controls.advance(seconds);
    const changed = this.#pass(seconds) || moved;
    if (changed) this.#scene.change();
    if (changed || this.#changed) {
      this.#changed = false;
      this.#scene.draw();
      this.#recent = [...this.#recent.filter((time) => now - time < 1000), now];
    }
    this.#showStats();
  }

  /** Let a moving scene go on; true if it does. */
  #pass(seconds) {
    if (!this.#playing) return false;
    this.#scene.time = (this.#scene.time + seconds / duration(this.#scene.header)) % 1;
    this.#showTime();
    return true;
  }

  #heard(kind, value) {
    if (kind === "header") this.#open(this.#scene);
    if (kind === "progress") this.#progress(value);
    if (kind === "complete") this.#complete();
    if (kind === "error") this.#problem(value);
    if (kind === "offered") this.#offer(value);
    if (kind === "passed") this.#pass(value);
    if (kind === "left") this.#scene.change();
    if (kind === "refused") this.#problem(value, true);
    this.#changed = true;
  }

  #open({ header, camera }) {
    this.#controls = new Controls(this.canvas, camera, (what, ...more) => this.#act(what, ...more));
    document.body.classList.toggle("moves", header.moving);
    document.getElementById("player").hidden = !header.moving;
    document.getElementById("next").hidden = camera.views.length < 2;
    this.#showTime();
    this.#resize();
  }

  #progress(part) {
    document.querySelector("#loading progress").value = part;
    document.querySelector("#loading span").textContent = `Loading ${Math.round(100 * part)} %`;
  }

  async #complete() {
    await this.#scene.settled();
    document.body.classList.remove("loading");
    this.#hidePoster();
    this.#awake();
    if (this.#scene.header.moving && !calm()) this.#play(true);
    this.#done();
  }

  #hidePoster() {
    document.getElementById("poster")?.classList.add("gone");
  }

  /** Show the kinds of headsets' sessions that this machine offers. */
  #offer(kinds) {
    document.body.classList.toggle("headset", kinds.length > 0);
    for (const kind of ["vr", "ar"]) document.getElementById(kind).hidden = !kinds.includes(kind);
  }

  /** Say what is wrong; a passing problem is gone with the next press. */
  #problem(text, passing = false) {
    const place = document.getElementById("problem");
    this.#passing = passing;
    place.textContent = text;
    place.hidden = false;
    document.body.classList.remove("loading");
  }

  #resize() {
    const scale = this.fixed ? 1 : Math.min(window.devicePixelRatio || 1, 2);
    const style = this.canvas.style;
    style.width = this.fixed ? `${this.fixed[0]}px` : "";
    style.height = this.fixed ? `${this.fixed[1]}px` : "";
    const size = this.fixed || [this.canvas.clientWidth, this.canvas.clientHeight];
    const [width, height] = size.map((pixels) => Math.max(1, Math.round(pixels * scale)));
    if (this.canvas.width !== width || this.canvas.height !== height) {
      Object.assign(this.canvas, { width, height });
    }
    const poster = document.getElementById("poster");
    if (poster?.naturalWidth) {
      const zoom = fitted(poster.naturalWidth, poster.naturalHeight, ...size);
      poster.style.width = `${poster.naturalWidth * zoom}px`;
      poster.style.height = `${poster.naturalHeight * zoom}px`;
    } else {
      poster?.addEventListener("load", () => this.#resize(), { once: true });
    }
    this.#changed = true;
    this.#scene?.draw();
  }

  #buttons() {
    const press = (name, action) => document.getElementById(name).addEventListener("click", action);
    press("play", () => this.#play(!this.#playing));
    press("next", () => this.#show(this.#view + 1));
    press("reset", () => this.#show(0));
    press("ask", () => this.#help());
    press("full", () => fullScreen());
    for (const kind of ["vr", "ar"]) press(kind, () => this.#headset.toggle(kind));
    const slider = document.getElementById("time");
    slider.addEventListener("input", () => { this.#play(false); this.#seek(Number(slider.value)); });
    for (const name of ["pointermove", "pointerdown", "keydown", "wheel"]) {
      document.addEventListener(name, () => this.#awake(), { passive: true });
    }
    for (const name of ["pointerdown", "keydown"]) {
      document.addEventListener(name, () => {
        if (this.#passing) document.getElementById("problem").hidden = true;
      });
    }
    if (!document.fullscreenEnabled) document.getElementById("full").hidden = true;
  }

  /** What the controls ask for; true if the key means something. */
  #act(what, ...more) {
    if (what === "moved") this.#scene.change();
    if (what === "focus") this.#focus(...more);
    if (what !== "key") this.#hidePoster();
    this.#changed = true;
    return what === "key" && this.#key(more[0]);
  }

  #key(key) {
    const { header, time } = this.#scene, step = 1 / Math.max(1, header.frames - 1);
    const to = (place) => { this.#play(false); this.#seek(Math.max(0, Math.min(1, place))); };
    const actions = {
      r: () => this.#show(0),
      v: () => this.#show(this.#view + 1),
      f: () => fullScreen(),
      b: () => this.#changeBackground(),
      i: () => { const stats = document.getElementById("stats"); stats.hidden = !stats.hidden; },
      "?": () => this.#help(),
      h: () => this.#help(),
      ...(header.moving && {
        " ": () => this.#play(!this.#playing),
        ",": () => to(time - step),
        ".": () => to(time + step),
      }),
    };
    const action = /^[1-9]$/.test(key) ? () => this.#show(Number(key) - 1, true) : actions[key];
    if (action) action();
    return Boolean(action);
  }

  #show(index, strict = false) {
    const { views } = this.#scene.camera;
    if (strict && index >= views.length) return;
    this.#view = index % views.length;
    this.#scene.camera.travel(views[this.#view], calm() ? 0 : JOURNEY);
    this.#scene.change();
    this.#hidePoster();
    this.#changed = true;
  }

  async #focus(x, y) {
    const point = await this.#scene.pick(x, y);
    if (!point) return;
    this.#scene.camera.travel(this.#scene.camera.towards(point), calm() ? 0 : JOURNEY);
    this.#scene.change();
    this.#changed = true;
  }

  #play(playing) {
    this.#playing = playing;
    document.body.classList.toggle("playing", playing);
    const button = document.getElementById("play");
    button.setAttribute("aria-label", playing ? "Pause" : "Play");
    button.title = `${playing ? "Pause" : "Play"} (space)`;
    this.#changed = true;
  }

  #seek(time) {
    this.#scene.time = time;
    this.#showTime();
    this.#scene.change();
    this.#changed = true;
  }

  #showTime() {
    const { header, time } = this.#scene, slider = document.getElementById("time");
    if (!header.moving) return;
    const [first, last] = header.time_range;
    const digits = last - first > 50 ? 0 : 2;
    const shown = (first + time * (last - first)).toFixed(digits);
    slider.value = time;
    slider.setAttribute("aria-valuetext", shown);
    slider.style.setProperty("--part", `${100 * time}%`);
    document.getElementById("now").textContent = shown;
  }

  #showStats() {
    const place = document.getElementById("stats");
    if (place.hidden) return;
    const { limit, header, renderer, milliseconds } = this.#scene;
    place.textContent = [
      `${this.rate.toFixed(0).padStart(5)} images/s`,
      `${renderer.count.toLocaleString("en")} of ${limit.toLocaleString("en")} splats drawn`,
      limit < header.rows ? `${header.rows.toLocaleString("en")} in the file` : "",
      `${milliseconds.toFixed(1)} ms to sort`,
      `${this.canvas.width} × ${this.canvas.height} pixels, SH degree ${header.degree}`,
    ].filter(Boolean).join("\n");
  }

  #changeBackground() {
    const choices = [null, [0, 0, 0], [1, 1, 1], [0.5, 0.5, 0.5]];
    this.#backgrounds = (this.#backgrounds + 1) % choices.length;
    this.#scene.background = choices[this.#backgrounds];
    const { background } = this.#scene;
    document.body.style.backgroundColor = css(background);
    document.body.classList.toggle("bright", background.reduce((a, b) => a + b) > 1.5);
    this.#changed = true;
  }

  #help() { document.getElementById("help").showModal(); }

  #awake() {
    document.body.classList.remove("idle");
    clearTimeout(this.#idle);
    this.#idle = setTimeout(() => document.body.classList.add("idle"), IDLE);
  }
}

const css = (color) => `rgb(${color.map((value) => Math.round(255 * value)).join(" ")})`;

/** Seconds that a moving scene takes. */
const duration = ({ frames }) => Math.max(2, Math.min(60, frames / FRAMES_A_SECOND));

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.documentElement.requestFullscreen().catch(() => {});
}
