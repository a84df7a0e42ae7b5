/* A worker that makes grey levels of frames. A camera's own luma is taken as it came wherever the browser gives it: it
   is .299 R + .587 G + .114 B of what the camera saw, while a browser that takes full-range luma for video's 16 to 235
   makes colours of it in which black and white are cut off. Otherwise grey is made of the colours, as OpenCV does. */

const LUMA_FIRST = new Set(["I420", "I420A", "I422", "I444", "NV12"]);
let canvas = null;
let pen = null;
let planes = new Uint8Array(0);

onmessage = async ({ data: { frame, time } }) => {
  let image = null;
  try {
    image = hasLuma(frame) ? await luma(frame) : ofColours(frame);
  } catch {
    // The camera was closed meanwhile: there is no frame.
  }
  frame.close();
  postMessage({ image, time }, image ? [image.grey.buffer] : []);
};

const hasLuma = (frame) => LUMA_FIRST.has(frame.format) && !frame.rotation && !frame.flip;

/** The first plane, without what pads its rows. */
async function luma(frame) {
  const { width, height } = frame.visibleRect;
  if (planes.length !== frame.allocationSize()) planes = new Uint8Array(frame.allocationSize());
  const [{ offset, stride }] = await frame.copyTo(planes);
  if (stride === width) return { grey: planes.slice(offset, offset + width * height), width, height };
  const grey = new Uint8Array(width * height);
  for (let row = 0; row < height; row += 1) {
    grey.set(planes.subarray(offset + row * stride, offset + row * stride + width), row * width);
  }
  return { grey, width, height };
}

/** Weights in 15 bits; a frame is a VideoFrame, or an ImageBitmap where there is none. */
function ofColours(frame) {
  const [width, height] = [frame.displayWidth ?? frame.width, frame.displayHeight ?? frame.height];
  if (!canvas || canvas.width !== width || canvas.height !== height) {
    canvas = new OffscreenCanvas(width, height);
    pen = canvas.getContext("2d", { willReadFrequently: true, alpha: false });
  }
  pen.drawImage(frame, 0, 0);
  const colours = pen.getImageData(0, 0, width, height).data;
  const grey = new Uint8Array(width * height);
  for (let n = 0, k = 0; n < grey.length; n += 1, k += 4) {
    grey[n] = (9798 * colours[k] + 19235 * colours[k + 1] + 3735 * colours[k + 2] + 16384) >> 15;
  }
  return { grey, width, height };
}
