// Two arms: a slice of the configuration space of both, and the coordination diagram of their paths. Follows
// cspace_picture.js, picture_sketch.js and slice_raster.js.

const part = (selector) => root.querySelector(selector);
const CELLS = 220, BLOCKED = "#aab4c2";

/** The interpolated value at x in a table with increasing positions. */
function interpolated(places, rows, x) {
  let k = places.findIndex((p) => p >= x);
  if (k <= 0) return rows[k < 0 ? rows.length - 1 : 0].slice();
  const t = (x - places[k - 1]) / (places[k] - places[k - 1] || 1);
  return rows[k].map((v, c) => rows[k - 1][c] + t * (v - rows[k - 1][c]));
}

class Diagram extends Sketch {
  constructor(canvas, lesson) {
    super(canvas, 1, (pen, unit) => lesson.drawDiagram(pen, unit));
    this.lesson = lesson;
  }

  laid() {
    this.makePlot();
    this.paint();
  }

  /** The blocked cells as a picture. */
  paint() {
    const { scenario } = this.lesson;
    if (!this.plot || !scenario) return;
    const { size } = this.plot, [m, n] = scenario.shape, bits = bytes(scenario.blocked), [one, two] = scenario.lengths;
    this.area = element("canvas");
    this.area.width = this.area.height = size;
    const pen = this.area.getContext("2d");
    pen.fillStyle = "#fff";
    pen.fillRect(0, 0, size, size);
    const stripes = element("canvas"), gap = Math.round(7 * this.unit);
    stripes.width = stripes.height = gap;
    const tile = stripes.getContext("2d");
    tile.fillStyle = "#c3cad5";
    tile.fillRect(0, 0, gap, gap);
    Object.assign(tile, { strokeStyle: "#9aa5b5", lineWidth: gap / 4 });
    tile.beginPath();
    for (const k of [-1, 0, 1]) { tile.moveTo((k - 0.5) * gap, 1.5 * gap); tile.lineTo((k + 1.5) * gap, -0.5 * gap); }
    tile.stroke();
    pen.fillStyle = pen.createPattern(stripes, "repeat");
    pen.beginPath();
    const x = (k) => (one[k] / one[m - 2]) * size, y = (k) => size - (two[k] / two[n - 2]) * size;
    for (let i = 1; i < m - 1; i++) {
      for (let j = 1; j < n - 1; j++) {
        const at = i * n + j;
        if ((bits[at >> 3] >> (at & 7)) & 1) pen.rect(x(i - 1), y(j), x(i) - x(i - 1) + 0.6, y(j - 1) - y(j) + 0.6);
      }
    }
    pen.fill();
    this.redraw();
  }

  of([a, b]) {
    const { x, y, size } = this.plot, [one, two] = this.lesson.ends;
    return [x + (a / one) * size, y + (1 - b / two) * size];
  }

  under(event) {
    const box = this.canvas.getBoundingClientRect(), { x, y, size } = this.plot, [one, two] = this.lesson.ends;
    const u = ((event.clientX - box.left) * this.ratio - x) / size, v = 1 - ((event.clientY - box.top) * this.ratio - y) / size;
    return [clamp(u, 0, 1) * one, clamp(v, 0, 1) * two];
  }
}

class TwoArms {
  constructor() {
    root.classList.add("picture-panel");
    document.body.classList.add("lesson");
    viewer.editing.sleep();
    this.shown = 0; // the arm whose slice is shown
    this.places = null;
    this.time = 0;
    this.pressScenario = choices(part(".scenarios"), data.scenarios.map(({ name, title }) => [name, title]), (name) => this.setScenario(name));
    const arms = element("span", undefined, "row arms");
    part(".slice-title").append(element("span", "Configuration space of"), arms);
    this.pressArm = choices(arms, data.arms.map(({ name }, k) => [String(k), name]), (k) => this.setArm(Number(k)));
    this.square = new Square(part(".slice canvas"), (pen, unit) => this.drawSlice(pen, unit));
    this.diagram = new Diagram(part(".diagram canvas"), this);
    this.clock = part(".walk input");
    this.clock.oninput = () => { this.stop(); this.setTime(Number(this.clock.value)); };
    this.runButton = part("[data-tool=run]");
    this.runButton.onclick = () => this.run();
    this.wire();
    lookFromAbove(data.view, data.height);
    this.setArm(0);
    this.setScenario(data.scenarios[0].name);
    viewer.on("change", () => this.follow());
    viewer.films.push(() => ({ start: 0, end: this.end / this.rate, show: (t) => this.setTime(t * this.rate) }));
    viewer.on("planner", (planner, reason) => this.meet(planner, reason));
    if (viewer.planner || viewer.noPlanner) this.meet(viewer.planner, viewer.noPlanner);
  }

  /** Takes the planner of the page, whose kernels compute slices. */
  meet(planner, reason) {
    const note = part(".missing");
    note.hidden = Boolean(planner);
    note.textContent = planner ? "" : `This picture is computed in the page, which needs WebAssembly: ${reason}.`;
    this.rasters = planner && data.arms.map(({ layers, layerOf }) => new SliceRaster(planner, layers, layerOf, CELLS));
    this.rasterize();
  }

  get ends() { return this.scenario.lengths.map((row) => row[row.length - 1]); }

  setArm(k) {
    this.shown = k;
    this.pressArm(String(k));
    const { low, high, periodic, joints, layers } = data.arms[k];
    Object.assign(data, { low, high, periodic, joints, layers });
    this.rasterize();
  }

  setScenario(name) {
    this.stop();
    this.scenario = data.scenarios.find((row) => row.name === name);
    this.pressScenario(name);
    this.pressSchedule = choices(part(".schedules"), this.scenario.schedules.map((row) => [row.name, row.title]), (chosen) => { this.setSchedule(chosen); this.run(); });
    part(".schedules").hidden = !this.scenario.schedules.length;
    this.setSchedule(this.scenario.schedules[0].name);
    this.diagram.paint();
  }

  setSchedule(name) {
    this.stop();
    this.schedule = this.scenario.schedules.find((row) => row.name === name);
    this.pressSchedule(name);
    this.setTime(0);
  }

  /** Moves both arms to their positions in the schedule. */
  setTime(time) {
    const { times, places, joint } = this.schedule;
    this.time = clamp(time, 0, times[times.length - 1]);
    if (joint) {
      this.places = null;
      this.pose(interpolated(times, joint, this.time));
    } else this.setPlaces(interpolated(times, places, this.time));
  }

  /** Moves both arms to positions on their paths. */
  setPlaces(places) {
    this.places = places;
    const [one, two] = [0, 1].map((k) => interpolated(this.scenario.lengths[k], this.scenario.configurations[k], places[k]));
    this.pose([...one, ...two]);
  }

  pose(q) {
    this.posed = q;
    viewer.setQ(withColumns(viewer.q, data.columnsOfBoth, q));
  }

  q() { return data.columnsOfBoth.map((column) => viewer.q[column]); }

  get end() { return this.schedule.times[this.schedule.times.length - 1]; }

  /** Short motions are slowed down, so that the eye can follow. */
  get rate() { return Math.min(1, this.end / 4); }

  run() {
    if (this.timer) { this.stop(); return; }
    if (reducedMotion()) { this.setTime(this.end); return; }
    const { end, rate } = this;
    if (this.time >= end) this.time = 0;
    let last = performance.now();
    const tick = (now) => {
      this.setTime(this.time + (rate * Math.max(0, now - last)) / 1000);
      last = now;
      this.timer = this.time < end ? requestAnimationFrame(tick) : null;
      if (!this.timer) this.stop();
    };
    this.timer = requestAnimationFrame(tick);
    this.runButton.textContent = "Pause";
  }

  stop() {
    cancelAnimationFrame(this.timer);
    this.timer = null;
    this.runButton.textContent = "Run";
  }

  wire() {
    const hold = (sketch, put) => {
      let held = false;
      const { canvas } = sketch;
      canvas.addEventListener("pointerdown", (event) => { held = true; canvas.setPointerCapture(event.pointerId); this.stop(); put(sketch.under(event)); });
      canvas.addEventListener("pointermove", (event) => { if (held) put(sketch.under(event)); });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = false; });
    };
    hold(this.square, (q) => this.poseShown(q));
    hold(this.diagram, (places) => this.setPlaces(places));
    const keys = (text, canvas, put) => viewer.keys.arrows("Two arms", text, canvas, (by, event) => {
      this.stop();
      put(by.map((v) => v * (event.shiftKey ? 10 : 1)));
    });
    keys("In the slice: move the arm; with Shift farther", this.square.canvas, (by) => this.poseShown(this.shownQ().map((v, axis) => v + (by[axis] * Math.PI) / 180)));
    keys("In the diagram: move both arms along their paths", this.diagram.canvas, (by) => {
      const places = this.places || [0, 0];
      this.setPlaces(places.map((v, k) => clamp(v + 0.01 * by[k] * this.ends[k], 0, this.ends[k])));
    });
    viewer.keys.add("Two arms", [
      { keys: [" ", "x"], text: "Run the schedule, or pause", act: () => this.run() },
      { keys: [",", "."], text: "A 20th of a second back or on", act: ({ key }) => { this.stop(); this.setTime(this.time + (key === "." ? 0.05 : -0.05)); } },
    ]);
  }

  shownQ() { return this.q().slice(2 * this.shown, 2 * this.shown + 2); }

  /** Moves the arm whose slice is shown, off its path. */
  poseShown(q) {
    const both = this.q();
    q.forEach((v, axis) => { both[2 * this.shown + axis] = clamp(v, data.low[axis], data.high[axis]); });
    this.places = null;
    this.pose(both);
  }

  follow() {
    // Unless the arms are where the places on their paths have put them.
    if (this.q().some((v, k) => v !== this.posed[k])) this.places = null;
    const other = this.rasterKey();
    if (other !== this.rastered) this.rasterize();
    else { this.square.redraw(); }
    this.diagram.redraw();
    this.say();
    const { end } = this;
    Object.assign(this.clock, { max: end, value: this.time });
    showValue(this.clock, part(".walk output"), `${this.time.toFixed(1)} / ${end.toFixed(1)} s`);
  }

  /** The inputs of the slice: the other arm, and moved obstacles. */
  rasterKey() {
    return [...this.q().slice(2 - 2 * this.shown, 4 - 2 * this.shown), ...obstaclePoses()].join();
  }

  rasterize() {
    if (!this.rasters || !this.scenario) { this.square.redraw(); return; }
    const { low, high } = data, q = this.q();
    this.rastered = this.rasterKey();
    const bits = this.rasters[this.shown].bits([2 * this.shown, 2 * this.shown + 1], low, high, q);
    this.square.show(cellsOf(bits, CELLS));
  }

  say() {
    const pairs = viewer.planner ? viewer.planner.contacts(this.q()) : [];
    let words = this.schedule.text, tone = this.schedule.tone;
    if (pairs.length) {
      words = `${pairs.map(([a, b]) => `${a.replace("/", "’s ")} and ${b.replace("/", "’s ")}`).join(", ")} touch. ${words}`;
      tone = "bad";
    }
    showVerdict(words, tone, this.timer && this.time < this.end);
  }

  drawSlice(pen, unit) {
    const { square, scenario } = this, own = data.arms[this.shown].color;
    if (!scenario) return;
    const path = this.schedule.joint ? this.schedule.joint.map((q) => q.slice(2 * this.shown, 2 * this.shown + 2)) : scenario.configurations[this.shown];
    pen.lineJoin = pen.lineCap = "round";
    for (const [color, width] of [["rgba(255,255,255,.92)", 6], [INK, 2]]) {
      Object.assign(pen, { strokeStyle: color, lineWidth: width * unit });
      square.line(path);
    }
    square.mark(path[0], (x, y) => { disc(pen, x, y, 6 * unit, START, "#fff", 2 * unit); square.write("start", x, y - 15 * unit, { color: START }); });
    square.mark(path[path.length - 1], (x, y) => { disc(pen, x, y, 6 * unit, GOAL, "#fff", 2 * unit); square.write("goal", x, y + 16 * unit, { color: GOAL }); });
    square.mark(this.shownQ(), (x, y) => { disc(pen, x, y, 9.5 * unit, "#fff", INK, 1.2 * unit); disc(pen, x, y, 6 * unit, own); });
    this.drawLegend(pen, unit);
  }

  drawLegend(pen, unit) {
    const { x, y } = this.square.plot, patterns = patternsOf(data.layers);
    data.layers.forEach(({ name, color }, k) => {
      const top = y + (16 + 18 * k) * unit;
      disc(pen, x + 14 * unit, top, 5 * unit, pen.createPattern(patternTile(color, patterns[k], Math.round(6 * unit)), "repeat"), "#fff", unit);
      this.square.write(name, x + 24 * unit, top, { align: "left", color: INK, size: 11.5 });
    });
  }

  drawDiagram(pen, unit) {
    const { diagram } = this;
    if (!this.scenario || !diagram.plot || !diagram.area) return;
    const { x, y, size } = diagram.plot, [one, two] = this.ends;
    pen.drawImage(diagram.area, x, y);
    pen.save();
    pen.beginPath();
    pen.rect(x - 8 * unit, y - 8 * unit, size + 16 * unit, size + 16 * unit);
    pen.clip();
    for (const schedule of this.scenario.schedules) if (schedule !== this.schedule) this.drawCurve(pen, unit, schedule, false);
    this.drawCurve(pen, unit, this.schedule, true);
    for (const [at, color] of [[[0, 0], START], [[one, two], GOAL]]) disc(pen, ...diagram.of(at), 6.5 * unit, color, "#fff", 2 * unit);
    if (this.places) {
      const [px, py] = diagram.of(this.places);
      Object.assign(pen, { strokeStyle: INK, lineWidth: diagram.ratio, globalAlpha: 0.4 });
      pen.setLineDash([3 * unit, 4 * unit]);
      pen.beginPath();
      pen.moveTo(px, y + size); pen.lineTo(px, py); pen.lineTo(x, py);
      pen.stroke();
      pen.setLineDash([]);
      pen.globalAlpha = 1;
      disc(pen, px, py, 9.5 * unit, "#fff", INK, 1.2 * unit);
      disc(pen, px, py, 6 * unit, this.isBlocked() ? TOUCH : INK);
    } else if (this.schedule.joint) diagram.write("off both paths", x + size / 2, y + size / 2, { color: INK, size: 14 });
    pen.restore();
    Object.assign(pen, { strokeStyle: INK, lineWidth: 1.1 * unit });
    pen.strokeRect(x, y, size, size);
    const [a, b] = data.arms;
    Object.assign(pen, { lineWidth: 4 * unit, strokeStyle: a.color });
    pen.beginPath(); pen.moveTo(x, y + size + 3 * unit); pen.lineTo(x + size, y + size + 3 * unit); pen.stroke();
    pen.strokeStyle = b.color;
    pen.beginPath(); pen.moveTo(x - 3 * unit, y); pen.lineTo(x - 3 * unit, y + size); pen.stroke();
    diagram.write(`${a.name} on its path →`, x + size / 2, y + size + 16 * unit, { color: a.color });
    pen.save();
    pen.translate(x - 18 * unit, y + size / 2);
    pen.rotate(-Math.PI / 2);
    diagram.write(`${b.name} on its path →`, 0, 0, { color: b.color });
    pen.restore();
  }

  isBlocked() {
    const cell = this.places.map((v, k) => { const i = this.scenario.lengths[k].findIndex((p) => p >= v - 1e-9); return Math.max(1, i); });
    const at = cell[0] * this.scenario.shape[1] + cell[1];
    return Boolean((bytes(this.scenario.blocked)[at >> 3] >> (at & 7)) & 1);
  }

  drawCurve(pen, unit, { places }, chosen) {
    if (!places) return;
    pen.lineJoin = pen.lineCap = "round";
    const line = () => { pen.beginPath(); places.forEach((at, k) => (k ? pen.lineTo(...this.diagram.of(at)) : pen.moveTo(...this.diagram.of(at)))); pen.stroke(); };
    Object.assign(pen, { strokeStyle: "rgba(255,255,255,.9)", lineWidth: (chosen ? 6 : 4) * unit });
    line();
    Object.assign(pen, { strokeStyle: chosen ? ACCENT : "#8b95a3", lineWidth: (chosen ? 3.2 : 1.8) * unit });
    pen.setLineDash(chosen ? [] : [6 * unit, 5 * unit]);
    line();
    pen.setLineDash([]);
  }
}

viewer.pair = new TwoArms();
