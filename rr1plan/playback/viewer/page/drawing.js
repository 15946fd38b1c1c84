// What drawings on canvases share: colors, marks and ticks.

const BAD = "#c2255c", SOFT = "#667080", INK = "#1b2430", GRID = "#e3e7ec", ACCENT = "#e4500e";

/** A disc, with a rim of another color if there is one. */
function disc(pen, x, y, r, fill, rim = null, width = 1) {
  pen.beginPath();
  pen.arc(x, y, r, 0, 7);
  pen.fillStyle = fill;
  pen.fill();
  if (!rim) return;
  Object.assign(pen, { strokeStyle: rim, lineWidth: width });
  pen.stroke();
}

/** A cross in the color and width of the pen. */
function cross(pen, x, y, r) {
  pen.beginPath();
  for (const sign of [1, -1]) { pen.moveTo(x - r, y - sign * r); pen.lineTo(x + r, y + sign * r); }
  pen.stroke();
}

/** A cross that is readable on every background. */
function rimmedCross(pen, x, y, r, color, width) {
  for (const [strokeStyle, lineWidth] of [["#fff", 2.2 * width], [color, width]]) {
    Object.assign(pen, { strokeStyle, lineWidth, lineCap: "round" });
    cross(pen, x, y, r);
  }
  pen.lineCap = "butt";
}

/** Round numbers between low and high, about as many as requested. */
function niceTicks(low, high, count) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough)), step = power * [1, 2, 5, 10].find((f) => f * power >= 0.7 * rough);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) ticks.push(k * step);
  return ticks;
}
