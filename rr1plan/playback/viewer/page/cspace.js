// The lesson: the configuration space, its content, and the effects of clicks and drags.

const q2 = () => data.columns.map((column) => viewer.q[column]);
const part = (selector) => root.querySelector(selector);

class Lesson {
  constructor() {
    this.chart = new CspaceChart(this);
    this.arm = new Workspace();
    this.edits = new QueryEdits(this);
    this.pointer = null;
    this.blocked = false;
    this.flat = false;
    this.live = null;
    this.torus = null;
    this.phase = makePhase();
    const head = element("div", undefined, "head");
    head.append(root.querySelector("h2"), part(".state"));
    root.prepend(head);
    this.wireTools();
    this.wireCanvas();
    this.addKeys();
    this.takeData();
    viewer.on("data", (names) => { if (names.includes("cspace")) this.takeNewData(); });
    viewer.on("load", () => this.meet());
    viewer.on("change", () => this.follow());
    viewer.on("obstacle", (name) => { if (this.isSlice) this.recut([name]); });
    viewer.on("planner", (planner, reason) => this.takePlanner(planner, reason));
    // Without a motion, the growth of the tree is animated.
    viewer.films.push(() => (this.track || !this.tree.length ? null : { start: 0, end: this.tree.length / this.growthRate, show: (t) => { this.pauseTree(); this.growTo(Math.round(t * this.growthRate)); } }));
    this.meet();
    const fit = () => { if (this.chart.resize()) this.repaint(); };
    onResize(part(".plot"), fit);
    fit();
    new ResizeObserver(() => { if (this.workspace && !this.arm.turned) this.arm.look(); }).observe(viewer.stage.pane);
  }

  /** The planar arm, if it is one. */
  get workspace() {
    return data.planar ? this.arm : null;
  }

  /** Reads the data of the panel: initially, and whenever the program shows another scene. */
  takeData() {
    this.pauseTree();
    this.cells = new Cells();
    this.arm.prepare();
    this.tree = data.tree ? treePieces(data.tree) : [];
    this.sides = data.tree ? viewer.unpack(data.tree.sides).values : [];
    this.grown = this.tree.length;
    this.showTree = this.tree.length > 0;
    this.tinted = data.tone === "bad";
    this.only = this.pinned = -1;
    this.curve = [];
    this.motion = [];
    this.endLive();
    this.answer = this.explored = null;
    this.edits.clear();
    this.fillSliders();
    this.fillLegend();
    this.fillTools();
    this.fillVerdict();
  }

  /** Takes data that the program has sent, with another document, whose planner follows, or for the present one. */
  takeNewData() {
    this.takeData();
    this.repaint();
    if (viewer.planner) this.takePlanner(viewer.planner, "");
  }

  /** Reads the motion of the document. */
  meet() {
    this.takeTrack(viewer.player.track, 800);
    this.arm.draw();
    this.edits.placeTags();
    // Another motion in the same world does not move the camera.
    if (this.world !== viewer.world) {
      this.world = viewer.world;
      if (this.workspace && !this.arm.turned) this.arm.look();
      else if (this.flat && !this.workspace) viewer.look();
      this.flat = Boolean(this.workspace);
    }
    this.follow();
  }

  /** Samples a motion at `count` equal intervals for drawing; null: no motion. */
  takeTrack(track, count) {
    this.track = track && track.end > track.start ? track : null;
    const q = viewer.kinematics.rest();
    this.curve = (this.track ? track.instants(count) : []).map((t) => {
      track.at(t, q);
      return data.columns.map((column, axis) => share(axis, q[column]));
    });
    this.motion = wrappedCopies(this.curve.length ? this.curve : [[0, 0]]);
    this.fillTools();
    this.fillPhase();
  }

  // ---- the planner -------------------------------------------------------------------------

  /** With a planner, obstacles, start and goals can be moved; without one, the page says so. */
  async takePlanner(planner, reason) {
    const note = part(".fixed"), { live } = data;
    note.hidden = !reason || !(this.workspace || data.others.length);
    note.textContent = this.workspace ? `Obstacles stand still on this page: ${reason}.` : `The slice stays as it was saved: ${reason}.`;
    this.endLive();
    this.fillPhase();
    if (!planner || !live) { this.edits.awaitPlanner(false); return; }
    const image = await inflate(live.raster);
    if (data.live !== live || viewer.planner !== planner) return;
    this.live = new LiveQuery(planner, image);
    this.live.bits = this.cells.bits;
    this.live.used = this.cells.used();
    part(".others").hidden = !data.others.length;
    const { size } = this.live.stale;
    if (this.isSlice) {
      this.cutAt = data.others.map(({ column }) => viewer.kinematics.rest()[column]);
      if (size) this.recut([]);
    } else {
      this.edits.begin();
      if (size) { this.edits.update(); this.edits.drop(); }
    }
    this.fillTools();
    this.follow();
    if (!this.edits.isAwaited) return;
    this.edits.awaitPlanner(false);
    this.edits.requestPlan();
  }

  endLive() {
    if (this.live) this.live.end();
    this.live = this.edits.planning = null;
  }

  // ---- slices ------------------------------------------------------------------------------

  /** Whether the picture is a slice that follows obstacles and the joints that it does not show. */
  get isSlice() {
    return Boolean(this.live) && data.others.length > 0;
  }

  otherValues() {
    return data.others.map(({ column }) => viewer.q[column]);
  }

  /** Requests that the slice be recomputed at the next frame for these obstacles, or for all. */
  recut(names = Object.keys(data.live.ranges)) {
    for (const name of names) this.live.stale.add(name);
    this.cutting ||= requestAnimationFrame(() => { this.cutting = 0; if (this.isSlice) this.cut(); });
  }

  /** Computes the slice at the current values of the other joints. */
  cut() {
    this.cutAt = this.otherValues();
    this.live.raster.setConfiguration(viewer.planner.columns.map((column) => viewer.q[column]));
    const { bits, labels } = this.live.update();
    Object.assign(this.cells, { bits, labels });
    data.verdict = this.live.result().verdict;
    this.placeNames();
    this.showUsed();
    this.fillVerdict();
    this.repaint();
    this.follow(false);
  }

  // ---- results -----------------------------------------------------------------------------

  /** Keeps the heights of the panel and its verdict during a drag, so that the picture stays under the pointer. */
  holdLayout(on) {
    for (const node of [find("panels"), part(".verdict")]) node.style.height = on ? `${node.getBoundingClientRect().height}px` : "";
  }

  say(text) {
    part(".said").textContent = text;
  }

  /** The positions of the names of images, or of one of them. */
  placeNames(only = null) {
    data.layers.forEach((layer, k) => {
      if (only && layer.name !== only) return;
      const spot = widestSpot(this.cells.bits, data.size, k, data.periodic);
      layer.spot = spot && spot.map((part, axis) => value(axis, part));
    });
  }

  /** Takes the result of a query: tree, path and verdict. */
  take({ answer, tree, verdict, tone }) {
    Object.assign(data, { verdict, tone });
    this.answer = answer;
    this.tinted = tone === "bad";
    this.tree = tree ? tree.pieces : [];
    this.sides = tree ? tree.sides : [];
    this.grown = this.explored = this.tree.length;
    this.pauseTree();
    this.takeTrack(answer && answer.track ? new Track(answer.track) : null, 240);
    this.fillVerdict();
    for (const layer of ["toolpath", "path", "replay"]) if (viewer.world.layers[layer]) viewer.world.layers[layer].visible = false;
    this.arm.drawWay(this.curve.map((at) => at.map((part, axis) => value(axis, part))));
  }

  /** Shows that the page plans, and its progress, which screen readers do not read out. */
  sayPlanning(progress) {
    let shown = part(".verdict span");
    if (!shown) {
      this.take({ answer: null, tree: null, verdict: "Planning … ", tone: "open" });
      this.repaint();
      shown = element("span");
      shown.ariaLive = "off";
      part(".verdict").append(shown);
    }
    shown.textContent = progress;
  }

  /** The configuration of the arm with its two joints at q. */
  ownConfiguration(q) {
    const own = viewer.kinematics.arms.find((a) => a.name === data.arm);
    return withColumns(viewer.kinematics.rest(), data.columns, q).slice(own.firstColumn, own.firstColumn + own.robot.names.length);
  }

  // ---- controls ----------------------------------------------------------------------------

  fillSliders() {
    const add = (box, k, low, high, { name, straight }, mark, move) => {
      const row = element("div"), label = element("label"), slider = element("input"), out = element("output");
      Object.assign(slider, { type: "range", min: low, max: high, step: stepOf(low, high, straight), id: `cspace-${k}` });
      label.htmlFor = slider.id;
      label.append(element("b", mark), ` ${name}`);
      slider.oninput = () => move(Number(slider.value));
      row.append(label, out, slider);
      part(box).append(row);
      return { slider, out };
    };
    for (const pair of root.querySelectorAll(".pair")) pair.replaceChildren();
    this.sliders = [0, 1].map((axis) => add(".pair.shown", axis, data.low[axis], data.high[axis], data.joints[axis], symbol(axis), (v) => this.pose(q2().map((w, k) => (k === axis ? v : w)))));
    this.otherSliders = data.others.map((joint, k) => add(".others .pair", k + 2, joint.low, joint.high, joint, "", (v) => viewer.setJoint(joint.column, v)));
  }

  fillLegend() {
    part(".legend").replaceChildren();
    const patterns = patternsOf(data.layers);
    data.layers.forEach((layer, k) => {
      const chip = element("button", undefined, "chip"), dot = element("i");
      chip.title = `Only the image of ${layer.name}`;
      chip.setAttribute("aria-pressed", "false");
      dot.style.background = patterned(layer.color, patterns[k]);
      chip.append(dot, layer.name);
      chip.onclick = () => { this.pinned = this.pinned === k ? -1 : k; this.single(this.pinned); };
      chip.onpointerenter = () => this.single(k);
      chip.onpointerleave = () => this.single(this.pinned);
      part(".legend").append(chip);
    });
    this.showUsed();
  }

  /** Lists only layers with an image in the legend. */
  showUsed() {
    const used = this.live ? this.live.used : this.cells.used();
    [...part(".legend").children].forEach((chip, k) => { chip.hidden = !((used >>> k) & 1); });
  }

  single(layer) {
    [...part(".legend").children].forEach((chip, k) => chip.setAttribute("aria-pressed", String(this.pinned === k)));
    if (layer === this.only) return;
    this.only = layer;
    this.repaint();
  }

  wireTools() {
    const tool = (name) => part(`[data-tool=${name}]`);
    this.tools = Object.fromEntries(["parts", "elbow", "tree", "grow", "torus", "phase", "undo", "reset"].map((name) => [name, tool(name)]));
    this.reach = part(".grow input");
    this.tools.parts.onclick = () => { this.tinted = !this.tinted; this.repaint(); };
    this.tools.elbow.onclick = () => this.pose(this.arm.flat.twin(q2()));
    this.tools.tree.onclick = () => { this.showTree = !this.showTree; this.redraw(); };
    this.tools.grow.onclick = () => this.grow();
    this.tools.torus.onclick = () => this.toggleTorus();
    this.tools.phase.onclick = () => { this.phase.hidden = !this.phase.hidden; this.fillPhase(); viewer.frame(); };
    this.tools.undo.onclick = () => this.edits.undo();
    this.tools.reset.onclick = () => this.edits.reset();
    this.reach.oninput = () => { this.pauseTree(); this.growTo(Number(this.reach.value)); };
  }

  fillTools() {
    part(".grow").hidden = !this.tree.length;
    this.tools.elbow.hidden = !this.workspace || data.planar.kinds === "PP";
    this.tools.phase.hidden = !this.track && !(this.live && data.start);
    this.tools.torus.hidden = !data.periodic.every(Boolean) || !viewer.stage.renderer;
    this.tools.undo.hidden = this.tools.reset.hidden = !this.live || !this.edits.past.length;
    if (this.workspace) this.arm.readout.hint.hidden = !this.live || this.edits.past.length > 0;
    Object.assign(this.reach, { max: this.tree.length, step: 1, value: this.tree.length });
    const explored = this.explored ?? (data.tree ? data.tree.explored : 0), thinned = explored > this.tree.length;
    this.tools.tree.title = `What the planner explored (T)${thinned ? `: ${this.tree.length} of ${explored} edges are drawn` : ""}`;
  }

  /** Animates the growth of the tree in five seconds, pauses, or continues; at once with "reduced motion". */
  grow() {
    if (this.growing) { this.pauseTree(); return; }
    if (!this.tree.length) return;
    if (reducedMotion()) { this.growTo(this.tree.length); return; }
    const rate = this.growthRate / 1000, from = this.grown < this.tree.length ? this.grown : 0;
    const began = performance.now();
    const step = (now) => {
      this.growTo(Math.min(from + Math.round(rate * Math.max(now - began, 0)), this.tree.length));
      if (this.grown < this.tree.length) this.growing = requestAnimationFrame(step); else this.pauseTree();
    };
    this.growing = requestAnimationFrame(step);
    this.tools.grow.textContent = "Pause";
    this.growTo(from);
  }

  /** Edges per second: all of them in five seconds, or less. */
  get growthRate() {
    return this.tree.length / Math.min(5, 1.5 + 0.01 * this.tree.length);
  }

  pauseTree() {
    if (!this.growing) return;
    cancelAnimationFrame(this.growing);
    this.growing = 0;
    this.tools.grow.textContent = "Grow";
  }

  /** Adds or removes one edge of the tree. */
  walk(by) {
    this.pauseTree();
    this.growTo(clamp(this.grown + by, 0, this.tree.length));
  }

  growTo(count) {
    this.grown = count;
    this.showTree = true;
    this.redraw();
  }

  fillVerdict() {
    const text = part(".verdict");
    text.textContent = data.verdict;
    const { answer } = this;
    if (answer && answer.track) {
      const ms = 1000 * Object.values(answer.seconds).reduce((sum, v) => sum + v, 0), long = answer.track.breaks.values;
      text.append(` Planned here in ${ms.toFixed(1)} ms${answer.certified ? `, ${viewer.omitted || "certified free"}` : ""}: ${long[long.length - 1].toFixed(2)} s.`);
    }
    for (const tone of ["good", "bad", "open"]) text.classList.toggle(tone, data.tone === tone);
    if (data.tone !== "bad" || !this.place(data.start).free) return;
    const chip = (q) => {
      const swatch = element("i"), label = this.place(q).part;
      swatch.style.background = label ? patterned(PARTS[Math.min(label, PARTS.length) - 1], (label - 1) % PATTERNS.length) : "#fff";
      return swatch;
    };
    const free = data.goals.find((goal) => this.place(goal).free);
    if (free) text.append(" ", chip(data.start), "the start’s, ", chip(free), "the goal’s.");
  }

  place(q) {
    return this.cells.answer(share(0, q[0]), share(1, q[1]));
  }

  addKeys() {
    const { keys } = viewer, { tools, edits } = this, title = "Configuration space", live = () => Boolean(this.live && this.workspace), click = (tool) => ({ when: () => !tool.hidden, act: () => tool.click() });
    keys.add(title, [
      { keys: ["c"], text: "Color the components of free space", ...click(tools.parts) },
      { keys: ["e"], text: "The other elbow", ...click(tools.elbow) },
      { keys: ["t"], text: "Show or hide the tree", when: () => this.tree.length > 0, act: () => tools.tree.click() },
      { keys: ["g"], text: "Grow the tree, or pause", when: () => this.tree.length > 0, act: () => this.grow() },
      { keys: ["d"], text: "Torus", ...click(tools.torus) },
      { keys: ["f"], text: "Phase plane", ...click(tools.phase) },
      // As on the page of any other arm.
      { keys: ["j"], text: "Select the next obstacle", when: live, act: () => edits.selectNext() },
      { keys: ["a"], text: "The start is where the arm is", when: live, act: () => edits.endHere("start") },
      { keys: ["z"], text: "The goal is where the arm is", when: live, act: () => edits.endHere(0) },
      { keys: ["p"], text: "Plan and play, or cancel planning", when: () => live() || (edits.isLoading && Boolean(this.workspace)), act: () => edits.requestPlan() },
      { keys: ["o"], text: "Everything as it was at first", when: () => !tools.reset.hidden, act: () => edits.reset() },
      { keys: ["Ctrl+z"], text: "Undo", when: () => live() && edits.past.length > 0, act: () => edits.undo() },
    ]);
    keys.add(title, [
      { keys: [",", "."], text: "One edge of the growing tree back or on", when: () => this.showTree && this.grown < this.tree.length, act: ({ key }) => this.walk(key === "." ? 1 : -1) },
      { keys: Object.keys(ARROWS), text: "Move the selected obstacle; with Shift farther", when: () => Boolean(edits.selected), act: (event) => edits.nudge(event, ...ARROWS[event.key], 0) },
      { keys: ["<", ">"], text: "Turn the selected obstacle", when: () => Boolean(edits.selected), act: (event) => edits.nudge(event, 0, 0, event.key === "<" ? 1 : -1) },
      { keys: ["Escape"], text: "Select nothing", when: () => Boolean(edits.selected), act: () => edits.select(null) },
      { keys: ["Escape"], text: "", when: () => Boolean(edits.planning), act: () => edits.cancel() },
      { keys: Object.keys(ARROWS), text: "Turn the torus", when: (target) => Boolean(this.torus) && target === this.torus.canvas, act: (event) => this.torus.rotate(...ARROWS[event.key].map((v, axis) => (axis ? 0.1 : -0.1) * v)) },
    ], { first: true });
    keys.arrows(title, "In the picture: move the arm; with Shift farther", this.chart.canvas, (by, event) => {
      const step = (event.shiftKey ? 10 : 1) / 360;
      this.pose(q2().map((v, axis) => v + by[axis] * step * (data.high[axis] - data.low[axis])));
    });
  }

  // ---- other views -------------------------------------------------------------------------

  toggleTorus() {
    if (this.torus) this.torus.dispose();
    this.torus = this.torus ? null : new TorusView(this, part(".plot"));
    this.tools.torus.setAttribute("aria-pressed", String(Boolean(this.torus)));
    this.chart.canvas.style.visibility = this.torus ? "hidden" : "";
    part(".tip").hidden = true;
  }

  /** The phase plane of the motion, if it is shown. */
  fillPhase() {
    this.tools.phase.setAttribute("aria-pressed", String(!this.phase.hidden));
    if (this.phase.hidden) return;
    const rates = viewer.planner && viewer.planner.rates, timed = this.track && (this.answer || viewer.document.track.timed);
    this.plane = rates && timed ? phasePlane(this.track, rates) : null;
    this.drawPhase();
  }

  drawPhase() {
    if (this.phase.hidden) return;
    const why = !this.track ? "No motion" : !viewer.planner ? "No limits of joints: the page has no planner" : this.live ? "No times yet: P plans a timed motion" : "This path has no times";
    drawPhasePlane(this.phase.querySelector("canvas"), this.plane, viewer.manual || this.edits.pending ? null : viewer.player.fraction, why);
  }

  // ---- the configuration -------------------------------------------------------------------

  /** Moves the two joints, wrapped on periodic axes and clamped to the picture on others. */
  pose(q) {
    const inside = q.map((v, axis) => (data.periodic[axis] ? wrapped(axis, v) : clamp(v, data.low[axis], data.high[axis])));
    viewer.setQ(withColumns(viewer.q, data.columns, inside));
  }

  /** Shows the configuration; draw: also redraw the picture if nothing else does. */
  follow(draw = true) {
    const q = q2(), answer = this.place(q);
    this.sliders.forEach(({ slider, out }, axis) => {
      const v = wrapped(axis, q[axis]);
      slider.value = v;
      showValue(slider, out, reading(axis, v));
    });
    if (this.isSlice) {
      this.otherSliders.forEach(({ slider, out }, k) => {
        const { column } = data.others[k], v = viewer.q[column];
        slider.value = v;
        showValue(slider, out, viewer.jointText(column, v));
      });
      if (this.otherValues().some((v, k) => v !== this.cutAt[k])) this.recut();
    }
    const state = part(".state"), { text, color, ink } = words(answer);
    if (state.textContent !== text) {
      announce(state, text, viewer.playing || (viewer.manual && viewer.origin !== "by hand"));
      state.title = text; // a long name of an obstacle is cut off
      Object.assign(state.style, { background: color, color: ink });
    }
    const blocked = !answer.free && !answer.edge && viewer.manual;
    if (blocked !== this.blocked) {
      this.blocked = blocked;
      const { arms } = viewer.kinematics, own = arms.find((a) => a.name === data.arm);
      viewer.world.paint(viewer.byArm && arms.length > 1, blocked ? own.robot.links.map((link) => `${own.name}/${link}`) : []);
      viewer.redraw();
    }
    if (this.workspace) {
      this.workspace.follow(q);
      this.tools.elbow.disabled = Math.abs(this.arm.flat.side(q)) < 1e-6 || this.place(this.arm.flat.twin(q)).outside;
    }
    this.drawPhase();
    if (draw) this.chart.draw();
  }

  // ---- the pointer -------------------------------------------------------------------------

  wireCanvas() {
    const { chart } = this, { canvas } = chart;
    let held = false, mark = null, dragged = null, from = null;
    const take = (event) => {
      const spot = chart.spot(event);
      this.pose(this.snapped(spot, event.type === "pointerdown") || spot.map((part, axis) => value(axis, part)));
    };
    canvas.addEventListener("pointerdown", (event) => {
      const spot = chart.spot(event);
      if (event.button !== 0 || !chart.inPlot(spot)) return;
      held = true;
      from = [event.clientX, event.clientY];
      mark = this.live ? chart.markAt(spot) : null;
      canvas.setPointerCapture(event.pointerId);
      take(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      const spot = chart.spot(event);
      this.pointer = held || chart.inPlot(spot) ? spot : null;
      if (mark !== null && dragged === null && Math.hypot(event.clientX - from[0], event.clientY - from[1]) > 3) {
        dragged = mark;
        this.edits.remember();
      }
      // When the mark of the start or a goal is dragged, the arm follows it.
      if (held && (mark === null || dragged !== null)) take(event); else if (!held) chart.draw();
      if (dragged !== null) this.edits.dragEnd(dragged);
      canvas.style.cursor = !held && this.live && chart.markAt(spot) !== null ? "move" : "";
      this.tip();
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, () => {
        if (dragged !== null) { if (end === "pointercancel") this.edits.cancelDrag(); else this.edits.drop(); }
        held = false;
        mark = dragged = null;
      });
    }
    canvas.addEventListener("pointerleave", () => { this.pointer = null; this.tip(); chart.draw(); });
    this.drags = new PlanarDrags(this, this.arm);
  }

  /** A click on the mark of the start or a goal selects exactly that configuration. */
  snapped(spot, wanted) {
    const mark = wanted ? this.chart.markAt(spot) : null;
    return mark === null ? null : mark === "start" ? data.start : data.goals[mark];
  }

  tip() {
    const tip = part(".tip");
    tip.hidden = !this.pointer;
    if (!this.pointer) return;
    const answer = this.cells.answer(...this.pointer);
    const head = element("b"), dot = element("i");
    dot.style.background = answer.layers.length ? answer.layers[0].color : "#3ecf9a";
    head.append(dot, words(answer).text);
    const q = this.pointer.map((share, axis) => reading(axis, wrapped(axis, value(axis, share))));
    tip.replaceChildren(head, `${symbol(0)} ${q[0]}   ${symbol(1)} ${q[1]}`);
    if (this.chart.nearTwin(this.pointer)) tip.append(element("br"), "other elbow: the tool in the same place");
    const { plot: { x, y, size }, ratio, canvas } = this.chart, k = 1 / ratio, wide = canvas.clientWidth;
    const px = (x + this.pointer[0] * size) * k, py = (y + (1 - this.pointer[1]) * size) * k;
    const left = px + 16 + tip.offsetWidth > wide ? px - 16 - tip.offsetWidth : px + 16;
    const top = py - 12 - tip.offsetHeight < 0 ? py + 16 : py - 12 - tip.offsetHeight;
    tip.style.transform = `translate(${Math.round(Math.max(0, left))}px, ${Math.round(top)}px)`;
  }

  // ---- drawing -----------------------------------------------------------------------------

  /** Paints the cells again, after a change of them or of their display. */
  repaint() {
    this.chart.paint();
    this.tools.parts.setAttribute("aria-pressed", String(this.tinted));
    this.redraw();
    if (this.torus) this.torus.paint();
  }

  /** Draws the tree and all that is above the cells again. */
  redraw() {
    this.chart.redraw();
    this.tools.tree.setAttribute("aria-pressed", String(this.showTree));
    this.reach.value = this.grown;
    showValue(this.reach, part(".grow output"), `${this.grown}`);
  }
}

/** Shows a result in words, in the colors of its tone. */
function words(answer) {
  if (answer.outside) return { text: "outside the picture", color: "#e6e9ee", ink: INK };
  if (answer.free && !answer.edge) return { text: "free", color: "#d8f3e7", ink: "#13795b" };
  const things = answer.layers.filter((l) => l.kind === "thing").map((l) => l.name);
  const reasons = [];
  if (things.length) reasons.push(`${answer.edge ? "at the edge of" : "blocked by"} ${listed(things)}`);
  const own = answer.edge ? { self: "at the edge of self-collision", limits: "at the joint limits" } : { self: "blocked by the arm itself", limits: "outside the joint limits" };
  for (const layer of answer.layers) if (own[layer.kind]) reasons.push(own[layer.kind]);
  const text = reasons.join(", ");
  if (answer.edge) return { text, color: "#fdf0cf", ink: "#7a5600" };
  const { color } = answer.layers[0];
  return { text, color, ink: isLight(color) ? INK : "#fff" };
}

/** The card of the phase plane in a corner of the workspace. */
function makePhase() {
  const card = element("figure", undefined, "phase card"), plot = element("canvas");
  plot.setAttribute("role", "img");
  plot.setAttribute("aria-label", "Phase plane: path speed over path length, below its limit curve");
  card.append(element("figcaption", "Phase plane: ṡ over s, limit curve dashed"), plot);
  card.hidden = true;
  find("stage").append(card);
  return card;
}

viewer.lesson = new Lesson();
