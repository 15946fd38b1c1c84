// The chart of a configuration space on a canvas: cells, tree, motion, and marks of configurations.

class CspaceChart {
  constructor(lesson) {
    this.lesson = lesson;
    this.canvas = part("canvas");
    this.pen = this.canvas.getContext("2d");
    this.overlays = []; // f(pen), drawn above the cells and below the marks
    this.twin = null; // the configuration with the other elbow
  }

  /** Fits the picture to its place; whether its size has changed. */
  resize() {
    const wide = part(".plot").clientWidth, ratio = fineness(), large = magnification();
    if (wide === this.wide && ratio === this.ratio) return false;
    Object.assign(this, { wide, ratio });
    this.unit = ratio * large * clamp(wide / large / 480, 0.85, 1.6);
    const left = Math.round(40 * this.unit), below = Math.round(26 * this.unit), rim = Math.round(8 * this.unit);
    const size = Math.max(32, Math.round(wide * this.ratio) - left - rim);
    this.plot = { x: left, y: rim, size };
    this.canvas.width = left + size + rim;
    this.canvas.height = rim + size + below;
    part(".plot").style.height = `${this.canvas.height / this.ratio}px`;
    return true;
  }

  // ---- places ------------------------------------------------------------------------------

  /** The position of the pointer as fractions of the axes. */
  spot(event) {
    const box = this.canvas.getBoundingClientRect(), { ratio, plot: { x, y, size } } = this;
    return [((event.clientX - box.left) * ratio - x) / size, 1 - ((event.clientY - box.top) * ratio - y) / size];
  }

  inPlot([u, v]) {
    return u >= 0 && u <= 1 && v >= 0 && v <= 1;
  }

  /** The pixel at fractions of the axes. */
  at(u, v) {
    const { x, y, size } = this.plot;
    return [x + u * size, y + (1 - v) * size];
  }

  /** A configuration as fractions of the axes. */
  shares(q) {
    return q.map((x, axis) => share(axis, wrapped(axis, x)));
  }

  /** The joint values b, shifted by whole turns to be nearest to a. */
  near(a, b) {
    return b.map((v, axis) => (data.periodic[axis] ? v + 2 * Math.PI * Math.round((a[axis] - v) / (2 * Math.PI)) : v));
  }

  /** The mark at a position: "start", the number of a goal, or null. */
  markAt(spot) {
    const near = (q) => {
      const [u, v] = this.shares(q);
      return Math.hypot(u - spot[0], v - spot[1]) * this.plot.size < 9 * this.unit;
    };
    if (data.start && near(data.start)) return "start";
    const goal = data.goals.findIndex(near);
    return goal < 0 ? null : goal;
  }

  nearTwin([u, v]) {
    return Boolean(this.twin) && Math.hypot(this.twin[0] - u, this.twin[1] - v) * this.plot.size < 9 * this.unit;
  }

  // ---- drawing -----------------------------------------------------------------------------

  /** Paints the cells. */
  paint() {
    const { lesson, plot: { size } } = this;
    this.area ||= element("canvas");
    if (this.area.width !== size) this.area.width = this.area.height = size;
    this.area.getContext("2d").putImageData(lesson.cells.paint(size, this.ratio, lesson.tinted, lesson.only), 0, 0);
  }

  /** Draws the static layers: cells, tree, frame; then the others. */
  redraw() {
    this.still ||= element("canvas");
    const { width, height } = this.canvas, pen = this.still.getContext("2d"), { x, y } = this.plot;
    if (this.still.width === width && this.still.height === height) pen.clearRect(0, 0, width, height);
    else Object.assign(this.still, { width, height });
    pen.drawImage(this.area, x, y);
    this.inside(pen, () => { if (this.lesson.showTree) this.drawTree(pen); });
    drawFrame(pen, this.plot, this.unit);
    this.draw();
  }

  /** Draws what moves on the static layers: overlays, motion, names of the images, marks, names of the marks. */
  draw() {
    if (!this.still) return;
    const { lesson, pen, unit } = this, { flat } = lesson.arm;
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.still, 0, 0);
    this.inside(pen, () => {
      for (const overlay of this.overlays) overlay(pen);
      this.drawMotion(pen);
      this.drawNames(pen);
      const [u, v] = this.shares(q2());
      this.drawHairs(pen, u, v);
      if (lesson.workspace && Math.abs(flat.side(q2())) > 0.02 && !lesson.place(flat.twin(q2())).outside) {
        this.twin = this.shares(flat.twin(q2()));
        this.around(this.twin, (x, y) => disc(pen, x, y, 5.5 * unit, "rgba(255,255,255,.75)", ACCENT, 2 * unit));
      } else this.twin = null;
      data.goals.forEach((goal) => this.around(this.shares(goal), (x, y) => star(pen, x, y, 10.5 * unit, GOAL, unit)));
      if (data.start) this.around(this.shares(data.start), (x, y) => disc(pen, x, y, 6.5 * unit, START, "#fff", 2 * unit));
      this.around([u, v], (x, y) => {
        disc(pen, x, y, 9.5 * unit, "#fff", INK, 1.2 * unit);
        disc(pen, x, y, 6 * unit, ACCENT);
      });
    });
    this.drawLabels(pen);
  }

  /** Draws clipped to the picture. */
  inside(pen, draw) {
    const { x, y, size } = this.plot;
    pen.save();
    pen.beginPath();
    pen.rect(x, y, size, size);
    pen.clip();
    draw();
    pen.restore();
  }

  /** Draws a polyline of fractions of the axes. */
  line(pen, points) {
    pen.beginPath();
    points.forEach(([u, v], k) => (k ? pen.lineTo(...this.at(u, v)) : pen.moveTo(...this.at(u, v))));
    pen.stroke();
  }

  /** Draws a polyline of joint values, also across the seams. */
  trace(pen, values) {
    for (const copy of wrappedCopies(values.map((q) => q.map((v, axis) => share(axis, v))))) this.line(pen, copy);
  }

  /** A mark near an edge that is identified with another is drawn at both. */
  around(shares, mark) {
    for (const [u, v] of copiesNear(shares)) mark(...this.at(u, v));
  }

  drawTree(pen) {
    const dense = this.lesson.tree.length > 800;
    pen.lineWidth = (dense ? 0.8 : 1.4) * this.unit;
    pen.globalAlpha = dense ? 0.6 : 0.85;
    [START, GOAL].forEach((color, side) => {
      const edges = this.lesson.tree.slice(0, this.lesson.grown).filter((_, e) => this.lesson.sides[e] === side).flat();
      pen.strokeStyle = pen.fillStyle = color;
      pen.beginPath();
      for (const [a, b] of edges) { pen.moveTo(...this.at(...a)); pen.lineTo(...this.at(...b)); }
      pen.stroke();
      if (dense) return;
      for (const end of edges.flat()) { pen.beginPath(); pen.arc(...this.at(...end), 2.2 * this.unit, 0, 7); pen.fill(); }
    });
  }

  /** Names on the images, so that no reader depends on colors. */
  drawNames(pen) {
    this.taken = []; // parts of the picture with text: [left, top, right, bottom]
    pen.save();
    pen.font = `600 ${12 * this.unit}px ${FONT}`;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.lineJoin = "round";
    pen.lineWidth = 3 * this.unit;
    data.layers.forEach((layer, k) => {
      if (!layer.spot || (this.lesson.only >= 0 && this.lesson.only !== k)) return;
      const [px, py] = this.at(share(0, layer.spot[0]), share(1, layer.spot[1])), light = isLight(layer.color), name = pictureName(layer.name);
      // Completely inside the picture, even if the image extends beyond its edge.
      const { x, size } = this.plot, half = pen.measureText(name).width / 2 + 4 * this.unit;
      const middle = Math.max(Math.min(px, x + size - half), x + half);
      pen.strokeStyle = light ? "#fff" : layer.color;
      pen.strokeText(name, middle, py);
      pen.fillStyle = light ? INK : "#fff";
      pen.fillText(name, middle, py);
      this.taken.push([middle - half, py - 8 * this.unit, middle + half, py + 8 * this.unit]);
    });
    pen.restore();
  }

  drawHairs(pen, u, v) {
    const { x, y, size } = this.plot, [px, py] = this.at(u, v);
    pen.save();
    pen.strokeStyle = INK;
    pen.globalAlpha = 0.35;
    pen.lineWidth = this.ratio;
    pen.setLineDash([3 * this.unit, 4 * this.unit]);
    pen.beginPath();
    pen.moveTo(px, y + size); pen.lineTo(px, py);
    pen.moveTo(x, py); pen.lineTo(px, py);
    pen.stroke();
    pen.restore();
  }

  /** The motion: faint as a whole, bright up to the current time. */
  drawMotion(pen) {
    if (!this.lesson.curve.length) return;
    const come = viewer.manual ? 1 : viewer.player.fraction, last = Math.max(2, Math.ceil(come * this.lesson.curve.length));
    pen.lineJoin = pen.lineCap = "round";
    for (const copy of this.lesson.motion) {
      pen.strokeStyle = "rgba(255,255,255,.92)";
      pen.lineWidth = 6 * this.unit;
      this.line(pen, copy);
      pen.strokeStyle = "#f2a27f";
      pen.lineWidth = 3 * this.unit;
      this.line(pen, copy);
    }
    pen.strokeStyle = ACCENT;
    pen.lineWidth = 3.4 * this.unit;
    for (const copy of this.lesson.motion) this.line(pen, copy.slice(0, last));
  }

  drawLabels(pen) {
    const marks = data.goals.map((goal, k) => [goal, data.goalNames[k], GOAL]);
    if (data.start) marks.push([data.start, "start", START]);
    // Where the hollow ring has room for its name.
    if (this.twin && !marks.some(([q]) => Math.hypot(...this.shares(q).map((part, axis) => part - this.twin[axis])) < 0.09)) {
      marks.push([this.twin.map((part, axis) => value(axis, part)), "other elbow", ACCENT]);
    }
    const { x, y, size } = this.plot;
    pen.save();
    pen.font = `650 ${12.5 * this.unit}px ${FONT}`;
    pen.textBaseline = "middle";
    pen.lineJoin = "round";
    for (const [q, text, color] of marks) {
      pen.font = `${text === "other elbow" ? 500 : 650} ${(text === "other elbow" ? 11 : 12.5) * this.unit}px ${FONT}`;
      const [px, py] = this.at(...this.shares(q)), wide = pen.measureText(text).width;
      // Next to the mark, or below or above it, where there is room and no other text.
      const far = 13 * this.unit, low = 19 * this.unit, middle = Math.max(Math.min(px - wide / 2, x + size - wide - 3 * this.unit), x + 3 * this.unit);
      const boxes = [[px + far, py - 9 * this.unit], [px + far, py + 9 * this.unit], [middle, py + low], [middle, py - low], [px - far - wide, py - 9 * this.unit]]
        .map(([left, top]) => [left, top - 8 * this.unit, left + wide, top + 8 * this.unit]);
      const inside = boxes.filter((box) => box[0] >= x && box[1] >= y && box[2] <= x + size && box[3] <= y + size);
      const spot = inside.find((box) => !this.taken.some((other) => meets(box, other))) || inside[0] || boxes[0];
      const left = spot[0], top = (spot[1] + spot[3]) / 2;
      this.taken.push(spot);
      pen.strokeStyle = "rgba(255,255,255,.95)";
      pen.lineWidth = 4.5 * this.unit;
      pen.strokeText(text, left, top);
      pen.fillStyle = color;
      pen.fillText(text, left, top);
    }
    pen.restore();
  }
}

/** Whether two boxes [left, top, right, bottom] overlap. */
function meets(a, b) {
  return a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
}

function star(pen, x, y, r, fill, unit) {
  pen.beginPath();
  for (let k = 0; k < 10; k++) {
    const a = -Math.PI / 2 + (k * Math.PI) / 5, far = k % 2 ? 0.45 * r : r;
    pen.lineTo(x + far * Math.cos(a), y + far * Math.sin(a));
  }
  pen.closePath();
  pen.fillStyle = fill;
  pen.strokeStyle = "#fff";
  pen.lineWidth = 3 * unit;
  pen.lineJoin = "round";
  pen.stroke();
  pen.fill();
}
