/* The side panel: the verdict's bars, the small maps, what is said of the next photo and of all. */

import { drawMap, mapKey } from "./sensor_map.js";
import { capital } from "./words.js";

const MAP_WIDTH = 480;
const part = (id) => document.getElementById(id);

export function showPanel(guidance, state, seen, isMirrored) {
  part("headline").textContent = capital(guidance.headline);
  document.body.dataset.stage = guidance.stage;
  part("next").hidden = !guidance.ghost;
  part("sentence").textContent = guidance.ghost ? capital(seen(guidance.ghost.sentence)) : "";
  part("bars").replaceChildren(...guidance.bars.map(bar));
  part("remarks").replaceChildren(...guidance.remarks.map((text) => made("li", "", capital(text))));
  part("about").textContent = state ? `${capital(state.target)}. Photos are kept in ${state.folder}.` : "";
  showMaps(guidance.cameras.filter((camera) => camera.map), guidance.cameras.length > 1, isMirrored);
}

function bar({ title, text, share, grade }) {
  const item = made("li", `bar grade-${grade}`);
  const head = made("p", "bar-head");
  head.append(made("b", "", capital(title)), made("span", "bar-text", text));
  const meter = made("div", "bar-meter");
  const fill = made("div", "bar-fill");
  const percent = Math.round(100 * Math.min(1, Math.max(0, share)));
  fill.style.width = `${percent}%`;
  meter.setAttribute("role", "meter");
  meter.setAttribute("aria-label", title);
  meter.setAttribute("aria-valuenow", String(percent));
  meter.append(fill);
  item.append(head, meter);
  return item;
}

function showMaps(cameras, hasNames, isMirrored) {
  part("maps").replaceChildren(...cameras.map((camera) => {
    const figure = made("figure", "map-small");
    const [width, height] = camera.image_size;
    const canvas = Object.assign(document.createElement("canvas"), { width: MAP_WIDTH });
    canvas.height = Math.round((MAP_WIDTH * height) / width);
    canvas.classList.toggle("mirrored", isMirrored);
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "How well each part of the image is known");
    drawMap(canvas.getContext("2d"), camera.map, { x: 0, y: 0, width: canvas.width, height: canvas.height }, 1);
    figure.append(canvas, made("figcaption", "", `How well each part of the image is known${hasNames ? `: ${camera.name}` : ""}`));
    return figure;
  }));
  const key = cameras.length ? mapKey(cameras[0].map) : [];
  part("map-key").replaceChildren(...key.map(([colour, words]) => {
    const item = made("li");
    const swatch = made("i", colour.startsWith("#") ? "" : `sign-${colour}`);
    if (colour.startsWith("#")) swatch.style.background = colour;
    item.append(swatch, words);
    return item;
  }));
}

export function made(tag, className = "", text = "") {
  return Object.assign(document.createElement(tag), { className, textContent: text });
}
