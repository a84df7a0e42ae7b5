/* What is known of each part of the image, in colours that colour-blind people tell apart: orange is uncertain, blue
   is good; a hatch says that nothing is known, a dot that no photo shows the target there. */

const STEPS = [
  { most: 1, colour: "#2171b5" },
  { most: 2, colour: "#9ecae1" },
  { most: 4, colour: "#fee391" },
  { most: 8, colour: "#fe9929" },
  { most: Infinity, colour: "#b34400" },
];
const UNKNOWN = "#8a9099";

const colourOf = (sigma, wanted) => STEPS.find((step) => sigma <= step.most * wanted * 1.0001).colour;

/** Draw a map into a box; `pen` is a canvas' 2D context. */
export function drawMap(pen, map, box, alpha) {
  const [rows, columns] = [map.sigma_px.length, map.sigma_px[0]?.length ?? 0];
  const [wide, high] = [box.width / columns, box.height / rows];
  pen.save();
  for (let row = 0; row < rows; row += 1) {
    for (let column = 0; column < columns; column += 1) {
      const sigma = map.sigma_px[row][column];
      const [x, y] = [box.x + column * wide, box.y + row * high];
      pen.globalAlpha = alpha;
      pen.fillStyle = sigma === null ? UNKNOWN : colourOf(sigma, map.wanted_px);
      pen.fillRect(x, y, wide + 0.5, high + 0.5);
      pen.globalAlpha = 1;
      if (sigma === null) hatch(pen, x, y, wide, high);
      else if (!map.is_covered[row][column]) dot(pen, x + wide / 2, y + high / 2, Math.min(wide, high) / 7);
    }
  }
  pen.restore();
}

function hatch(pen, x, y, wide, high) {
  pen.strokeStyle = "rgb(0 0 0 / 45%)";
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(x, y + high);
  pen.lineTo(x + wide, y);
  pen.stroke();
}

function dot(pen, x, y, radius) {
  pen.fillStyle = "rgb(0 0 0 / 55%)";
  pen.beginPath();
  pen.arc(x, y, Math.max(1, radius), 0, 2 * Math.PI);
  pen.fill();
}

/** The colours' meanings: `[colour, words]`; "hatch" and "dot" stand for the two signs. */
export function mapKey(map) {
  const px = (factor) => String(Number((factor * map.wanted_px).toPrecision(2)));
  const steps = STEPS.map((step, n) => [
    step.colour, Number.isFinite(step.most) ? `to ${px(step.most)}${n === 0 ? " px: good" : ""}` : "more",
  ]);
  return [...steps, ["hatch", "nothing known"], ["dot", "no photo there"]];
}
