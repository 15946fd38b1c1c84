// A query in a changing configuration space: obstacles, start and goals that the user moves, and all dependent data.
//
//   live.moveObstacle(name, pose)   live.setEnd("start" | k, q)   then
//   live.update()                   {bits, labels} of the cells, without the planner
//   await live.plan(report)         {verdict, tone, answer, tree}; null if canceled; see `BackgroundPlanner.plan`
//   live.cancel()   live.end()

const TREE_STEP = 0.15; // [rad] Short edges show how the tree grew.
const MOST_ITERATIONS = 4000; // of the planner for one goal

class LiveQuery {
  constructor(planner, image) {
    this.planner = planner;
    this.background = new BackgroundPlanner(planner);
    this.raster = new LiveRaster(planner, image);
    this.bits = this.labels = null;
    this.used = 0; // layers with an image, as bits
    const { editing } = viewer; // the data are those of the document, from which obstacles may have been moved
    this.stale = new Set(editing.moved(editing.asPlanned.poses).filter((name) => data.live.ranges[name]));
    this.whole = new Map(); // cells that are in contact as a whole, by layer, if computed
    this.start = data.start && [...data.start];
    this.goals = data.goals.map((goal) => [...goal]);
  }

  moveObstacle(name, pose) {
    viewer.editing.moveObstacle(name, pose);
    this.stale.add(name);
    this.whole.delete(name);
  }

  setEnd(which, q) {
    if (which === "start") this.start = [...q]; else this.goals[which] = [...q];
  }

  /** Computes the cells that have changed, and their components. */
  update() {
    this.rasterize();
    this.labels = this.components();
    return { bits: this.bits, labels: this.labels };
  }

  /** Writes the image of each moved obstacle into the bits of the cells. */
  rasterize() {
    const { bits } = this;
    for (const name of this.stale) {
      const cells = this.raster.image(name);
      let layer = data.layers.findIndex((known) => known.name === name);
      if (layer < 0) {
        if (!cells.some(Boolean)) continue;
        throw new Error(`${name} has no layer`);
      }
      const bit = 1 << layer, rest = ~bit;
      let hit = 0;
      for (let c = 0; c < bits.length; c++) {
        bits[c] = cells[c] ? bits[c] | bit : bits[c] & rest;
        hit |= cells[c];
      }
      this.used = hit ? this.used | bit : this.used & rest;
    }
    this.stale.clear();
  }

  cell(q) {
    const [i, j] = [0, 1].map((axis) => cellOn(axis, share(axis, q[axis]), data.size[axis]));
    return i < 0 || j < 0 ? -1 : i * data.size[1] + j;
  }

  components() {
    const { bits } = this, free = new Uint8Array(bits.length);
    for (let c = 0; c < bits.length; c++) free[c] = bits[c] ? 0 : 1;
    const ends = [this.start, ...this.goals].filter(Boolean).map((q) => this.cell(q));
    return rankedComponents(labelComponents(free, data.size, data.periodic), ends);
  }

  /** The goals that are connected to the start on the grid. */
  get candidates() {
    if (!this.start) return [];
    const of = (q) => (this.cell(q) < 0 ? 0 : this.labels[this.cell(q)]), own = of(this.start);
    // At the boundary of an image a configuration may be free although the center of its cell is not.
    const isRim = (goal) => (!own || !of(goal)) && this.isFree(this.start) && this.isFree(goal);
    return this.goals.filter((goal) => (own && of(goal) === own) || isRim(goal));
  }

  /** Plans to one candidate after the other until there is a path; the result in words. */
  async plan(report) {
    const { start } = this, options = { seed: 0, iterations: MOST_ITERATIONS, step: TREE_STEP };
    let answer = null;
    for (const goal of this.candidates) {
      answer = await this.background.plan(start, goal, options, report);
      if (!answer) return null;
      if (answer.status === "found") break;
    }
    return this.result(answer);
  }

  cancel() { this.background.cancel(); }
  end() { this.background.end(); }

  /** The answer of the planner (null: there was nothing to plan), its tree and the verdict. */
  result(answer = null) {
    return { answer, tree: answer && treeOf(answer.trees), ...this.verdict(answer) };
  }

  isFree(q) {
    return this.cell(q) >= 0 && this.planner.withinLimits(q) && this.planner.isFree(q);
  }

  /** The result in a sentence, and its tone, as in `cspace_verdict.py`. */
  verdict(answer) {
    const { start, goals, labels } = this, cells = `${data.size.join(" × ")} cells`;
    if (!start) {
      const open = this.bits.reduce((sum, bits) => sum + (bits ? 0 : 1), 0), parts = new Set(labels).size - (open < labels.length ? 1 : 0);
      return { verdict: `${Math.round((100 * open) / labels.length)} % of all configurations are free, in ${parts} component${parts === 1 ? "" : "s"} of free space.`, tone: "" };
    }
    if (answer && answer.status === "found") {
      const over = crossesSeam(answer.shortened.waypoints.values) ? "; the path leads over the seam" : "";
      return { verdict: `Start and goal lie in the same component of free space${over}.`, tone: "good" };
    }
    if (answer && !answer.status.startsWith("invalid")) {
      return { verdict: `On this grid of ${cells} start and goal lie in the same component of free space; the planner found no path in ${answer.iterations} iterations.`, tone: "open" };
    }
    if (!this.isFree(start)) return { verdict: `The start is not free: ${this.names(start)}.`, tone: "bad" };
    if (!goals.some((goal) => this.isFree(goal))) return { verdict: "No path exists: no configuration that reaches the goal is free.", tone: "bad" };
    if (this.proves()) {
      return { verdict: `No path exists: start and goal are free, but in different components of free space, proven by certified cells on a grid of ${data.size.join(" × ")}.`, tone: "bad" };
    }
    return { verdict: `Open: this grid of ${cells} does not join start and goal, but that is no proof.`, tone: "open" };
  }

  names(q) {
    const bits = this.cell(q) < 0 ? 0 : this.bits[this.cell(q)];
    const touching = this.planner.contacts(q).flat().filter((name) => data.live.ranges[name]);
    const found = [...new Set([...touching, ...data.layers.filter((_, k) => (bits >>> k) & 1).map((layer) => layer.name)])];
    return listed(found.length ? found : ["it is too near to something"]);
  }

  /**
   * Whether cells that are in contact as a whole separate the start from every goal: a proof that no path exists.
   *
   * A path is a connected set, so the cells that it crosses meet in edges or corners.
   */
  proves() {
    const count = this.bits.length, open = new Uint8Array(count).fill(1), [n, m] = data.size;
    for (const name of Object.keys(data.live.ranges)) {
      if (!this.whole.has(name)) this.whole.set(name, this.raster.image(name, true).slice());
      const full = this.whole.get(name);
      for (let c = 0; c < count; c++) if (full[c]) open[c] = 0;
    }
    const outside = [0, 1].map((axis) => Array.from({ length: data.size[axis] }, (_, k) => {
      const [low, high] = data.limits[axis], step = (data.high[axis] - data.low[axis]) / data.size[axis], at = data.low[axis] + k * step;
      return (low !== null && at + step < low - 1e-9) || (high !== null && at > high + 1e-9);
    }));
    for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) if (outside[0][i] || outside[1][j]) open[i * m + j] = 0;
    const { labels } = labelComponents(open, data.size, data.periodic, true), own = labels[this.cell(this.start)];
    return own > 0 && this.goals.every((goal) => this.cell(goal) >= 0 && labels[this.cell(goal)] !== own);
  }
}

/** Whether a path leaves the square on one side and re-enters on the other. */
function crossesSeam(values) {
  return [0, 1].some((axis) => {
    const turns = Array.from({ length: values.length / 2 }, (_, k) => Math.floor(share(axis, values[2 * k + axis])));
    return data.periodic[axis] && turns.some((turn) => turn !== turns[0]);
  });
}

/** Trees for drawing: pieces inside the square, those nearer to their root first, and the tree of each. */
function treeOf(trees) {
  const edges = trees.flatMap(({ vertices: { values }, parents, lengths }, side) => parents.flatMap((parent, i) => {
    if (parent < 0) return [];
    const ends = [parent, i].map((k) => [share(0, values[2 * k]), share(1, values[2 * k + 1])]);
    return [{ side, reach: lengths[i], copies: wrappedCopies(ends) }];
  }));
  edges.sort((a, b) => a.reach - b.reach);
  return { pieces: edges.map(({ copies }) => copies), sides: edges.map(({ side }) => side) };
}
