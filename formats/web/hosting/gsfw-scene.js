// <gsfw-scene src="folder/"></gsfw-scene>: a scene of gsfw in any page.
//
// Attributes: src, the folder that gsfw export has written (by default the one that this file is
// in); label, what it shows, for screen readers; budget, the most splats to load.

const home = new URL(".", document.currentScript?.src ?? document.baseURI);

class GsfwScene extends HTMLElement {
  static observedAttributes = ["src", "label", "budget"];

  #frame = document.createElement("iframe");

  constructor() {
    super();
    const style = document.createElement("style");
    style.textContent = ":host { display: block; aspect-ratio: 16 / 9; background: #000; }"
      + "iframe { width: 100%; height: 100%; border: 0; display: block; }";
    this.#frame.loading = "lazy";
    this.#frame.allow = "fullscreen; xr-spatial-tracking";
    this.attachShadow({ mode: "open" }).append(style, this.#frame);
  }

  attributeChangedCallback() { this.#show(); }
  connectedCallback() { this.#show(); }

  #show() {
    if (!this.isConnected) return;
    const given = this.getAttribute("src");
    const folder = given === null ? home : new URL(given.replace(/\/?$/, "/"), document.baseURI);
    const address = new URL("index.html", folder);
    const budget = Number(this.getAttribute("budget"));
    if (budget > 0) address.searchParams.set("budget", budget);
    this.#frame.title = this.getAttribute("label") ?? "Scene in three dimensions";
    if (this.#frame.src !== address.href) this.#frame.src = address.href;
  }
}

customElements.define("gsfw-scene", GsfwScene);
