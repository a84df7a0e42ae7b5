/* The camera, the target where it is and where to hold it, in space: x right, y down, z away, as the camera has it.
   THREE and ringsolidShapes are the page's own scripts. */

const FIELD_OF_VIEW = 30;
const GHOST_OPACITY = 0.4;
const FOCAL_SHARE = 0.9; // of the longer side: how wide the camera's pyramid is drawn
const VIEWER = [-0.4, -0.5, -0.9]; // from the middle: behind the camera, above it and a little to its left
const REST = 9; // times what a drawing took, before the next one
const SIGN_COLOUR = 0x8a9099;

export class Space {
  constructor(element) {
    this.element = element;
    this.canvas = document.createElement("canvas");
    this.context = this.canvas.getContext("webgl2", { antialias: true, alpha: true });
    this.isThere = this.context !== null;
    if (!this.isThere) return;
    element.append(this.canvas);
    this.restUntil = 0;
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, context: this.context, alpha: true, antialias: true });
    this.renderer.setClearColor(0, 0);
    this.viewer = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 1, 1e5);
    this.viewer.up.set(0, -1, 0);
    this.world = new THREE.Scene();
    this.content = new THREE.Group(); // mirrored as a whole
    const sky = new THREE.HemisphereLight(0xffffff, 0xaab2c0, 1.9);
    sky.position.set(0, -1, 0);
    const lamp = new THREE.DirectionalLight(0xffffff, 1.5);
    lamp.position.set(-0.5, 0.7, 1);
    this.viewer.add(lamp, lamp.target);
    this.world.add(sky, this.viewer, this.content);
    this.controls = new THREE.OrbitControls(this.viewer, this.canvas);
    this.controls.addEventListener("change", () => this.request());
    new ResizeObserver(() => this.request()).observe(element);
  }

  /** The target, as designer/page/scene.py has it. */
  setScene(json) {
    if (!this.isThere) return;
    this.content.clear();
    const scene = JSON.parse(json);
    this.live = targetOf(scene);
    this.ghost = targetOf(scene);
    this.ghost.traverse((object) => { if (object.material) fade(object.material); });
    this.live.visible = this.ghost.visible = false;
    this.radius = Math.max(...pointsOf(scene).map((point) => point.length()));
    this.content.add(this.live, this.ghost);
    this.request();
  }

  setGhost(pose, imageSize) {
    if (!this.ghost) return;
    put(this.ghost, pose);
    if (pose) {
      this.goal = new THREE.Vector3(pose[0][3], pose[1][3], pose[2][3]);
      if (this.sign) this.content.remove(this.sign);
      this.sign = cameraSign(imageSize, 0.25 * this.goal.length());
      this.content.add(this.sign);
      this.fit();
    }
    this.request();
  }

  setLive(pose) {
    if (!this.live) return;
    put(this.live, pose);
    this.request();
  }

  setMirrored(isMirrored) {
    if (!this.isThere) return;
    this.content.scale.x = isMirrored ? -1 : 1;
    if (this.goal) this.fit();
    this.request();
  }

  /** Stand where the camera, and the target as it is to be held, are seen. */
  fit() {
    const middle = this.goal.clone().multiplyScalar(0.55);
    middle.x *= this.content.scale.x;
    const reach = 0.4 * this.goal.length() + this.radius;
    const away = reach / Math.sin((FIELD_OF_VIEW * Math.PI) / 360);
    this.viewer.position.copy(middle).addScaledVector(new THREE.Vector3(...VIEWER).normalize(), away);
    this.viewer.near = away / 50;
    this.viewer.far = 5 * away;
    this.controls.target.copy(middle);
    this.controls.update();
  }

  /** Draw soon; where a machine draws slowly, seldom, for the picture goes first. */
  request() {
    if (this.isPending) return;
    this.isPending = true;
    setTimeout(() => requestAnimationFrame(() => { this.isPending = false; this.draw(); }), this.restUntil - performance.now());
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(width, height, false);
    this.viewer.aspect = width / height;
    this.viewer.updateProjectionMatrix();
    const start = performance.now();
    this.renderer.render(this.world, this.viewer);
    this.context.readPixels(0, 0, 1, 1, this.context.RGBA, this.context.UNSIGNED_BYTE, new Uint8Array(4)); // waits for it
    this.restUntil = performance.now() + REST * (performance.now() - start);
  }
}

/** The target alone: without numbers and axes, which are hidden at first. */
function targetOf(scene) {
  const group = new THREE.Group();
  group.matrixAutoUpdate = false;
  for (const layer of scene.layers.filter((one) => one.shown)) group.add(ringsolidShapes.buildLayer(layer).group);
  return group;
}

function pointsOf(scene) {
  return scene.layers.filter((one) => one.shown)
    .flatMap((layer) => ringsolidShapes.buildLayer(layer).parts.flatMap((part) => part.points));
}

function fade(material) {
  Object.assign(material, { transparent: true, opacity: GHOST_OPACITY, depthWrite: false });
  material.color?.lerp(new THREE.Color("#ffb000"), 0.55);
}

function put(group, pose) {
  group.visible = Boolean(pose);
  if (!pose) return;
  group.matrix.set(...pose.flat());
  group.matrixWorldNeedsUpdate = true;
}

/** A pyramid for the camera, with a tick where its picture's top is. */
function cameraSign([width, height], depth) {
  const unit = depth / (FOCAL_SHARE * Math.max(width, height));
  const [x, y] = [(unit * width) / 2, (unit * height) / 2];
  const at = (...place) => new THREE.Vector3(...place);
  const corners = [at(-x, -y, depth), at(x, -y, depth), at(x, y, depth), at(-x, y, depth)];
  const tick = [at(-x / 3, -1.1 * y, depth), at(0, -1.6 * y, depth), at(x / 3, -1.1 * y, depth)];
  const ends = corners.flatMap((corner, n) => [at(0, 0, 0), corner, corner, corners[(n + 1) % 4]]);
  const sign = ringsolidShapes.lines([...ends, tick[0], tick[1], tick[1], tick[2], tick[2], tick[0]], null, 1.8);
  sign.material.color.set(SIGN_COLOUR);
  return sign;
}
