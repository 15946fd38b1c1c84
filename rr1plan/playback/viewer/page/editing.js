// Edits by the user: joints, tools, obstacles, start and goal; and the motion planned for them.
//
//   editing.select({ kind: "tool" | "joint" | "obstacle", arm (its index), column (of q), name })
//   editing.jog(column, value)   editing.moveTool(arm, T_world_tool)   editing.moveObstacle(name, T_world_obstacle)
//   editing.setEnd("start" | "goal", q)   editing.undo()  .redo()  .reset()
//   await editing.plan()         the result of the planner, whose motion plays; null if canceled or impossible
//   editing.cancel(why)
//   editing.judge(q)             {tone, title, text, touching: [[element, element], ...], clearance [m]} of a configuration

const MOST_UNDONE = 200;
const OFF = 5e-4, TURNED = 2e-3; // share of an arm's reach or [m], [rad]: a tool this near is at its target
const CLOSE_EDITS = 800; // [ms] between steps of one jog, which are undone together

const ROUNDED = 1e-5; // [rad or m] rounding error of a motion at its ends, at most
const MOST_GHOSTS = 12; // with more arms, only moving ones have ghosts at a start or goal set by the user

const LOADING = "the planner is being loaded"; // the reason why there is none yet

/** A clearance, after what it does not cover. */
const inWords = (clearance, omitted) => [
  omitted, Number.isFinite(clearance) ? `clearance ${length(clearance)}` : omitted ? "" : "nothing to touch",
].filter(Boolean).join(", ");

/** What the page states about a motion that it has planned, in the form of the referee's reports. */
function reportOf(answer, { omitted, shapeless }) {
  return {
    certified: answer.certified, valid: true, violations: [], margins: {},
    title: `Planned here, ${answer.certified ? omitted || "certified free" : "not proven free"}`,
    checked: answer.certified ? ["collision in continuous time", "position", "velocity", "acceleration", "rest", "start", "goal"] : [],
    not_checked: { ...Object.fromEntries(shapeless.map((name) => [name, SHAPELESS])), ...(answer.certified ? {} : { proof: answer.fault }) },
  };
}

/** Text about the moving arms, if there are many. */
const inTurn = (legs) => (legs.length > 1 ? `, ${legs.length} arms one after the other` : ", the other arms stand still");

class Editing {
  constructor(viewer) {
    this.viewer = viewer;
    this.picker = new Picker(viewer);
    this.isOpen = false;
    this.lit = null;
    this.planner = this.background = null;
    this.planning = null; // the plan being made: {start, goal, poses, seed, planner, began [ms], progress}
    this.awaited = null; // f(whether to plan), called once the planner is loaded, or canceled
    this.isAsleep = false;
    this.hands = new Dragging(viewer, this);
    this.card = new PlanCard(viewer, this);
    this.keys = new Jogging(viewer, this);
    this.stages = new SceneStages(viewer, this);
    viewer.on("change", (q, time, manual) => {
      this.stale = true;
      this.stages.follow(time, manual);
    });
    viewer.on("planner", (planner, reason) => this.takePlanner(planner, reason));
  }

  load(doc) {
    const { kinematics, player } = this.viewer;
    this.cancel();
    this.solvers = new Map();
    this.scratch = new Float64Array(16 * kinematics.links);
    this.poses = new Map(doc.obstacles.map(({ name, pose }) => [name, Float64Array.from(pose)]));
    const { track, path, report, replay, compare, samples, tree } = doc;
    this.motion = { changes: { track, path, report, replay, compare, samples, tree, planned: null }, poses: this.poses };
    const { track: motion } = player, moves = motion && motion.end > motion.start;
    this.start = this.ghostly("start", doc, motion && this.viewer.at(motion.start)) || kinematics.rest();
    this.goal = this.ghostly("goal", doc, moves ? this.viewer.at(motion.end) : null);
    this.ghosts = { start: null, goal: null };
    this.asPlanned = this.snapshot();
    this.past = [];
    this.future = [];
    this.lastEdit = this.reach = this.lit = this.asked = this.headline = null;
    const moving = doc.track ? doc.track.columns : doc.ghosts.map(({ arm }) => kinematics.arms.find((a) => a.name === arm).firstColumn);
    this.arm = Math.max(kinematics.arms.indexOf(movedArms(kinematics, moving)[0]), 0);
    this.selected = kinematics.arms.length ? { kind: "tool", arm: this.arm } : null;
    this.stale = true;
    this.hands.load();
    this.card.load(doc);
    this.takePlanner(null, doc.planner ? LOADING : "this page was made without a planner");
    this.stages.load(doc);
  }

  /** Takes the planner of the document when it is ready; `reason` says why there is none. */
  takePlanner(planner, reason) {
    const loose = this.viewer.document.bodies && !this.stages.rows;
    if (this.planning || reason === LOADING) this.cancel(": the scene has changed");
    if (this.background) this.background.end();
    this.planner = loose ? null : planner;
    this.background = this.planner && new BackgroundPlanner(planner);
    if (this.isOpen && this.background) this.background.start();
    this.reason = loose ? "objects move along this motion" : reason;
    if (this.planner) for (const [name, pose] of this.poses) if (planner.obstacles.includes(name)) planner.moveObstacle(name, pose);
    this.stale = true;
    this.card.refreshPlanner();
    if (!this.isLoading) this.resumePlan(true);
  }

  get isLoading() {
    return this.reason === LOADING;
  }

  /** Whether a plan is being made, or will be once the planner is loaded. */
  get isPlanning() {
    return Boolean(this.planning || this.awaited);
  }

  /** Whether an obstacle can be drawn and checked at another pose. */
  canMove(name) {
    return this.viewer.world.canMove(name) && (!this.planner || this.planner.obstacles.includes(name));
  }

  /** Whether arms can be moved here; the panel of a planar arm has its own drags and disables these (`sleep`). */
  get active() {
    return this.viewer.kinematics.arms.length > 0 && !this.isAsleep;
  }

  sleep(on = true) {
    this.isAsleep = on;
    find("edit").hidden = on;
    find("handles").hidden = on;
  }

  /** The kinematics of an arm's tool, by the arm's index. */
  solver(index) {
    const { kinematics } = this.viewer;
    if (!this.solvers.has(index)) this.solvers.set(index, new DifferentialIk(kinematics, kinematics.arms[index], this.scratch));
    return this.solvers.get(index);
  }

  get dragging() {
    return this.hands.dragging;
  }

  /**
   * The configuration that the document's ghosts of a kind show, if every one of these arms has one. Ghosts are exact,
   * but the motion is rounded, so a ghost near an end of the motion (`near`) replaces that end.
   */
  ghostly(kind, doc, near = null) {
    const { kinematics } = this.viewer, q = near ? near.slice() : kinematics.rest(), own = (which) => doc.ghosts.filter((ghost) => ghost.kind === which);
    for (const { arm } of own("start")) {
      const { firstColumn } = kinematics.arms.find((a) => a.name === arm);
      const found = own(kind).find((ghost) => ghost.arm === arm && (!near || ghost.q.every((v, i) => Math.abs(v - near[firstColumn + i]) < ROUNDED)));
      if (!found) return near;
      q.set(found.q, firstColumn);
    }
    return own(kind).length ? q : near;
  }

  // ---- changes -----------------------------------------------------------------------------

  open(on = true) {
    if (on === this.isOpen || (on && !this.active)) return;
    this.isOpen = on;
    if (on && this.background) this.background.start();
    this.stale = true;
    this.card.show(on);
  }

  /** Opens or closes the card, as a button or a key does; during a drag the picture would move away from the pointer. */
  toggle() {
    this.open(!this.isOpen);
    this.viewer.frame();
  }

  select(thing) {
    this.selected = thing;
    if (thing && thing.arm >= 0) this.arm = thing.arm;
    this.stale = true;
  }

  /** Shows a configuration set by the user, and reports the moved joints to a running program. */
  setQ(q) {
    const { viewer } = this, { live } = viewer, before = viewer.q.slice();
    viewer.setQ(q);
    if (live) q.forEach((value, column) => { if (value !== before[column]) live.tellSlider(column, value); });
  }

  jog(column, value) {
    this.remember(`joint ${column}`);
    this.open();
    this.turn(column, value);
  }

  /** Sets one joint, inside its limits. */
  turn(column, value) {
    const [low, high] = this.viewer.limits[column];
    this.reach = null;
    this.setQ(withColumns(this.viewer.q, [column], [clamp(value, low, high)]));
  }

  /** Moves the joints of an arm so that its tool is at a pose, or as near as possible. */
  moveTool(arm, target) {
    const found = this.solver(arm).solve(this.viewer.q, target);
    this.reach = { arm, ...found };
    this.setQ(found.q);
    return found;
  }

  moveObstacle(name, pose) {
    const { viewer } = this;
    // Snapshots keep the map with which they were taken.
    this.poses = new Map(this.poses).set(name, Float64Array.from(pose));
    viewer.world.moveObstacle(name, pose);
    if (this.planner && this.planner.obstacles.includes(name)) this.planner.moveObstacle(name, pose);
    this.stale = true;
    this.refreshHeadline();
    viewer.redraw();
    for (const f of viewer.listeners.obstacle) f(name);
  }

  /** Sets the start or the goal, and shows it as a ghost. */
  setEnd(kind, q = this.viewer.q) {
    this.remember(null);
    this[kind] = q.slice();
    this.ghosts = { ...this.ghosts, [kind]: this[kind] };
    this.showGhosts(kind);
    const judged = this.judge(this[kind]);
    this.card.say(judged.tone === "bad" ? `${kind === "start" ? "Start" : "Goal"} set, but ${judged.sentence}` : `${kind === "start" ? "Start" : "Goal"} set${kind === "start" && !this.goal ? "; now a goal" : ""}`, judged.tone);
  }

  showGhosts(kind) {
    const { viewer } = this, { world, kinematics } = viewer, own = this.ghosts[kind];
    // If there are many arms, only those that move from start to goal have ghosts.
    const other = kind === "start" ? this.goal : this.start, many = kinematics.arms.length > MOST_GHOSTS && own && other;
    const moved = kinematics.arms.filter((a, k) => (!this.planner || this.planner.columns.includes(a.firstColumn)) && (!many || this.differ(k, own, other)));
    const rows = own && moved.map((a) => ({ arm: a.name, q: own.slice(a.firstColumn, a.firstColumn + a.robot.names.length) }));
    world.setGhosts(kind, rows || viewer.document.ghosts.filter((ghost) => ghost.kind === kind));
    if (kind === "goal" && viewer.targets) viewer.targets.visible = !own;
    if (own) viewer.hidden.delete(kind);
    if (world.layers[kind]) world.layers[kind].visible = viewer.isShown(kind);
    viewer.controls.fillToggles(viewer.document);
    viewer.redraw();
  }

  // ---- undo --------------------------------------------------------------------------------

  snapshot() {
    const { poses, start, goal, ghosts, motion } = this;
    return { q: this.viewer.q.slice(), manual: this.viewer.manual, time: this.viewer.time, sceneTime: this.stages.time, poses, start, goal, ghosts, motion };
  }

  /** Saves the current state for undo; consecutive steps of the same jog within a short time count as one. */
  remember(what) {
    const now = performance.now(), last = this.lastEdit;
    this.lastEdit = { what, now };
    if (what !== null && last && last.what === what && now - last.now < CLOSE_EDITS) return;
    this.past.push(this.snapshot());
    if (this.past.length > MOST_UNDONE) this.past.shift();
    this.future = [];
    this.stale = true;
  }

  undo() { this.travel(this.past, this.future); }
  redo() { this.travel(this.future, this.past); }

  /** Takes back a canceled edit, which cannot be redone. */
  discard() {
    this.undo();
    this.future.pop();
  }

  travel(from, to) {
    if (!from.length) return;
    to.push(this.snapshot());
    this.restore(from.pop());
    this.lastEdit = null;
  }

  /** Restores the document's motion, obstacles, start and goal. */
  reset() {
    this.remember(null);
    this.restore(this.asPlanned);
  }

  restore(kept) {
    const { viewer } = this, then = { ...kept }; // a copy, because the clock changes the kept state
    this.reach = null;
    for (const [name, pose] of then.poses) if (this.poses.get(name) !== pose) this.moveObstacle(name, pose);
    this.poses = then.poses;
    if (this.motion !== then.motion) {
      this.motion = then.motion;
      viewer.setMotion(then.motion.changes);
    }
    if (this.stages.rows) this.stages.stand(then.sceneTime);
    Object.assign(this, { start: then.start, goal: then.goal });
    const ghosts = this.ghosts;
    this.ghosts = then.ghosts;
    for (const kind of ["start", "goal"]) if (ghosts[kind] !== then.ghosts[kind]) this.showGhosts(kind);
    if (then.manual || !viewer.player.track) viewer.setQ(then.q);
    else { viewer.pause(); viewer.seek(then.time); }
    if (!then.manual) viewer.endManual();
    this.card.say("");
    this.refreshHeadline();
  }

  /** Whether anything differs from the document. */
  get changed() {
    const then = this.asPlanned;
    return this.viewer.manual || ["start", "goal", "motion"].some((name) => this[name] !== then[name]) || this.moved(then.poses).length > 0;
  }

  /** The obstacles whose poses differ from the given ones. */
  moved(poses) {
    return [...this.poses].filter(([name, pose]) => pose.some((v, i) => v !== poses.get(name)[i])).map(([name]) => name);
  }

  // ---- verdict on a configuration ----------------------------------------------------------

  judge(q) {
    const { viewer, planner } = this;
    const outside = viewer.joints.filter((_, c) => {
      const [low, high] = viewer.limits[c];
      return (low !== null && q[c] < low - 1e-9) || (high !== null && q[c] > high + 1e-9);
    });
    if (outside.length) {
      const names = namesOf(outside, 2, ", ");
      return { tone: "bad", title: "Out of limits", text: names, sentence: `it is out of limits: ${names}`, touching: [], clearance: null };
    }
    const unchecked = planner ? this.unchecked(q) : this.reason;
    if (unchecked) return { tone: "open", title: "Within limits", text: `collisions not checked: ${unchecked}`, sentence: unchecked, touching: [], clearance: null };
    const own = planner.columns.map((c) => q[c]), touching = planner.contacts(own);
    if (touching.length) {
      const names = namesOf(touching.map((pair) => pair.join(" and ")), 2, ", ");
      return { tone: "bad", title: "Touching", text: names, sentence: `it touches: ${names}`, touching, clearance: null };
    }
    // If there are many arms, the clearance of the active one.
    const clearance = planner.clearance(own, Infinity, [this.arm]), { omitted } = viewer;
    const [tone, title] = omitted ? ["open", "Within limits"] : ["good", "Free"];
    return { tone, title, text: inWords(clearance, omitted), sentence: omitted, touching, clearance };
  }

  /** Why collisions of a configuration are unknown: an arm that the planner does not move is not at its place. */
  unchecked(q) {
    const { stages } = this, { rest } = stages, little = stages.rows ? ROUNDED : 0;
    const moved = q.findIndex((value, c) => Math.abs(value - rest[c]) > little && !this.planner.columns.includes(c));
    const [arm, joint] = moved < 0 ? [] : this.viewer.joints[moved].split("/");
    return arm ? `${stages.rows ? joint : arm} is not where the planner has it` : "";
  }

  /** The verdict on the configuration shown: first its contacts, then whether the tool is where it was dragged to. */
  verdict() {
    const { viewer, reach } = this, judged = this.judge(viewer.q);
    const off = OFF * Math.min(1, reach ? viewer.world.reach[reach.arm] : 1);
    if (judged.tone === "bad" || !reach || (reach.off < off && reach.turned < TURNED)) {
      return judged.tone === "open" && reach ? { ...judged, title: "Reachable" } : judged;
    }
    const { robot } = viewer.kinematics.arms[reach.arm], limits = reach.atLimit.map((c) => robot.names[c]);
    const short = reach.off >= off ? `${length(reach.off)} short` : `${tenths(DEGREES * reach.turned)}° short`;
    return { ...judged, tone: "open", title: "Out of reach", text: [short, limits.length ? `${namesOf(limits, 2, ", ")} at ${limits.length > 1 ? "their limits" : "its limit"}` : ""].filter(Boolean).join(", ") };
  }

  // ---- planning ----------------------------------------------------------------------------

  /** Called when an obstacle has been dropped. */
  dropped() {
    if (this.planOnDrop && this.planner) this.plan();
  }

  /** Plans on the user's request, or cancels the plan being made. */
  requestPlan() {
    if (this.isPlanning) this.cancel(); else this.plan();
  }

  cancel(why = "") {
    if (!this.isPlanning) return;
    this.planning = null;
    if (this.background) this.background.cancel();
    this.resumePlan(false);
    this.card.say(`Planning canceled${why}.`);
  }

  /** Makes the plan that waits for the planner, or drops it. */
  resumePlan(go) {
    const { awaited } = this;
    this.awaited = null;
    if (awaited) awaited(go);
  }

  /** Plans from the start to the goal, and plays the motion. Returns the planner's result, or null. */
  async plan() {
    const { viewer, planner, card } = this;
    this.cancel();
    this.open();
    if (this.stages.rows) {
      viewer.pause();
      if (!this.goal && viewer.manual) this.setEnd("goal");
    }
    const { start, goal, poses, asked } = this;
    if (goal && this.isLoading) {
      const go = new Promise((resolve) => { this.awaited = resolve; });
      card.say("Planning starts when the planner is loaded.");
      return (await go) ? this.plan() : null;
    }
    const missing = !planner && !this.isLoading ? `Cannot plan here: ${this.reason}.` : !goal ? "No goal configuration yet: pose the arm, then set the goal (Z)."
      : this.unchecked(start) || this.unchecked(goal);
    if (missing) { card.say(missing, "open"); return null; }
    const again = asked && asked.start === start && asked.goal === goal && asked.poses === poses;
    const planning = { start, goal, poses, seed: again ? asked.seed + 1 : 0, planner, began: performance.now(), progress: null };
    this.planning = planning;
    const own = (q) => planner.columns.map((c) => q[c]), report = (text) => { planning.progress = text; };
    try {
      const answer = await this.background.plan(own(start), own(goal), { seed: planning.seed }, report);
      this.stopIfOvertaken();
      if (this.planning !== planning) return null;
      this.take(answer, planning);
      return answer;
    } finally {
      if (this.planning === planning) this.planning = null;
      card.refreshActs();
    }
  }

  /** Shows the planner's result. */
  take(answer, planning) {
    const { viewer, card } = this, { omitted } = viewer, took = 1000 * Object.values(answer.seconds).reduce((sum, part) => sum + part, 0);
    this.asked = planning;
    if (answer.status !== "found") {
      card.say(`${{ invalid_start: "Start is not valid", invalid_goal: "Goal is not valid" }[answer.status] || "No motion found"}: ${answer.reason}.`, "bad");
      return;
    }
    if (!answer.track) { card.say(`A path, but no motion: ${answer.reason}.`, "bad"); return; }
    this.remember(null);
    this.reach = null;
    const track = this.withRest(answer.track), spent = took < 1000 ? `${took.toFixed(1)} ms` : `${(took / 1000).toFixed(1)} s`;
    this.show({ track, path: answer.shortened, report: reportOf(answer, viewer), planned: `${spent}, seed ${planning.seed}` }, planning.poses);
    viewer.play();
    const proven = omitted ? "Motion" : "Certified motion";
    const said = `${answer.certified ? proven : `Not proven (${answer.fault}): motion`} of ${seconds(viewer.duration, viewer.duration)}${answer.legs ? inTurn(answer.legs) : ""}, planned in ${spent}`;
    card.say(`${said}${omitted && `, ${omitted}`}.`, answer.certified && !omitted ? "good" : "open");
    this.measure(this.motion, answer.track, said);
  }

  /** Shows a motion that the page has planned with obstacles at these poses, and nothing of the motion before. */
  show({ track, path = null, report = null, planned = null }, poses = this.poses) {
    const samples = { torque: null, clearance: null, error: null, places: [] };
    this.motion = { changes: { track, path, report, replay: null, compare: [], samples, tree: null, planned }, poses };
    this.viewer.setMotion(this.motion.changes);
    this.refreshHeadline();
  }

  /** Cancels the plan being made if the question has changed. */
  stopIfOvertaken() {
    const { planning } = this;
    if (planning && ["start", "goal", "poses", "planner"].some((name) => this[name] !== planning[name])) {
      this.cancel(": the start, the goal or an obstacle has changed");
    }
  }

  /** A track extended by columns that the planner does not move and whose values differ from the document. */
  withRest(track) {
    const { rest } = this.stages, usual = this.viewer.kinematics.rest();
    const still = [...rest.keys()].filter((c) => rest[c] !== usual[c] && !track.columns.includes(c));
    if (!still.length) return track;
    const columns = [...track.columns, ...still], [pieces, terms, width] = track.coefficients.shape, wide = columns.length;
    const values = new Float64Array(pieces * terms * wide);
    for (let row = 0; row < pieces * terms; row++) {
      values.set(track.coefficients.values.subarray(row * width, (row + 1) * width), row * wide);
      if (row % terms === 0) values.set(still.map((c) => rest[c]), row * wide + width);
    }
    return { ...track, columns, coefficients: { values, shape: [pieces, terms, wide] } };
  }

  /** Adds the least clearance, which takes longer than the proof, to the text about a motion that was planned here. */
  async measure(motion, track, said) {
    const least = await this.background.run("leastClearance", [track]);
    if (!least || this.motion !== motion) return;
    const { report } = motion.changes;
    if (Number.isFinite(least.value)) {
      report.margins.clearance = { value: least.value, unit: "m", subject: [], time: least.time };
      report.not_checked["clearance between samples"] = `the least of ${CLEARANCE_SAMPLES + 1} instants is shown`;
    }
    const isOpen = !find("report").hidden;
    this.headline = null;
    this.refreshHeadline();
    if (isOpen) find("badge").click(); // a report that is being read stays open
    const { omitted } = this.viewer, tone = report.certified && !omitted ? "good" : "open";
    if (find("answer").textContent.startsWith(said)) this.card.say(`${said}, ${inWords(least.value, omitted)}.`, tone);
  }

  /** Whether joints of an arm (by its index) differ by more than rounding in two configurations. */
  differ(index, one, two, little = ROUNDED) {
    const { firstColumn, robot } = this.viewer.kinematics.arms[index];
    return robot.names.some((_, j) => Math.abs(one[firstColumn + j] - two[firstColumn + j]) > little);
  }

  /** Neither a certificate nor contacts and clearances cover obstacles that have moved since. */
  refreshHeadline() {
    const { motion, viewer } = this, moved = this.moved(motion.poses), { report, track } = motion.changes, { controls } = viewer;
    const key = moved.join();
    if (this.headline && this.headline.motion === motion && this.headline.key === key) return;
    this.headline = { motion, key };
    viewer.setMoved(moved);
    const violations = report ? report.violations.filter(({ subject }) => !subject.some((name) => moved.includes(name))) : [];
    const shown = !moved.length || !track ? report : {
      certified: false, valid: !violations.length, violations, margins: {}, checked: [], title: violations.length ? "" : "Obstacles moved: not checked",
      not_checked: { collision: `${namesOf(moved, 3, ", ")} moved after this motion was planned` },
    };
    controls.fillReport(shown);
    controls.fillFacts({ ...viewer.document, report: shown });
  }

  // ---- at each frame -----------------------------------------------------------------------

  frame() {
    this.hands.frame();
    this.stopIfOvertaken();
    const { planning } = this, isSlow = planning && (performance.now() - planning.began > SLOW_PLAN || !this.background.isParallel);
    if (isSlow) this.card.sayPlanning(planning.progress ?? "");
    if (!this.stale) return;
    this.stale = false;
    if (!this.isOpen) return;
    const verdict = this.verdict(), touched = this.viewer.manual ? [...new Set(verdict.touching.flat())] : null;
    if (touched && touched.join() !== this.viewer.touched.join()) {
      this.viewer.touched = touched;
      this.viewer.paint();
      this.viewer.redraw();
    }
    this.card.refresh(verdict);
  }

  /** Highlights one element; null: none. */
  light(element) {
    if (element === this.lit) return;
    this.lit = element;
    this.viewer.paint();
    this.viewer.redraw();
  }
}
