// A recorded search, step by step: in the configuration space, in the workspace and in numbers. On the page it is
// RR1.search:
//
//   search.choose({planner, step, bias})   show another search; omitted options keep their values, or the nearest available
//   search.go(k)                           show the first k steps;  search.at, search.length
//   search.play()                          grow from the beginning, or stop

const DASHES = { Dijkstra: [2, 2], "A*": [], RRT: [7, 2.5], "RRT-Connect": [7, 2, 2, 2], "RRT*": [], PRM: [4, 1.5] };
const [SAMPLE, BLOCKED, REFUSED, VERTEX, EDGE, PARENT, CLOSED] = data.kinds.map((_, k) => k);
const rough = (number) => (number >= 10000 ? `${Math.round(number / 1000)}k` : `${number}`);
const part = (selector) => root.querySelector(selector);
/** The length of a path, with its unit. */
const measured = (v) => `${placed(v, 2 * data.scale, 2)}${data.unit}`;

class Search extends Walk {
  constructor() {
    super();
    this.space = viewer.lesson;
    this.planners = Object.keys(data.colors);
    this.records = data.variants.map((row) => ({ ...row, ...unpacked(row) }));
    this.wire();
    this.space.chart.overlays.push((pen) => this.draw(pen));
    this.choose({ planner: "RRT", bias: 0.05 });
    viewer.on("load", () => this.place());
    viewer.on("change", () => { if (this.playing && viewer.origin !== "search") this.stop(); });
    viewer.films.push(() => ({ start: 0, end: this.length / this.rate, show: (t) => this.go(Math.round(t * this.rate)) }));
    onResize(part(".race"), () => this.drawRace());
  }

  // ---- controls ----------------------------------------------------------------------------

  wire() {
    for (const planner of this.planners) {
      const chip = element("button", undefined, "chip"), line = element("canvas");
      chip.dataset.planner = planner;
      Object.assign(line, { width: 68, height: 28 });
      const pen = line.getContext("2d");
      Object.assign(pen, { strokeStyle: data.colors[planner], lineWidth: 10 });
      pen.setLineDash(DASHES[planner].map((d) => 3 * d));
      pen.beginPath(); pen.moveTo(0, 14); pen.lineTo(68, 14); pen.stroke();
      chip.append(line, planner);
      chip.onclick = () => this.choose({ planner, step: data.usual[planner], bias: 0.05 });
      part(".planners").append(chip);
    }
    part(".play").onclick = () => this.play();
    for (const button of root.querySelectorAll("[data-move]")) button.onclick = () => this.walk(Number(button.dataset.move));
    part(".at").oninput = () => { this.stop(); this.go(Number(part(".at").value)); };
    part(".step").oninput = () => this.choose({ step: this.steps[Number(part(".step").value)] });
    part(".bias").oninput = () => this.choose({ bias: this.biases[Number(part(".bias").value)] });
    viewer.keys.add("Search", [
      { keys: [" ", "p"], text: "Grow the search, or pause", act: () => this.play() },
      { keys: [",", "."], text: "One step back or on", act: ({ key }) => this.walk(key === "." ? 1 : -1) },
    ]);
  }

  choose(wish) {
    this.stop();
    const { planner, step, bias } = { planner: this.record?.planner, step: this.record?.step, bias: this.record?.bias, ...wish };
    const own = this.records.filter((r) => r.planner === planner);
    this.steps = [...new Set(own.map((r) => r.step))].sort((a, b) => a - b);
    const nearest = this.steps.reduce((a, b) => (Math.abs(b - (step ?? data.usual[planner])) < Math.abs(a - (step ?? data.usual[planner])) ? b : a));
    const same = own.filter((r) => r.step === nearest);
    this.biases = same.map((r) => r.bias).filter((b) => b !== null).sort((a, b) => a - b);
    this.record = same.find((r) => r.bias === bias) || same.find((r) => r.bias === 0.05) || same[0];
    for (const chip of part(".planners").children) chip.setAttribute("aria-pressed", String(chip.dataset.planner === planner));
    this.fill(".step", this.steps, nearest, `${Number(placed(nearest, 2 * data.scale, 2))}${data.unit}`);
    this.fill(".bias", this.biases, this.record.bias, this.biases.length ? `${Math.round(100 * this.record.bias)} %` : "none");
    part(".at").max = this.length;
    this.place();
    this.go(this.length);
  }

  fill(name, values, value, text) {
    const slider = part(name);
    Object.assign(slider, { max: Math.max(values.length - 1, 0), value: Math.max(values.indexOf(value), 0), disabled: values.length < 2 });
    slider.parentElement.classList.toggle("off", values.length < 2);
    showValue(slider, slider.parentElement.querySelector("output"), text);
  }

  get length() { return this.record.ends.length; }

  /** Steps per second: all of them in nine seconds, or less. */
  get rate() { return Math.max(12, this.length / 9); }

  get verb() { return "Grow"; }

  // ---- the state after k steps ----------------------------------------------------------------

  go(k) {
    const { record } = this;
    this.at = k;
    this.state = stateOf(record, k);
    const slider = part(".at");
    slider.value = k;
    showValue(slider, part(".count"), `${k} / ${this.length}`);
    const numbers = {
      vertices: this.state.count,
      checks: k ? record.checks[k - 1] : 0,
      rejected: this.state.rejected.length,
      cost: k && record.costs[k - 1] !== null ? measured(record.costs[k - 1]) : "–",
    };
    for (const [name, value] of Object.entries(numbers)) part(`[data-of=${name}]`).textContent = typeof value === "number" ? rough(value) : value;
    announce(part(".said"), this.say(), this.playing && k < this.length);
    if (this.state.focus) viewer.setQ(withColumns(viewer.q, viewer.panelData.cspace.columns, this.state.focus), "search");
    this.drawSpace();
    this.space.chart.draw();
    this.drawRace();
  }

  /** A sentence about the latest step. */
  say() {
    const { record, at } = this, { newest } = this.state;
    if (!at) return "Nothing has been examined yet.";
    const count = (kind) => newest.filter((e) => e.kind === kind).length;
    const words = [];
    if (count(CLOSED)) words.push(`closes vertex ${newest.find((e) => e.kind === CLOSED).vertex}`);
    if (count(BLOCKED)) words.push("sample rejected: it is in collision");
    else if (count(SAMPLE)) words.push("sample drawn");
    if (count(VERTEX)) words.push(count(VERTEX) > 1 ? `${count(VERTEX)} new vertices` : "one new vertex");
    if (count(EDGE)) words.push(`${count(EDGE)} new edges`);
    if (count(PARENT)) words.push(`${count(PARENT)} cheaper by a new parent`);
    if (count(REFUSED)) words.push(count(REFUSED) > 1 ? `${count(REFUSED)} edges rejected` : "edge rejected: not free");
    const path = record.paths.find((p) => p.step === at - 1);
    if (path) words.push(`path of ${measured(record.costs[at - 1])}`);
    return `Step ${at}: ${words.join(", ") || "nothing new"}.`;
  }

  // ---- the configuration space ----------------------------------------------------------------

  draw(pen) {
    if (!this.state) return;
    const { record, state, space: { chart } } = this, { unit } = chart, color = data.colors[record.planner];
    const dense = state.count > 500, line = (a, b) => chart.trace(pen, [a, chart.near(a, b)]);
    pen.save();
    pen.lineCap = "round";
    pen.lineWidth = (dense ? 0.8 : 1.3) * unit;
    for (const [a, b] of state.edges) {
      pen.strokeStyle = record.sides[b] ? "#14855a" : color;
      line(record.vertices[a], record.vertices[b]);
    }
    for (let v = 0; v < state.count; v++) {
      // Open vertices of a lattice are hollow, closed ones filled.
      const isOpen = state.closed && !state.closed.has(v);
      chart.around(chart.shares(record.vertices[v]), (x, y) => {
        if (isOpen) disc(pen, x, y, 1.7 * unit, "#fff", color, pen.lineWidth);
        else disc(pen, x, y, (dense ? 1.3 : 1.9) * unit, record.sides[v] ? "#14855a" : color);
      });
    }
    pen.strokeStyle = "rgba(27, 36, 48, .5)";
    pen.lineWidth = unit;
    for (const q of state.rejected) chart.around(chart.shares(q), (x, y) => cross(pen, x, y, (dense ? 1.6 : 2.4) * unit));
    for (const path of [state.path].filter(Boolean)) {
      pen.lineJoin = "round";
      pen.strokeStyle = "#fff"; pen.lineWidth = 6 * unit; chart.trace(pen, path);
      pen.strokeStyle = INK; pen.lineWidth = 3 * unit; chart.trace(pen, path);
    }
    if (this.at < this.length || !state.path) this.drawNewest(pen, line);
    pen.restore();
  }

  /** The latest step: its sample, its edges, and rejected ones. */
  drawNewest(pen, line) {
    const { record, state, space: { chart } } = this, { unit } = chart;
    for (const event of state.newest) {
      const rejected = event.kind === REFUSED;
      pen.strokeStyle = pen.fillStyle = rejected ? INK : ACCENT;
      pen.lineWidth = 2.6 * unit;
      pen.setLineDash(rejected ? [3 * unit, 3 * unit] : []);
      if (rejected) line(record.vertices[event.vertex], event.point);
      else if ([VERTEX, EDGE, PARENT].includes(event.kind) && event.parent >= 0) line(record.vertices[event.parent], record.vertices[event.vertex]);
      pen.setLineDash([]);
      if (event.kind === SAMPLE) chart.around(chart.shares(event.point), (x, y) => plus(pen, x, y, 6 * unit));
      if (rejected || event.kind === BLOCKED) { pen.strokeStyle = INK; chart.around(chart.shares(event.point), (x, y) => cross(pen, x, y, 5.5 * unit)); }
    }
  }

  // ---- the workspace --------------------------------------------------------------------------

  /** The tool positions of this search, drawn up to the current step. */
  place() {
    const { THREE } = viewer, { record } = this, group = new THREE.Group(), color = new THREE.Color(data.colors[record.planner]).convertSRGBToLinear();
    const points = (count, style) => {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * Math.max(count, 1)), 3));
      const cloud = new THREE.Points(geometry, new THREE.PointsMaterial({ sizeAttenuation: false, transparent: true, depthTest: false, ...style }));
      cloud.frustumCulled = false;
      cloud.renderOrder = 6;
      group.add(cloud);
      return cloud;
    };
    this.clouds = {
      vertices: points(record.vertices.length, { size: record.vertices.length > 500 ? 4 : 6, color, map: sprite(THREE, (pen) => { pen.arc(16, 16, 14, 0, 7); pen.fill(); }) }),
      rejected: points(record.points.length, { size: 7, color: 0x0a0d12, map: sprite(THREE, (pen) => cross(pen, 16, 16, 11)), opacity: 0.6 }),
    };
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * 20000), 3));
    this.clouds.edges = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color, transparent: true, opacity: 0.6, depthTest: false }));
    this.clouds.edges.frustumCulled = false;
    this.clouds.edges.renderOrder = 5;
    group.add(this.clouds.edges);
    viewer.add("search", group);
  }

  drawSpace() {
    const { record, state, clouds } = this;
    const fill = (cloud, rows) => {
      const { position } = cloud.geometry.attributes;
      rows.forEach((row, k) => position.array.set(row, 3 * k));
      position.needsUpdate = true;
      cloud.geometry.setDrawRange(0, rows.length);
    };
    fill(clouds.vertices, record.vertexTools.slice(0, state.count));
    fill(clouds.rejected, state.rejectedTools);
    fill(clouds.edges, state.edges.slice(0, 20000).flatMap(([a, b]) => [record.vertexTools[a], record.vertexTools[b]]));
    viewer.redraw();
  }

  // ---- the race ---------------------------------------------------------------------------------

  /** Length of the best path over the edges checked, for every planner with its default options and for this search. */
  drawRace() {
    const canvas = part(".race"), large = magnification(), ratio = fineness() * large, wide = canvas.clientWidth / large, high = canvas.clientHeight / large;
    if (!wide) return;
    Object.assign(canvas, { width: wide * ratio, height: high * ratio });
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const best = this.planners.map((planner) => this.usual(planner)).filter((r) => r !== this.record && r.paths.length);
    const shown = [...best, this.record];
    const costs = shown.flatMap((r) => r.costs.filter((c) => c !== null));
    const most = Math.max(...shown.map((r) => r.checks[r.checks.length - 1])), low = Math.min(...costs, 1e9), top = Math.max(...costs, low + 0.1 * data.scale);
    pen.font = `11px ${FONT}`;
    const marks = (costs.length ? [low, top] : []).map((c) => [c, placed(c, 2 * data.scale, 1)]);
    const left = Math.max(44, ...marks.map(([, text]) => pen.measureText(text).width + 9)), right = wide - 10, up = 18, down = high - 30, least = 20;
    const x = (n) => left + ((right - left) * Math.log(Math.max(n, least) / least)) / Math.log(most / least);
    const y = (c) => down - ((down - up) * (c - low)) / (top - low || 1);
    pen.fillStyle = SOFT;
    pen.strokeStyle = "#d5dae1";
    for (const n of [30, 100, 300, 1000, 3000, 10000].filter((n) => n <= most)) {
      pen.beginPath(); pen.moveTo(x(n), up); pen.lineTo(x(n), down); pen.stroke();
      pen.textAlign = "center"; pen.fillText(rough(n), x(n), down + 13);
    }
    if (!costs.length) { pen.textAlign = "center"; pen.fillText("no path found", (left + right) / 2, (up + down) / 2); }
    pen.textAlign = "right";
    for (const [c, text] of marks) pen.fillText(text, left - 5, y(c) + 4);
    pen.textAlign = "left"; pen.fillText(`length of the best path${data.unit && ` [${data.unit.trim()}]`}`, left, 11);
    pen.textAlign = "right"; pen.fillText("edges checked", right, high - 4);
    for (const r of shown) {
      const own = r === this.record, end = own ? this.at : r.checks.length, first = r.costs.findIndex((c) => c !== null);
      pen.strokeStyle = data.colors[r.planner];
      pen.globalAlpha = own ? 1 : 0.55;
      pen.lineWidth = own ? 3 : 1.8;
      if (own) disc(pen, x(end ? r.checks[end - 1] : 0), down, 4, ACCENT);
      if (first < 0 || first >= end) continue;
      pen.setLineDash(DASHES[r.planner]);
      pen.beginPath();
      pen.moveTo(x(r.checks[first]), y(r.costs[first]));
      for (let k = first + 1; k < end; k++) { pen.lineTo(x(r.checks[k]), y(r.costs[k - 1])); pen.lineTo(x(r.checks[k]), y(r.costs[k])); }
      pen.stroke();
      pen.setLineDash([]);
      disc(pen, x(r.checks[first]), y(r.costs[first]), own ? 4.5 : 3, data.colors[r.planner]);
    }
    pen.globalAlpha = 1;
  }

  usual(planner) {
    const far = (r) => Math.abs(r.step - data.usual[planner]) + (r.bias === null ? 0 : 10 * Math.abs(r.bias - 0.05));
    return this.records.filter((r) => r.planner === planner).reduce((a, b) => (far(b) < far(a) ? b : a));
  }
}

/** The columns of a record converted to rows for fast access. */
function unpacked(row) {
  const rows = (packed) => {
    const { values, shape } = viewer.unpack(packed), wide = shape[1] || 1;
    return Array.from({ length: shape[0] }, (_, k) => (wide === 1 ? values[k] : Array.from(values.subarray(wide * k, wide * (k + 1)))));
  };
  const points = rows(row.points);
  return {
    ends: rows(row.ends),
    checks: rows(row.checks),
    vertices: rows(row.vertices),
    vertexTools: rows(row.vertexTools),
    points,
    pointTools: rows(row.pointTools),
    events: rows(row.events).map(([kind, vertex, parent], k) => ({ kind, vertex: vertex - 1, parent: parent - 1, point: points[k], index: k })),
  };
}

/** The state after k steps: vertices, edges [parent, vertex], rejected points, the path, the events of the latest step. */
function stateOf(record, k) {
  const end = k ? record.ends[k - 1] : 0, begin = k > 1 ? record.ends[k - 2] : 0;
  const parents = new Map(), edges = [], rejected = [], rejectedTools = [];
  const lattice = record.planner === "Dijkstra" || record.planner === "A*", closed = lattice ? new Set() : null;
  let count = 0;
  for (const event of record.events.slice(0, end)) {
    if (event.kind === VERTEX) { count += 1; if (event.parent >= 0) parents.set(event.vertex, event.parent); }
    else if (event.kind === PARENT) parents.set(event.vertex, event.parent);
    else if (event.kind === EDGE) edges.push([event.parent, event.vertex]);
    else if (event.kind === CLOSED && closed) closed.add(event.vertex);
    else if (event.kind === REFUSED || event.kind === BLOCKED) { rejected.push(event.point); rejectedTools.push(record.pointTools[event.index]); }
  }
  for (const [vertex, parent] of parents) edges.push([parent, vertex]);
  const newest = record.events.slice(begin, end);
  const path = record.paths.filter((p) => p.step < k).pop();
  const seen = [...newest].reverse().find((e) => [VERTEX, REFUSED, BLOCKED, CLOSED].includes(e.kind));
  // Before the first step the arm is at the start, the first vertex.
  const focus = k ? seen && ([VERTEX, CLOSED].includes(seen.kind) ? record.vertices[seen.vertex] : seen.point) : record.vertices[0];
  return { count, edges, rejected, rejectedTools, closed, newest, path: path && path.points, focus };
}

function plus(pen, x, y, r) {
  pen.beginPath();
  pen.moveTo(x - r, y); pen.lineTo(x + r, y); pen.moveTo(x, y - r); pen.lineTo(x, y + r);
  pen.stroke();
}

/** A small white picture, tinted by the points' color. */
function sprite(THREE, draw) {
  const canvas = element("canvas");
  canvas.width = canvas.height = 32;
  const pen = canvas.getContext("2d");
  Object.assign(pen, { strokeStyle: "#fff", fillStyle: "#fff", lineWidth: 6 });
  pen.beginPath();
  draw(pen);
  return new THREE.CanvasTexture(canvas);
}

viewer.search = new Search();
