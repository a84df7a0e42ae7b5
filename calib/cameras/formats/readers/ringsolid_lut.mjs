// A camera as a table of rays: reads camera.lut, which `calib convert CAMERA --to lut` writes.
//
//     import {readLut} from "./ringsolid_lut.mjs";
//     const lut = readLut(await (await fetch("camera.lut")).arrayBuffer());   // throws an Error where it is none
//     lut.unproject(u, v);          // [x, y, z], a unit vector: x right, y down, z forward; null: no light there
//     lut.project([x, y, z]);       // [u, v] of a point in the camera's frame; null: not in the image
//
// Pixel (0, 0) is the centre of the upper left one. lut.maxErrorPx says how far off the camera the table is at most.
const HEAD = 56, MAGIC = "ringsolid lut 1\n";

export function readLut(buffer) {
  const bytes = new Uint8Array(buffer), data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const require = (isSo, why) => {
    if (!isSo) throw new Error(`not a camera.lut that can be read: ${why}`);
  };
  require(bytes.length >= HEAD && String.fromCharCode(...bytes.subarray(0, 16)) === MAGIC, "no table of rays, version 1");
  const [width, height, across, down] = [16, 20, 24, 28].map((at) => data.getUint32(at, true));
  for (const side of [width, height]) require(side >= 1 && side <= 1e6, "sizes");
  for (const cells of [across, down]) require(cells >= 1 && cells <= 4096, "sizes");
  const controls = (across + 3) * (down + 3) * 2;
  require(bytes.length === HEAD + controls * 8 + height * 8, "length");
  require(BigInt(checksum(bytes)) === data.getBigUint64(48, true), "checksum");
  const control = Float64Array.from({length: controls}, (_, k) => data.getFloat64(HEAD + 8 * k, true));
  require(control.every(Number.isFinite), "not finite");
  const seen = Uint32Array.from({length: 2 * height}, (_, k) => data.getUint32(HEAD + 8 * controls + 4 * k, true));
  require(seen.every((one) => one <= width), "light beyond the image");
  return new Lut([width, height], [across, down], control, seen, data.getFloat64(32, true), data.getFloat64(40, true));
}

class Lut {
  constructor(side, cells, control, seen, maxErrorPx, rmsErrorPx) {
    Object.assign(this, {side, cells, control, seen, maxErrorPx, rmsErrorPx, width: side[0], height: side[1]});
    Object.assign(this, {weight: new Float64Array(8), change: new Float64Array(8), cell: [0, 0]}); // to work with
  }

  // Whether light reaches a place of the image.
  sees(u, v) {
    const [width, height] = this.side;
    if (!(u >= -0.5 && u < width - 0.5 && v >= -0.5 && v < height - 0.5)) return false;
    const row = Math.floor(v + 0.5), column = Math.floor(u + 0.5);
    return column >= this.seen[2 * row] && column < this.seen[2 * row + 1];
  }

  unproject(u, v) {
    if (!this.sees(u, v)) return null;
    const [a, b] = this.#evaluate([u, v]), square = a * a + b * b;
    return [2 * a / (1 + square), 2 * b / (1 + square), (1 - square) / (1 + square)];
  }

  project([x, y, z]) {
    const away = Math.hypot(x, y, z) + z;
    if (!(away > 0)) return null;
    const place = this.side.map((side) => (side - 1) / 2);
    for (let step = 0; step < 30; step++) { // Newton's method, kept near the image
      const [a, b, aByU, aByV, bByU, bByV] = this.#evaluate(place);
      const determinant = aByU * bByV - aByV * bByU, offA = x / away - a, offB = y / away - b;
      const move = [(bByV * offA - aByV * offB) / determinant, (aByU * offB - bByU * offA) / determinant];
      if (!Number.isFinite(move[0] + move[1])) return null;
      let moved = 0;
      for (let k = 0; k < 2; k++) {
        const margin = this.side[k] / this.cells[k], from = place[k];
        place[k] = Math.min(Math.max(from + move[k], -margin), this.side[k] + margin);
        moved += Math.abs(place[k] - from);
      }
      if (moved < 1e-7) return Math.abs(move[0]) + Math.abs(move[1]) < 1e-6 && this.sees(place[0], place[1]) ? place : null;
    }
    return null;
  }

  // The surface at a place, and its slopes: of the first part by u and v, then of the second.
  #evaluate(place) {
    const {weight, change, cell, side, cells, control} = this, result = [0, 0, 0, 0, 0, 0], columns = cells[0] + 3;
    for (let k = 0; k < 2; k++) {
      const perPx = cells[k] / side[k], x = (place[k] + 0.5) * perPx;
      cell[k] = Math.min(Math.max(Math.floor(x), 0), cells[k] - 1);
      const t = x - cell[k], s = 1 - t, at = 4 * k;
      weight[at] = s * s * s / 6;
      weight[at + 1] = (3 * t * t * t - 6 * t * t + 4) / 6;
      weight[at + 2] = (3 * s * s * s - 6 * s * s + 4) / 6;
      weight[at + 3] = t * t * t / 6;
      change[at] = -s * s / 2 * perPx;
      change[at + 1] = (3 * t * t - 4 * t) / 2 * perPx;
      change[at + 2] = (4 * s - 3 * s * s) / 2 * perPx;
      change[at + 3] = t * t / 2 * perPx;
    }
    for (let j = 0; j < 4; j++) {
      for (let part = 0; part < 2; part++) {
        let value = 0, across = 0;
        for (let i = 0; i < 4; i++) {
          const one = control[2 * ((cell[1] + j) * columns + cell[0] + i) + part];
          value += weight[i] * one;
          across += change[i] * one;
        }
        result[part] += weight[4 + j] * value;
        result[2 + 2 * part] += weight[4 + j] * across;
        result[3 + 2 * part] += change[4 + j] * value;
      }
    }
    return result;
  }
}

function checksum(bytes) { // CRC-32 of all but itself
  let crc = ~0;
  bytes.forEach((byte, k) => {
    if (k >= 48 && k < HEAD) return;
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = crc >>> 1 ^ (0xEDB88320 & -(crc & 1));
  });
  return ~crc >>> 0;
}
/* ringsolid.reader-mjs */
