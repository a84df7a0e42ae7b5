/* The strip of photos: small pictures of those that were taken, with a way to delete and to restore each. */

const THUMB_WIDTH = 240;

export class PhotoStrip {
  /** @param {{list: Element, box: HTMLDialogElement, command: (kind: string, name: string) => void}} parts */
  constructor({ list, box, command }) {
    this.list = list;
    this.box = box;
    this.command = command;
    this.items = new Map(); // by name
    this.queue = Promise.resolve(); // pictures are fetched one after another
    const part = (name) => box.querySelector(`#photo-${name}`);
    this.parts = { name: part("name"), words: part("words"), image: part("image") };
    part("delete").addEventListener("click", () => { this.command("delete", this.shown); box.close(); });
  }

  /** Show these, and after them those that were deleted. */
  show(photos, leftOut, imageSize) {
    const present = new Set(photos.map((photo) => photo.name));
    for (const photo of [...photos, ...leftOut]) this.item(photo, imageSize);
    for (const [name, item] of this.items) this.mark(item, present.has(name));
    const order = [...photos.map((photo) => photo.name), ...[...this.items.keys()].filter((name) => !present.has(name))];
    const before = this.list.children.length;
    this.list.append(...order.map((name) => this.items.get(name).element));
    if (photos.length && this.list.children.length !== before) {
      this.items.get(photos.at(-1).name).element.scrollIntoView({ block: "nearest", inline: "end" });
    }
  }

  item(photo, imageSize) {
    const item = this.items.get(photo.name) ?? this.made(photo, imageSize);
    item.photo = photo;
    item.words.textContent = photo.is_counted ? `${photo.rings} rings` : photo.remark || "not counted";
    item.open.setAttribute("aria-label", `${photo.name}: ${[`${photo.rings} rings`, photo.remark].filter(Boolean).join(", ")}`);
    item.element.classList.toggle("not-counted", !photo.is_counted);
    item.open.title = photo.remark;
  }

  made(photo, imageSize) {
    const element = document.createElement("li");
    const open = button("photo-open", "", () => this.open(item));
    const remove = button("photo-remove", "×", () => this.toggle(item));
    const canvas = document.createElement("canvas");
    const name = Object.assign(document.createElement("b"), { textContent: photo.name.replace(/\.[a-z]+$/iu, "") });
    const words = document.createElement("span");
    open.append(canvas, name, words);
    element.append(open, remove);
    const item = { element, open, remove, canvas, words, photo };
    this.items.set(photo.name, item);
    this.queue = this.queue.then(() => draw(item, imageSize));
    return item;
  }

  mark(item, isThere) {
    item.isThere = isThere;
    item.element.classList.toggle("deleted", !isThere);
    item.remove.textContent = isThere ? "×" : "Restore";
    item.remove.setAttribute("aria-label", `${isThere ? "Delete" : "Restore"} ${item.photo.name}`);
  }

  toggle(item) {
    this.command(item.isThere ? "delete" : "restore", item.photo.name);
  }

  open(item) {
    if (!item.isThere) return;
    const { name, words, image } = this.parts;
    this.shown = item.photo.name;
    name.textContent = item.photo.name;
    words.textContent = [`${item.photo.rings} rings`, item.photo.remark].filter(Boolean).join(": ");
    image.src = address(item.photo.name);
    image.alt = `The photo ${item.photo.name}`;
    this.box.showModal();
  }
}

const address = (name) => `photos/${encodeURIComponent(name)}`;

function button(className, text, onClick) {
  const made = Object.assign(document.createElement("button"), { type: "button", className, textContent: text });
  made.addEventListener("click", onClick);
  return made;
}

/** A small picture of the photo; where the browser cannot show it, the target's outline alone. */
async function draw({ canvas, photo }, imageSize) {
  const pen = canvas.getContext("2d");
  try {
    const answer = await fetch(address(photo.name));
    if (!answer.ok) throw new Error(answer.statusText);
    const bitmap = await createImageBitmap(await answer.blob(), { resizeWidth: THUMB_WIDTH, resizeQuality: "medium" });
    Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
    pen.drawImage(bitmap, 0, 0);
    bitmap.close();
  } catch {
    outline(canvas, pen, photo, imageSize ?? [3, 2]);
  }
}

function outline(canvas, pen, photo, [width, height]) {
  const scale = THUMB_WIDTH / width;
  Object.assign(canvas, { width: THUMB_WIDTH, height: Math.round(scale * height) });
  pen.strokeStyle = "#56b4e9";
  pen.lineWidth = 2;
  for (const line of photo.outline_px) {
    pen.beginPath();
    line.forEach(([u, v]) => pen.lineTo(scale * (u + 0.5), scale * (v + 0.5)));
    pen.closePath();
    pen.stroke();
  }
}
