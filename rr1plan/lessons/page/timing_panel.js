// From a path to a motion: shortcuts, blends, the phase plane, seven phases, the cost of a jerk limit. On the page it is
// RR1.timing:
//
//   timing.show(mode)        path, shortcut, blend, plane, phases, cost
//   timing.set(knob, value)  blend, tries, velocity, acceleration, distance, speed, push, jerk
//   timing.drive()           drive the arm, or stop;  timing.at(share) puts it somewhere on its way
//   timing.duration          of the motion shown [s]

const part = (selector) => root.querySelector(selector);
// Units with a space before them: of path lengths, none if one joint turns and the other one slides, and of the first joint.
const { colors, unit, first_unit: firstUnit, distances: [usual, farthest] } = data;
/** A value with a unit and, for rates, a suffix of it. */
const measured = (text, unit, rate = "") => `${text}${unit && `${unit}${rate}`}`;
/** A length in the configuration space with its unit. */
const long = (v) => `${placed(v, 2 * data.scale, 2)}${unit}`;
const blendText = (v) => `${Number(placed(v, 2 * data.scale, 2))}${unit}`;
/** The label of an axis. */
const label = (name, unit, rate = "") => `${name}${unit && ` [${unit.trim()}${rate}]`}`;
const read = (packed) => {
  const { values, shape } = viewer.unpack(packed), wide = shape[1];
  return wide ? Array.from({ length: shape[0] }, (_, k) => Array.from(values.subarray(wide * k, wide * (k + 1)))) : Array.from(values);
};
const lengthOf = (path) => path.slice(1).reduce((sum, q, k) => sum + Math.hypot(...q.map((v, i) => v - path[k][i])), 0);
const percent = (v) => `${Math.round(100 * v)} %`;

// ---- the fastest motion along a path: see phase_plane.py --------------------------------------------

/** |q' u + q'' x| <= a as rows [a, b, c] of a u + b x <= c. */
function rowsAt(first, second, limit) {
  return first.flatMap((d, i) => [[d, second[i], limit[i]], [-d, -second[i], limit[i]]]);
}

/** The largest x >= 0 for which some u satisfies all rows a u + b x <= c. */
function largestX(rows) {
  const up = rows.filter(([a]) => a > 1e-12), down = rows.filter(([a]) => a < -1e-12);
  let best = Infinity;
  const bound = (slope, room) => { if (slope > 1e-12) best = Math.min(best, room / slope); };
  for (const [a, b, c] of up) for (const [d, e, f] of down) bound(b / a - e / d, c / a - f / d);
  for (const [a, b, c] of rows) if (Math.abs(a) <= 1e-12) bound(b, c);
  return Math.max(0, best);
}

const top = (first, limit) => Math.min(...first.map((d, i) => (limit[i] / Math.abs(d)) ** 2));

function phasePlane(grid, velocity, acceleration) {
  const n = grid.begin.length, delta = grid.begin.map((_, i) => grid.s[i + 1] - grid.s[i]);
  const rows = grid.begin.map((begin, i) => {
    const end = rowsAt(grid.end[i], grid.bend[i], acceleration).map(([a, b, c]) => [a + 2 * delta[i] * b, b, c]);
    return [...rowsAt(begin, grid.bend[i], acceleration), ...end];
  });
  const limit = grid.begin.map((begin, i) => [begin, grid.end[i]].map((first) => Math.sqrt(Math.min(largestX(rowsAt(first, grid.bend[i], acceleration)), top(first, velocity)))));
  const reach = new Float64Array(n + 1), stops = new Set(grid.stops);
  for (let i = n - 1; i >= 0; i--) {
    const more = [[2 * delta[i], 1, Math.min(reach[i + 1], top(grid.end[i], velocity))], [-2 * delta[i], -1, 0]];
    reach[i] = stops.has(i) ? 0 : Math.min(largestX([...rows[i], ...more]), top(grid.begin[i], velocity));
  }
  const x = new Float64Array(n + 1), u = new Float64Array(n), times = new Float64Array(n + 1);
  for (let i = 0; i < n; i++) {
    u[i] = Math.min(...rows[i].filter(([a]) => a > 0).map(([a, b, c]) => (c - b * x[i]) / a), (reach[i + 1] - x[i]) / (2 * delta[i]));
    x[i + 1] = Math.min(Math.max(0, x[i] + 2 * delta[i] * u[i]), reach[i + 1]);
    times[i + 1] = times[i] + (2 * delta[i]) / (Math.sqrt(x[i]) + Math.sqrt(x[i + 1]));
  }
  const small = 1e-3 * Math.max(...u.map(Math.abs)), sign = Array.from(u, (v) => (Math.abs(v) < small ? 0 : Math.sign(v)));
  const switches = sign.flatMap((v, i) => (i && v !== sign[i - 1] ? [i] : []));
  return { limit, speed: x.map(Math.sqrt), acceleration: u, sign, times, switches, duration: times[n] };
}

// ---- one joint: see seven_phases.py -------------------------------------------------------------------

function sevenPhases(h, v, a, j) {
  let [rise, up] = v * j >= a * a ? [a / j, a / j + v / a] : [Math.sqrt(v / j), 2 * Math.sqrt(v / j)];
  if (h < v * up) {
    if (h >= (2 * a ** 3) / j ** 2) [rise, up] = [a / j, 0.5 * (a / j + Math.sqrt((a / j) ** 2 + (4 * h) / a))];
    else { rise = Math.cbrt(h / (2 * j)); up = 2 * rise; }
  }
  const flat = up - 2 * rise;
  return piecewise([rise, flat, rise, Math.max(0, (h - v * up) / v), rise, flat, rise], [j, 0, -j, 0, -j, 0, j]);
}

/** Without a jerk limit: pieces of constant acceleration. */
function threePhases(h, v, a) {
  const up = h >= (v * v) / a ? v / a : Math.sqrt(h / a);
  return piecewise([up, Math.max(0, h / v - v / a), up], [0, 0, 0], [a, 0, -a]);
}

/** Pieces of constant jerk, or with `pushes` of constant acceleration, from rest. */
function piecewise(durations, jerks, pushes = null) {
  const starts = [], ends = [0];
  let state = [0, 0, 0];
  const advance = ([p, v, a], j, t) => [p + t * (v + t * (a / 2 + (t * j) / 6)), v + t * (a + (t * j) / 2), a + t * j];
  durations.forEach((t, k) => {
    if (pushes) state = [state[0], state[1], pushes[k]];
    starts.push(state);
    state = advance(state, jerks[k], t);
    ends.push(ends[k] + t);
  });
  const duration = ends[ends.length - 1];
  const at = (t) => {
    let k = 0;
    while (k < durations.length - 1 && t >= ends[k + 1]) k++;
    return [...advance(starts[k], jerks[k], Math.min(t, duration) - ends[k]), jerks[k]];
  };
  return { durations, ends, duration, at };
}

// ---- the panel ----------------------------------------------------------------------------------------

class Timing {
  constructor() {
    this.space = viewer.lesson;
    this.blends = data.blends.map((b) => ({ size: b.size, stops: b.stops, s: read(b.s), q: read(b.q), begin: read(b.begin), end: read(b.end), bend: read(b.bend) }));
    this.values = { blend: this.blends.length - 1, tries: data.shortcuts.length, velocity: 1, acceleration: 1, distance: usual, speed: data.velocity[0], push: data.acceleration[0], jerk: data.jerk };
    this.share = 0;
    this.space.chart.overlays.push((pen) => this.draw(pen));
    this.wire();
    this.show("path");
    viewer.on("change", () => { if (this.driving && viewer.origin !== "timing") this.stop(); });
    viewer.films.push(() => (this.duration ? { start: 0, end: this.duration, show: (t) => this.at(t / this.duration) } : null));
    onResize(part(".chart"), () => this.drawChart());
  }

  wire() {
    part(".play").onclick = () => this.drive();
    part(".at").oninput = () => { this.stop(); this.at(Number(part(".at").value)); };
    viewer.keys.add("Motion", [
      { keys: [" ", "d"], text: "Drive the arm, or pause", when: () => this.duration > 0, act: () => this.drive() },
      { keys: [",", "."], text: "A 60th of a second back or on", when: () => this.duration > 0, act: ({ key }) => this.walk((key === "." ? 1 : -1) / 60) },
    ]);
    const chart = part(".chart");
    const point = (event) => {
      const box = chart.getBoundingClientRect();
      this.point((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    };
    chart.addEventListener("pointerdown", (event) => { chart.setPointerCapture(event.pointerId); this.stop(); point(event); });
    chart.addEventListener("pointermove", (event) => { if (event.buttons) point(event); });
  }

  get knobs() {
    const jerk = { name: "jerk", text: "j", low: 1, high: 3.2, log: true, say: (v) => measured(+v.toPrecision(2), firstUnit, "/s³") };
    const blend = { name: "blend", text: "blend", low: 0, high: this.blends.length - 1, step: 1, say: (v) => (v ? blendText(this.blends[v].size) : "stops") };
    return {
      path: [],
      shortcut: [{ name: "tries", text: "tries", low: 0, high: data.shortcuts.length, step: 1, say: (v) => `${v} / ${data.shortcuts.length}` }],
      blend: [blend],
      plane: [blend, { name: "velocity", text: "v", low: 0.2, high: 1.5, say: percent }, { name: "acceleration", text: "a", low: 0.2, high: 2, say: percent }],
      phases: [
        { name: "distance", text: "distance", low: farthest / 150, high: farthest, say: (v) => measured(placed(v, 2 * farthest, 2), firstUnit) },
        { name: "speed", text: "v", low: 0.15 * data.velocity[0], high: 2 * data.velocity[0], say: (v) => measured(v.toFixed(1), firstUnit, "/s") },
        { name: "push", text: "a", low: 0.125 * data.acceleration[0], high: 2 * data.acceleration[0], say: (v) => measured(v.toFixed(1), firstUnit, "/s²") },
        jerk,
      ],
      cost: [],
    }[this.mode];
  }

  show(mode) {
    this.stop();
    this.mode = mode;
    part(".knobs").replaceChildren(...this.knobs.map((knob) => this.makeKnob(knob)));
    part(".walk").hidden = mode === "cost";
    part(".chart").setAttribute("aria-label", { plane: "Speed over the path", phases: "Position, velocity, acceleration and jerk over time", cost: "Duration over the jerk limit" }[mode] || "Speed over time");
    this.compute();
    this.at(0);
  }

  makeKnob({ name, text, low, high, step, log, say }) {
    const label = element("label"), slider = element("input"), out = element("output");
    const value = log ? Math.log10(this.values[name]) : this.values[name];
    Object.assign(slider, { type: "range", min: low, max: high, step: step || (high - low) / 200 });
    slider.value = value;
    slider.dataset.knob = name;
    const refresh = () => showValue(slider, out, say(this.values[name]));
    slider.oninput = () => { this.values[name] = log ? 10 ** Number(slider.value) : Number(slider.value); refresh(); this.stop(); this.compute(); this.at(this.share); };
    slider.setAttribute("aria-label", name);
    label.append(text, slider, out);
    refresh();
    return label;
  }

  set(name, value) {
    this.values[name] = value;
    this.show(this.mode);
  }

  /** The displayed motion as a function q(t). */
  compute() {
    const { values } = this, grid = this.blends[this.mode === "blend" || this.mode === "plane" ? values.blend : this.blends.length - 1];
    const full = data.velocity, push = data.acceleration;
    this.grid = grid;
    this.plane = null;
    if (this.mode === "path" || this.mode === "shortcut") {
      const path = this.mode === "path" || !values.tries ? data.raw : data.shortcuts[values.tries - 1].path;
      this.path = path.filter((q, k) => !k || lengthOf([path[k - 1], q]) > 1e-6 * data.scale);
      this.motion = alongLines(this.path, full, push);
    } else if (this.mode === "blend" || this.mode === "plane") {
      const scale = this.mode === "plane" ? values : { velocity: 1, acceleration: 1 };
      this.plane = phasePlane(grid, full.map((v) => v * scale.velocity), push.map((a) => a * scale.acceleration));
      this.motion = { duration: this.plane.duration, q: (t) => positionAt(grid, this.plane, t) };
    } else if (this.mode === "phases") {
      this.seven = sevenPhases(values.distance, values.speed, values.push, values.jerk);
      this.three = threePhases(values.distance, values.speed, values.push);
      // Downward from the start, or from where the whole distance is within the limits.
      const { start, low, high, periodic } = viewer.panelData.cspace;
      const from = periodic[0] ? start[0] : clamp(start[0], low[0] + values.distance, high[0]);
      this.motion = { duration: this.seven.duration, q: (t) => [from - this.seven.at(t)[0], start[1]] };
    } else this.motion = { duration: 0, q: () => viewer.panelData.cspace.start };
    part(".said").innerHTML = this.say();
  }

  get duration() { return this.motion.duration; }

  say() {
    const { values } = this, s = (v) => `<b>${seconds(v, v)}</b>`, { durations } = data;
    if (this.mode === "path") return `${this.path.length} waypoints, ${long(lengthOf(this.path))}; with stops ${s(this.duration)}.`;
    if (this.mode === "shortcut") {
      const last = values.tries ? data.shortcuts[values.tries - 1] : null;
      return `${last ? (last.free ? "Free: taken. " : "Not free: rejected. ") : ""}${this.path.length} waypoints, ${long(lengthOf(this.path))}; with stops ${s(this.duration)}.`;
    }
    if (this.mode === "blend") return values.blend ? `Blends of at most ${blendText(this.grid.size)}: ${s(this.duration)}${this.grid.stops.length ? `, ${this.grid.stops.length} stops left` : ""}.` : `No blends, ${this.grid.stops.length} stops: ${s(this.duration)}.`;
    if (this.mode === "plane") return `${s(this.duration)}, ${this.plane.switches.length} switching points.`;
    if (this.mode === "phases") return `${this.seven.durations.filter((t) => t > 1e-9).length} phases, ${s(this.seven.duration)}; without a jerk limit ${s(this.three.duration)}, ${(this.seven.duration - this.three.duration).toFixed(3)} s less.`;
    return `Stops ${s(durations.stop)}, blends ${s(durations.blend)}, stops with jerk ≤ ${measured(data.jerk, unit, "/s³")} ${s(durations.smooth[data.jerks.indexOf(data.jerk)] ?? durations.smooth[0])}.`;
  }

  // ---- driving --------------------------------------------------------------------------------------

  drive() {
    if (this.driving) { this.stop(); return; }
    if (!this.duration) return;
    if (reducedMotion()) { this.at(1); return; }
    const from = this.share >= 1 ? 0 : this.share, began = performance.now();
    const frame = (now) => {
      this.at(Math.min(1, from + Math.max(0, now - began) / 1000 / this.duration));
      if (this.share < 1) this.driving = requestAnimationFrame(frame); else this.stop();
    };
    part(".play").textContent = "Pause";
    this.driving = requestAnimationFrame(frame);
  }

  stop() {
    cancelAnimationFrame(this.driving);
    this.driving = 0;
    part(".play").textContent = "Drive";
  }

  /** Moves the arm by some time [s], forward or back. */
  walk(by) {
    this.stop();
    this.at(clamp(this.share + by / this.duration, 0, 1));
  }

  /** Moves the arm to a share of the duration. */
  at(share) {
    this.share = share;
    const t = share * this.duration, slider = part(".at");
    slider.value = share;
    showValue(slider, part(".count"), `${seconds(t, this.duration).slice(0, -2)} / ${seconds(this.duration, this.duration)}`);
    viewer.setQ(withColumns(viewer.q, viewer.panelData.cspace.columns, this.motion.q(t)), "timing");
    this.space.chart.draw();
    this.drawChart();
  }

  /** A click in the chart moves the arm to that point. */
  point(x, y) {
    const { left, right } = this.frame || {};
    if (left === undefined || this.mode === "cost") return;
    let place = (x * part(".chart").clientWidth) / magnification() - left;
    if (this.frame.again && place > this.frame.again) place -= this.frame.again;  // two plots are side by side
    const share = clamp(place / (right - left), 0, 1);
    if (!this.plane || this.mode !== "plane") { this.at(share); return; }
    const s = share * this.grid.s[this.grid.s.length - 1], k = Math.max(0, this.grid.s.findIndex((v) => v >= s));
    this.at(this.plane.times[k] / this.duration);
  }

  // ---- the configuration space ------------------------------------------------------------------------

  draw(pen) {
    if (!this.motion) return;
    const { space: { chart }, values } = this, { unit } = chart;
    const line = (points, color, width, dash = []) => {
      pen.lineJoin = pen.lineCap = "round";
      pen.setLineDash([]); pen.strokeStyle = "rgba(255,255,255,.9)"; pen.lineWidth = (width + 2.5) * unit; chart.trace(pen, points);
      pen.setLineDash(dash.map((d) => d * unit)); pen.strokeStyle = color; pen.lineWidth = width * unit; chart.trace(pen, points);
      pen.setLineDash([]);
    };
    if (this.mode !== "phases") line(data.raw, colors.raw, this.mode === "path" ? 3 : 1.6, this.mode === "path" ? [] : [5, 4]);
    const tried = this.mode === "shortcut" && values.tries ? data.shortcuts[values.tries - 1] : null;
    if (this.mode === "shortcut") line(this.path, colors.short, 3);
    if (tried) {
      line([tried.begin, tried.end], tried.free ? ACCENT : INK, 2.4, tried.free ? [] : [2, 4]);
      for (const q of [tried.begin, tried.end]) chart.around(chart.shares(q), (x, y) => disc(pen, x, y, 4 * unit, tried.free ? ACCENT : INK));
      if (!tried.free) {
        const middle = tried.begin.map((v, i) => (v + tried.end[i]) / 2);
        Object.assign(pen, { strokeStyle: INK, lineWidth: 2.4 * unit });
        chart.around(chart.shares(middle), (x, y) => cross(pen, x, y, 6 * unit));
      }
    }
    if (["blend", "plane", "cost"].includes(this.mode)) {
      line(data.shortcuts[data.shortcuts.length - 1].path, colors.short, 1.8, [6, 4]);
      line(this.grid.q, colors.blend, 3);
    }
    const corners = { path: data.raw, shortcut: this.path }[this.mode] || [];
    const dots = (qs, color) => { for (const q of qs) chart.around(chart.shares(q), (x, y) => disc(pen, x, y, 3 * unit, color)); };
    dots(corners, this.mode === "path" ? "#5f6b7a" : colors.short);
    if (this.plane) dots(this.plane.switches.map((k) => this.grid.q[k]), INK);
  }

  // ---- the chart --------------------------------------------------------------------------------------

  drawChart() {
    const canvas = part(".chart"), large = magnification(), ratio = fineness() * large, wide = canvas.clientWidth / large, high = canvas.clientHeight / large;
    if (!wide || !this.motion) return;
    Object.assign(canvas, { width: wide * ratio, height: high * ratio });
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    pen.font = `11px ${FONT}`;
    const box = { left: 40, right: wide - 8, top: 20, bottom: high - 30 };
    this.frame = box;
    if (this.mode === "plane") this.drawPlane(pen, box);
    else if (this.mode === "phases") this.drawPhases(pen, box);
    else if (this.mode === "cost") this.drawCost(pen, box);
    else this.drawSpeeds(pen, box);
  }

  /** Axes with round ticks; returns the two scales. */
  axes(pen, { left, right, top: up, bottom }, [xLow, xHigh, xText], [yLow, yHigh, yText], more = {}) {
    const x = more.log ? (v) => left + ((right - left) * Math.log(v / xLow)) / Math.log(xHigh / xLow) : (v) => left + ((right - left) * (v - xLow)) / (xHigh - xLow || 1);
    const y = (v) => bottom - ((bottom - up) * (v - yLow)) / (yHigh - yLow || 1);
    pen.lineWidth = 1;
    pen.fillStyle = SOFT;
    pen.textAlign = "center";
    for (const v of more.log ? [10, 30, 100, 300, 1000].filter((n) => n >= xLow && n <= xHigh) : niceTicks(xLow, xHigh, more.few || 6)) {
      pen.strokeStyle = GRID; pen.beginPath(); pen.moveTo(x(v), up); pen.lineTo(x(v), bottom); pen.stroke();
      if (xText !== null) pen.fillText(`${Number(v.toPrecision(6))}`, x(v), bottom + 13);
    }
    pen.textAlign = "right";
    for (const v of niceTicks(yLow, yHigh, more.tight ? 2 : 4)) {
      pen.strokeStyle = GRID; pen.beginPath(); pen.moveTo(left, y(v)); pen.lineTo(right, y(v)); pen.stroke();
      pen.fillText(`${Number(v.toPrecision(6))}`.replace("-", "−"), left - 5, y(v) + 4, 34);
    }
    pen.textAlign = "left"; pen.fillStyle = INK; pen.fillText(yText, left + 2, up - 7);
    pen.textAlign = "right"; pen.fillStyle = SOFT; if (xText) pen.fillText(xText, right, bottom + 26);
    return [x, y];
  }

  drawPlane(pen, box) {
    const { plane, grid } = this, end = grid.s[grid.s.length - 1];
    const most = 1.08 * Math.min(Math.max(...plane.limit.flat()), 2.2 * Math.max(...plane.speed));
    box = this.legend(pen, box, [[colors.limit, [5, 3], "limit curve"], [colors.blend, [], "faster or steady"], [colors.brake, [], "slower"]]);
    const [x, y] = this.axes(pen, box, [0, end, label("s", unit)], [0, most, label("ṡ", unit, "/s")]);
    pen.save();
    pen.beginPath(); pen.rect(box.left, box.top, box.right - box.left, box.bottom - box.top); pen.clip();
    pen.beginPath(); pen.moveTo(x(0), box.top);
    plane.limit.forEach(([a, b], i) => { pen.lineTo(x(grid.s[i]), y(a)); pen.lineTo(x(grid.s[i + 1]), y(b)); });
    pen.lineTo(x(end), box.top); pen.closePath();
    pen.fillStyle = "rgba(163, 66, 143, .12)"; pen.fill();
    pen.beginPath();
    plane.limit.forEach(([a, b], i) => { pen[i ? "lineTo" : "moveTo"](x(grid.s[i]), y(a)); pen.lineTo(x(grid.s[i + 1]), y(b)); });
    pen.strokeStyle = colors.limit; pen.lineWidth = 1.6; pen.setLineDash([5, 3]); pen.stroke(); pen.setLineDash([]);
    pen.lineCap = "round";
    plane.sign.forEach((sign, i) => {
      pen.beginPath(); pen.moveTo(x(grid.s[i]), y(plane.speed[i])); pen.lineTo(x(grid.s[i + 1]), y(plane.speed[i + 1]));
      const brakes = sign < 0;
      pen.strokeStyle = brakes ? colors.brake : colors.blend; pen.lineWidth = brakes ? 2 : 3.2; pen.stroke();
    });
    for (const k of plane.switches) disc(pen, x(grid.s[k]), y(plane.speed[k]), 3, INK);
    pen.restore();
    const t = this.share * this.duration, k = indexAt(plane.times, t, grid.s.length - 2), f = (t - plane.times[k]) / (plane.times[k + 1] - plane.times[k] || 1);
    this.cursor(pen, x(grid.s[k] + f * (grid.s[k + 1] - grid.s[k])), y(plane.speed[k] + f * (plane.speed[k + 1] - plane.speed[k])), box);
  }

  drawPhases(pen, box) {
    const { seven, three } = this, end = Math.max(seven.duration, three.duration);
    const rows = [["position", ""], ["velocity", "/s"], ["acceleration", "/s²"], ["jerk", "/s³"]];
    const names = rows.map(([name, rate]) => label(name, firstUnit, rate));
    const high = (box.bottom + 18 - box.top) / 2, wide = (box.right - box.left + 40) / 2, t = this.share * seven.duration;
    names.forEach((name, k) => {
      const left = box.left + (k % 2) * wide, up = box.top + Math.floor(k / 2) * high;
      const own = { left, right: left + wide - 40, top: up + 14, bottom: up + high - 18 };
      const count = 300, times = Array.from({ length: count + 1 }, (_, i) => (end * i) / count);
      const values = times.map((v) => seven.at(v)[k]), other = k < 3 ? times.map((v) => (v <= three.duration ? three.at(v)[k] : k ? 0 : three.at(three.duration)[0])) : [];
      const low = Math.min(0, ...values, ...other), most = Math.max(...values, ...other, 1e-9), room = 0.08 * (most - low);
      const phases = seven.durations.flatMap((d, phase) => (d < 1e-9 ? [] : [phase]));
      phases.forEach((phase, count) => {
        const [a, b] = [seven.ends[phase], seven.ends[phase + 1]].map((v) => own.left + ((own.right - own.left) * v) / end);
        pen.fillStyle = count % 2 ? "#fff" : "#eef1f5"; pen.fillRect(a, own.top, b - a, own.bottom - own.top);
        if (k === 0 && b - a > 8) { pen.fillStyle = SOFT; pen.textAlign = "center"; pen.fillText(`${phase + 1}`, (a + b) / 2, own.top + 11); }
      });
      const [x, y] = this.axes(pen, own, [0, end, k > 1 ? "" : null], [low - room, most + (k ? 1 : 3) * room, ""], { tight: true, few: 3 });
      pen.fillStyle = INK; pen.textAlign = "left"; pen.fillText(name, own.left + 2, own.top - 3);
      pen.save(); pen.beginPath(); pen.rect(own.left, own.top - 2, own.right - own.left, own.bottom - own.top + 4); pen.clip();
      const curve = (points) => { pen.beginPath(); points.forEach((v, i) => pen[i ? "lineTo" : "moveTo"](x(times[i]), y(v))); pen.stroke(); };
      pen.strokeStyle = colors.raw; pen.lineWidth = 1.4; pen.setLineDash([4, 3]); if (other.length) curve(other); pen.setLineDash([]);
      pen.strokeStyle = colors.blend; pen.lineWidth = 2.2; curve(values);
      pen.restore();
      const now = seven.at(t)[k];
      disc(pen, x(t), y(now), 3.5, ACCENT);
    });
    const phase = seven.durations.findIndex((d, k) => d > 1e-9 && t <= seven.ends[k + 1] + 1e-9);
    pen.fillStyle = INK; pen.textAlign = "left"; pen.fillText(`phase ${phase + 1}: ${data.phases[Math.max(phase, 0)]}`, box.left + 2, 12);
    pen.textAlign = "right"; pen.fillStyle = SOFT; pen.fillText("t [s]", box.right, box.bottom + 26);
    this.frame = { ...box, right: box.left + ((wide - 40) * seven.duration) / end, again: wide };
  }

  drawCost(pen, box) {
    const { durations, jerks } = data, most = 1.08 * Math.max(...durations.smooth);
    const [x, y] = this.axes(pen, box, [jerks[0] * 0.9, jerks[jerks.length - 1] * 1.1, label("jerk limit", unit, "/s³")], [0, most, "duration [s]"], { log: true });
    const flat = (v, color, dash) => { pen.strokeStyle = color; pen.lineWidth = 2; pen.setLineDash(dash); pen.beginPath(); pen.moveTo(box.left, y(v)); pen.lineTo(box.right, y(v)); pen.stroke(); pen.setLineDash([]); };
    flat(durations.stop, INK, [6, 4]);
    flat(durations.blend, colors.blend, [8, 3, 2, 3]);
    pen.strokeStyle = colors.short; pen.lineWidth = 2.4;
    pen.beginPath(); jerks.forEach((j, k) => pen[k ? "lineTo" : "moveTo"](x(j), y(durations.smooth[k]))); pen.stroke();
    jerks.forEach((j, k) => disc(pen, x(j), y(durations.smooth[k]), 4, colors.short));
    pen.textAlign = "center"; pen.fillStyle = INK;
    jerks.forEach((j, k) => { if (k % 2 === 0) pen.fillText(durations.smooth[k].toFixed(2), Math.max(x(j), box.left + 14), y(durations.smooth[k]) - 9); });
    const rows = [[colors.short, [], "stops, jerk limit"], [INK, [6, 4], "stops, no jerk limit"], [colors.blend, [8, 3, 2, 3], "blends, no jerk limit"]];
    // Below all lines, or at the top if one is there.
    const first = y(durations.blend) > box.bottom - 56 ? box.top + 12 : box.bottom - 42;
    rows.forEach((row, k) => this.legendRow(pen, box.right, first + 16 * k, [row]));
  }

  /** Speeds of both joints over time. */
  drawSpeeds(pen, box) {
    const count = 240, { duration } = this, step = duration / count, times = Array.from({ length: count }, (_, i) => (i + 0.5) * step);
    const speeds = times.map((t) => this.motion.q(t + 0.5 * step).map((v, i) => (v - this.motion.q(t - 0.5 * step)[i]) / step));
    const most = 1.15 * Math.min(Math.max(...data.velocity), 2 * Math.max(...speeds.flat().map(Math.abs)));
    box = this.legend(pen, box, [[colors.blend, [], "joint 1"], [colors.short, [5, 3], "joint 2"]]);
    const [x, y] = this.axes(pen, box, [0, duration, "t [s]"], [-most, most, label("joint velocities", unit, "/s")]);
    [[colors.blend, []], [colors.short, [5, 3]]].forEach(([color, dash], joint) => {
      pen.strokeStyle = color; pen.lineWidth = 2; pen.setLineDash(dash); pen.beginPath();
      speeds.forEach((v, i) => pen[i ? "lineTo" : "moveTo"](x(times[i]), y(v[joint]))); pen.stroke(); pen.setLineDash([]);
    });
    const t = this.share * duration, now = speeds[Math.min(Math.floor(t / step), count - 1)];
    this.cursor(pen, x(t), y(now[0]), box);
  }

  cursor(pen, x, y, { top: up, bottom }) {
    pen.strokeStyle = "rgba(228, 80, 14, .55)"; pen.lineWidth = 1; pen.beginPath(); pen.moveTo(x, up); pen.lineTo(x, bottom); pen.stroke();
    disc(pen, x, y, 6, "#fff");
    disc(pen, x, y, 4.2, ACCENT);
  }

  /** Legend of the lines, at the top right; returns the box that it leaves for the chart. */
  legend(pen, box, rows) {
    const wide = rows.reduce((sum, [, , text]) => sum + pen.measureText(text).width + 57, 0), isBeside = wide <= box.right - box.left - 130;
    this.legendRow(pen, box.right, isBeside ? box.top - 7 : 10, rows);
    // Without room beside the title of the axis, the legend has a separate row above it.
    return isBeside ? box : { ...box, top: box.top + 14 };
  }

  /** One line of a legend, which ends at the right. */
  legendRow(pen, right, baseline, rows) {
    let x = right;
    pen.textAlign = "right";
    for (const [color, dash, text] of [...rows].reverse()) {
      pen.fillStyle = INK; pen.fillText(text, x, baseline);
      x -= pen.measureText(text).width + 4;
      pen.strokeStyle = color; pen.lineWidth = 2.6; pen.setLineDash(dash);
      pen.beginPath(); pen.moveTo(x - 18, baseline - 4); pen.lineTo(x, baseline - 4); pen.stroke(); pen.setLineDash([]);
      x -= 27;
    }
  }
}

/** The position of a phase-plane motion at a time. */
function positionAt(grid, plane, t) {
  const k = indexAt(plane.times, t, grid.s.length - 2), h = Math.min(t, plane.duration) - plane.times[k];
  const s = h * (plane.speed[k] + 0.5 * h * plane.acceleration[k]);
  return grid.q[k].map((v, i) => v + s * (grid.begin[k][i] + 0.5 * s * grid.bend[k][i]));
}

/** A motion along straight lines with a stop at every waypoint. */
function alongLines(path, velocity, acceleration) {
  const lines = path.slice(1).map((q, k) => {
    const long = lengthOf([path[k], q]), way = q.map((v, i) => (v - path[k][i]) / long);
    const limit = (row) => Math.min(...way.map((d, i) => row[i] / Math.max(Math.abs(d), 1e-12)));
    return { from: path[k], way, motion: threePhases(long, limit(velocity), limit(acceleration)) };
  });
  const ends = [0];
  for (const line of lines) ends.push(ends[ends.length - 1] + line.motion.duration);
  const duration = ends[ends.length - 1];
  return { duration, q: (t) => {
    const k = indexAt(ends, t, lines.length - 1), line = lines[k];
    const s = line.motion.at(clamp(t - ends[k], 0, line.motion.duration))[0];
    return line.from.map((v, i) => v + s * line.way[i]);
  } };
}

viewer.timing = new Timing();
