// Pieces: where the page finds its scene, as it comes.

/** The pieces that the page itself holds, in base64; the parser may not have come to all yet. */
async function* held() {
  for (;;) {
    const part = document.querySelector("script.scene");
    const loaded = document.readyState !== "loading";
    if (part && (loaded || part.nextSibling)) {
      const text = part.textContent;
      part.remove();
      yield text;
    } else if (loaded) {
      return;
    } else {
      await new Promise((resolve) => { setTimeout(resolve, 20); });
    }
  }
}

/** The pieces of a file beside the page; no more is read than is asked for. */
async function* fetched(address) {
  if (location.protocol === "file:") {
    throw new Error("This folder is made for a web server, which browsers ask for its files. "
      + "To try it here: python3 -m http.server, in the folder. "
      + "(gsfw export RUN format=html makes a page that opens from disk.)");
  }
  const response = await fetch(address);
  if (!response.ok) throw new Error(`${address} cannot be loaded: ${response.status}.`);
  const reader = response.body.getReader();
  try {
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      yield value;
    }
  } finally {
    reader.cancel().catch(() => {});
  }
}
