"use strict";
(() => {
  const said = document.getElementById("said");
  const say = (words) => { said.textContent = words; };

  // Tables: a click on a head sorts by its column, a second one the other way; what has no value stays last.
  const texts = new Intl.Collator("en", { numeric: true });
  const key = (cell) => {
    const text = cell.textContent.trim();
    if (cell.dataset.value !== undefined) return { rank: 0, value: Number(cell.dataset.value), text };
    const isMissing = text === "" || (/^[-–—]$|^n\/a$|^nan$/i).test(text);
    return { rank: isMissing ? 2 : 1, value: 0, text };
  };
  const compare = (a, b) => (a.rank === 0 ? a.value - b.value : texts.compare(a.text, b.text));
  const sort = (head) => {
    const table = head.closest("table");
    const body = table.tBodies[0];
    const place = head.cellIndex;
    const isDown = head.getAttribute("aria-sort") === "ascending";
    const keyed = Array.from(body.rows, (row) => ({ row, key: key(row.cells[place]) }));
    keyed.sort((a, b) => a.key.rank - b.key.rank || (isDown ? -1 : 1) * compare(a.key, b.key));
    body.append(...keyed.map((entry) => entry.row));
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", isDown ? "descending" : "ascending");
  };
  for (const button of document.querySelectorAll("thead button")) {
    button.addEventListener("click", () => sort(button.closest("th")));
  }

  // Tables that are wider than their place: what goes on beyond an edge is told by a class.
  const wide = Array.from(document.querySelectorAll(".scroll"));
  const edge = (one) => {
    const rest = one.scrollWidth - one.clientWidth - one.scrollLeft;
    one.classList.toggle("more-left", one.scrollLeft > 1);
    one.classList.toggle("more-right", rest > 1);
  };
  const edges = new ResizeObserver((seen) => seen.forEach((entry) => edge(entry.target)));
  for (const one of wide) {
    one.addEventListener("scroll", () => edge(one), { passive: true });
    edges.observe(one);
  }

  // Galleries: a picture opens large; arrow keys go on, Escape closes (the dialog's own).
  const box = document.getElementById("lightbox");
  const part = (name) => document.getElementById(`lightbox-${name}`);
  let pictures = [];
  let shown = 0;
  const show = (place) => {
    shown = (place + pictures.length) % pictures.length;
    const button = pictures[shown];
    const name = button.querySelector(".name");
    part("image").src = button.querySelector("img").src;
    part("image").alt = name.textContent.trim();
    part("name").replaceChildren(...name.cloneNode(true).childNodes);
    part("place").textContent = `${shown + 1} of ${pictures.length}`;
    part("caption").textContent = button.querySelector(".words").textContent;
    part("full").hidden = button.dataset.full === undefined;
    if (button.dataset.full === undefined) part("full").removeAttribute("href");
    else part("full").setAttribute("href", button.dataset.full);
  };
  for (const gallery of document.querySelectorAll(".gallery")) {
    const buttons = Array.from(gallery.querySelectorAll("button"));
    buttons.forEach((button, place) => button.addEventListener("click", () => {
      pictures = buttons;
      show(place);
      box.showModal();
    }));
  }
  box.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    show(shown + step);
  });
  box.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (event.target === box || button?.dataset.close !== undefined) box.close();
    else if (button) show(shown + Number(button.dataset.step));
  });
  box.addEventListener("close", () => pictures[shown]?.focus());

  // Commands: copied, or selected where the browser does not let a page copy.
  const copy = async (button) => {
    const code = button.parentElement.querySelector("code");
    try {
      await navigator.clipboard.writeText(code.textContent);
      button.textContent = "Copied";
      say("Copied");
    } catch {
      window.getSelection().selectAllChildren(code);
      button.textContent = "Selected";
      say("Selected: copy it with your keyboard");
    }
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  };
  for (const button of document.querySelectorAll("[data-copy]")) {
    button.addEventListener("click", () => copy(button));
  }

  // Print: all folds are open, and afterwards as they were.
  let closed = [];
  window.addEventListener("beforeprint", () => {
    closed = Array.from(document.querySelectorAll("details:not([open])"));
    for (const fold of closed) fold.open = true;
  });
  window.addEventListener("afterprint", () => {
    for (const fold of closed) fold.open = false;
    closed = [];
  });

  // Contents: the section being read is marked, the last whose head has passed the upper third.
  const links = new Map(Array.from(document.querySelectorAll(".contents a"), (link) => [link.hash.slice(1), link]));
  const sections = Array.from(document.querySelectorAll("main > section")).filter((one) => links.has(one.id));
  let marked = null;
  const mark = () => {
    const isEnd = window.innerHeight + window.scrollY >= document.documentElement.scrollHeight - 2;
    const passed = sections.filter((one) => one.getBoundingClientRect().top < window.innerHeight / 3);
    const last = isEnd && window.scrollY > 0 ? sections.at(-1) : passed.at(-1);
    const link = last ? links.get(last.id) : null;
    if (link === marked) return;
    marked?.removeAttribute("aria-current");
    link?.setAttribute("aria-current", "true");
    marked = link;
    if (link) {
      const list = link.closest("ol");
      list.scrollLeft = link.offsetLeft - list.offsetLeft - 24;
    }
  };
  if (sections.length > 0) {
    window.addEventListener("scroll", mark, { passive: true });
    window.addEventListener("resize", mark);
    mark();
  }
})();
