"use strict";
// Values of the charts under the pointer.
for (const svg of document.querySelectorAll("svg[data-chart]")) {
  const chart = JSON.parse(svg.dataset.chart);
  const tip = svg.parentElement.querySelector(".tip");
  const [left, top, right, bottom] = chart.box;
  const cursor = document.createElementNS(svg.namespaceURI, "line");
  cursor.setAttribute("class", "cursor");
  cursor.setAttribute("y1", top);
  cursor.setAttribute("y2", bottom);
  const shown = (value) => String(Number(value.toPrecision(5)));
  const hide = () => { tip.style.display = "none"; cursor.remove(); };
  svg.addEventListener("pointerleave", hide);
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width * chart.size[0];
    if (x < left - 4 || x > right + 4) { hide(); return; }
    const span = chart.high[0] - chart.low[0];
    const wanted = chart.low[0] + (x - left) / (right - left) * span;
    const near = (points) => points.reduce((best, point) =>
      Math.abs(point[0] - wanted) < Math.abs(best[0] - wanted) ? point : best);
    const found = chart.curves.map((curve) => ({ curve, point: near(curve.points) }));
    const main = found.reduce((best, item) =>
      Math.abs(item.point[0] - wanted) < Math.abs(best.point[0] - wanted) ? item : best);
    tip.replaceChildren();
    const head = document.createElement("b");
    head.textContent = shown(main.point[0]);
    tip.append(head);
    for (const { curve, point } of found) {
      const line = document.createElement("div");
      const key = document.createElement("span");
      key.className = `key c${curve.color}`;
      key.textContent = `${curve.name} ${shown(point[1])}${chart.unit && " " + chart.unit}`;
      line.append(key);
      tip.append(line);
    }
    const at = left + (main.point[0] - chart.low[0]) / span * (right - left);
    cursor.setAttribute("x1", at);
    cursor.setAttribute("x2", at);
    svg.append(cursor);
    tip.style.display = "block";
    const place = at / chart.size[0] * box.width;
    const flip = place > box.width / 2;
    tip.style.left = flip ? "auto" : `${place + 10}px`;
    tip.style.right = flip ? `${box.width - place + 10}px` : "auto";
  });
}

// A click on an image of a view shows it large; arrow keys go through photo, render and error.
const dialog = document.querySelector("dialog");
if (dialog) {
  const large = dialog.querySelector("img");
  const choices = dialog.querySelector(".choices");
  const named = dialog.querySelector(".named");
  let images = [];
  let place = 0;
  const show = (wanted) => {
    place = (wanted + images.length) % images.length;
    large.src = images[place].src;
    large.alt = images[place].alt;
    named.textContent = images[place].alt;
    [...choices.children].forEach((button, index) =>
      button.setAttribute("aria-pressed", String(index === place)));
    choices.children[place].focus();
  };
  document.addEventListener("click", (event) => {
    const image = event.target.closest(".views img");
    if (!image) return;
    images = [...image.closest("tr").querySelectorAll("img")];
    choices.replaceChildren(...images.map((item, index) => {
      const button = document.createElement("button");
      button.textContent = item.dataset.kind;
      button.addEventListener("click", () => show(index));
      return button;
    }));
    dialog.showModal();
    show(images.indexOf(image));
  });
  large.addEventListener("click", () => dialog.close());
  dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });
  dialog.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (steps) { show(place + steps); event.preventDefault(); }
  });
}

// Two runs side by side: the slider moves the border, the menus choose the runs.
for (const slide of document.querySelectorAll(".slide")) {
  slide.querySelector("input").addEventListener("input", (event) =>
    slide.style.setProperty("--at", `${event.target.value}%`));
}
const menus = document.querySelectorAll("select[data-side]");
const choose = () => {
  for (const menu of menus) {
    for (const image of document.querySelectorAll(".slide img")) {
      image.classList.toggle(menu.dataset.side, image.dataset.run === menu.value);
    }
    const name = menu.selectedOptions[0].textContent;
    for (const side of document.querySelectorAll(`.side.${menu.dataset.side[0]}`)) {
      side.textContent = name;
    }
  }
};
for (const menu of menus) menu.addEventListener("change", choose);
if (menus.length) choose();
