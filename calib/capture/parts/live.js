/* The live page: what the server says is shown, what the person does is told to it. Texts come from files and may hold
   anything: they reach the page as text nodes alone. */

import { Band } from "./band.js";
import { BrowserCamera } from "./camera.js";
import { made, showPanel } from "./panel.js";
import { PhotoStrip } from "./photos.js";
import { Picture } from "./picture.js";
import { Sound } from "./sound.js";
import { Space } from "./space.js";
import { connect } from "./wire.js";
import { instruction, mirrored } from "./words.js";

const OLD_MS = 1500; // what was found so long ago is not shown
const SLOW = 3; // times what there is between two looks, if that is longer
const ASKING_MS = 1000; // before it is said that the browser asks
const LATE_MS = 1000; // a look that has not come by then is not waited for
const NOTICE_MS = { line: 6000, fault: 15000 };
const FLASH_MS = 500;

const part = (id) => document.getElementById(id);
const model = {
  state: null, guidance: null, look: null, looks: [], fault: "", isLost: false, isAsking: false,
  isWaiting: false, isMirrored: false, hasMap: false, isAsked: false, endsAt: null,
};
const pictures = [];
const band = new Band();
const sound = new Sound();
const space = new Space(part("space-view"));
part("space").hidden = !space.isThere;
let camera = null;
const sent = { number: -1, at: -Infinity };
let answered = -1;

const wire = connect({
  open() {
    model.isLost = false;
    sent.at = -Infinity; // an answer to it is not to be waited for
    if (model.fault) tellFault();
    showWords();
  },
  lost: () => { model.isLost = true; showWords(); },
  message: (message) => HANDLERS[message.kind]?.(message),
  image: (header, bytes) => pictures[header.source]?.setImage(header, bytes),
});
const strip = new PhotoStrip({ list: part("photos"), box: part("photo-box"), command: wire.command });

// ---- what the server says

const HANDLERS = {
  state(state) {
    const before = model.state;
    model.state = state;
    model.endsAt = state.ends_in_s === null ? null : performance.now() + 1000 * state.ends_in_s;
    if (!before) makePictures(state.sources);
    if (state.sources.length > 1) state.sources.forEach(({ name, fault }, row) => pictures[row].setWords(fault || name));
    if (!state.is_here) { wire.stayAway(); camera?.close(); }
    part("automatic").setAttribute("aria-pressed", String(state.is_automatic));
    if (state.phase !== before?.phase) enter(state.phase, before?.phase);
    showPanels();
    showWords();
  },
  guidance({ guidance, scene, left_out: leftOut }) {
    const isNewlyGood = guidance.stage === "good" && model.guidance !== null && model.guidance.stage !== "good";
    model.guidance = guidance;
    if (scene) space.setScene(scene);
    pictures.forEach((picture, row) => picture.setCamera(guidance.cameras[row] ?? null));
    space.setGhost(guidance.ghost?.cam_from_target ?? null, guidance.cameras[ghostCamera()]?.image_size ?? [3, 2]);
    strip.show(guidance.photos, leftOut, guidance.cameras[0]?.image_size);
    part("delete").disabled = guidance.photos.length === 0;
    part("size").disabled = guidance.photos.length > 0;
    part("size").title = guidance.photos.length > 0 ? "All photos have one size" : "";
    if (isNewlyGood) sound.play("good");
    showPanels();
    showWords();
  },
  look(look) {
    if (isBrowser(look.source)) answered = Math.max(answered, look.number);
    model.isWaiting = false;
    showLook(look.source, look);
    const { source } = look;
    clearTimeout(forgetting[source]);
    const between = Math.min(performance.now() - (lookedAt[source] ?? -Infinity), OLD_MS);
    lookedAt[source] = performance.now();
    forgetting[source] = setTimeout(() => showLook(source, null), Math.max(OLD_MS, SLOW * between));
  },
  taken({ name }) {
    sound.play("taken");
    flash();
    notice(`Photo ${name} taken`, false);
  },
  notice({ said, is_fault: isFault }) {
    if (isFault) sound.play("wrong");
    notice(said, isFault);
  },
};

const forgetting = []; // timers, by source
const lookedAt = [];

function showLook(source, look) {
  model.looks[source] = look;
  pictures[source]?.setLook(look);
  const told = lookTold();
  model.look = model.looks[told] ?? null;
  space.setLive(model.looks[ghostCamera()]?.look.cam_from_target ?? null);
  showNotes(model.look?.look.notes ?? []);
  showWords();
}

/** The row of the first camera that is to see the target next; poses are in its frame. */
function ghostCamera() {
  return Math.max(0, model.guidance?.cameras.findIndex((camera) => camera.ghost_px.length > 0) ?? 0);
}

/** Of several cameras, the row of the one whose look is put into words: one that takes, or else that is to see. */
function lookTold() {
  const wanting = model.looks.findIndex((one) => one?.look.is_wanted);
  return wanting >= 0 ? wanting : ghostCamera();
}

const isBrowser = (source) => model.state?.sources[source]?.kind === "browser";

function makePictures(sources) {
  for (const [row, source] of sources.entries()) {
    const picture = new Picture(sources.length > 1 ? source.name : "");
    pictures.push(picture);
    part("pictures").append(picture.element);
    if (source.kind === "browser") startCamera(row, picture);
  }
  part("pictures").dataset.count = String(sources.length);
}

const TAKES = ["taking", "ending"]; // phases in which the camera is open

function enter(phase, before) {
  document.body.dataset.phase = phase;
  model.isAsked = false;
  if (!TAKES.includes(phase)) camera?.close();
  else if (before && !TAKES.includes(before)) openCamera();
  if (phase === "done") showReport();
}

/** The report stays when the server ends; the files beside it are in the folder, and not at this address. */
function showReport() {
  const frame = part("report");
  frame.addEventListener("load", () => {
    for (const link of frame.contentDocument.querySelectorAll("a[href]:not([href^='#'])")) {
      link.title = `In ${model.state.folder}`;
      link.removeAttribute("href");
    }
    wire.stayAway();
    wire.command("bye");
  }, { once: true });
  frame.hidden = false;
  frame.src = "report";
}

// ---- the browser's camera

let asking = 0;

function startCamera(row, picture) {
  camera = new BrowserCamera({
    isFree: () => wire.isFree() && model.state.is_here && (answered >= sent.number || performance.now() - sent.at > LATE_MS),
    frame(about, grey) {
      if (answered < 0 && sent.number >= 1) { model.isWaiting = true; showWords(); }
      Object.assign(sent, { number: sent.number + 1, at: performance.now() });
      wire.frame({ source: row, number: sent.number, ...about }, grey);
    },
    asking() {
      clearTimeout(asking);
      asking = setTimeout(() => { model.isAsking = true; showWords(); }, ASKING_MS);
    },
    fault(line) {
      clearTimeout(asking);
      Object.assign(model, { fault: line, look: null, looks: [], isAsking: false });
      tellFault();
      showWords();
      sound.play("wrong");
    },
    ready(about) {
      const wasFaulty = model.fault !== "";
      clearTimeout(asking);
      Object.assign(model, { fault: "", isAsking: false });
      if (wasFaulty) tellFault();
      picture.setSize(about.width, about.height);
      showChoices(about);
      if (about.isFront !== model.isMirrored && !part("mirror").dataset.chosen) setMirrored(about.isFront);
      showWords();
    },
  });
  picture.setVideo(camera.video);
  part("mirror").hidden = false;
  part("choices").hidden = false;
  part("device").addEventListener("change", () => camera.open({ deviceId: part("device").value }));
  part("size").addEventListener("change", () => {
    const [width, height] = part("size").value.split("x").map(Number);
    camera.open({ deviceId: part("device").value, width, height });
  });
  // Photos that are there already say which size is wanted; they are told right after the state.
  setTimeout(openCamera, 150);
}

function openCamera() {
  if (TAKES.includes(model.state.phase) && model.state.is_here) camera?.open({ ...camera.wish, ...sizeOfPhotos() });
}

function sizeOfPhotos() {
  const guidance = model.guidance;
  if (!guidance || guidance.photos.length === 0) return {};
  const [width, height] = guidance.cameras[0].image_size;
  return { width, height };
}

function tellFault() {
  wire.command("source", model.fault);
}

function showChoices({ deviceId, width, height, sizes, devices }) {
  const option = (value, text, isChosen) => new Option(text, value, isChosen, isChosen);
  part("device").replaceChildren(...devices.map((one, n) => (
    option(one.deviceId, one.label || `camera ${n}`, one.deviceId === deviceId))));
  const all = sizes.some(([w, h]) => w === width && h === height) ? sizes : [[width, height], ...sizes];
  part("size").replaceChildren(...all.map(([w, h]) => option(`${w}x${h}`, `${w} × ${h}`, w === width && h === height)));
}

// ---- words

function showWords() {
  band.show(() => instruction(counted()), showCard);
}

/** What is left of a countdown. */
function counted() {
  if (model.endsAt === null || model.state === null) return model;
  const left = Math.max(0, (model.endsAt - performance.now()) / 1000);
  return { ...model, state: { ...model.state, ends_in_s: left } };
}

function showNotes(notes) {
  const text = JSON.stringify(notes);
  if (text === part("notes").dataset.shown) return;
  part("notes").dataset.shown = text;
  part("notes").replaceChildren(...notes.map((note) => made("li", note.forbids ? "forbids" : "", note.sentence)));
}

function showPanels() {
  const seen = model.isMirrored ? mirrored : (text) => text;
  if (model.guidance) showPanel(model.guidance, model.state, seen, model.isMirrored);
}

function notice(text, isFault) {
  const line = made("li", isFault ? "fault" : "", text);
  part("notices").append(line);
  while (part("notices").children.length > 3) part("notices").firstChild.remove();
  setTimeout(() => line.remove(), isFault ? NOTICE_MS.fault : NOTICE_MS.line);
}

function flash() {
  part("flash").classList.add("on");
  setTimeout(() => part("flash").classList.remove("on"), FLASH_MS);
}

// ---- questions over the picture

const reload = () => window.location.reload();
const CARDS = {
  elsewhere: { words: "This session is shown in another tab or window.", buttons: [["Take it back here", reload]] },
  fault: { words: "", buttons: [["Try again", () => camera.open(camera.wish)]] },
  asked: {
    words: "It is not good yet. Finish with the photos so far?",
    buttons: [["Take more photos", () => ask(false)], ["Finish now", () => wire.command("finish")]],
  },
  ending: {
    words: "",
    buttons: [["Take more photos", () => wire.command("more")], ["Finish now", () => wire.command("finish")]],
  },
  failed: {
    words: "The photos are kept. Take more of them, or close this page to end.",
    buttons: [["Take more photos", () => wire.command("more")], ["Compute again", () => wire.command("finish")]],
  },
};
let shownCard = "";

function showCard() {
  const name = cardNow();
  if (name === shownCard) return;
  shownCard = name;
  part("card").hidden = !name;
  const { words, buttons } = CARDS[name] ?? { words: "", buttons: [] };
  part("card-words").textContent = words;
  part("card-buttons").replaceChildren(...buttons.map(([text, action]) => {
    const button = Object.assign(made("button", "primary", text), { type: "button" });
    button.addEventListener("click", action);
    return button;
  }));
  part("card-buttons").querySelector("button")?.focus({ preventScroll: true });
}

function cardNow() {
  if (model.state && !model.state.is_here) return "elsewhere";
  if (model.isLost) return "";
  if (["ending", "failed"].includes(model.state?.phase)) return model.state.phase;
  if (model.state?.phase !== "taking") return "";
  return model.isAsked ? "asked" : model.fault && "fault";
}

/** Whether to finish, if the photos do not suffice yet. */
function ask(isAsked) {
  model.isAsked = isAsked;
  showWords();
}

// ---- what the person does

function setMirrored(isMirrored) {
  model.isMirrored = isMirrored;
  part("mirror").setAttribute("aria-pressed", String(isMirrored));
  pictures.forEach((picture) => picture.set({ isMirrored }));
  space.setMirrored(isMirrored);
  showPanels();
  showWords();
}

const ACTIONS = {
  take: () => wire.command(["ending", "failed"].includes(model.state?.phase) ? "more" : "take"),
  skip: () => wire.command("skip"),
  delete: () => { const last = model.guidance?.photos.at(-1); if (last) wire.command("delete", last.name); },
  automatic: () => wire.command(model.state?.is_automatic ? "by_hand" : "automatic"),
  map() {
    model.hasMap = !model.hasMap;
    part("map").setAttribute("aria-pressed", String(model.hasMap));
    pictures.forEach((picture) => picture.set({ hasMap: model.hasMap }));
  },
  mirror() { part("mirror").dataset.chosen = "yes"; setMirrored(!model.isMirrored); },
  sound() { sound.toggle(); part("sound").setAttribute("aria-pressed", String(sound.isOn)); },
  finish() {
    const isEarly = model.state?.phase === "taking" && ["first", "guiding"].includes(model.guidance?.stage);
    if (isEarly && !model.isAsked) ask(true); else wire.command("finish");
  },
  help: () => part("help-box").showModal(),
};
const KEYS = {
  " ": "take", n: "skip", Delete: "delete", Backspace: "delete", a: "automatic", m: "map", i: "mirror", s: "sound", f: "finish",
  "?": "help",
};

for (const [name, action] of Object.entries(ACTIONS)) part(name).addEventListener("click", action);
// A button that was clicked gives the focus back, so that the space bar takes a photo, and is not this button again.
document.addEventListener("click", (event) => {
  if (event.detail > 0) event.target.closest("button")?.blur();
}, true);
for (const id of ["device", "size"]) part(id).addEventListener("change", () => part(id).blur()); // keys are the page's again
document.addEventListener("keydown", (event) => {
  const action = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action || event.repeat || event.ctrlKey || event.metaKey || event.altKey || isElsewhere(event)) return;
  event.preventDefault();
  ACTIONS[action]();
});

/** Whether a key is for what has the focus. */
function isElsewhere(event) {
  const isOnButton = event.key === " " && event.target.closest("button, summary, a");
  const isBehind = document.querySelector("dialog[open]") !== null;
  return Boolean(isBehind || event.target.closest("select, input, textarea") || isOnButton);
}

for (const box of document.querySelectorAll("dialog")) {
  box.addEventListener("click", (event) => {
    if (event.target === box || event.target.closest("[data-close]")) box.close();
  });
}
setInterval(() => { if (model.endsAt !== null) showWords(); }, 250);
showWords();
