/* The band of large words: as large as there is room for, no oftener changed than a person can read. */

const STEADY_MS = 350; // words stay at least so long
const SAID_MS = 2500; // and are not read aloud oftener
const LINES = [[0.97, 1.2], [1.7, 2.35], [2.4, 3.5]]; // what one to three lines hold in widths, and their height in letters

const part = (id) => document.getElementById(id);

export class Band {
  constructor() {
    this.shownAt = -Infinity;
    this.saidAt = -Infinity;
    this.ruler = document.createElement("canvas").getContext("2d");
    new ResizeObserver(() => this.fit()).observe(part("big"));
  }

  /** Show what `told()` says now or, if other words are too new, a little later; then call `shown`. */
  show(told, shown) {
    clearTimeout(this.later);
    const { tone, big, small } = told();
    const isUrgent = tone !== document.body.dataset.tone && tone !== "plain" && tone !== "warn";
    const isNew = big !== part("big").textContent;
    const wait = STEADY_MS - (performance.now() - this.shownAt);
    if (wait > 0 && isNew && !isUrgent) {
      this.later = setTimeout(() => this.show(told, shown), wait);
      return;
    }
    part("small").textContent = small;
    document.body.dataset.tone = tone;
    if (isNew) {
      this.shownAt = performance.now();
      part("big").textContent = big;
      this.fit();
    }
    this.say(big);
    shown();
  }

  /** The largest letters with which the words have room. */
  fit() {
    const big = part("big");
    const style = getComputedStyle(big);
    this.ruler.font = `${style.fontWeight} 100px ${style.fontFamily}`;
    const width = this.ruler.measureText(big.textContent).width / 100 || 1;
    const sizes = LINES.map(([wide, high]) => Math.min((wide * big.clientWidth) / width, big.clientHeight / high));
    big.style.fontSize = `${Math.max(...sizes).toFixed(1)}px`;
  }

  /** For who listens to the page. */
  say(text) {
    if (performance.now() - this.saidAt < SAID_MS || part("said").textContent === text) return;
    this.saidAt = performance.now();
    part("said").textContent = text;
  }
}
