// Edits of the query of a planar arm: obstacles, start and goals that the user moves, undo, and the plans made for them.
//
//   edits.remember()                            saves the state for undo, before a change
//   edits.moveObstacle(name, x, y, turned)      edits.moveEnd("start" | k, q)
//   edits.drag(step)                            makes a step of a drag at the next frame
//   edits.drop()                                after a change: the clock plays the motion once it is planned
//   edits.undo()  .reset()  .restore(state)     edits.select(name): the obstacle that the arrow keys move
//   await edits.update()                        shows the cells and plans
//   edits.requestPlan()                         plans the query as it is, or cancels the plan being made
//
// The query itself and the data that depend on it are those of `lesson.live` (`LiveQuery`), and null without a planner.

const MOST_QUERIES = 100; // that can be undone

class QueryEdits {
  constructor(lesson) {
    this.lesson = lesson;
    this.isAwaited = false; // whether to plan once the planner is loaded
    this.planning = null; // the plan being made: {began [ms]}
    this.clear();
  }

  get live() { return this.lesson.live; }

  /** Forgets all edits. */
  clear() {
    this.first = null; // the initial state
    this.past = [];
    this.selected = null;
    this.pending = false; // whether the motion that plays is older than the query
    this.dropped = false; // whether the motion that is planned plays once it is known
    this.resume = false; // whether that motion plays at once
  }

  /** Takes the planner, which is loaded now. */
  begin() {
    const { poses } = viewer.editing.asPlanned;
    this.first = { ...this.snapshot(), poses: new Map(Object.keys(data.live.outlines).map((name) => [name, poses.get(name)])) };
  }

  // ---- undo --------------------------------------------------------------------------------

  snapshot() {
    const { start, goals, planner } = this.live;
    return { start, goals: [...goals], poses: new Map(Object.keys(data.live.outlines).map((name) => [name, planner.obstaclePose(name)])) };
  }

  /** Saves the current state for undo. */
  remember() {
    this.lesson.holdLayout(true);
    this.live.background.start();
    this.past.push(this.snapshot());
    if (this.past.length > MOST_QUERIES) this.past.shift();
    this.lesson.fillTools();
  }

  undo() {
    if (this.live && this.past.length) this.restore(this.past.pop());
  }

  /** Restores the initial state. */
  reset() {
    if (!this.live) return;
    this.remember();
    this.restore(this.first);
  }

  restore({ start, goals, poses }) {
    const { live } = this;
    for (const [name, pose] of poses) if (live.planner.obstaclePose(name).some((v, k) => v !== pose[k])) live.moveObstacle(name, pose);
    if (start) live.setEnd("start", start);
    goals.forEach((goal, k) => live.setEnd(k, goal));
    this.lesson.fillTools();
    this.update();
    this.drop();
  }

  // ---- obstacles ---------------------------------------------------------------------------

  /** The obstacle at a point of the plane, or null. */
  obstacleAt(point) {
    const names = Object.keys(data.live.outlines).reverse();
    const isOn = (name) => {
      const place = this.obstaclePlace(name), local = point.map((v, axis) => v - place[axis]);
      return this.loops(name).some((loop) => insidePolygon(local, loop));
    };
    return names.find((name) => this.canMove(name) && isOn(name)) || null;
  }

  canMove(name) {
    return viewer.world.canMove(name) && data.live.outlines[name].length > 0;
  }

  /** The outlines of an obstacle around its origin, in its current orientation. */
  loops(name) {
    const now = this.live.planner.obstaclePose(name), then = this.first.poses.get(name);
    const angle = Math.atan2(now[1], now[0]) - Math.atan2(then[1], then[0]), [c, s] = [Math.cos(angle), Math.sin(angle)];
    return data.live.outlines[name].map((loop) => loop.map(([x, y]) => [c * x - s * y, s * x + c * y]));
  }

  obstaclePlace(name) {
    const pose = this.live.planner.obstaclePose(name);
    return [pose[12], pose[13]];
  }

  /** Selects the obstacle that the arrow keys move, or none. */
  select(name) {
    if (name === this.selected) return;
    this.selected = name;
    this.outlineSelected();
    this.lesson.say(name ? `${name}: arrow keys move it, < and > turn it` : "");
  }

  /** The next obstacle that can be moved, then none. */
  selectNext() {
    if (!this.live) return;
    const names = [...Object.keys(data.live.outlines).filter((name) => this.canMove(name)), null];
    this.select(names[(names.indexOf(this.selected) + 1) % names.length]);
  }

  outlineSelected() {
    const { workspace } = this.lesson;
    if (!workspace || !this.live) return;
    workspace.outline(this.selected ? this.loops(this.selected) : [], this.selected ? this.obstaclePlace(this.selected) : [0, 0]);
    viewer.redraw();
  }

  /** Moves and rotates an obstacle in the plane, and updates all dependent data. */
  moveObstacle(name, x, y, turned = 0) {
    const pose = this.live.planner.obstaclePose(name), [c, s] = [Math.cos(turned), Math.sin(turned)];
    for (const k of [0, 4, 8]) [pose[k], pose[k + 1]] = [c * pose[k] - s * pose[k + 1], s * pose[k] + c * pose[k + 1]];
    [pose[12], pose[13]] = [x, y];
    this.live.moveObstacle(name, pose);
    if (name === this.selected) this.outlineSelected();
    return this.update(name);
  }

  /** Moves the selected obstacle by a step in the plane, or turns it. */
  nudge(event, right, up, turned) {
    const step = (event.shiftKey ? 0.05 : 0.01) * this.lesson.arm.outer, [x, y] = this.obstaclePlace(this.selected);
    if (!event.repeat) this.remember();
    this.moveObstacle(this.selected, x + step * right, y + step * up, (turned * Math.PI) / 36);
    this.drop();
  }

  /** Moves the names of obstacles along with them. */
  placeTags() {
    const { tags } = this.lesson.arm;
    if (!this.first || !tags) return;
    for (const [name, { tag, place }] of tags) {
      if (!this.first.poses.has(name)) continue;
      const now = this.obstaclePlace(name), then = this.first.poses.get(name);
      tag.position.set(place[0] + now[0] - then[12], place[1] + now[1] - then[13], place[2]);
    }
  }

  // ---- start and goals ---------------------------------------------------------------------

  /** Sets the start or a goal to a configuration; which: "start" or the number of a goal. */
  moveEnd(which, q) {
    this.live.setEnd(which, q.map((v, axis) => wrapped(axis, v)));
    return this.update();
  }

  /** Sets the start or the goal to the configuration shown. */
  endHere(which) {
    if (!this.live || (which === "start" ? !data.start : !data.goals.length)) return;
    this.remember();
    this.moveEnd(which, q2());
    this.drop();
  }

  // ---- drags -------------------------------------------------------------------------------

  /** Moves an obstacle with the pointer. */
  dragObstacle(name, x, y) {
    this.resume ||= viewer.playing;
    viewer.pause();
    this.drag(() => this.moveObstacle(name, x, y));
  }

  /** Moves the start or a goal to the arm, which the pointer moves. */
  dragEnd(which) {
    const q = q2();
    this.drag(() => this.moveEnd(which, q));
  }

  /** Makes a step of a drag at the next frame; it replaces the step that waits. */
  drag(step) {
    this.step = step;
    this.waiting ||= requestAnimationFrame(() => this.dragOn());
  }

  /** Makes the step that waits once the step before is answered, unless its planning is slow. */
  dragOn() {
    const { planning } = this, waits = planning && performance.now() - planning.began < SLOW_PLAN;
    this.waiting = waits ? requestAnimationFrame(() => this.dragOn()) : 0;
    if (!waits) this.takeStep();
  }

  takeStep() {
    const { step } = this;
    if (this.waiting) cancelAnimationFrame(this.waiting);
    this.waiting = 0;
    this.step = null;
    if (step && this.live) step(); // unless the program shows another scene meanwhile
  }

  /** Takes back the drag that has not been dropped. */
  cancelDrag() {
    this.step = null;
    this.undo();
  }

  /** After a change: the ghosts move to start and goals, and the clock plays the motion once it is planned. */
  drop() {
    const { lesson } = this;
    lesson.holdLayout(false);
    this.takeStep();
    if (!this.pending) return;
    lesson.placeNames();
    lesson.redraw();
    const standing = (kind, ends) => ends.map((end) => ({ kind, arm: data.arm, q: lesson.ownConfiguration(end) }));
    viewer.world.setGhosts("start", standing("start", data.start ? [data.start] : []));
    viewer.world.setGhosts("goal", standing("goal", data.goals));
    for (const kind of ["start", "goal"]) if (viewer.world.layers[kind]) viewer.world.layers[kind].visible = viewer.isShown(kind);
    if (this.planning) this.dropped = true; else this.playAnswer();
  }

  // ---- plans -------------------------------------------------------------------------------

  /** Shows the cells after a change, and plans; the promise: `plan`. */
  update(moving = null) {
    const { live, lesson } = this;
    live.cancel();
    Object.assign(lesson.cells, live.update());
    data.start = live.start;
    data.goals = live.goals;
    this.pending = true;
    this.dropped = false;
    this.resume ||= viewer.playing;
    lesson.placeNames(moving);
    lesson.showUsed();
    this.placeTags();
    this.planning = null;
    const isOpen = live.candidates.length > 0;
    if (!isOpen) lesson.take(live.result());
    lesson.repaint();
    lesson.follow(false);
    return isOpen ? this.plan() : Promise.resolve(true);
  }

  /** Plans the query in the background, and shows the result; whether it was neither canceled nor overtaken. */
  async plan() {
    const { live } = this, planning = { began: performance.now() };
    let progress = "", isSlow = false;
    const show = () => { if (isSlow && this.planning === planning) this.lesson.sayPlanning(progress); };
    this.planning = planning;
    const timer = setTimeout(() => { isSlow = true; show(); }, SLOW_PLAN);
    try {
      const found = await live.plan((text) => { progress = text; show(); });
      if (!found || this.planning !== planning) return false;
      this.planning = null;
      this.show(found);
      return true;
    } finally {
      clearTimeout(timer);
      if (this.planning === planning) this.planning = null;
    }
  }

  /** Cancels planning on the user's request. */
  cancel() {
    this.live.cancel();
    this.planning = null;
    this.show({ answer: null, tree: null, verdict: "Planning canceled.", tone: "open" });
  }

  /** Plans the same query in the page, and plays the motion; once more cancels. */
  requestPlan() {
    if (!data.start) return;
    if (this.isLoading) { this.awaitPlanner(!this.isAwaited); return; }
    if (!this.live) return;
    if (this.planning) { this.cancel(); return; }
    this.update();
    this.resume = true;
    this.drop();
  }

  /** Whether the planner will come. */
  get isLoading() {
    return Boolean(data.live) && !this.live && !viewer.noPlanner;
  }

  /** Plans once the planner is loaded, or no longer. */
  awaitPlanner(on) {
    if (on !== this.isAwaited) this.lesson.say(on ? "Planning starts when the planner is loaded." : "");
    this.isAwaited = on;
  }

  /** Shows the result of a plan. */
  show(found) {
    const { lesson } = this, { tinted } = lesson;
    lesson.take(found);
    if (lesson.tinted === tinted) lesson.redraw(); else lesson.repaint();
    lesson.follow(false);
    if (this.dropped) this.playAnswer();
  }

  /** The clock plays the motion that was planned. */
  playAnswer() {
    const { answer } = this.lesson, { manual } = viewer, q = viewer.q.slice(), track = answer && answer.track;
    this.pending = this.dropped = false;
    viewer.editing.show(track ? { track, report: reportOf(answer, viewer) } : { track: null });
    for (const layer of ["toolpath", "path"]) if (viewer.world.layers[layer]) viewer.world.layers[layer].visible = viewer.isShown(layer);
    viewer.add("way", new viewer.THREE.Group());
    if (this.resume && track) viewer.play(); else if (manual || !track) viewer.setQ(q);
    this.resume = false;
    this.lesson.fillVerdict();
  }
}
