// An arm of six joints: slices of its configuration space, inverse solutions, self-motion, the free share. Follows
// cspace_picture.js, picture_sketch.js and slice_raster.js.

const part = (selector) => root.querySelector(selector);
const CELLS = 200, BATCH = 500, Z = 1.96;
const percent = (x, digits = 1) => `${(100 * x).toFixed(digits)} %`;
const degrees = (x) => `${Math.round((180 / Math.PI) * x) + 0}°`.replace("-", "−");

class SixJoints {
  constructor() {
    root.classList.add("picture-panel");
    document.body.classList.add("lesson");
    this.columns = [0, 1];
    this.axis = Object.keys(data.motions)[0];
    this.along = 0.5;
    this.counts = [];
    this.seed = 1;
    this.fillPickers();
    this.fillSliders();
    this.pressMode = choices(part(".modes"), [["slice", "Slices"], ["solutions", "Solutions"], ["motion", "Self-motion"], ["measure", "Free share"]], (mode) => this.setMode(mode));
    this.pressSolution = choices(part(".solutions"), data.solutions.map((_, k) => [String(k), `${k + 1}`]), (k) => this.pose(data.solutions[k].q));
    [...part(".solutions").children].forEach((chip, k) => { chip.dataset.state = data.solutions[k].state; chip.title = data.solutions[k].text; });
    this.pressAxis = choices(part(".axes"), Object.entries(data.motions).map(([name, { title }]) => [name, title]), (name) => this.setAxis(name));
    part(".motion input").oninput = (event) => this.setAlong(Number(event.target.value));
    part("[data-tool=sample]").onclick = () => this.sample();
    part("[data-tool=clear]").onclick = () => { this.counts = []; this.seed = 1; this.chart.redraw(); this.say(); };
    this.square = new Square(part(".plot canvas"), (pen, unit) => this.draw(pen, unit));
    this.chart = new Sketch(part(".bars canvas"), 0.3, (pen, unit) => this.drawChart(pen, unit));
    this.wire();
    this.setMode("slice");
    viewer.on("change", () => this.follow());
    viewer.on("obstacle", () => { this.waiting ||= requestAnimationFrame(() => { this.waiting = 0; this.follow(); }); });
    viewer.on("planner", (planner, reason) => this.meet(planner, reason));
    if (viewer.planner || viewer.noPlanner) this.meet(viewer.planner, viewer.noPlanner);
    this.setColumns(data.pair);
    // Forward and back along the self-motion.
    viewer.films.push(() => (this.mode === "motion" ? { start: 0, end: 8, show: (t) => this.setAlong(0.5 - 0.5 * Math.cos((t * Math.PI) / 4)) } : null));
  }

  meet(planner, reason) {
    const note = part(".missing");
    note.hidden = Boolean(planner);
    note.textContent = planner ? "" : `Slices are computed in the page, which needs WebAssembly: ${reason}.`;
    this.raster = planner && new SliceRaster(planner, data.layers, data.layerOf, CELLS);
    this.rasterize();
    this.say();
  }

  // ---- controls --------------------------------------------------------------------------------

  fillPickers() {
    for (const select of root.querySelectorAll("select")) {
      const axis = Number(select.dataset.axis);
      select.replaceChildren(...data.all.joints.map(({ name }, k) => new Option(`${k + 1} ${name}`, k)));
      select.onchange = () => {
        const columns = this.columns.slice(), chosen = Number(select.value);
        // Choosing the other axis' joint swaps both.
        if (columns[1 - axis] === chosen) columns[1 - axis] = columns[axis];
        columns[axis] = chosen;
        this.setColumns(columns);
      };
    }
  }

  fillSliders() {
    this.sliders = data.all.joints.map(({ name, straight }, k) => {
      const row = element("div"), label = element("label"), slider = element("input"), out = element("output");
      const low = data.all.low[k], high = data.all.high[k];
      Object.assign(slider, { type: "range", min: low, max: high, step: stepOf(low, high, straight), id: `slices-${k}` });
      label.htmlFor = slider.id;
      label.textContent = `${k + 1} ${name}`;
      // Browsers round the value of a slider, at its ends to outside of the limits.
      slider.oninput = () => { const q = this.q(); q[k] = clamp(Number(slider.value), low, high); this.pose(q); };
      row.append(label, out, slider);
      return { row, slider, out, text: straight ? (v) => viewer.jointText(data.arm[k], v) : degrees };
    });
    part(".sliders").replaceChildren(...this.sliders.map(({ row }) => row));
  }

  setMode(mode) {
    this.mode = mode;
    this.pressMode(mode);
    part(".solutions").hidden = mode !== "solutions";
    part(".motion").hidden = mode !== "motion";
    part(".measure").hidden = mode !== "measure";
    part(".sliders").hidden = mode === "measure";
    if (mode === "solutions") this.pose(data.solutions[0].q);
    else if (mode === "motion") this.setAxis(this.axis);
    else this.follow();
  }

  setColumns(columns) {
    this.columns = columns;
    for (const select of root.querySelectorAll("select")) select.value = columns[Number(select.dataset.axis)];
    for (const key of ["joints", "low", "high", "periodic"]) data[key] = columns.map((k) => data.all[key][k]);
    this.sliders.forEach(({ row }, k) => row.classList.toggle("shown", columns.includes(k)));
    this.rasterize();
    this.say();
  }

  setAxis(name) {
    this.axis = name;
    this.pressAxis(name);
    this.setAlong(data.motions[name].begin);
  }

  /** Moves the arm to a share of the curve of its self-motion. */
  setAlong(share) {
    const { rows } = data.motions[this.axis];
    this.along = clamp(share, 0, 1);
    const slider = part(".motion input");
    slider.value = this.along;
    showValue(slider, part(".motion output"), percent(this.along, 0));
    const at = this.along * (rows.length - 1), k = Math.min(Math.floor(at), rows.length - 2);
    this.pose(rows[k].map((v, c) => v + (at - k) * (rows[k + 1][c] - v)));
  }

  q() { return data.arm.map((column) => viewer.q[column]); }

  pose(q) {
    viewer.setQ(withColumns(viewer.q, data.arm, q));
  }

  wire() {
    const { canvas } = this.square;
    let held = false;
    const put = (pair) => {
      const q = this.q();
      this.columns.forEach((column, axis) => { q[column] = clamp(pair[axis], data.low[axis], data.high[axis]); });
      this.pose(q);
    };
    canvas.addEventListener("pointerdown", (event) => { held = true; canvas.setPointerCapture(event.pointerId); put(this.square.under(event)); });
    canvas.addEventListener("pointermove", (event) => { if (held) put(this.square.under(event)); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = false; });
    viewer.keys.arrows("Slice", "In the picture: move the two joints; with Shift farther", canvas, (by, event) => {
      const q = this.q();
      put(this.columns.map((column, axis) => q[column] + by[axis] * (event.shiftKey ? 10 : 1) * (data.high[axis] - data.low[axis]) / 200));
    });
    viewer.keys.add("Slice", [
      { keys: ["s"], text: "Check 500 more configurations", when: () => this.mode === "measure", act: () => this.sample() },
      { keys: data.solutions.map((_, k) => String(k + 1)), text: "Go to a solution", when: () => this.mode === "solutions", act: ({ key }) => this.pose(data.solutions[key - 1].q) },
    ]);
  }

  // ---- display ---------------------------------------------------------------------------------

  follow() {
    const q = this.q();
    this.sliders.forEach(({ slider, out, text }, k) => {
      slider.value = q[k];
      showValue(slider, out, text(q[k]));
    });
    if (this.mode === "solutions") this.pressSolution(String(this.solution()));
    if (this.rasterKey() !== this.rastered) this.rasterize();
    else this.square.redraw();
    this.say();
  }

  /** The index of the inverse solution equal to the current configuration, or -1. */
  solution() {
    const q = this.q();
    return data.solutions.findIndex((row) => row.q.every((v, k) => Math.abs(v - q[k]) < 1e-6));
  }

  /** The inputs of the slice: the other joints, and moved obstacles. */
  rasterKey() {
    return [...this.q().filter((_, k) => !this.columns.includes(k)), ...obstaclePoses()].join();
  }

  rasterize() {
    const q = this.q();
    this.rastered = this.rasterKey();
    if (!this.raster) { this.square.redraw(); return; }
    const bits = this.raster.bits(this.columns, data.low, data.high, q);
    this.blocked = bits.reduce((count, cell) => count + (cell ? 1 : 0), 0) / bits.length;
    let seen = 0;
    bits.forEach((cell) => { seen |= cell; });
    const patterns = patternsOf(data.layers), rows = data.layers.map(({ name, color }, k) => ({ name, color, k })).filter(({ k }) => (seen >>> k) & 1);
    part(".legend").replaceChildren(...rows.map(({ name, color, k }) => {
      const item = element("span"), swatch = element("i");
      swatch.style.background = patterned(color, patterns[k]);
      item.append(swatch, name);
      return item;
    }));
    this.square.show(cellsOf(bits, CELLS));
  }

  say() {
    if (!viewer.planner) { showVerdict("", ""); return; }
    if (this.mode === "measure") { showVerdict(this.shareWords(), "open"); return; }
    const q = this.q(), pairs = viewer.planner.contacts(q), inside = viewer.planner.withinLimits(q);
    const where = this.mode === "solutions" && this.solution() >= 0 ? `Solution ${this.solution() + 1}: ` : "";
    const touching = pairs.map(([a, b]) => `${a.split("/").pop()} and ${b.split("/").pop()}`).join(", ");
    if (!inside) showVerdict(`${where || "The arm is "}outside the joint limits${touching ? `, and in contact: ${touching}` : ""}.`, "bad");
    else if (touching) showVerdict(`${where || "The arm is "}in contact: ${touching}.`, "bad");
    else showVerdict(`${where || "The arm is "}free. Of this slice ${percent(1 - this.blocked, 0)} is free.`, "good");
  }

  draw(pen, unit) {
    const { square } = this;
    const place = (q) => square.of(this.columns.map((column) => q[column]));
    if (this.mode === "motion") this.drawMotion(pen, unit, place);
    if (this.mode === "solutions") {
      data.solutions.forEach((row, k) => {
        const color = { free: FREE, contact: TOUCH, limits: OPEN }[row.state], [x, y] = place(row.q);
        disc(pen, x, y, 6 * unit, "#fff", color, 2.4 * unit);
        square.write(`${k + 1}`, x + 11 * unit, y - 9 * unit, { color });
      });
    }
    const [x, y] = place(this.q());
    disc(pen, x, y, 9.5 * unit, "#fff", INK, 1.2 * unit);
    disc(pen, x, y, 6 * unit, ACCENT);
  }

  /** The curve of the self-motion projected to the slice; dashed where the arm is in contact. */
  drawMotion(pen, unit, place) {
    const { rows, free } = data.motions[this.axis];
    pen.lineJoin = pen.lineCap = "round";
    for (const [color, width] of [["rgba(255,255,255,.92)", 7], [FREE, 3.4]]) {
      Object.assign(pen, { strokeStyle: color, lineWidth: width * unit });
      pen.beginPath();
      rows.forEach((q, k) => (k ? pen.lineTo(...place(q)) : pen.moveTo(...place(q))));
      pen.stroke();
    }
    Object.assign(pen, { strokeStyle: TOUCH, lineWidth: 4 * unit });
    pen.lineCap = "butt";
    pen.setLineDash([4 * unit, 3 * unit]);
    pen.beginPath();
    rows.forEach((q, k) => { if (k && !(free[k] && free[k - 1])) { pen.moveTo(...place(rows[k - 1])); pen.lineTo(...place(q)); } });
    pen.stroke();
    pen.setLineDash([]);
  }

  // ---- the free share --------------------------------------------------------------------------

  /** A uniform number in [0, 1) from a generator with the same sequence in every browser (mulberry32). */
  random() {
    this.seed = (this.seed + 0x6d2b79f5) | 0;
    let t = Math.imul(this.seed ^ (this.seed >>> 15), 1 | this.seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  }

  sample() {
    if (!viewer.planner) return;
    let q;
    for (let k = 0; k < BATCH; k++) {
      q = data.all.low.map((low, c) => low + this.random() * (data.all.high[c] - low));
      const last = this.counts[this.counts.length - 1] || 0;
      this.counts.push(last + (viewer.planner.isFree(q) ? 1 : 0));
    }
    this.pose(q);
    this.chart.redraw();
  }

  /** The share of the first n samples, and Wilson's interval around it. */
  interval(n) {
    const p = this.counts[n - 1] / n, middle = (p + (Z * Z) / (2 * n)) / (1 + (Z * Z) / n);
    const half = (Z / (1 + (Z * Z) / n)) * Math.sqrt((p * (1 - p)) / n + (Z * Z) / (4 * n * n));
    return [p, middle - half, middle + half];
  }

  shareWords() {
    const n = this.counts.length;
    if (!n) return "No configuration has been checked yet. Press “Sample 500”.";
    const [p, low, high] = this.interval(n);
    return `Of ${n} random configurations ${this.counts[n - 1]} are free: ${percent(p)}; with 95 % confidence the share is ${percent(low)} to ${percent(high)}.`;
  }

  drawChart(pen, unit) {
    const { chart, counts } = this, { width, height } = chart.canvas, n = counts.length;
    const left = 42 * unit, right = width - 8 * unit, top = 8 * unit, floor = height - 22 * unit;
    const low = n && this.interval(n)[1] < 0.5 ? 0 : 0.5, high = 1;
    const y = (p) => floor - ((clamp(p, low, high) - low) / (high - low)) * (floor - top), x = (k) => left + (k / Math.max(n, 1)) * (right - left);
    chart.font(11);
    Object.assign(pen, { fillStyle: SOFT, strokeStyle: GRID, lineWidth: chart.ratio, textAlign: "right", textBaseline: "middle" });
    for (const p of [low, 0.5 * (low + high), high]) {
      pen.beginPath(); pen.moveTo(left, y(p)); pen.lineTo(right, y(p)); pen.stroke();
      pen.fillText(percent(p, 0), left - 6 * unit, y(p));
    }
    chart.write(n ? `${n} ${n === 1 ? "sample" : "samples"}` : "no samples", 0.5 * (left + right), height - 8 * unit, { color: SOFT, weight: 400, size: 11 });
    if (!n) return;
    const ends = Array.from({ length: 200 }, (_, k) => Math.max(1, Math.round(((k + 1) / 200) * n)));
    const rows = ends.map((k) => [k, ...this.interval(k)]);
    pen.fillStyle = "rgba(47,102,200,.2)";
    pen.beginPath();
    rows.forEach(([k, , a]) => pen.lineTo(x(k), y(a)));
    rows.slice().reverse().forEach(([k, , , b]) => pen.lineTo(x(k), y(b)));
    pen.fill();
    Object.assign(pen, { strokeStyle: BLUE, lineWidth: 2 * unit });
    pen.beginPath();
    rows.forEach(([k, p]) => pen.lineTo(x(k), y(p)));
    pen.stroke();
  }
}

viewer.slices = new SixJoints();
