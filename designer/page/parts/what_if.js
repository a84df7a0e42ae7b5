/* Sliders: each `div.what-if[data-model]` gets controls for the model that stands as JSON in the script element with
   that id; see designer/page/what_if.py for the JSON, and designer/base/square_law.py for the arithmetic, of which `Law`
   is the second of two: the tests hold it to the first. Names come from files and may hold anything: they reach the
   page as text alone. Numbers of cells stand unrounded in data-value, to be sorted by, and for tests. */
"use strict";

(() => {
  const STEPS = 400; // of a slider; 0 is none at all
  const FARTHEST = 1e9;
  const HALVINGS = 64;
  const MOST_NAMED = 3; // of the errors that add most
  const LARGE_SHARE = 0.1;
  const UNITS = { // in one of the slider's own unit, as designer/base/units.py and designer/tolerance/error_file.py
    mm: { "": 1, mm: 1, cm: 10, m: 1000, um: 1e-3, "µm": 1e-3, "μm": 1e-3, in: 25.4, thou: 0.0254, mil: 0.0254 },
    deg: { "": 1, deg: 1, "°": 1, rad: 180 / Math.PI, mrad: 0.18 / Math.PI },
    "%": { "": 1, "%": 1 },
    K: { "": 1, K: 1, "°C": 1, degC: 1 },
    px: { "": 1, px: 1 },
  };
  const QUANTITY = /^\s*(?:(normal|uniform|fixed)\s+)?([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,3})?)\s*([^\s\d.+-]\S*)?\s*$/i;

  // ---- the arithmetic

  class Law {
    constructor(rows, missed) {
      Object.assign(this, rows); // null is no number: it adds nothing to others, and is told as "-"
      this.share = missed;
    }

    product(one, other) {
      const high = Math.max(one, other);
      return this.fixed[high * (high + 1) / 2 + Math.min(one, other)];
    }

    square(measure, sizes) {
      if (this.noise[measure] === null) return NaN;
      let total = this.noise[measure];
      const known = [];
      sizes.forEach((size, error) => {
        if (!size.fixed) total += size.value ** 2 * this.drawn[error][measure];
        else if (size.value !== 0) known.push([error, size.value]);
      });
      for (const [s, a] of known) for (const [t, b] of known) total += a * b * this.product(s, t)[measure];
      return total;
    }

    cost(error, measure, size) {
      const by = size.fixed ? this.product(error, error) : this.drawn[error];
      return size.value ** 2 * by[measure];
    }

    missed(error, measure, size) {
      const a = Math.abs(size.value);
      if (!size.fixed) return a ** 4 * Math.abs(this.missed_drawn[error][measure]);
      return a ** 3 * Math.abs(this.missed_third[error][measure]) + a ** 4 * Math.abs(this.missed_fixed[error][measure]);
    }

    isBeyond(measure, sizes) {
      const missed = sizes.reduce((sum, size, error) => sum + this.missed(error, measure, size), 0);
      return missed > this.share * this.square(measure, sizes);
    }

    reach(error, measure, sizes) {
      const fixed = sizes[error].fixed;
      const rest = this.square(measure, sizes.with(error, { value: 0, fixed }));
      const mixed = this.mixed(error, measure, sizes);
      const isTooMuch = (value) => {
        const size = { value, fixed };
        return this.missed(error, measure, size) > this.share * (rest + this.cost(error, measure, size) + 2 * value * mixed);
      };
      if (!isTooMuch(FARTHEST)) return Infinity;
      let [low, high] = [-Math.log(FARTHEST), Math.log(FARTHEST)];
      for (let step = 0; step < HALVINGS; step += 1) {
        const middle = 0.5 * (low + high);
        if (isTooMuch(Math.exp(middle))) high = middle;
        else low = middle;
      }
      return Math.exp(high);
    }

    // What a unit of a known size has in common with the other known ones.
    mixed(error, measure, sizes) {
      if (!sizes[error].fixed) return 0;
      return sizes.reduce((sum, size, other) => (
        size.fixed && other !== error ? sum + size.value * this.product(error, other)[measure] : sum), 0);
    }

    largest(error, measure, limit, sizes) {
      const fixed = sizes[error].fixed;
      const by = this.cost(error, measure, { value: 1, fixed });
      const mixed = this.mixed(error, measure, sizes);
      const room = limit ** 2 - this.square(measure, sizes.with(error, { value: 0, fixed }));
      if (!(by > 0)) return Infinity;
      return room > 0 ? (Math.sqrt(mixed ** 2 + by * room) - mixed) / by : 0;
    }

    together(measure, limit, sizes) {
      const room = limit ** 2 - this.noise[measure];
      const added = this.square(measure, sizes) - this.noise[measure];
      if (!(room > 0)) return 0;
      return added > 0 ? Math.sqrt(room / added) : Infinity;
    }
  }

  const gainOf = (setting) => setting.gain * (setting.distribution === "uniform" ? 1 / Math.sqrt(3) : 1);
  const inLaw = (setting) => ({ value: gainOf(setting) * setting.size, fixed: setting.distribution === "fixed" });

  // ---- words

  const figure = (value, digits = 3) => {
    if (!Number.isFinite(value)) return "-";
    if (value === 0) return "0";
    const exponent = Math.floor(Math.log10(Math.abs(value)));
    if (exponent <= -7 || exponent >= 7) return value.toExponential(digits - 1);
    return value.toFixed(Math.max(0, digits - 1 - exponent));
  };
  const plain = (value, digits = 3) => String(Number(value.toPrecision(digits)));
  const sizeText = (setting, unit, digits = 3) => (
    `${setting.distribution === "normal" ? "" : `${setting.distribution} `}${plain(setting.size, digits)}${unit}`);
  const shareText = (share) => (share === 0 ? "" : share < 1e-3 ? "< 0.1 %" : `${(100 * share).toFixed(1)} %`);
  const quoted = (word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\"'\"'")}'`);

  // A size as a person writes it; null if it is none.
  const parse = (text, unit) => {
    const found = QUANTITY.exec(text);
    const per = found && UNITS[unit][found[3] ?? ""];
    const size = per ? Number(found[2]) * per : NaN;
    const distribution = found?.[1]?.toLowerCase() ?? "normal";
    if (!Number.isFinite(size) || (size < 0 && distribution !== "fixed")) return null;
    return { distribution, size };
  };

  // ---- the parts of the page

  const make = (name, { text, ...properties } = {}, ...children) => {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(properties)) {
      if (key in element) element[key] = value;
      else element.setAttribute(key, value);
    }
    if (text !== undefined) element.textContent = text;
    element.append(...children);
    return element;
  };
  // A cell's number and words; what is the same is left alone, which saves the browser its layout.
  const put = (cell, text, value = NaN) => {
    if (cell.textContent !== text) cell.textContent = text;
    cell.dataset.value = String(value);
  };
  const icon = (level) => {
    const drawing = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
    drawing.setAttribute("class", `icon level-${level}`);
    drawing.setAttribute("aria-hidden", "true");
    use.setAttribute("href", `#icon-${level}`);
    drawing.append(use);
    return drawing;
  };
  let names = 0;
  const named = (element, word) => {
    element.id ||= `what-if-${word}-${names += 1}`;
    return element.id;
  };

  // A slider's place and the size it stands for, in its unit.
  const sizeAt = (slider, place) => {
    if (place === 0) return 0;
    return Number((slider.lowest * (slider.highest / slider.lowest) ** ((place - 1) / (STEPS - 1))).toPrecision(3));
  };
  const placeOf = (slider, size) => {
    if (!(Math.abs(size) >= slider.lowest)) return 0;
    const share = Math.log(Math.abs(size) / slider.lowest) / Math.log(slider.highest / slider.lowest);
    return 1 + (STEPS - 1) * Math.min(share, 1);
  };

  // ---- one error: its slider, box and what it costs

  class Row {
    constructor(slider, measures, changed) {
      this.slider = slider;
      this.changed = changed;
      const title = make("th", { scope: "row" }, make("span", { text: slider.title }), make("code", { text: slider.name }));
      const label = named(title.firstChild, "error");
      this.range = make("input", { type: "range", min: 0, max: STEPS, step: 1, "aria-labelledby": label });
      this.track = make("span", { className: "what-if-track" }, make("span", { className: "reach" }), this.range);
      this.box = make("input", {
        type: "text", autocomplete: "off", spellcheck: false, className: "size", "aria-labelledby": label,
      });
      this.hint = make("span", { className: "hint", text: "" });
      this.box.setAttribute("aria-describedby", named(this.hint, "hint"));
      const size = make("td", {}, make("div", { className: "set" }, this.track, this.box, this.hint));
      this.cells = ["adds", "of it", "may be, rest as set", "may be, alone"].map((head) => (
        make("td", { className: "number", "data-head": head })));
      this.bar = make("span", { className: "bar", "aria-hidden": "true" });
      this.share = make("span");
      this.cells[1].append(this.bar, this.share);
      this.element = make("tr", {}, title, size, ...this.cells);
      this.range.addEventListener("input", () => {
        const distribution = this.setting.distribution;
        this.set({ ...this.setting, size: sizeAt(slider, Number(this.range.value)), distribution });
        changed();
      });
      this.box.addEventListener("change", () => this.typed());
    }

    typed() {
      const found = parse(this.box.value, this.slider.unit);
      this.box.setAttribute("aria-invalid", String(found === null));
      this.hint.textContent = found ? "" : `write a size such as 0.1${this.slider.unit} or uniform 0.1${this.slider.unit}`;
      if (found === null) return;
      this.set({ ...this.setting, ...found });
      this.changed();
    }

    set(setting) {
      this.setting = setting;
      const isFree = setting.gain > 0;
      this.range.disabled = this.box.disabled = !isFree;
      const text = isFree ? sizeText(setting, this.slider.unit) : "-";
      if (Number(this.range.value) !== Math.round(placeOf(this.slider, setting.size))) {
        this.range.value = Math.round(placeOf(this.slider, setting.size));
      }
      this.box.value = text;
      this.box.setAttribute("aria-invalid", "false");
      this.hint.textContent = isFree ? "" : "this way of making has none";
    }

    show(law, error, measure, unit, limit, sizes, rank, total) {
      const [adds, share, beside, alone] = this.cells;
      const cost = law.cost(error, measure, sizes[error]);
      const part = total > 0 ? cost / total : 0;
      put(adds, cost > 0 ? `${figure(Math.sqrt(cost))} ${unit}` : "0", Math.sqrt(cost));
      if (this.share.textContent !== shareText(part)) this.share.textContent = shareText(part);
      share.dataset.value = String(part);
      this.bar.style.setProperty("--part", String(part));
      this.bar.classList.toggle("empty", part === 0);
      this.element.dataset.rank = String(rank);
      const none = sizes.map((size) => ({ value: 0, fixed: size.fixed }));
      this.allowed(beside, law.largest(error, measure, limit, sizes));
      this.allowed(alone, law.largest(error, measure, limit, none));
      const reach = this.ofLaw(law.reach(error, measure, sizes));
      this.element.dataset.reach = String(reach);
      this.track.style.setProperty("--reach", String(placeOf(this.slider, reach) / STEPS));
      this.track.classList.toggle("all", reach >= this.slider.highest);
      const isPast = Math.abs(this.setting.size) > reach;
      this.track.classList.toggle("past", isPast);
      const text = sizeText(this.setting, this.slider.unit);
      this.range.setAttribute("aria-valuetext", isPast ? `${text}, beyond the prediction's reach` : text);
    }

    ofLaw(value) {
      const gain = gainOf(this.setting);
      return gain > 0 ? value / gain : Infinity;
    }

    allowed(cell, value) {
      const size = this.ofLaw(value);
      const text = size === 0 ? "none" : size > 1e3 * this.slider.highest ? "any" : `${plain(size)}${this.slider.unit}`;
      put(cell, text, size);
      cell.classList.toggle("short", size > 0 && size < Math.abs(this.setting.size));
      cell.classList.toggle("none", size === 0);
    }
  }

  // ---- one target, or one way of making it

  class Side {
    constructor(side, model, changed) {
      this.side = side;
      this.law = new Law(side.law, model.missed);
      this.rows = side.sliders.map((slider) => new Row(slider, model.measures, () => { this.touched(); changed(); }));
      this.choice = make("select", {}, ...side.choices.map((one) => (
        make("option", { value: one.name, text: one.title ? `${one.name}: ${one.title}` : one.name }))));
      this.choice.addEventListener("change", () => { this.choose(this.chosen()); changed(); });
      this.again = make("button", { type: "button", text: "Reset" });
      this.again.addEventListener("click", () => { this.choose(this.chosen()); changed(); });
      const label = make("label", {}, make("span", { text: "made as" }), this.choice);
      this.heads = ["error", "size", "adds", "of it", "may be, rest as set", "may be, alone"];
      const head = make("tr", {}, ...this.heads.map((text, place) => (
        make("th", { scope: "col", text, className: place > 1 ? "number" : "" }))));
      this.body = make("tbody", {}, ...this.rows.map((row) => row.element));
      const table = make("table", {}, make("thead", {}, head), this.body);
      const title = make("h3", { text: side.title });
      table.setAttribute("aria-labelledby", named(title, "side"));
      this.total = make("p", { className: "what-if-total" });
      this.element = make("div", { className: "what-if-side" }, title,
        make("p", { className: "what-if-choice" }, label, this.again), this.total, table);
      this.choice.value = side.start.name;
      this.choose(side.start);
    }

    chosen() { return this.side.choices.find((one) => one.name === this.choice.value); }

    choose(choice) {
      this.rows.forEach((row, place) => row.set(choice.settings[place]));
      this.touched();
    }

    touched() { this.again.disabled = this.changes().length === 0; }

    get sizes() { return this.rows.map((row) => inLaw(row.setting)); }

    changes() {
      const template = this.chosen().settings;
      return this.rows.flatMap(({ slider, setting }, place) => {
        const [now, then] = [setting, template[place]].map((one) => sizeText(one, slider.unit, 6));
        return now === then || setting.gain === 0 ? [] : [`${slider.name}=${now}`];
      });
    }

    get words() {
      const { choice_option: choose, size_option: set } = this.side;
      return [choose, this.choice.value, ...this.changes().flatMap((change) => [set, change])];
    }

    show(measure, unit, title, limit) {
      const sizes = this.sizes;
      const costs = sizes.map((size, error) => this.law.cost(error, measure, size));
      const sum = costs.reduce((total, cost) => total + cost, 0);
      const order = costs.map((_, error) => error).sort((a, b) => costs[b] - costs[a]);
      this.rows.forEach((row, error) => {
        row.show(this.law, error, measure, unit, limit, sizes, order.indexOf(error) + 1, sum);
      });
      this.order = order.filter((error) => costs[error] > 0).map((error) => this.rows[error].slider.name);
      const factor = this.law.together(measure, limit, sizes);
      const now = Math.sqrt(this.law.square(measure, sizes));
      const wanted = `${plain(limit)} ${unit}`;
      const words = factor === 0 ? "Noise alone is more than what is wanted, so no size is small enough."
        : factor === Infinity ? "It is kept whatever these errors are."
          : `All errors together may be ${figure(factor)} times what is set.`;
      const most = order.slice(0, MOST_NAMED).filter((error) => costs[error] >= LARGE_SHARE * sum && sum > 0).map((error) => (
        `${this.rows[error].slider.title} (${(100 * costs[error] / sum).toFixed(0)} %)`));
      const from = most.length > 0 ? `, most of it from ${most.join(", ")}` : "";
      const grade = `${now <= limit ? "kept" : "missed"}: ${wanted} is wanted.`;
      const beyond = this.law.isBeyond(measure, sizes) ? " So large errors are beyond the prediction's reach: draw them." : "";
      put(this.total, `${title} ${figure(now)} ${unit}${from}; ${grade} ${words}${beyond}`, factor);
      this.total.classList.toggle("missed", !(now <= limit));
    }
  }

  // ---- all of it

  class WhatIf {
    constructor(element) {
      this.model = JSON.parse(document.getElementById(element.dataset.model).textContent);
      const { measures, sides, shown } = this.model;
      this.limits = measures.map((one) => one.limit);
      this.edited = new Set();
      this.sides = sides.map((side) => new Side(side, this.model, () => this.changed()));
      this.start = this.sides.map((side) => shown.map((row) => Math.sqrt(side.law.square(row, side.sizes))));
      this.by = make("select", {}, ...shown.map((row) => make("option", { value: row, text: measures[row].title })));
      this.by.value = this.model.by;
      this.by.addEventListener("change", () => { this.limit.value = this.limitText(); this.changed(); });
      this.limit = make("input", { type: "text", autocomplete: "off", spellcheck: false, className: "size" });
      this.limit.addEventListener("change", () => this.wanted());
      this.limitHint = make("span", { className: "hint" });
      this.limit.setAttribute("aria-describedby", named(this.limitHint, "hint"));
      this.code = make("code");
      const line = make("div", { className: "line" }, make("pre", { tabIndex: 0 }, this.code),
        make("button", { type: "button", text: "Copy", "data-copy": "" }));
      element.querySelector(".table-block").replaceWith(
        make("p", { className: "what-if-wanted" }, make("label", {}, make("span", { text: "Look at" }), this.by),
          make("label", {}, make("span", { text: "wanted at most" }), this.limit), this.limitHint),
        this.measuresTable(),
        make("div", { className: "what-if-sides" }, ...this.sides.map((side) => side.element)),
        make("div", { className: "command" }, make("p", { text: "The same by draws, to be sure:" }), line),
      );
      this.limit.value = this.limitText();
      element.dataset.state = "ready";
      this.element = element;
      this.changed();
    }

    get measure() { return this.model.measures[Number(this.by.value)]; }

    limitText() { return `${plain(this.limits[Number(this.by.value)])}${this.measure.unit}`; }

    wanted() {
      const found = parse(this.limit.value, this.measure.unit);
      const isGood = found !== null && found.distribution === "normal" && found.size > 0;
      this.limit.setAttribute("aria-invalid", String(!isGood));
      this.limitHint.textContent = isGood ? "" : `write a limit above 0, such as 0.1${this.measure.unit}`;
      if (!isGood) return;
      this.limits[Number(this.by.value)] = found.size;
      this.edited.add(Number(this.by.value));
      this.changed();
    }

    measuresTable() {
      const { measures, shown } = this.model;
      const many = this.sides.length > 1;
      const heads = many ? [...this.sides.map((one) => one.side.title), "ratio"] : ["as set", "as assumed", "noise alone"];
      const head = make("tr", {}, make("th", { scope: "col", text: "of the calibration" }), ...heads.map((text) => (
        make("th", { scope: "col", className: "number", text }))));
      this.cells = shown.map(() => heads.map(() => make("td", { className: "number" })));
      this.lines = shown.map((row, place) => (
        make("tr", {}, make("th", { scope: "row", text: measures[row].title }), ...this.cells[place])));
      return make("div", { className: "scroll", role: "region", "aria-label": "errors of the calibration", tabIndex: 0 }, make("table", { className: "what-if-measures" },
        make("thead", {}, head), make("tbody", {}, ...this.lines)));
    }

    showMeasures() {
      const { measures, shown } = this.model;
      const sizes = this.sides.map((side) => side.sizes);
      shown.forEach((row, place) => {
        const unit = measures[row].unit;
        const now = this.sides.map(({ law }, number) => Math.sqrt(law.square(row, sizes[number])));
        const cells = this.cells[place];
        this.sides.forEach(({ law }, number) => {
          const isBeyond = law.isBeyond(row, sizes[number]);
          put(cells[number], `${figure(now[number])} ${unit}`, now[number]);
          cells[number].dataset.beyond = isBeyond ? "yes" : "no";
          if (isBeyond) {
            cells[number].prepend(icon("usable"), make("span", { className: "hidden", text: "beyond reach: " }), " ");
          }
        });
        if (this.sides.length > 1) put(cells[2], figure(now[0] / now[1]), now[0] / now[1]);
        else {
          put(cells[1], `${figure(this.start[0][place])} ${unit}`, this.start[0][place]);
          const noise = Math.sqrt(this.sides[0].law.noise[row] ?? NaN);
          put(cells[2], `${figure(noise)} ${unit}`, noise);
        }
        this.lines[place].classList.toggle("chosen", row === Number(this.by.value));
      });
    }

    changed() {
      const row = Number(this.by.value);
      const { unit, title } = this.measure;
      this.showMeasures();
      for (const side of this.sides) side.show(row, unit, title[0].toUpperCase() + title.slice(1), this.limits[row]);
      const required = this.model.measures.flatMap((one, place) => (
        one.is_required || this.edited.has(place) ? ["--require", `${one.name}=${plain(this.limits[place], 6)}${one.unit}`] : []));
      const words = [...this.model.command, ...this.sides.flatMap((side) => side.words), "--by", this.measure.name, ...required];
      this.code.textContent = words.map(quoted).join(" ");
      this.element.dataset.ranking = this.sides.map((side) => side.order.join(" ")).join("; ");
    }
  }

  for (const element of document.querySelectorAll(".what-if")) new WhatIf(element);
})();
