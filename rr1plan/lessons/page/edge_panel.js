// A straight edge, checked at fixed steps, by halving and by advancing. Follows cspace_picture.js, picture_sketch.js and
// planar_distance.js; `rr1plan/lessons/edge_intervals.py` is the Python counterpart.

const part = (selector) => root.querySelector(selector);
const TOLERANCE = 1e-6, MOST = 4000, SHORTEST = 1e-6;
const STRAIGHT = data.joints.filter((joint) => joint.straight).length, RANGE = Math.max(...[0, 1].map((axis) => data.high[axis] - data.low[axis]));
const WIDTH = data.view[1][0] - data.view[0][0]; // of the part of the plane that the tool reaches [m]
const [UNIT, SCALE] = WIDTH < 0.1 ? ["mm", 1000] : WIDTH < 20 ? ["cm", 100] : ["m", 1];
const LEAST = 0.032 * WIDTH; // the axis of distances ends there or higher [m]

/** Distances of all pairs beyond their padding, and the links they belong to. */
function clearances(q) {
  const poses = viewer.poses(withColumns(viewer.q, data.columns, q));
  return data.pairs.map(({ a, b, padding }) => elementDistance(a, b, poses, data.outlines) - padding - TOLERANCE);
}

class Edge {
  constructor(q0, q1) {
    Object.assign(this, { q0, q1 });
    const change = [0, 1].map((axis) => Math.abs(q1[axis] - q0[axis]));
    this.length = Math.hypot(...change);
    /** Bound on the relative motion of each pair on the whole edge. */
    this.travel = data.pairs.map(({ levers }) => levers[0] * change[0] + levers[1] * change[1]);
    this.halved = this.halve();
    this.advanced = this.advance();
    this.curve = Array.from({ length: 241 }, (_, k) => Math.min(...clearances(this.at(k / 240))));
  }

  at(s) { return [0, 1].map((axis) => this.q0[axis] + s * (this.q1[axis] - this.q0[axis])); }

  interval(begin, end, where) {
    const distances = clearances(this.at(where)), half = Math.max(where - begin, end - where);
    const rooms = distances.map((d, k) => d - half * this.travel[k]);
    const touching = Math.min(...distances) <= 0;
    const k = touching ? distances.indexOf(Math.min(...distances)) : rooms.indexOf(Math.min(...rooms));
    return { begin, end, where, distances, distance: distances[k], bound: half * this.travel[k], pair: data.pairs[k], verdict: touching ? "contact" : rooms[k] > 0 ? "free" : "halved" };
  }

  /** All intervals in the order in which they are checked, long ones first. */
  halve() {
    const found = [], waiting = [[0, 1]];
    for (let head = 0; head < waiting.length && found.length < MOST; head++) {
      const [begin, end] = waiting[head], next = this.interval(begin, end, 0.5 * (begin + end));
      found.push(next);
      if (next.verdict === "contact") break;
      if (next.verdict === "halved") waiting.push([begin, next.where], [next.where, end]);
    }
    return found;
  }

  /** Steps from the start of the edge, each as long as the distances at its own start allow. */
  advance() {
    const found = [];
    for (let at = 0; at < 1 && found.length < MOST;) {
      const distances = clearances(this.at(at));
      const steps = distances.map((d, k) => (this.travel[k] > 0 ? d / this.travel[k] : d > 0 ? Infinity : 0));
      const k = steps.indexOf(Math.min(...steps)), step = Math.min(steps[k], 1 - at), pair = data.pairs[k];
      const stuck = step < SHORTEST && at + step < 1;
      found.push({ begin: at, end: stuck ? at : at + step, where: at, distances, distance: distances[k], bound: stuck ? 0 : step * this.travel[k], pair, verdict: stuck ? "contact" : "free" });
      if (stuck) break;
      at += step;
    }
    return found;
  }

  samples(step) {
    const count = Math.max(1, Math.ceil(this.length / step - 1e-9));
    return Array.from({ length: count + 1 }, (_, k) => ({ s: k / count, free: Math.min(...clearances(this.at(k / count))) > -TOLERANCE }));
  }

  /** Parts of the edge in contact, as fractions, from fine sampling refined by bisection. */
  contacts() {
    const inside = (s) => Math.min(...clearances(this.at(s))) <= 0, found = [];
    const border = (a, b) => { for (let k = 0; k < 40; k++) { const c = 0.5 * (a + b); if (inside(c) === inside(a)) a = c; else b = c; } return b; };
    let begin = inside(0) ? 0 : null;
    for (let k = 1; k <= 960; k++) {
      const now = inside(k / 960);
      if (now && begin === null) begin = border((k - 1) / 960, k / 960);
      if (!now && begin !== null) { found.push([begin, border((k - 1) / 960, k / 960)]); begin = null; }
    }
    if (begin !== null) found.push([begin, 1]);
    return found;
  }
}

class EdgeLesson {
  constructor() {
    this.mode = "steps";
    this.shown = 0;
    this.cells = new Cells();
    root.classList.add("picture-panel");
    document.body.classList.add("lesson");
    viewer.editing.sleep();
    this.pressMode = choices(part(".modes"), [["steps", "Fixed steps"], ["halve", "Halving"], ["advance", "Advancing"]], (name) => this.setMode(name));
    this.pressPreset = choices(part(".presets"), data.presets.map(({ name, title }) => [name, title]), (name) => this.setPreset(name));
    this.step = part(".steps input");
    this.step.oninput = () => this.refresh();
    this.walk = part(".walk input");
    this.walk.oninput = () => { this.stop(); this.shown = Number(this.walk.value); this.refresh(); };
    const tool = (name) => part(`[data-tool=${name}]`);
    tool("back").onclick = () => this.move(-1);
    tool("next").onclick = () => this.move(1);
    tool("run").onclick = () => this.run();
    this.runButton = tool("run");
    this.square = new Square(part(".plot canvas"), (pen, unit) => this.drawEdge(pen, unit));
    this.square.cells = this.cells;
    this.bars = new Sketch(part(".bars canvas"), 0.34, (pen, unit) => this.drawBars(pen, unit));
    this.wire();
    this.frame = lookFromAbove(data.view, data.height);
    this.setPreset(data.presets[0].name);
    viewer.add("outlines", this.outlines());
    viewer.films.push(() => this.film());
    viewer.on("load", () => { viewer.add("outlines", this.outlines()); this.refresh(); });
  }

  setMode(mode) {
    this.stop();
    this.mode = mode;
    this.shown = mode === "steps" ? 0 : 1;
    this.refresh();
    this.frame(this.view());
  }

  setPreset(name) {
    // A lesson about a user's edge has only that edge.
    const preset = data.presets.find((row) => row.name === name) || data.presets[0];
    this.preset = preset.name;
    this.setEdge(preset.start, preset.goal);
    this.frame(this.view());
  }

  setEdge(q0, q1) {
    this.stop();
    this.edge = new Edge(q0, q1);
    this.inContact = this.edge.contacts();
    this.shown = this.mode === "steps" ? 0 : 1;
    this.refresh();
  }

  /** Step of the samples [rad or m]; the slider is logarithmic, from 30° to 0.1°, or in the same ratio to the range of two prismatic joints. */
  get stepSize() { return (STRAIGHT === 2 ? RANGE : 1) * (Math.PI / 180) * 30 * Math.exp((-Math.log(300) * this.step.value) / 100); }

  set stepDegrees(degrees) {
    this.step.value = (100 * Math.log(30 / degrees)) / Math.log(300);
    this.refresh();
  }

  get list() { return this.mode === "halve" ? this.edge.halved : this.edge.advanced; }

  get current() { return this.mode === "steps" || !this.shown ? null : this.list[this.shown - 1]; }

  move(by) {
    this.stop();
    this.shown = clamp(this.shown + by, 1, this.list.length);
    this.refresh();
  }

  /** Time for each interval [ms]. */
  get pace() { return clamp(9000 / this.list.length, 60, 700); }

  /** Animation for a video: the intervals one after the other. */
  film() {
    if (this.mode === "steps") return null;
    const show = (t) => { this.shown = clamp(Math.floor((1000 * t) / this.pace) + 1, 1, this.list.length); this.refresh(); };
    return { start: 0, end: (this.pace * this.list.length) / 1000, show };
  }

  run() {
    if (this.timer) { this.stop(); return; }
    if (reducedMotion()) { this.shown = this.list.length; this.refresh(); return; }
    if (this.shown >= this.list.length) this.shown = 0;
    const { pace } = this;
    const tick = () => {
      this.shown += 1;
      if (this.shown >= this.list.length) this.stop();
      this.refresh();
    };
    this.timer = setInterval(tick, pace);
    tick();
    this.runButton.textContent = "Pause";
  }

  stop() {
    clearInterval(this.timer);
    this.timer = null;
    this.runButton.textContent = "Run";
  }

  wire() {
    const { canvas } = this.square;
    let held = null;
    const grip = (event) => {
      const place = (q) => this.square.of(q), box = canvas.getBoundingClientRect(), k = this.square.ratio;
      const far = [this.edge.q0, this.edge.q1].map((q) => Math.hypot(place(q)[0] - (event.clientX - box.left) * k, place(q)[1] - (event.clientY - box.top) * k));
      const nearest = far[0] <= far[1] ? 0 : 1;
      return far[nearest] < 22 * this.square.unit ? nearest : null;
    };
    const put = (end, q) => {
      const ends = [this.edge.q0, this.edge.q1];
      ends[end] = q.map((v, axis) => clamp(v, data.low[axis], data.high[axis]));
      this.preset = null;
      this.setEdge(...ends);
    };
    canvas.addEventListener("pointerdown", (event) => {
      held = grip(event);
      if (held !== null) canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (held !== null) put(held, this.square.under(event));
      else canvas.style.cursor = grip(event) === null ? "" : "move";
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
    viewer.keys.arrows("Edge", "In the picture: move the end of the edge; with Shift its begin", canvas, (by, event) => {
      const end = event.shiftKey ? 0 : 1;
      put(end, (end ? this.edge.q1 : this.edge.q0).map((v, axis) => v + (by[axis] * Math.PI) / 180));
    });
    const walks = () => this.mode !== "steps";
    viewer.keys.add("Edge", [
      { keys: [" ", "x"], text: "Run through the intervals, or pause", when: walks, act: () => this.run() },
      { keys: [",", "."], text: "One interval back or on", when: walks, act: ({ key }) => this.move(key === "." ? 1 : -1) },
    ]);
  }

  refresh() {
    const fixed = this.mode === "steps";
    this.pressMode(this.mode);
    this.pressPreset(this.preset);
    part(".steps").hidden = !fixed;
    part(".walk").hidden = fixed;
    if (fixed) {
      this.samples = this.edge.samples(this.stepSize);
      showValue(this.step, part(".steps output"), extent(this.stepSize));
    } else {
      Object.assign(this.walk, { min: 0, max: this.list.length, value: this.shown });
      showValue(this.walk, part(".walk output"), `${this.shown} / ${this.list.length}`);
    }
    this.pose();
    this.say();
    this.square.redraw();
    this.bars.redraw();
  }

  /** The arm at the checked configuration, with the region that it may sweep. */
  pose() {
    const { current, edge } = this;
    const hit = this.mode === "steps" ? this.samples.find((sample) => !sample.free) : null;
    const at = current ? current.where : hit ? hit.s : this.inContact.length ? 0.5 * (this.inContact[0][0] + this.inContact[0][1]) : 0.5;
    viewer.setQ(withColumns(viewer.q, data.columns, edge.at(at)));
    viewer.add("sweep", current ? this.sweep(current) : this.ghosts());
  }

  flat(outline, T, color, opacity, height) {
    const { THREE } = viewer, { points, radius } = movedOutline(outline, T), shape = new THREE.Shape();
    const rim = points.length < 3 ? points : points.slice();
    // Around each corner an arc: the hull of discs.
    const all = rim.flatMap(([x, y]) => Array.from({ length: 40 }, (_, k) => [x + radius * Math.cos((k * Math.PI) / 20), y + radius * Math.sin((k * Math.PI) / 20)]));
    convexHull(all).forEach(([x, y], k) => (k ? shape.lineTo(x, y) : shape.moveTo(x, y)));
    const mesh = new THREE.Mesh(new THREE.ShapeGeometry(shape), new THREE.MeshBasicMaterial({ color, opacity, transparent: true, depthWrite: false, depthTest: false, side: THREE.DoubleSide }));
    mesh.position.z = height;
    mesh.renderOrder = 6;
    return mesh;
  }

  /** The obstacles' outlines, so that a thin plate is visible from above. */
  outlines() {
    const { THREE } = viewer, group = new THREE.Group();
    for (const [name, parts] of Object.entries(data.outlines)) {
      const layer = data.layers.find((row) => row.name === name);
      if (layer) for (const outline of parts) group.add(this.flat({ ...outline, radius: outline.radius + 0.002 * WIDTH }, null, layer.color, 1, data.height));
    }
    return group;
  }

  /** The region that the links can reach in the interval, whatever their path: the links, widened by the bound. */
  sweep(interval) {
    const { THREE } = viewer, group = new THREE.Group(), color = { free: FREE, halved: OPEN, contact: TOUCH }[interval.verdict];
    for (const outline of this.swept(interval)) group.add(this.flat(outline, null, color, 0.24, data.height));
    return group;
  }

  /** The outlines of that region, one for each part of a link. */
  swept(interval) {
    const half = Math.max(interval.where - interval.begin, interval.end - interval.where);
    const poses = viewer.poses(withColumns(viewer.q, data.columns, this.edge.at(interval.where))), firstPairs = new Map(data.pairs.map(({ a }, k) => [a, k]).reverse());
    return [...firstPairs].flatMap(([link, k]) => data.outlines[link].map((outline) => (
      movedOutline({ ...outline, radius: outline.radius + Math.min(half * this.edge.travel[k], 0.8 * WIDTH) }, poses[link]))));
  }

  /** The part of the plane with the reach of the arm and the region of the longest interval that is proven free. */
  view() {
    const free = this.mode === "steps" ? [] : this.list.filter(({ verdict }) => verdict === "free").sort((a, b) => b.bound - a.bound);
    const corners = free.slice(0, 1).flatMap((interval) => this.swept(interval)).flatMap(({ points, radius }) => points.flatMap(([x, y]) => [[x - radius, y - radius], [x + radius, y + radius]]));
    return [Math.min, Math.max].map((most, k) => [0, 1].map((axis) => most(data.view[k][axis], ...corners.map((corner) => corner[axis]))));
  }

  /** The arm at every sample of a fixed step. */
  ghosts() {
    const { THREE } = viewer, group = new THREE.Group(), every = Math.ceil(this.samples.length / 120);
    this.samples.forEach(({ s, free }, k) => {
      if (k % every && free) return;
      const poses = viewer.poses(withColumns(viewer.q, data.columns, this.edge.at(s)));
      for (const link of Object.keys(data.outlines)) {
        if (poses[link]) for (const outline of data.outlines[link]) group.add(this.flat(outline, poses[link], free ? BLUE : TOUCH, free ? 0.2 : 0.5, data.height));
      }
    });
    return group;
  }

  say() {
    const { current } = this, put = (words, tone) => showVerdict(words, tone, Boolean(this.timer));
    if (this.mode === "steps") { put(...this.stepWords()); return; }
    if (!current) { put("Nothing has been looked at yet.", "open"); return; }
    const names = `${current.pair.a.split("/").pop()} and ${current.pair.b.split("/").pop()}`;
    const last = this.shown === this.list.length, share = `${(100 * current.begin).toFixed(1)} to ${(100 * current.end).toFixed(1)} %`;
    if (current.verdict === "contact") put(`Contact at ${(100 * current.where).toFixed(2)} % of the edge: ${names}. The edge is not free, and this configuration shows it.`, "bad");
    else if (current.verdict === "free") {
      const all = last ? ` All is proven: the edge is free, after ${this.list.length} ${this.list.length === 1 ? "distance" : "distances"}.` : "";
      put(`${share}: distance ${readable(current.distance)} between ${names}, which approach each other by ${readable(current.bound)} at most. Proven free.${all}`, "good");
    } else put(`${share}: distance ${readable(current.distance)} between ${names}, which might approach each other by ${readable(current.bound)}. Not proven, so the interval is halved.`, "open");
  }

  stepWords() {
    const { samples, edge, inContact } = this, hits = samples.filter((sample) => !sample.free).length;
    const count = `${samples.length} samples`;
    if (hits) return [`${count}, ${hits} of them in contact: the edge is not free. This time a sample fell into the gap.`, "bad"];
    if (!inContact.length) return [`${count}, all free. The edge is free indeed, but samples do not prove it.`, "open"];
    const widest = Math.max(...inContact.map(([a, b]) => b - a)) * edge.length;
    return [`${count}, all free, and the edge is taken for free. It is not: over ${extent(widest)} of its ${extent(edge.length)} the arm is in contact. Only a step of ${extent(widest)} or less is sure to find that.`, "bad"];
  }

  drawEdge(pen, unit) {
    const { edge, square } = this;
    pen.lineCap = "round";
    const line = (a, b, color, width) => {
      Object.assign(pen, { strokeStyle: color, lineWidth: width * unit });
      square.line([edge.at(a), edge.at(b)]);
    };
    line(0, 1, "#fff", 6);
    line(0, 1, INK, 2);
    if (this.mode === "steps") this.drawSamples(pen, unit);
    else this.drawIntervals(pen, unit, line);
    [edge.q0, edge.q1].forEach((q, end) => {
      const [x, y] = square.of(q);
      disc(pen, x, y, 8 * unit, end ? GOAL : START, "#fff", 2.5 * unit);
      square.write(end ? "end" : "begin", x, y - 17 * unit, { color: end ? GOAL : START, align: x < square.plot.x + 40 * unit ? "left" : x > square.plot.x + square.plot.size - 30 * unit ? "right" : "center" });
    });
  }

  drawSamples(pen, unit) {
    const r = this.samples.length > 80 ? 2.2 : 4.5;
    for (const { s, free } of this.samples) {
      const [x, y] = this.square.of(this.edge.at(s));
      if (free) disc(pen, x, y, r * unit, BLUE, "#fff", unit);
      else rimmedCross(pen, x, y, 6 * unit, TOUCH, 3 * unit);
    }
  }

  drawIntervals(pen, unit, line) {
    const { square, edge, current } = this, seen = this.list.slice(0, this.shown);
    if (current && current.verdict !== "contact") this.drawBall(pen, unit, current);
    pen.lineCap = "butt";
    for (const { begin, end, verdict } of seen) if (verdict === "free") line(begin, end, FREE, 7);
    for (const { begin, end, verdict } of seen) {
      if (verdict !== "free") continue;
      for (const s of [begin, end]) disc(pen, ...square.of(edge.at(s)), 2.4 * unit, "#fff", FREE, 1.4 * unit);
    }
    if (!current) return;
    if (current.verdict === "halved") line(current.begin, current.end, OPEN, 7);
    const [x, y] = square.of(edge.at(current.where));
    if (current.verdict === "contact") rimmedCross(pen, x, y, 8 * unit, TOUCH, 3.6 * unit);
    else disc(pen, x, y, 5 * unit, "#fff", current.verdict === "free" ? FREE : OPEN, 3 * unit);
  }

  /** All configurations that the distances at one prove free: each pair allows sum of lever_j |dq_j| < distance. */
  drawBall(pen, unit, { where, distances, verdict }) {
    const center = this.edge.at(where), corners = [];
    for (let k = 0; k < 96; k++) {
      const angle = (k * Math.PI) / 48, [c, s] = [Math.cos(angle), Math.sin(angle)];
      const rates = data.pairs.map(({ levers }) => levers[0] * Math.abs(c) + levers[1] * Math.abs(s));
      const r = Math.min(...distances.map((d, i) => (rates[i] > 1e-12 ? d / rates[i] : Infinity)), 1.5 * RANGE);
      corners.push([center[0] + r * c, center[1] + r * s]);
    }
    pen.save();
    Object.assign(pen, { fillStyle: "rgba(20,133,90,.16)", strokeStyle: FREE, lineWidth: 1.4 * unit });
    pen.setLineDash([5 * unit, 4 * unit]);
    pen.beginPath();
    corners.forEach((q, k) => (k ? pen.lineTo(...this.square.of(q)) : pen.moveTo(...this.square.of(q))));
    pen.closePath();
    pen.fill();
    pen.stroke();
    pen.restore();
  }

  drawBars(pen, unit) {
    const { bars, edge, current } = this, { width, height } = bars.canvas;
    const left = 38 * unit, right = width - 8 * unit, top = 24 * unit, floor = height - 30 * unit;
    const most = Math.max(LEAST, 1.06 * Math.max(...edge.curve));
    const x = (s) => left + s * (right - left), y = (v) => floor - (clamp(v, 0, most) / most) * (floor - top);
    bars.font(11);
    Object.assign(pen, { fillStyle: SOFT, strokeStyle: GRID, lineWidth: bars.ratio, textBaseline: "middle", textAlign: "right" });
    const power = 10 ** Math.floor(Math.log10(most)), grid = power * (most > 5 * power ? 2 : most > 2.5 * power ? 1 : 0.5);
    for (let v = 0; v <= most; v += grid) {
      pen.beginPath(); pen.moveTo(left, y(v)); pen.lineTo(right, y(v)); pen.stroke();
      pen.fillText(`${Number((SCALE * v).toPrecision(3))}`, left - 6 * unit, y(v));
    }
    if (this.mode !== "steps") this.drawBounds(pen, unit, x, y);
    for (const [a, b] of this.inContact) {
      pen.fillStyle = TOUCH;
      pen.fillRect(x(a), floor - 3 * unit, Math.max(x(b) - x(a), 2 * unit), 6 * unit);
    }
    Object.assign(pen, { strokeStyle: INK, lineWidth: 1.8 * unit, lineJoin: "round" });
    pen.beginPath();
    edge.curve.forEach((v, k) => pen.lineTo(x(k / (edge.curve.length - 1)), y(v)));
    pen.stroke();
    if (this.mode === "steps") {
      for (const { s, free } of this.samples) {
        if (free) disc(pen, x(s), floor, (this.samples.length > 80 ? 2 : 4) * unit, BLUE, "#fff", unit);
        else rimmedCross(pen, x(s), floor, 5 * unit, TOUCH, 2.6 * unit);
      }
    } else if (current) disc(pen, x(current.where), y(current.distance), 4.5 * unit, "#fff", INK, 2.2 * unit);
    bars.write("along the edge", 0.5 * (left + right), height - 9 * unit, { color: SOFT, weight: 400, size: 11.5 });
    bars.write(`distance [${UNIT}]`, left - 20 * unit, 9 * unit, { color: INK, align: "left", size: 11.5 });
    if (this.mode !== "steps") bars.write("motion bound", right, 9 * unit, { color: current && current.verdict === "halved" ? "#9a5f00" : FREE, align: "right", size: 11.5 });
  }

  /** The bound of each interval as a box over it: proven if the distance at its middle is above the box. */
  drawBounds(pen, unit, x, y) {
    const { current } = this, floor = y(0);
    this.list.slice(0, this.shown).forEach((interval) => {
      const { begin, end, bound, verdict } = interval, now = interval === current;
      if (verdict === "contact" || (verdict === "halved" && !now)) return;
      const color = verdict === "free" ? FREE : OPEN;
      pen.globalAlpha = now ? 0.5 : 0.26;
      pen.fillStyle = color;
      if (this.mode === "advance") {
        // Bound on the motion of the links since the start of the step.
        pen.beginPath(); pen.moveTo(x(begin), floor); pen.lineTo(x(end), y(bound)); pen.lineTo(x(end), floor); pen.fill();
      } else pen.fillRect(x(begin), y(bound), Math.max(1, x(end) - x(begin)), floor - y(bound));
      pen.globalAlpha = 1;
      Object.assign(pen, { strokeStyle: color, lineWidth: (now ? 2.4 : 1) * unit });
      pen.setLineDash(verdict === "free" ? [] : [5 * unit, 4 * unit]);
      if (this.mode === "halve") pen.strokeRect(x(begin), y(bound), x(end) - x(begin), floor - y(bound));
      pen.setLineDash([]);
    });
  }
}

/** A distance [m] in the unit for arms of this size. */
function readable(distance) { return `${(SCALE * distance).toFixed(Math.abs(SCALE * distance) < 1 ? 2 : 1)} ${UNIT}`.replace("-", "−"); }

/** A length in configuration space: degrees if both joints turn, a distance if both slide, else without a unit. */
function extent(length) {
  if (STRAIGHT === 2) return readable(length);
  const [scale, unit] = STRAIGHT ? [1, ""] : [180 / Math.PI, "°"];
  return `${(scale * length).toFixed(scale * length < 1 ? 2 : 1)}${unit}`;
}

/** Corners of the convex hull, counter-clockwise (Andrew's monotone chain). */
function convexHull(points) {
  const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (list) => {
    const out = [];
    for (const p of list) {
      while (out.length > 1) {
        const [a, b] = out.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        out.pop();
      }
      out.push(p);
    }
    return out.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

viewer.edge = new EdgeLesson();
