// Worker: decodes the scene and sorts it, beside the page.

let sorter = null;
const { readable, writable } = new DecompressionStream("gzip");
const input = writable.getWriter();
const failed = (error) => postMessage({ kind: "error", text: error.message });
input.closed.catch(() => {});  // The reading side reports what is wrong.

const answers = {
  piece({ content }) {
    const bytes = typeof content === "string"
      ? Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0)) : content;
    input.write(bytes).catch(() => {});
  },
  end() { input.close().catch(() => {}); },
  sort(view) {
    const begin = performance.now();
    const { order, count } = sorter.sort(view);
    const milliseconds = performance.now() - begin;
    const sorted = { kind: "order", order, count, number: view.number, milliseconds };
    postMessage(sorted, [order.buffer]);
  },
  pick(ray) { postMessage({ kind: "picked", number: ray.number, point: sorter.pick(ray) }); },
};
onmessage = ({ data }) => answers[data.kind](data);

let shown = 0;
decode(readable, {
  header(header) {
    const limit = Math.min(header.rows, Math.ceil(BUDGET / header.block) * header.block);
    sorter = new Sorter(header, limit);
    postMessage({ kind: "header", header, limit });
    return limit;
  },
  block(block) {
    sorter.add(block);
    const { first, count, base, sh, motion } = block;
    const kept = [base, sh, motion].filter((array) => array);
    postMessage({ kind: "block", first, count, base, sh, motion }, kept.map((a) => a.buffer));
  },
  progress(part) {
    if (part < 1 && part - shown < 0.01) return;
    shown = part;
    postMessage({ kind: "progress", part });
  },
}).then(() => postMessage({ kind: "complete" })).catch((error) => {
  failed(error instanceof TypeError
    ? new Error("The scene is damaged or cut short: it cannot be unpacked.") : error);
});
