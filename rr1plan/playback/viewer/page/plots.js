// The card of curves under the scene: joints against their limits, torques, clearances, tracking errors, violations.

const EDGES = { left: 50, right: 12, top: 15, bottom: 19 }; // [px]
const WIDE = 1000; // [px] width of the picture from which two curves are shown initially
/** The quantity in whose chart violations of a kind are marked across the whole height. */
const KINDS = { collision: "clearance", undecided: "clearance", torque: "torque", velocity: "velocity", acceleration: "acceleration", jerk: "jerk", position: "position" };

class Plots {
  constructor(viewer) {
    this.viewer = viewer;
    this.root = find("plots");
    this.open = false;
    this.charts = [];
    this.joint = null;
    this.isFirstChoice = true; // the user has not chosen other curves
    this.root.append(this.makeHead(), (this.area = element("div", undefined, "charts")), (this.legend = element("div", undefined, "legend")));
    // Keys keep their meaning on the page, except for arrows in a list.
    onResize(this.root, () => this.fit());
    viewer.on("planner", () => this.load());
    viewer.on("obstacle", () => { if (this.open) this.source.measureAgain(); else this.source.measured.clear(); });
  }

  makeHead() {
    const head = element("div", undefined, "head");
    this.armMenu = element("select");
    this.armMenu.setAttribute("aria-label", "Arm");
    this.armMenu.onchange = () => this.choose(this.arms[this.armMenu.selectedIndex]);
    this.jointMenu = element("select");
    this.jointMenu.setAttribute("aria-label", "Joint");
    this.jointMenu.onchange = () => { this.joint = this.jointMenu.value || null; this.build(); };
    this.chips = element("div", undefined, "chips");
    this.chips.setAttribute("role", "group");
    this.chips.setAttribute("aria-label", "Curves");
    this.zoom = element("button", "Fit", "chip");
    this.zoom.setAttribute("aria-pressed", "false");
    this.zoom.title = "Scale to the curves instead of to the limits";
    this.zoom.onclick = () => { this.zoomed = !this.zoomed; this.zoom.setAttribute("aria-pressed", String(this.zoomed)); this.build(); };
    const close = element("button", "×", "round");
    close.setAttribute("aria-label", "Close the plots");
    close.onclick = () => this.toggle();
    head.append(this.chips, this.armMenu, this.jointMenu, this.zoom, close);
    return head;
  }

  // ---- for each document -------------------------------------------------------------------------

  load() {
    const { viewer } = this;
    this.source = new PlotSource(viewer, () => this.takeMeasured());
    this.arms = this.source.arms();
    find("plotter").hidden = !this.arms.length;
    this.arm = this.arms.find(({ name }) => this.arm && name === this.arm.name) || this.arms[0] || null;
    this.armMenu.replaceChildren(...this.arms.map(({ name }) => element("option", name)));
    this.armMenu.hidden = this.arms.length < 2;
    if (!this.arm && this.open) this.toggle();
    if (this.open) this.choose(this.arm);
  }

  /** Opens or closes the card. */
  toggle() {
    if (!this.open && !this.arm) return;
    this.open = !this.open;
    this.root.hidden = !this.open;
    find("plotter").setAttribute("aria-pressed", String(this.open));
    if (this.open) this.choose(this.arm);
    this.fit();
  }

  choose(arm) {
    this.arm = arm;
    this.armMenu.selectedIndex = this.arms.indexOf(arm);
    this.offered = this.source.quantities(arm);
    if (!arm.robot.names.includes(this.joint)) this.joint = null;
    const options = [["", "All joints"], ...arm.robot.names.map((name) => [name, name])].map(([value, text]) => {
      const option = element("option", text);
      option.value = value;
      return option;
    });
    this.jointMenu.replaceChildren(...options);
    this.jointMenu.value = this.joint || "";
    if (this.isFirstChoice || !this.chosen.some((key) => this.offered.includes(key))) {
      this.chosen = this.firstChoice();
      this.isFirstChoice = true;
    }
    this.build();
  }

  /** Shows the clearances that the page has measured, or, while it measures them again, none. */
  takeMeasured() {
    if (!this.open) return;
    const offered = this.source.quantities(this.arm), isSame = offered.join() === this.offered.join();
    if (!isSame) { this.choose(this.arm); return; }
    for (const chart of this.charts) if (chart.key === "clearance") { chart.choose(); chart.draw(); }
  }

  /** The violated quantity, and the velocity; only one of them if there is little room. */
  firstChoice() {
    const wanted = [...this.viewer.conflicts.all.map(({ kind }) => KINDS[kind]), "velocity", "clearance", ...this.offered];
    const known = [...new Set(wanted)].filter((key) => this.offered.includes(key));
    return known.slice(0, find("stage").clientWidth >= WIDE * magnification() ? 2 : 1);
  }

  /** The chips, a chart for each chosen quantity, and the legend. */
  build() {
    const chips = this.offered.map((key) => {
      const chip = element("button", QUANTITIES[key].label, "chip");
      chip.dataset.plot = key;
      chip.setAttribute("aria-pressed", String(this.chosen.includes(key)));
      chip.onclick = () => this.switch(key);
      return chip;
    });
    const focused = this.chips.contains(document.activeElement) ? document.activeElement.dataset.plot : null;
    this.chips.replaceChildren(...chips);
    if (focused) chips.find((chip) => chip.dataset.plot === focused)?.focus();
    this.charts = this.offered.filter((key) => this.chosen.includes(key)).map((key) => new Chart(this, key));
    this.area.replaceChildren(...this.charts.map(({ root }) => root));
    this.fillLegend();
    this.fit();
  }

  switch(key) {
    const on = this.chosen.includes(key);
    this.isFirstChoice = false;
    if (on && this.charts.length === 1) return; // chosen curves that this motion does not have are not shown
    this.chosen = on ? this.chosen.filter((other) => other !== key) : [...this.chosen, key];
    this.build();
  }

  fillLegend() {
    const names = this.arm.robot.names.map((name, i) => {
      const button = element("button", undefined, "key");
      button.setAttribute("aria-pressed", String(this.joint === name));
      button.append(badge(String(i + 1), CURVES[i % CURVES.length]), element("span", name));
      button.onclick = () => { this.joint = this.joint === name ? null : name; this.jointMenu.value = this.joint || ""; this.build(); };
      button.onpointerenter = button.onfocus = () => this.emphasize(name);
      button.onpointerleave = button.onblur = () => this.emphasize(null);
      return button;
    });
    const motions = this.source.motions.filter(({ name }) => name).map(({ name, kind }) => {
      const key = element("span", undefined, "key");
      key.append(dashes(kind), element("span", name));
      return key;
    });
    this.legend.replaceChildren(...names, ...motions);
  }

  emphasize(name) {
    for (const chart of this.charts) if (chart.emphasized !== name) { chart.emphasized = name; chart.draw(); }
  }

  /** Makes room for the card, and draws its charts at its width. */
  fit() {
    const height = this.root.offsetHeight ? this.root.offsetHeight + 10 * magnification() : 0;
    if (this.open) for (const chart of this.charts) chart.fit();
    if (height === this.height) return;
    this.height = height;
    find("stage").style.setProperty("--plots", `${height}px`);
    find("stage").classList.toggle("plotting", height > 0);
    this.viewer.frame();
  }

  // ---- at each frame -----------------------------------------------------------------------------

  follow() {
    if (this.open) for (const chart of this.charts) chart.follow();
  }
}

function badge(text, color) {
  const mark = element("i", text, "number");
  mark.style.background = color;
  return mark;
}

function dashes(kind) {
  const canvas = element("canvas"), pen = canvas.getContext("2d");
  Object.assign(canvas, { width: 52, height: 8 });
  canvas.style.width = "2.6rem";
  Object.assign(pen, { strokeStyle: INK, lineWidth: 3.5 });
  pen.setLineDash(DASHES[kind].map((v) => 2 * v));
  pen.moveTo(0, 4);
  pen.lineTo(52, 4);
  pen.stroke();
  return canvas;
}

class Chart {
  constructor(plots, key) {
    const { viewer } = plots;
    Object.assign(this, { plots, viewer, key, emphasized: null });
    this.root = element("figure");
    this.said = element("output");
    this.said.setAttribute("aria-live", "off"); // it changes with the clock
    this.note = element("span", undefined, "note");
    const caption = element("figcaption");
    this.title = element("b");
    caption.append(this.title, this.note, this.said);
    this.area = element("div", undefined, "area");
    this.area.tabIndex = 0;
    this.area.setAttribute("role", "slider");
    this.area.setAttribute("aria-label", `${QUANTITIES[key].label} over time; arrow keys move the time`);
    this.back = element("canvas");
    this.front = element("canvas");
    this.area.append(this.back, this.front);
    this.root.append(caption, this.area);
    this.choose();
    this.listen();
  }

  /** The curves that are drawn, and whether they are relative to their limits. */
  choose() {
    const { plots, key } = this, { arm, joint, source, zoomed } = plots;
    const all = source.curves(arm, key), clearance = key === "clearance";
    const single = clearance || joint ? all.filter(({ name }) => clearance || name === joint) : all;
    const bounded = single.filter(({ bounds }) => bounds);
    this.relative = !clearance && !joint && bounded.length > 0 && bounded.some(({ motion }) => motion === null);
    this.curves = this.relative ? bounded : single;
    const left = this.relative ? [...new Set(single.filter(({ bounds }) => !bounds).map(({ name }) => name))] : [];
    const units = [...new Set(this.curves.map(({ unit }) => unit))];
    this.unit = this.relative ? "%" : units.join(", ");
    this.title.textContent = `${QUANTITIES[key].label}${joint && !clearance ? ` of ${joint}` : ""}`;
    const marks = clearance ? [...new Set(single.map(({ mark, name }) => `${mark} ${name}`))].join(", ") : "";
    const remarks = [this.relative ? "share of the limit" : this.unit, source.remark(key), marks, left.length ? `no limit: ${left.join(", ")}` : ""];
    this.note.textContent = this.note.title = remarks.filter(Boolean).join("; ");
    this.bounds = !this.relative && this.curves.length && (joint || clearance) ? this.curves[0].bounds : null;
    this.zoomed = zoomed;
  }

  /** A value as drawn: in its unit, or as a share of its limit, from -100 to 100 %. */
  drawn(curve, value) {
    if (!this.relative) return value;
    const [low, high] = curve.bounds;
    return (100 * (2 * value - low - high)) / (high - low);
  }

  // ---- drawing ---------------------------------------------------------------------------------

  /** Draws again at another size. Chromium prints nothing of a canvas that is drawn while it makes the sheet. */
  fit() {
    const { area, back } = this, ratio = fineness(), isDrawn = Boolean(this.box) && back.width === Math.round(area.clientWidth * ratio);
    if (!isDrawn || back.height !== Math.round(area.clientHeight * ratio)) this.draw();
  }

  draw() {
    const { clientWidth, clientHeight } = this.area, ratio = fineness(), large = magnification();
    if (!clientWidth || !clientHeight) return;
    for (const canvas of [this.back, this.front]) {
      canvas.width = Math.round(clientWidth * ratio);
      canvas.height = Math.round(clientHeight * ratio);
    }
    const width = clientWidth / large, height = clientHeight / large;
    Object.assign(this, { large, fine: ratio * large, box: { left: EDGES.left, right: width - EDGES.right, top: EDGES.top, bottom: height - EDGES.bottom } });
    const { player } = this.viewer;
    this.span = [player.start, Math.max(player.end, player.start + 1e-9)];
    const lines = this.curves.map((curve) => ({ curve, ...curve.points(width) }));
    this.range = this.rangeOf(lines);
    const pen = this.pen(this.back);
    this.drawGrid(pen);
    this.drawLimits(pen);
    pen.save();
    pen.beginPath();
    pen.rect(this.box.left, this.box.top - 2, this.box.right - this.box.left, this.box.bottom - this.box.top + 4);
    pen.clip();
    for (const line of lines) this.drawLine(pen, line);
    pen.restore();
    this.drawConflicts(pen);
    this.follow();
  }

  pen(canvas) {
    const pen = canvas.getContext("2d");
    pen.setTransform(this.fine, 0, 0, this.fine, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.font = `11px ${FONT}`;
    return pen;
  }

  x(t) {
    return this.box.left + ((t - this.span[0]) / (this.span[1] - this.span[0])) * (this.box.right - this.box.left);
  }

  y(value) {
    return this.box.bottom - ((value - this.range[0]) / (this.range[1] - this.range[0])) * (this.box.bottom - this.box.top);
  }

  rangeOf(lines) {
    let low = Infinity, high = -Infinity;
    for (const { curve, values } of lines) {
      for (const value of values) {
        const v = this.drawn(curve, value);
        if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); }
      }
    }
    if (low > high) [low, high] = [-1, 1];
    const limits = this.relative ? [-100, 100] : this.bounds || [];
    if (!this.zoomed) for (const limit of limits) if (limit !== null) { low = Math.min(low, limit); high = Math.max(high, limit); }
    const room = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1;
    return [low - room, high + room];
  }

  drawGrid(pen) {
    const { left, right, top, bottom } = this.box;
    pen.lineWidth = 1;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    const all = niceTicks(...this.range, Math.max(2, Math.min(5, (bottom - top) / 26)));
    for (const value of all) {
      const at = Math.round(this.y(value)) + 0.5;
      pen.strokeStyle = value === 0 ? "#aeb7c2" : GRID;
      pen.beginPath();
      pen.moveTo(left, at);
      pen.lineTo(right, at);
      pen.stroke();
      pen.fillStyle = SOFT;
      pen.fillText(`${shortNumber(value)}${this.relative ? " %" : ""}`, left - 6, at);
    }
    pen.textBaseline = "top";
    // Instants too close to differ in three digits, as those of a motion without duration, have one label.
    const ticks = niceTicks(...this.span, Math.max(2, (right - left) / 90)).filter((t, i, all) => !i || shortNumber(t) !== shortNumber(all[i - 1]));
    ticks.forEach((t, i) => {
      pen.strokeStyle = GRID;
      pen.beginPath();
      pen.moveTo(this.x(t), top);
      pen.lineTo(this.x(t), bottom);
      pen.stroke();
      pen.textAlign = i && this.x(t) > right - 16 ? "right" : i ? "center" : "left";
      pen.fillText(`${shortNumber(t)}${i === ticks.length - 1 ? " s" : ""}`, this.x(t), bottom + 6);
    });
  }

  /** Limits as dark lines, with the area beyond them hatched. */
  drawLimits(pen) {
    const { left, right, top, bottom } = this.box, [low, high] = this.relative ? [-100, 100] : this.bounds || [null, null];
    for (const [limit, edge] of [[low, bottom + 2], [high, top - 2]]) {
      if (limit === null || limit < this.range[0] || limit > this.range[1]) continue;
      const at = this.y(limit), from = Math.min(at, edge), height = Math.abs(edge - at);
      pen.save();
      pen.beginPath();
      pen.rect(left, from, right - left, height);
      pen.clip();
      pen.strokeStyle = "rgba(27, 36, 48, .16)";
      pen.lineWidth = 1;
      pen.beginPath();
      for (let x = left - height; x < right; x += 6) { pen.moveTo(x, from + height); pen.lineTo(x + height, from); }
      pen.stroke();
      pen.restore();
      pen.strokeStyle = INK;
      pen.lineWidth = 1.25;
      pen.beginPath();
      pen.moveTo(left, at);
      pen.lineTo(right, at);
      pen.stroke();
    }
  }

  drawLine(pen, { curve, times, values }) {
    const faint = this.emphasized !== null && curve.name !== this.emphasized && this.key !== "clearance";
    pen.strokeStyle = curve.color;
    pen.globalAlpha = faint ? 0.15 : 1;
    pen.lineWidth = curve.dash.length ? 1.5 : 1.8;
    pen.lineJoin = "round";
    pen.setLineDash(curve.dash);
    pen.beginPath();
    let drawing = false;
    for (let i = 0; i < times.length; i++) {
      const v = this.drawn(curve, values[i]);
      if (!Number.isFinite(v)) { drawing = false; continue; }
      if (drawing) pen.lineTo(this.x(times[i]), this.y(v)); else pen.moveTo(this.x(times[i]), this.y(v));
      drawing = true;
    }
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  /** A red triangle above each violation and a line across the chart of its quantity; contacts of a replay as bars. */
  drawConflicts(pen) {
    const { top, bottom } = this.box;
    pen.fillStyle = pen.strokeStyle = BAD;
    for (const conflict of this.viewer.conflicts.all) {
      const x = this.x(conflict.time);
      if (conflict.simulated) pen.fillRect(x, top - 5, Math.max(2, this.x(conflict.last) - x), 4);
      if (this.concerns(conflict)) {
        pen.lineWidth = 1.5;
        pen.beginPath();
        pen.moveTo(x, top);
        pen.lineTo(x, bottom);
        pen.stroke();
      }
      pen.beginPath();
      pen.moveTo(x - 5.5, top - 12);
      pen.lineTo(x + 5.5, top - 12);
      pen.lineTo(x, top - 2);
      pen.fill();
    }
  }

  /** Whether a violation concerns this quantity, and the arm and the joint shown. */
  concerns({ kind, subject, simulated }) {
    const { arm, joint } = this.plots;
    const own = subject.some((name) => name.split("/")[0] === arm.name && (!joint || kind === "collision" || name === `${arm.name}/${joint}`));
    return own && (KINDS[kind] === this.key || (simulated && this.key === "error"));
  }

  // ---- the time --------------------------------------------------------------------------------

  /** The time cursor, a numbered dot on each curve, and the values there as text. */
  follow() {
    if (!this.box) return;
    const { viewer } = this, pen = this.pen(this.front), t = viewer.time, x = this.x(t);
    this.area.setAttribute("aria-valuemin", this.span[0]);
    this.area.setAttribute("aria-valuemax", this.span[1]);
    this.area.setAttribute("aria-valuenow", t);
    const values = this.curves.map((curve) => ({ curve, value: curve.at(t) }));
    const words = viewer.manual ? "" : this.words(values);
    if (this.said.textContent !== words) this.said.textContent = words;
    this.area.setAttribute("aria-valuetext", `${seconds(t, viewer.duration)}, ${words}`);
    pen.globalAlpha = viewer.manual ? 0.25 : 1;
    pen.strokeStyle = INK;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(x, this.box.top - 2);
    pen.lineTo(x, this.box.bottom);
    pen.stroke();
    if (viewer.manual) return;
    pen.font = `600 9px ${FONT}`;
    Object.assign(pen, { textAlign: "center", textBaseline: "middle" });
    for (const { curve, value } of values) {
      const v = this.drawn(curve, value);
      if (!Number.isFinite(v) || (this.emphasized && curve.name !== this.emphasized)) continue;
      const y = clamp(this.y(v), this.box.top - 4, this.box.bottom + 4), plain = !curve.dash.length;
      pen.fillStyle = curve.color;
      pen.strokeStyle = "#fff";
      pen.lineWidth = 1.2;
      pen.beginPath();
      pen.arc(x, y, plain ? 6.5 : 3.2, 0, 7);
      pen.fill();
      pen.stroke();
      pen.fillStyle = "#fff";
      if (plain) pen.fillText(curve.mark, x, y + 0.5);
    }
  }

  /** The value of the only curve, or of the one nearest to its limit. */
  words(values) {
    const own = values.filter(({ value }) => Number.isFinite(value));
    if (!own.length) return "";
    if (!this.relative) {
      const shown = this.plots.joint && this.key !== "clearance" ? own : own.filter(({ curve }) => !curve.motion);
      const name = (curve) => (this.key === "clearance" ? `${curve.mark} ` : curve.motion ? `${curve.motion} ` : this.plots.joint ? "" : `${curve.mark} `);
      if (shown.length > 3) return this.largest(shown);
      return shown.map(({ curve, value }) => `${name(curve)}${shortNumber(value)} ${curve.unit}`).join(", ");
    }
    const share = ({ curve, value }) => Math.abs(this.drawn(curve, value));
    const most = own.filter(({ curve }) => !curve.motion).reduce((a, b) => (share(b) > share(a) ? b : a), own[0]);
    return `${most.curve.mark} ${most.curve.name}: ${shortNumber(most.value)} ${most.curve.unit}, ${share(most).toFixed(0)} %`;
  }

  largest(values) {
    const { curve, value } = values.reduce((a, b) => (Math.abs(b.value) > Math.abs(a.value) ? b : a));
    return `${curve.mark} ${curve.name}: ${shortNumber(value)} ${curve.unit}`;
  }

  listen() {
    const { viewer, area } = this;
    const place = (event) => {
      const { left, top } = area.getBoundingClientRect(), x = (event.clientX - left) / this.large, y = (event.clientY - top) / this.large;
      const share = (x - this.box.left) / (this.box.right - this.box.left);
      return { time: this.span[0] + clamp(share, 0, 1) * (this.span[1] - this.span[0]), x, y };
    };
    const conflictAt = ({ x, y }) => {
      const near = viewer.conflicts.all.filter((c) => Math.abs(this.x(c.time) - x) < 8 && (y < this.box.top + 6 || this.concerns(c)));
      return near.sort((a, b) => Math.abs(this.x(a.time) - x) - Math.abs(this.x(b.time) - x))[0];
    };
    const go = (event) => { viewer.pause(); viewer.seek(place(event).time); };
    area.onpointerdown = (event) => {
      area.setPointerCapture(event.pointerId);
      const conflict = conflictAt(place(event));
      this.dragging = !conflict;
      if (conflict) viewer.point(conflict.time, conflict.elements); else go(event);
    };
    area.onpointermove = (event) => {
      if (event.buttons && this.dragging) go(event);
      const conflict = conflictAt(place(event));
      area.title = conflict ? conflict.message || conflict.subject.join(" and ") : "";
      area.style.cursor = conflict ? "pointer" : "ew-resize";
    };
  }
}
