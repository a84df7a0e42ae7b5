/* One live picture, and what is drawn on it: the map, where to hold the target, what was found, how long it is still. */

import { drawMap } from "./sensor_map.js";

const FOUND = "#56b4e9";
const GHOST = "#ffc83d";
const MATCH = "#4fe0ae";
const CASING = "rgb(0 0 0 / 65%)";
const MAP_ALPHA = 0.55;
const FADED = 0.4;

export class Picture {
  constructor(name) {
    this.element = Object.assign(document.createElement("figure"), { className: "picture-live" });
    this.still = Object.assign(document.createElement("canvas"), { className: "frame" });
    this.overlay = Object.assign(document.createElement("canvas"), { className: "overlay" });
    this.name = Object.assign(document.createElement("figcaption"), { textContent: name });
    this.element.append(this.still, this.overlay, this.name);
    this.size = null;
    this.camera = null;
    this.look = null;
    this.isMirrored = false;
    this.hasMap = false;
    this.video = null;
    new ResizeObserver(() => this.draw()).observe(this.element);
  }

  setVideo(video) {
    this.video = video;
    this.still.hidden = true;
    this.element.prepend(video);
  }

  /** A JPEG of what another source sees. */
  async setImage(header, bytes) {
    if (this.isDecoding) return;
    this.isDecoding = true;
    try {
      const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/jpeg" }));
      Object.assign(this.still, { width: bitmap.width, height: bitmap.height });
      this.still.getContext("2d").drawImage(bitmap, 0, 0);
      this.setSize(header.width, header.height);
    } finally {
      this.isDecoding = false;
    }
  }

  setSize(width, height) {
    if (width && height) this.size = [width, height];
    if (this.size) this.element.closest("main")?.style.setProperty("--aspect", String(this.size[0] / this.size[1]));
    this.request();
  }

  /** What was found; null: nothing is known any more. */
  setLook(look) {
    this.look = look;
    this.request();
  }

  /** Under the picture: the camera's name, and why nothing comes from it. */
  setWords(text) {
    this.name.textContent = text;
  }

  setCamera(camera) {
    this.camera = camera;
    if (!this.size && camera) this.setSize(...camera.image_size);
    this.request();
  }

  set(values) {
    Object.assign(this, values);
    this.element.classList.toggle("mirrored", this.isMirrored);
    this.request();
  }

  request() {
    this.pending ??= requestAnimationFrame(() => { this.pending = undefined; this.draw(); });
  }

  /** Where the picture lies in its element, in CSS pixels: as `object-fit: contain` has it. */
  box() {
    const { clientWidth, clientHeight } = this.element;
    const scale = Math.min(clientWidth / this.size[0], clientHeight / this.size[1]);
    const [width, height] = [scale * this.size[0], scale * this.size[1]];
    return { x: (clientWidth - width) / 2, y: (clientHeight - height) / 2, width, height, scale };
  }

  draw() {
    const { clientWidth, clientHeight } = this.element;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [Math.round(density * clientWidth), Math.round(density * clientHeight)];
    if (this.overlay.width !== width || this.overlay.height !== height) Object.assign(this.overlay, { width, height });
    const pen = this.overlay.getContext("2d");
    pen.setTransform(density, 0, 0, density, 0, 0);
    pen.clearRect(0, 0, clientWidth, clientHeight);
    if (!this.size || !clientWidth) return;
    this.place = this.placer();
    if (this.hasMap && this.camera?.map) this.drawMap(pen);
    if (this.video === null && this.still.width === 300) this.frame(pen);
    if (this.look) this.drawFound(pen);
    this.drawGhost(pen);
    if (this.look) { this.drawWay(pen); this.drawStill(pen); }
  }

  /** From pixels of the photo, the middle of the first at (0, 0), to the element's. */
  placer() {
    const { x, y, width, scale } = this.box();
    const place = ([u, v]) => [
      this.isMirrored ? x + width - scale * (u + 0.5) : x + scale * (u + 0.5),
      y + scale * (v + 0.5),
    ];
    return Object.assign(place, { scale });
  }

  drawMap(pen) {
    const box = this.box();
    pen.save();
    if (this.isMirrored) { pen.translate(2 * box.x + box.width, 0); pen.scale(-1, 1); }
    drawMap(pen, this.camera.map, box, MAP_ALPHA);
    pen.restore();
  }

  /** The image's border, where there is no picture. */
  frame(pen) {
    const { x, y, width, height } = this.box();
    pen.strokeStyle = "#5a626b";
    pen.strokeRect(x + 0.5, y + 0.5, width - 1, height - 1);
  }

  closed(line) {
    const path = new Path2D();
    line.forEach((point, n) => path[n ? "lineTo" : "moveTo"](...this.place(point)));
    path.closePath();
    return path;
  }

  drawFound(pen) {
    const outlines = this.look.look.outline_px.map((line) => this.closed(line));
    stroke(pen, outlines, CASING, 4);
    stroke(pen, outlines, FOUND, 2);
    const rings = new Path2D();
    for (const [u, v, radius] of this.look.rings_px.flat()) {
      const [x, y] = this.place([u, v]);
      const r = Math.max(2, this.place.scale * radius);
      rings.moveTo(x + r, y);
      rings.arc(x, y, r, 0, 2 * Math.PI);
    }
    stroke(pen, [rings], FOUND, 1.8);
    pen.font = "600 13px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    for (const [u, v, text] of this.look.labels) {
      const [x, y] = this.place([u, v]);
      pen.lineWidth = 4;
      pen.strokeStyle = CASING;
      pen.strokeText(text, x, y);
      pen.fillStyle = "#ffffff";
      pen.fillText(text, x, y);
    }
  }

  /** The outlines of where to hold the target, filled from below by how much this frame is worth. */
  drawGhost(pen) {
    const faces = (this.camera?.ghost_px ?? []).map((line) => this.closed(line));
    if (faces.length === 0) return;
    const isMatch = Boolean(this.look?.look.is_match);
    const share = isMatch ? 1 : Math.min(1, Math.max(0, this.look?.look.worth ?? 0));
    const heights = this.camera.ghost_px.flat().map((point) => this.place(point)[1]);
    const box = this.box();
    const [top, bottom] = [Math.max(box.y, Math.min(...heights)), Math.min(box.y + box.height, Math.max(...heights))];
    const colour = isMatch ? MATCH : GHOST;
    const strength = this.look?.look.is_wanted && !isMatch ? FADED : 1; // here will do: nothing is to draw away from it
    pen.save();
    const all = new Path2D();
    faces.forEach((face) => all.addPath(face));
    pen.clip(all);
    pen.fillStyle = colour;
    pen.globalAlpha = 0.1 * strength;
    pen.fillRect(0, top, this.element.clientWidth, bottom - top);
    pen.globalAlpha = 0.38 * strength;
    const level = bottom - share * (bottom - top);
    pen.fillRect(0, level, this.element.clientWidth, bottom - level);
    pen.restore();
    pen.globalAlpha = strength;
    const isOne = faces.length === 1; // neighbours' sides lie on each other: dashes would not
    stroke(pen, faces, CASING, isOne ? 7 : 6);
    stroke(pen, faces, colour, isOne ? 3.5 : 2.5, isMatch || !isOne ? [] : [14, 8]);
    pen.globalAlpha = 1;
  }

  /** An arrow from the target to where it is to be, if that is some way off. */
  drawWay(pen) {
    const { look } = this.look;
    const goals = this.camera?.ghost_px ?? [];
    if (look.is_wanted || look.outline_px.length === 0 || goals.length === 0) return;
    const [from, to] = [this.middleOf(look.outline_px), this.middleOf(goals)];
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const thick = 0.016 * Math.min(this.element.clientWidth, this.element.clientHeight);
    if (length < 8 * thick) return;
    const at = (along, across) => [0, 1].map((axis) => {
      const [way, side] = [(to[axis] - from[axis]) / length, (axis ? 1 : -1) * (to[1 - axis] - from[1 - axis]) / length];
      return from[axis] + along * way + across * side;
    });
    const path = new Path2D();
    path.moveTo(...at(0, 0));
    path.lineTo(...at(length, 0));
    path.moveTo(...at(length - 2.5 * thick, 2 * thick));
    path.lineTo(...at(length, 0));
    path.lineTo(...at(length - 2.5 * thick, -2 * thick));
    stroke(pen, [path], CASING, 1.7 * thick);
    stroke(pen, [path], GHOST, thick);
  }

  middleOf(lines) {
    const points = lines.flat().map((point) => this.place(point));
    return [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
  }

  /** A ring that closes while the target is held still. */
  drawStill(pen) {
    const { still, look } = this.look;
    if (!look.is_wanted || look.outline_px.length === 0) return;
    const middle = this.middleOf(look.outline_px);
    const radius = 0.1 * Math.min(this.element.clientWidth, this.element.clientHeight);
    const from = -Math.PI / 2;
    const arc = (share) => {
      const path = new Path2D();
      path.arc(...middle, radius, from, from + 2 * Math.PI * share);
      return [path];
    };
    stroke(pen, arc(1), CASING, radius / 4);
    stroke(pen, arc(Math.min(1, still)), MATCH, radius / 5);
  }
}

function stroke(pen, paths, colour, width, dashes = []) {
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.lineJoin = "round";
  pen.lineCap = dashes.length ? "butt" : "round";
  pen.setLineDash(dashes);
  paths.forEach((path) => pen.stroke(path));
  pen.setLineDash([]);
}
