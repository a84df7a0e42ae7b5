/* The browser's camera: opened at its highest resolution, its frames as grey levels, its faults in one line each. */

const LEAST_FPS = 10;
const LARGEST = { width: 8192, height: 6144 }; // more than any has: the browser takes the largest there is
const SILENT_MS = 6000;
const SIZES = [
  [4096, 3072], [4096, 2160], [3840, 2160], [2592, 1944], [2560, 1440], [2048, 1536], [1920, 1080], [1600, 1200],
  [1280, 960], [1280, 720], [800, 600], [640, 480],
];
const FAULTS = {
  NotAllowedError: "The browser may not use the camera. Allow it at the camera sign beside the address, then try again.",
  NotFoundError: "No camera found. Plug one in, then try again.",
  NotReadableError: "The camera is in use by another program. Close it there, then try again.",
  OverconstrainedError: "The camera does not give pictures of this size. Choose another one, then try again.",
};
const UNPLUGGED = "The camera was unplugged. Plug it in again.";
const SILENT = "The camera sends no pictures. Does another program use it? Unplug it and plug it in again.";

export class BrowserCamera {
  /**
   * @param {{frame: Function, fault: (line: string) => void, asking: () => void, ready: Function,
   *   isFree: () => boolean}} on
   */
  constructor(on) {
    this.on = on;
    this.video = Object.assign(document.createElement("video"), { muted: true, playsInline: true, autoplay: true });
    this.worker = new Worker(new URL("grey.js", import.meta.url));
    this.worker.onmessage = ({ data }) => this.converted(data);
    this.isBusy = false;
    this.wish = {};
    this.track = null;
    this.isFaulty = this.isSilent = false;
    navigator.mediaDevices?.addEventListener("devicechange", () => { if (this.isFaulty) this.open(this.wish); });
    setInterval(() => this.watch(), 1000);
  }

  /** Open a camera; `wish` may name its `deviceId`, and `width` and `height` of its pictures. */
  async open(wish) {
    this.wish = wish;
    this.close();
    const turn = Symbol("turn"); // a later call overtakes this one
    this.turn = turn;
    this.on.asking();
    try {
      const stream = await firstOf(constraintsFor(wish));
      if (this.turn !== turn) { stop(stream); return; }
      await this.use(stream);
    } catch (error) {
      if (this.turn === turn) this.fail(FAULTS[error.name] || `The camera cannot be used: ${error.message}`);
    }
  }

  async use(stream) {
    [this.track] = stream.getVideoTracks();
    this.track.addEventListener("ended", () => this.fail(UNPLUGGED), { once: true });
    this.video.srcObject = stream;
    await this.video.play();
    await holdFocus(this.track);
    this.isFaulty = this.isSilent = false;
    this.heardAt = performance.now();
    this.on.ready(await this.about());
    this.next();
  }

  /** What was opened, and what else there is. */
  async about() {
    const settings = this.track.getSettings();
    const most = this.track.getCapabilities?.() ?? {};
    const fits = ([width, height]) => width <= (most.width?.max ?? Infinity) && height <= (most.height?.max ?? Infinity);
    const devices = await navigator.mediaDevices.enumerateDevices();
    return {
      deviceId: settings.deviceId,
      width: this.video.videoWidth,
      height: this.video.videoHeight,
      isFront: settings.facingMode === "user",
      sizes: SIZES.filter(fits),
      devices: devices.filter((one) => one.kind === "videoinput").map(({ deviceId, label }) => ({ deviceId, label })),
    };
  }

  close() {
    this.turn = null; // what is being opened is not used
    this.isFaulty = false;
    if (this.video.srcObject) stop(this.video.srcObject);
    this.video.srcObject = null;
    this.track = null;
  }

  fail(line) {
    this.close();
    this.isFaulty = true;
    this.on.fault(line);
  }

  /** Wait for the next frame. */
  next() {
    const { track } = this;
    const grab = (now, about) => {
      if (this.track !== track) return;
      this.heard();
      this.grab((about?.captureTime ?? now) / 1000);
      this.next();
    };
    if (this.video.requestVideoFrameCallback) this.video.requestVideoFrameCallback(grab);
    else setTimeout(() => grab(performance.now()), 40);
  }

  async grab(time) {
    if (this.isBusy || !this.on.isFree()) return;
    this.isBusy = true;
    try {
      const frame = window.VideoFrame ? new VideoFrame(this.video) : await createImageBitmap(this.video);
      this.worker.postMessage({ frame, time }, [frame]);
    } catch {
      this.isBusy = false; // closed meanwhile
    }
  }

  converted({ image, time }) {
    this.isBusy = false;
    if (this.track && image) this.on.frame({ time_s: time, width: image.width, height: image.height }, image.grey);
  }

  /** A camera that sends nothing, though the page is seen; it stays open, for it may be slow. */
  watch() {
    if (document.hidden || !this.track) this.heardAt = performance.now();
    else if (!this.isSilent && performance.now() - this.heardAt > SILENT_MS) {
      this.isSilent = true;
      this.on.fault(SILENT);
    }
  }

  async heard() {
    this.heardAt = performance.now();
    if (!this.isSilent) return;
    this.isSilent = false;
    this.on.ready(await this.about());
  }
}

/** From the best to what any camera can do; pictures are not to be scaled by the browser. */
function constraintsFor({ deviceId, width, height }) {
  const size = width ? { width: { ideal: width }, height: { ideal: height } }
    : { width: { ideal: LARGEST.width }, height: { ideal: LARGEST.height } };
  const which = deviceId ? { deviceId: { exact: deviceId } } : {};
  const unscaled = { resizeMode: { ideal: "none" } };
  return [{ ...which, ...size, ...unscaled, frameRate: { min: LEAST_FPS, ideal: 30 } }, { ...which, ...size }, which];
}

/** No autofocus, where the camera lets a page say so: the focus stays where it is, for it changes the focal length. */
async function holdFocus(track) {
  if (!track.getCapabilities?.().focusMode?.includes("manual")) return;
  try {
    await track.applyConstraints({ ...track.getConstraints(), advanced: [{ focusMode: "manual" }] });
  } catch {
    // a camera that offers it and does not do it is used as it is
  }
}

async function firstOf(tries) {
  if (!navigator.mediaDevices) throw new Error("this browser offers none to a page; use a newer one");
  let last = null;
  for (const video of tries) {
    try {
      return await navigator.mediaDevices.getUserMedia({ video: Object.keys(video).length ? video : true, audio: false });
    } catch (error) {
      last = error;
      if (error.name !== "OverconstrainedError") break;
    }
  }
  throw last;
}

function stop(stream) {
  stream.getTracks().forEach((track) => track.stop());
}
