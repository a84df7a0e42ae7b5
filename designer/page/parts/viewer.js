/* The page's 3D views: each `div.viewer[data-scene]` shows the scene that stands as JSON in the script element with
   that id; see designer/page/scene.py for the JSON and three_entry.js for THREE. Names come from files and may
   hold anything: they reach the page as text nodes and letters on a canvas only.

   An element tells of itself, for tests: data-state (ready, unavailable), data-rest (yes: all is drawn and still),
   data-azimuth and data-polar (degrees), data-distance (mm). */
"use strict";

(() => {
  const FIELD_OF_VIEW = 26; // degrees; small, so that parallel edges look parallel
  const TURN_SECONDS = 48; // of a whole turn
  const SWAY = { angle: 0.5, seconds: 14 }; // of a flat target, whose back there is no use in seeing
  const CAMERAS_AT_MOST = 5; // how much farther than for the target alone one stands back to see all cameras
  const KEY_TURN = Math.PI / 18;
  const KEY_ZOOM = 0.85;
  const HIGHLIGHT = 0xe69f00; // on white and on black
  const HELP = "Drag or arrow keys turn, right drag moves, + and \u2212 zoom, 0 resets.";
  const HELP_TOUCH = "One finger sideways turns, two fingers zoom and move.";
  const KEYS = {
    ArrowLeft: (view) => view.turn(KEY_TURN, 0),
    ArrowRight: (view) => view.turn(-KEY_TURN, 0),
    ArrowUp: (view) => view.turn(0, KEY_TURN),
    ArrowDown: (view) => view.turn(0, -KEY_TURN),
    "+": (view) => view.zoom(KEY_ZOOM),
    "=": (view) => view.zoom(KEY_ZOOM),
    "-": (view) => view.zoom(1 / KEY_ZOOM),
    "0": (view) => view.reset(),
  };

  const { buildLayer, lines } = ringsolidShapes;

  // ---- the view

  const prefersStill = window.matchMedia("(prefers-reduced-motion: reduce)");
  let scrolledAt = -Infinity;
  window.addEventListener("scroll", () => { scrolledAt = performance.now(); }, { passive: true });

  class View {
    constructor(element, scene, canvas, context) {
      this.element = element;
      this.canvas = canvas;
      this.layers = scene.layers.map(buildLayer);
      this.renderer = new THREE.WebGLRenderer({ canvas, context, antialias: true, alpha: true });
      this.renderer.setClearColor(0, 0); // the page's background shows through
      this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 1, 1000);
      this.up = new THREE.Vector3(...scene.up).normalize();
      this.from = new THREE.Vector3(...scene.from).normalize();
      this.camera.up.copy(this.up);
      this.world = this.build();
      this.measure();
      this.controls = new THREE.OrbitControls(this.camera, canvas);
      this.controls.dampingFactor = 0.16;
      this.controls.rotateSpeed = 0.9;
      canvas.style.touchAction = "pan-y"; // a finger that moves up or down scrolls the page
      this.isOnScreen = false;
      this.isTurning = !prefersStill.matches;
      this.turned = 0;
      this.frame = this.frame.bind(this);
      this.resize();
      this.listen();
    }

    build() {
      const world = new THREE.Scene();
      this.layers.forEach((layer) => world.add(layer.group));
      const sky = new THREE.HemisphereLight(0xffffff, 0xaab2c0, 1.9);
      sky.position.copy(this.up);
      const lamp = new THREE.DirectionalLight(0xffffff, 1.5); // goes with the viewer, so no face is ever black
      lamp.position.set(-0.5, 0.7, 1);
      this.camera.add(lamp, lamp.target);
      world.add(sky, this.camera);
      return world;
    }

    parts(isShown = (layer) => layer.group.visible) {
      return this.layers.filter(isShown).flatMap((layer) => layer.parts);
    }

    /** What stays as it is: the middle and size of the target, how far all things reach, and whether it is flat. */
    measure() {
      const all = this.parts(() => true);
      const points = this.points((part) => !part.isFar);
      const low = new THREE.Vector3(Infinity, Infinity, Infinity);
      const high = low.clone().negate();
      points.forEach((point) => { low.min(point); high.max(point); });
      this.middle = points.length ? low.clone().add(high).multiplyScalar(0.5) : new THREE.Vector3();
      this.radius = this.farthest(points) || 1;
      this.reach = Math.max(this.radius, this.farthest(all.flatMap((part) => part.points)));
      const normals = all.flatMap((part) => part.normals || []);
      const mean = normals.reduce((sum, normal) => sum.add(normal), new THREE.Vector3());
      this.isFlat = normals.length > 0 && mean.length() > 0.9 * normals.length;
      const thinnest = points.length ? Math.min(...high.sub(low).toArray()) / 2 : 0;
      this.nearest = 1.3 * thinnest + 0.2 * this.radius;
    }

    /** The points of what is shown. */
    points(isWanted) {
      return this.parts().filter(isWanted).flatMap((part) => part.points);
    }

    farthest(points) {
      return points.reduce((most, point) => Math.max(most, point.distanceTo(this.middle)), 0);
    }

    /** How far to stand back to see the target, turned any way unless it is flat, and if possible all cameras. */
    distance() {
      const slope = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
      const narrow = slope * Math.min(1, this.camera.aspect);
      const right = new THREE.Vector3().crossVectors(this.up, this.from).normalize();
      const top = new THREE.Vector3().crossVectors(this.from, right);
      const fit = (points) => points.reduce((most, point) => {
        const p = point.clone().sub(this.middle);
        const across = Math.abs(p.dot(right)) / (slope * this.camera.aspect);
        return Math.max(most, p.dot(this.from) + 1.07 * Math.max(across, Math.abs(p.dot(top)) / slope));
      }, 0);
      const near = this.points((part) => !part.isFar);
      const any = (1.06 * (this.farthest(near) || this.radius)) / Math.sin(Math.atan(narrow));
      const target = this.isFlat && near.length ? Math.min(any, 1.04 * fit(near)) : any;
      return Math.max(target, Math.min(fit(this.points((part) => part.isFar)), CAMERAS_AT_MOST * target));
    }

    /** Show or hide a layer; who has not zoomed sees all of it. */
    show(layer, isShown) {
      const before = this.distance();
      layer.group.visible = isShown;
      const now = this.camera.position.distanceTo(this.controls.target);
      if (Math.abs(now - before) < 0.02 * before) this.zoom(this.distance() / before);
      this.request();
    }

    reset() {
      const { controls } = this;
      controls.enableDamping = false; // a turn that still runs out would move the view from where it is put
      controls.update();
      controls.minDistance = this.nearest;
      controls.maxDistance = 4 * Math.max(this.distance(), this.reach);
      controls.target.copy(this.middle);
      this.camera.position.copy(this.middle).addScaledVector(this.from, this.distance());
      controls.update();
      controls.enableDamping = !prefersStill.matches;
      this.turned = 0;
      this.request();
    }

    turn(left, upwards) {
      this.controls.rotateLeft(left);
      this.controls.rotateUp(upwards);
      this.request();
    }

    zoom(factor) {
      const offset = this.camera.position.clone().sub(this.controls.target);
      const length = offset.length() * factor;
      offset.setLength(Math.min(this.controls.maxDistance, Math.max(this.controls.minDistance, length)));
      this.camera.position.copy(this.controls.target).add(offset);
      this.controls.update();
      this.request();
    }

    setTurning(isTurning) {
      this.isTurning = isTurning;
      this.lastTime = undefined;
      if (this.turnBox) this.turnBox.checked = isTurning;
      this.request();
    }

    resize() {
      const { clientWidth: width, clientHeight: height } = this.element;
      if (!width || !height) return;
      this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      if (!this.hasSize) this.reset();
      this.hasSize = true;
      this.draw(); // at once: a canvas is blank after its size changed, and it may be printed unseen
    }

    /** Ask for one frame; nothing is drawn while nothing changes or nobody sees it: then it waits to be seen. */
    request() {
      this.element.dataset.rest = "no";
      if (!this.isOnScreen || this.pending) return;
      this.pending = requestAnimationFrame(this.frame);
    }

    frame(time) {
      this.pending = 0;
      if (this.isTurning) this.autoTurn(time);
      if (this.controls.update() || this.isTurning) this.request();
      this.draw();
      this.element.dataset.rest = this.pending ? "no" : "yes";
    }

    autoTurn(time) {
      const seconds = this.lastTime === undefined ? 0 : Math.min(0.1, (time - this.lastTime) / 1000);
      this.lastTime = time;
      if (!this.isFlat) {
        this.controls.rotateLeft((-2 * Math.PI * seconds) / TURN_SECONDS);
        return;
      }
      const at = (t) => SWAY.angle * Math.sin((2 * Math.PI * t) / SWAY.seconds);
      this.controls.rotateLeft(at(this.turned + seconds) - at(this.turned));
      this.turned += seconds;
    }

    draw() {
      const { camera, controls } = this;
      const distance = camera.position.distanceTo(controls.target);
      const away = camera.position.distanceTo(this.middle);
      camera.near = Math.max(away - 1.1 * this.reach, distance / 100);
      camera.far = away + 1.1 * this.reach;
      camera.updateProjectionMatrix();
      const towards = new THREE.Vector3();
      for (const sprite of this.parts().flatMap((part) => part.labels || [])) {
        sprite.visible = towards.copy(camera.position).sub(sprite.position).dot(sprite.userData.normal) > 0;
      }
      this.renderer.render(this.world, camera);
      const degrees = (angle) => ((angle * 180) / Math.PI).toFixed(2);
      this.element.dataset.azimuth = degrees(controls.getAzimuthalAngle());
      this.element.dataset.polar = degrees(controls.getPolarAngle());
      this.element.dataset.distance = distance.toFixed(2);
    }

    // ---- mouse, fingers, keys

    listen() {
      const { element, canvas, controls } = this;
      controls.addEventListener("change", () => this.request());
      controls.addEventListener("start", () => { this.setTurning(false); this.point(null); });
      element.addEventListener("wheel", (event) => this.letPageScroll(event), { capture: true, passive: true });
      element.addEventListener("keydown", (event) => this.key(event));
      canvas.addEventListener("dblclick", () => this.reset());
      canvas.addEventListener("pointerdown", (event) => {
        this.pressedAt = [event.clientX, event.clientY];
        if (event.pointerType === "mouse") element.focus({ preventScroll: true });
      });
      canvas.addEventListener("pointermove", (event) => { if (!event.buttons) this.pointSoon(event); });
      canvas.addEventListener("pointerup", (event) => {
        const [x, y] = this.pressedAt || [Infinity, Infinity];
        if (Math.hypot(event.clientX - x, event.clientY - y) < 6) this.pointSoon(event);
      });
      canvas.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") this.point(null); });
      prefersStill.addEventListener("change", () => { if (prefersStill.matches) this.setTurning(false); });
      new ResizeObserver(() => this.resize()).observe(element);
      new IntersectionObserver((entries) => {
        this.isOnScreen = entries[entries.length - 1].isIntersecting;
        this.lastTime = undefined;
        this.request();
      }).observe(element);
      canvas.addEventListener("webglcontextrestored", () => this.request());
      // After the page's own listener, which opens what is folded: a view in there has had no size yet.
      window.addEventListener("load", () => window.addEventListener("beforeprint", () => this.resize()));
    }

    /** The wheel zooms with Ctrl, or once the view has the focus and the page is not just being scrolled past it. */
    letPageScroll(event) {
      const isScrolling = performance.now() - scrolledAt < 400;
      if (event.ctrlKey || event.metaKey || (document.activeElement === this.element && !isScrolling)) return;
      event.stopPropagation();
      this.hint.hidden = isScrolling && this.hint.hidden;
      clearTimeout(this.hintTimer);
      this.hintTimer = setTimeout(() => { this.hint.hidden = true; }, 1600);
    }

    key(event) {
      const action = KEYS[event.key];
      if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      this.setTurning(false);
      action(this);
    }

    pointSoon(event) {
      this.pointer = event;
      this.pointing = this.pointing || requestAnimationFrame(() => { this.pointing = 0; this.point(this.pointer); });
    }

    /** Say the name of what is under the pointer and draw around it. */
    point(event) {
      const hit = event && this.hit(event);
      const name = hit ? hit.name : "";
      if (name === this.pointedAt) return;
      this.pointedAt = name;
      if (this.outline) {
        this.world.remove(this.outline);
        this.outline.geometry.dispose();
        this.outline.material.dispose();
        this.outline = null;
      }
      this.tip.hidden = !name;
      this.tip.textContent = name;
      if (hit) {
        this.outline = lines(hit.outline(), null, 2.6);
        this.outline.material.color.set(HIGHLIGHT);
        this.outline.renderOrder = 1;
        this.world.add(this.outline);
        const box = this.element.getBoundingClientRect();
        const [x, y] = [event.clientX - box.left, event.clientY - box.top];
        this.tip.style.left = `${Math.max(0, Math.min(x + 14, box.width - this.tip.offsetWidth - 4))}px`;
        this.tip.style.top = `${Math.max(0, y > 44 ? y - 36 : y + 22)}px`;
      }
      this.request();
    }

    hit(event) {
      const box = this.canvas.getBoundingClientRect();
      const x = (2 * (event.clientX - box.left)) / box.width - 1;
      const y = 1 - (2 * (event.clientY - box.top)) / box.height;
      const caster = new THREE.Raycaster();
      caster.setFromCamera(new THREE.Vector2(x, y), this.camera);
      const walls = this.parts().filter((part) => part.blocks).map((part) => part.blocks);
      const wall = caster.intersectObjects(walls, false)[0];
      const limit = wall ? wall.distance + 0.01 * this.radius : Infinity;
      const hits = this.parts().filter((part) => part.pick).map((part) => part.pick(caster.ray, caster));
      return hits.filter((hit) => hit && hit.distance < limit).sort((a, b) => a.distance - b.distance)[0] || null;
    }
  }

  // ---- what stands around the view

  function make(tag, className, text = "") {
    const element = document.createElement(tag);
    element.className = className;
    element.textContent = text;
    return element;
  }

  function checkbox(text, isChecked, onChange) {
    const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: isChecked });
    box.addEventListener("change", () => onChange(box.checked));
    const line = make("label", "viewer-switch");
    line.append(box, text);
    return [line, box];
  }

  function button(sign, name, onClick) {
    const element = make("button", "viewer-button", sign);
    element.type = "button";
    element.title = name;
    element.setAttribute("aria-label", name);
    element.addEventListener("click", onClick);
    return element;
  }

  function surround(view, scene) {
    const { element } = view;
    view.tip = make("div", "viewer-tip");
    view.hint = make("div", "viewer-hint", "Ctrl + wheel zooms; so does the wheel alone after a click here");
    view.tip.setAttribute("role", "status");
    view.tip.hidden = view.hint.hidden = true;
    const tools = make("div", "viewer-tools");
    const act = (action) => () => { view.setTurning(false); action(); };
    tools.append(
      button("+", "zoom in", act(() => view.zoom(KEY_ZOOM))),
      button("\u2212", "zoom out", act(() => view.zoom(1 / KEY_ZOOM))),
      button("\u2302", "back to the first view", act(() => view.reset())),
    );
    const stage = make("div", "viewer-stage"); // buttons inside an element with role=img would be lost to screen readers
    element.replaceWith(stage);
    stage.append(element, tools, view.tip, view.hint);
    const bar = make("div", "viewer-bar");
    for (const layer of view.layers.filter((one) => one.hasSwitch)) {
      const [line] = checkbox(layer.name, layer.group.visible, (isShown) => view.show(layer, isShown));
      bar.append(line);
    }
    const [line, box] = checkbox("turn", view.isTurning, (isTurning) => view.setTurning(isTurning));
    view.turnBox = box;
    bar.append(line);
    stage.after(...(scene.legend.length ? [legend(scene.legend)] : []), bar);
    bar.after(make("p", "viewer-help", window.matchMedia("(pointer: coarse)").matches ? HELP_TOUCH : HELP));
  }

  function legend(entries) {
    const list = make("ul", "viewer-legend");
    for (const [colour, text] of entries) {
      const swatch = make("span", "viewer-swatch");
      swatch.style.backgroundColor = colour;
      const item = document.createElement("li");
      item.append(swatch, text);
      list.append(item);
    }
    return list;
  }

  // ---- start

  function unavailable(element, reason) {
    const instead = element.querySelector("img.poster") ? " Here is a picture of it." : "";
    element.dataset.state = "unavailable";
    element.removeAttribute("tabindex");
    element.append(make("p", "viewer-note", `No 3D view: ${reason}.${instead}`));
  }

  function start(element) {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2", { antialias: true, alpha: true, preserveDrawingBuffer: true });
    if (!context) {
      unavailable(element, "this browser offers no WebGL 2");
      return;
    }
    try {
      const scene = JSON.parse(document.getElementById(element.dataset.scene).textContent);
      element.append(canvas);
      const view = new View(element, scene, canvas, context);
      surround(view, scene);
      element.dataset.state = "ready";
    } catch (error) {
      canvas.remove();
      unavailable(element, `it could not be drawn (${error.message})`);
    }
  }

  document.querySelectorAll("div.viewer[data-scene]").forEach(start);
})();
