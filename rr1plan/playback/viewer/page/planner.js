// A planner in the page: the kernels of `core.wasm` in the order of `plan_motion`, with the same constants.
//
//   const planner = await loadPlanner(data)         data: from Python's `page_planner`, with the modules; rejects
//                                                   with the reason if the browser cannot run it; for many arms it is
//                                                   a `ManyArmsPlanner`
//   planner.columns  .joints                        columns of viewer.q that it moves, and their names; every q below
//                                                   has these columns only
//   planner.obstacles  .frames                      names of obstacles that can be moved, and of frames for inverse kinematics
//   planner.isFree(q)  .edgeIsFree(q0, q1)          certified with the padding of the scene
//   planner.contacts(q)                             [[element, element], ...] of all pairs in contact
//   planner.clearance(q, most)                      least distance of moving pairs beyond their padding [m], `most` at most
//   planner.clearances(qs)                          that of each configuration, of a planner for all arms together
//   planner.withinLimits(q)  .outOfLimits(q)        the indices in `joints` of those out of limits
//   planner.inverseKinematics(frame, target, q)     a configuration that brings a frame ("arm" or "arm/link") to a target,
//                                                   near q, or null; target: [x, y, z], or 16 numbers, column-major
//   planner.rates                                   limits of the columns: {velocity, acceleration}
//   planner.obstaclePose(name)  .moveObstacle(name, pose)    T_world_object, 16 numbers, column-major
//   planner.plan(start, goal, {seed, iterations, seconds, margin, step})    step: longest edge of the trees [rad or m]
//       status     "found", "invalid_start", "invalid_goal", "infeasible" or "timeout"; `reason` says why
//       path       {columns, waypoints: {values, shape}} as found, and `shortened` after shortcuts
//       track      {columns, breaks, coefficients, exact, timed}, for `new Track(...)`; null without a path
//       retiming   "blend", or "stop" if blends are not proven
//       certified  whether the referee (`referee.js`) has proven the timed motion; if not, `fault` says why
//       trees      of start and goal: {vertices: {values, shape}, parents, lengths}; a root's parent is -1;
//                  lengths: of the path from the root
//       margin, iterations, seconds: {plan, shorten, retime, certify}
//   planner.leastClearance(track)                   {value [m], time [s]} among some instants of the track of a result
//   planner.report(text)                            called with the progress while it plans, in words
//
// The same seed gives the same path and the same timing as `plan_motion(problem, planner="rrt_connect", rng=seed)`, to
// the last bit; for one arm or two this planner is the default.

// A module with one SIMD instruction, which only browsers with WebAssembly SIMD accept.
const SIMD_PROBE = Uint8Array.of(
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11,
);

/** Decompressed bytes from base64. */
async function inflate(text) {
  const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The planner of a page: for all arms together, or for many arms one after the other. */
async function loadPlanner(data) {
  checkBrowser(data);
  return data.templates ? ManyArmsPlanner.load(data) : PagePlanner.load(data);
}

/** Throws an error with the reason if this browser or this page cannot plan. */
function checkBrowser(data) {
  if (data.missing) throw new Error(data.missing);
  if (!data.modules) throw new Error("this page was opened without the planner's kernels");
  if (typeof WebAssembly !== "object") throw new Error("this browser has no WebAssembly");
  if (!WebAssembly.validate(SIMD_PROBE)) throw new Error("this browser has no WebAssembly SIMD");
  if (typeof DecompressionStream !== "function") throw new Error("this browser cannot decompress the planner");
}

/** A pose as numbers, if it is one. */
function checkedPose(name, pose) {
  if (pose.length !== 16) throw new TypeError(`a pose has 16 numbers, got ${pose.length}`);
  const plain = Float64Array.from(pose);
  if (!plain.every(Number.isFinite)) throw new TypeError(`the pose of ${name} is not finite`);
  return plain;
}

/** Converts 16 numbers from row-major to column-major order, and back. */
function transposed(pose) {
  return Float64Array.from({ length: 16 }, (_, i) => pose[4 * (i % 4) + (i >> 2)]);
}

const CLEARANCE_SAMPLES = 120; // of a motion, for its least clearance

/**
 * The least clearance [m] at some instants of the track of a result, and its time; clearance(q, most): that of the
 * columns of the track, `most` at most, which makes it faster.
 */
function leastClearanceOf(row, clearance) {
  const track = new Track({ ...row, columns: row.columns.map((_, j) => j) }), least = { value: Infinity, time: track.start };
  for (const time of track.instants(CLEARANCE_SAMPLES)) {
    const value = clearance(track.at(time, new Float64Array(row.columns.length)), least.value);
    if (value < least.value) Object.assign(least, { value, time });
  }
  return least;
}

class PagePlanner {
  /** See above. */
  static async load(data) {
    return PagePlanner.loadWith(data, await PageReferee.load(data.referee, data.modules));
  }

  /** A planner whose motions a given referee proves. */
  static async loadWith(data, referee) {
    const [module, image] = await Promise.all([data.modules.core, data.image].map(inflate));
    return new PagePlanner(data, await loadCore(module), image, referee);
  }

  #core;
  #memory; // content of the image, by name
  #data;
  #margin; // of the tables now [m]
  #poses; // of moved obstacles, by name
  #referee;

  report = () => {};

  constructor(data, core, image, referee) {
    this.#data = data;
    this.#referee = referee;
    this.#core = core;
    this.#memory = core.place(image);
    this.#poses = new Map(Object.entries(data.obstacles).map(([name, { pose }]) => [name, Float64Array.from(pose)]));
    this.columns = data.columns;
    this.joints = data.joints;
    this.obstacles = Object.keys(data.obstacles);
    this.frames = data.frames.map((frame) => frame.name);
    this.#keepMargin(0);
  }

  /** The data from which it was loaded. */
  get data() { return this.#data; }
  /** The kernels and the tables, for calls without a method here. */
  get core() { return this.#core; }
  get scene() { return this.#memory.scene; }
  get scratch() { return this.#memory.scratch; }
  get referee() { return this.#referee; }

  /** Limits of the columns: {velocity, acceleration}. */
  get rates() {
    const nq = this.columns.length, { velocity, acceleration } = this.#memory.rates;
    const of = (address) => new Float64Array(this.#core.buffer, address, nq).slice();
    return { velocity: of(velocity), acceleration: of(acceleration) };
  }

  // ---- collision -------------------------------------------------------------------------------

  isFree(q) {
    return this.edgeIsFree(q, q);
  }

  edgeIsFree(q0, q1) {
    this.#keepMargin(0);
    return this.#edgeIsFree(this.#checked(q0), this.#checked(q1));
  }

  contacts(q) {
    this.#keepMargin(0);
    const core = this.#core, { exact } = this.scene, found = new Map();
    core.scoped(() => {
      const pairs = core.array("int64_t", this.#memory.bare_padding.length);
      const count = core.call("rr1_find_contacts", exact, this.scratch.exact, this.#checked(q), pairs);
      for (const pair of pairs.values.subarray(0, count)) {
        const owner = this.#memory.pair_owner.values[Number(pair)];
        found.set(owner, this.#data.pairs[Number(owner)].map((element) => this.#data.elements[element]));
      }
    });
    return [...found.values()];
  }

  clearance(q, most = Infinity) {
    this.#keepMargin(0);
    return this.#clearance(this.#checked(q), Math.min(most, this.#data.reach ?? Infinity));
  }

  clearances(qs) {
    return Float64Array.from(qs, (q) => this.clearance(q));
  }

  leastClearance(track) {
    return leastClearanceOf(track, (q, most) => this.clearance(q, most));
  }

  withinLimits(q) {
    return this.outOfLimits(q).length === 0;
  }

  outOfLimits(q) {
    const { lower, upper } = this.#memory, [low, high] = [lower.values, upper.values], plain = this.#checked(q);
    return [...plain.keys()].filter((j) => !(low[j] <= plain[j] && plain[j] <= high[j]));
  }

  obstaclePose(name) {
    return transposed(this.#obstacle(name));
  }

  moveObstacle(name, pose) {
    this.#obstacle(name);
    const rows = transposed(checkedPose(name, pose));
    this.placeObjects(this.#data.obstacles[name].object, [rows]);
    this.#referee.moveObstacle(name, rows);
    this.#poses.set(name, rows);
  }

  /** Moves consecutive objects of the tables to poses, each 16 numbers, row-major. */
  placeObjects(first, poses) {
    if (!poses.length) return;
    const core = this.#core;
    core.scoped(() => {
      const rows = core.array("double", 16 * poses.length), { values } = rows;
      poses.forEach((pose, i) => values.set(pose, 16 * i));
      core.call("rr1_move_objects", this.scene, this.scratch, first, poses.length, rows);
    });
  }

  #obstacle(name) {
    const pose = this.#poses.get(name);
    if (!pose) throw new TypeError(`no obstacle ${name} can be moved, only ${this.obstacles.join(", ") || "none"}`);
    return pose;
  }

  #checked(q) {
    const plain = Float64Array.from(q);
    if (plain.length !== this.columns.length || !plain.every(Number.isFinite)) {
      throw new TypeError(`q is [${plain}], expected ${this.columns.length} finite numbers`);
    }
    return plain;
  }

  #edgeIsFree(q0, q1) {
    return this.#core.call("rr1_certify_edge", this.scene, this.scratch, q0, q1) === this.#core.constants.EDGE_FREE;
  }

  #clearance(q, most) {
    return this.#core.call("rr1_least_clearance", this.scene.exact, this.scratch.exact, q, most);
  }

  /** Changes the distance kept in addition to the padding [m]; the tables are valid for margins up to that of the image. */
  #keepMargin(margin) {
    if (margin === this.#margin) return;
    const { padding, bare_padding } = this.#memory;
    const kept = padding.values;
    let greatest = 0;
    bare_padding.values.forEach((bare, i) => {
      kept[i] = bare + margin;
      greatest = Math.max(greatest, kept[i]);
    });
    this.scene.max_padding = greatest;
    this.#margin = margin;
  }

  // ---- inverse kinematics ----------------------------------------------------------------------

  /**
   * Uses `attempts` initial guesses: q, then random ones from `seed`. The result equals that of
   * `solve_ik(..., seeds=q, attempts=attempts, max_solutions=1, rng=seed)`.
   */
  inverseKinematics(frame, target, q, { attempts = 1, seed = 0 } = {}) {
    const core = this.#core, start = this.#checked(q);
    const known = this.#data.frames.find(({ name, arm }) => name === frame || arm === frame);
    if (!known) throw new TypeError(`no frame ${frame}, only ${this.frames.join(", ")}`);
    if (target.length !== 3 && target.length !== 16) throw new TypeError("a target has 3 or 16 numbers");
    const { first, weight, tolerances, separations, near } = known, search = this.#memory[known.search];
    const nq = search.column_count, aim = core.at("IkTarget", search.target), rows = target.length === 16 && transposed(target);
    const position = rows ? [rows[3], rows[7], rows[11]] : target;
    aim.lower.set(position);
    aim.upper.set(position);
    if (rows) aim.rotation.set([0, 1, 2].flatMap((r) => [...rows.subarray(4 * r, 4 * r + 3)]));
    aim.weight = rows ? weight : 0;
    return core.scoped(() => {
      const numbers = (name) => new Float64Array(core.buffer, search[name], nq);
      const [lower, upper] = [numbers("lower").slice(), numbers("upper").slice()];
      const own = start.subarray(first, first + nq).map((value, j) => clamp(value, lower[j], upper[j]));
      const seeds = core.array("double", 2 * nq), preferred = core.array("double", own);
      seeds.values.set(own);
      Object.assign(search, { seeds, preferred, seed_count: 1, starts: 0, solution_count: 0, nearest_squared: Infinity });
      search.separation = separations[rows ? 1 : 0];
      let random = core.array("uint64_t", [BigInt.asUintN(64, BigInt(seed))]);
      const run = ([position_tolerance, orientation_tolerance]) => {
        Object.assign(search, { position_tolerance, orientation_tolerance });
        return core.call("rr1_search_ik", search, random, attempts);
      };
      let found = run(tolerances[0]);
      const [whole, turn] = tolerances[1];
      if (!found && search.nearest_squared <= near * (whole ** 2 + (aim.weight * turn) ** 2)) {
        const nearest = core.array("double", numbers("nearest").slice());
        core.call("rr1_descend", search.chain, search.target, nearest, nq, search.lower, search.upper, 60, search.memory + 8 * nq);
        seeds.values.set([...nearest.values, ...own]);
        Object.assign(search, { seed_count: 2, starts: 0 });
        found = run(tolerances[1]);
      }
      if (!found) return null;
      start.set(numbers("solutions"), first);
      return start;
    });
  }

  // ---- planning --------------------------------------------------------------------------------

  plan(start, goal, { seed = 0, iterations = 1e9, seconds = 2, margin = this.#data.margin, step = this.#data.tree_step } = {}) {
    const began = performance.now(), core = this.#core;
    [start, goal] = [this.#checked(start), this.#checked(goal)];
    if (!(margin >= 0 && margin <= this.#data.margin)) {
      throw new TypeError(`margin is ${margin}, expected 0 to ${this.#data.margin} m`);
    }
    const answer = {
      status: "found", reason: "", path: null, shortened: null, track: null, retiming: null, certified: false, fault: "",
      trees: [], margin: 0, iterations: 0, seconds: {},
    };
    let last = began;
    const stage = (name) => {
      const now = performance.now();
      answer.seconds[name] = (answer.seconds[name] ?? 0) + (now - last) / 1000;
      last = now;
    };
    return core.scoped(() => {
      answer.margin = this.#affordableMargin(start, goal, margin);
      const found = this.#searchWithMargin({ start, goal, seed: BigInt(seed), step }, iterations, began + 1000 * seconds, answer);
      stage("plan");
      if (!found) return answer;
      this.#keepMargin(answer.margin);
      answer.path = this.#asPath(found);
      this.report("shortening the path");
      const points = this.#shorten(found, BigInt(seed) ^ BigInt(this.#data.shortcuts.stream));
      answer.shortened = this.#asPath(points);
      stage("shorten");
      for (const method of ["blend", "stop"]) {
        this.#keepMargin(answer.margin);
        const motion = this.#retime(points, method);
        answer.retiming = method;
        answer.track = this.#asTrack(motion);
        stage("retime");
        this.report("proving the motion");
        answer.fault = this.#referee.findFault(motion, start, goal);
        answer.certified = answer.fault === "";
        stage("certify");
        if (answer.certified) break;
      }
      return answer;
    });
  }

  #asPath(points) {
    const nq = this.columns.length;
    return { columns: this.columns, waypoints: { values: points.slice(), shape: [points.length / nq, nq] } };
  }

  #asTrack({ breaks, coefficients, terms }) {
    const nq = this.columns.length;
    return {
      columns: this.columns,
      breaks: { values: breaks, shape: [breaks.length] },
      coefficients: { values: coefficients, shape: [coefficients.length / nq / terms, terms, nq] },
      exact: true,
      timed: true,
    };
  }

  /** The margin halved once, twice, ...: some times below the default, without the margin itself and zero. */
  #halves(margin) {
    const { "default": usual, halvings } = this.#data.margins, halves = [];
    for (let left = halvings; left; halves.push(margin)) {
      if (margin <= usual) left -= 1;
      margin *= 0.5;
    }
    return halves;
  }

  /** The margin, halved until the clearance of start and goal is twice as large; 0 if it never is. */
  #affordableMargin(start, goal, margin) {
    this.#keepMargin(margin);
    const clearance = margin + Math.min(this.#clearance(start, margin), this.#clearance(goal, margin));
    return [margin, ...this.#halves(margin)].find((part) => 2 * part <= clearance) ?? 0;
  }

  /** A path with the margin of the answer or, where that blocks, with a smaller one; or null, with the reason there. */
  #searchWithMargin(query, iterations, deadline, answer) {
    if (answer.margin === 0) return this.#search(query, iterations, deadline, answer);
    return this.#search(query, iterations, deadline, answer, (samples) => {
      const kept = answer.margin, most = Math.floor(samples / this.#data.margins.ratio);
      const brief = (margin) => this.#core.scoped(() => {
        const found = { ...answer, margin };
        const path = this.#search({ ...query, isBrief: true }, most, deadline, found);
        return path && { path, found };
      });
      let best = brief(0);
      for (const part of this.#halves(kept)) if (best && best.found.margin === 0) best = brief(part) ?? best;
      this.#keepMargin(kept);
      if (best) Object.assign(answer, best.found);
      return best && best.path;
    });
  }

  /**
   * The same with that margin alone. A pause is called with the number of samples after many of them, and may return a
   * path. A brief search does not report its samples.
   */
  #search({ start, goal, seed, step, isBrief = false }, iterations, deadline, answer, pause = null) {
    this.#keepMargin(answer.margin);
    const core = this.#core, { scene, scratch } = this, nq = this.columns.length;
    const { lower, upper, extent, can_move } = this.#memory;
    const near = core.array("double", nq), visible = core.array("int64_t", 1);
    const count = core.call(
      "rr1_check_endpoints", start, goal, 1, lower, upper, near, visible, scene, scratch,
    );
    if (count === 0) return this.#refuse(start, goal, answer);
    const goals = near.values.slice();
    if (goals.every((value, j) => value === start[j])) return goals;
    if (!can_move.values[0]) return this.#fail(answer, "infeasible", "no joint can move, and the start is not a goal");
    if (Number(visible.values[0]) === 0) return Float64Array.of(...start, ...goals);
    const query = core.struct("TreeQuery", { start: core.array("double", start), goals: near, lower, extent });
    Object.assign(query, {
      goal_count: 1, step, domain: this.#data.tree_domain, bound: Infinity,
    });
    const trees = core.struct("Trees", { column_count: nq, scratch: core.array("double", 6 * nq) });
    this.#giveRoom(trees, 1024);
    const random = core.array("uint64_t", [BigInt.asUintN(64, seed)]);
    const { SEARCH_SOLVED, SEARCH_FULL } = core.constants;
    let nextPause = pause ? this.#data.margins.samples : Infinity;
    for (let chunk = 128; ; chunk = Math.min(2 * chunk, 4096)) {
      if (trees.samples >= nextPause) {
        nextPause *= this.#data.margins.growth;
        const path = pause(trees.samples);
        if (path) return path;
      }
      const samples = Math.min(trees.samples + chunk, iterations, nextPause);
      const code = core.call("rr1_grow_trees", trees, query, random, samples, scene, scratch);
      answer.iterations = trees.samples;
      if (!isBrief) this.report(`${trees.samples.toLocaleString("en")} iterations`);
      const solved = code === SEARCH_SOLVED, over = trees.samples >= iterations || performance.now() >= deadline;
      if (solved || over) answer.trees = trees.sides.map((side) => this.#asTree(side, trees.capacity));
      if (solved) return new Float64Array(core.buffer, trees.path, trees.path_rows * nq).slice();
      if (code === SEARCH_FULL) this.#giveRoom(trees, 2 * trees.capacity);
      if (over) {
        const [ofStart, ofGoal] = trees.sides.map((side) => side.size);
        return this.#fail(answer, "timeout", `no path found after ${trees.samples} iterations; ` +
          `${ofStart} ${ofStart === 1 ? "configuration was" : "configurations were"} reached from the start, ` +
          `${ofGoal} from the goal`);
      }
    }
  }

  /** A tree, whose memory has one column of its vertices after the other. */
  #asTree({ size, vertices, parents, lengths }, capacity) {
    const nq = this.columns.length, values = new Float64Array(size * nq);
    for (let c = 0; c < nq; c++) {
      const column = new Float64Array(this.#core.buffer, vertices + 8 * c * capacity, size);
      for (let i = 0; i < size; i++) values[nq * i + c] = column[i];
    }
    const rows = new BigInt64Array(this.#core.buffer, parents, size), reach = new Float64Array(this.#core.buffer, lengths, size);
    return { vertices: { values, shape: [size, nq] }, parents: Array.from(rows, Number), lengths: reach.slice() };
  }

  #fail(answer, status, reason) {
    Object.assign(answer, { status, reason });
    return null;
  }

  #refuse(start, goal, answer) {
    for (const [name, q] of [["start", start], ["goal", goal]]) {
      const status = `invalid_${name}`;
      const outside = this.outOfLimits(q).map((j) => this.joints[j]).join(", ");
      if (outside) return this.#fail(answer, status, `the ${name} is out of limits: ${outside}`);
      if (this.isFree(q)) continue;
      const pairs = this.contacts(q).map(([a, b]) => `${a} and ${b}`).join(", ");
      return this.#fail(answer, status, `the ${name} is in collision: ${pairs || "too near to prove it free"}`);
    }
    return this.#fail(answer, "invalid_start", "start or goal are too near to something to prove them free");
  }

  /** Enlarges the arrays of trees and keeps their content. */
  #giveRoom(trees, capacity) {
    const core = this.#core, nq = this.columns.length, before = trees.capacity;
    const moved = (kind, Numbers, address, columns) => {
      const made = core.array(kind, columns * capacity);
      for (let c = 0; c < columns && before; c++) {
        const old = new Numbers(core.buffer, address + c * before * Numbers.BYTES_PER_ELEMENT, before);
        made.values.set(old, c * capacity);
      }
      return made;
    };
    for (const side of trees.sides) {
      side.vertices = moved("double", Float64Array, side.vertices, nq);
      side.parents = moved("int64_t", BigInt64Array, side.parents, 1);
      side.lengths = moved("double", Float64Array, side.lengths, 1);
      side.blocked = moved("uint8_t", Uint8Array, side.blocked, 1);
    }
    trees.path = core.array("double", 2 * capacity * nq);
    trees.capacity = capacity;
  }

  /** The path after random shortcuts. */
  #shorten(found, seed) {
    const core = this.#core, nq = this.columns.length, { tries, patience } = this.#data.shortcuts;
    const size = found.length / nq, capacity = size + 2 * tries;
    const points = core.array("double", capacity * nq);
    points.values.set(found);
    const path = core.struct("ShortcutPath", { points, column_count: nq, size });
    path.piece = core.array("double", capacity * nq);
    path.along = core.array("double", capacity);
    const random = core.array("uint64_t", [BigInt.asUintN(64, seed)]);
    while (!core.call("rr1_shorten", path, random, 128, tries, patience, this.scene, this.scratch));
    const shorter = points.values.slice(0, path.size * nq);
    const [before, after] = [found, shorter].map((rows) => core.call("rr1_polyline_length", rows, rows.length / nq, nq));
    return after <= before ? shorter : found;
  }

  /** The time-optimal motion along a path from rest to rest: breaks, and coefficients in time. */
  #retime(waypoints, method) {
    const core = this.#core, nq = this.columns.length, { duplicate } = this.#data.blends, { shortest_piece, step: time_step } = this.#data.timing;
    const rows = waypoints.length / nq, index = core.array("int64_t", rows);
    const corners = core.call("rr1_find_corners", waypoints, rows, nq, duplicate, index);
    const rest = { breaks: Float64Array.of(0), coefficients: waypoints.slice(0, nq), terms: 1 };
    if (corners === 1) return rest;
    const points = Float64Array.from({ length: corners * nq }, (_, i) =>
      waypoints[Number(index.values[Math.floor(i / nq)]) * nq + (i % nq)]);
    const sizes = method === "blend" ? this.#blendSizes(points) : new Float64Array(corners);
    const code = core.constants.ARENA_FULL;
    for (let room = 1 << 16, capacity = 256; ; room *= 4, capacity *= 4) {
      const durations = core.array("double", capacity), coefficients = core.array("double", capacity * 5 * nq);
      const arena = core.struct("Arena", { memory: core.array("double", room), size: room });
      const pieces = core.struct("TimedPieces", { durations, coefficients, capacity });
      const kind = core.call(
        "rr1_time_polyline", points, sizes, corners, nq, this.#memory.rates, time_step, duplicate, arena, pieces,
      );
      if (kind === code) continue;
      if (kind < code) throw new Error(`no speed before waypoint ${code - 1 - kind}`);
      const terms = kind === core.constants.TIMED_BENT ? 5 : 3, breaks = [0], kept = [];
      const [times, numbers] = [durations.values, coefficients.values];
      for (let i = 0; i < pieces.count; i++) {
        if (!(times[i] > shortest_piece)) continue;
        breaks.push(breaks[breaks.length - 1] + times[i]);
        kept.push(...numbers.subarray(5 * nq * i, 5 * nq * i + terms * nq));
      }
      if (!kept.length) return { ...rest, coefficients: numbers.slice(0, nq) };
      return { breaks: Float64Array.from(breaks), coefficients: Float64Array.from(kept), terms };
    }
  }

  /** The largest certified blend of each waypoint, 0 for a stop. */
  #blendSizes(points) {
    const core = this.#core, nq = this.columns.length, rows = points.length / nq;
    const { largest, reversal, smallest, halvings } = this.#data.blends;
    const sizes = core.array("double", rows), blend = core.array("double", 3 * nq);
    const length = core.call("rr1_largest_blends", points, rows, nq, largest, reversal, smallest, sizes);
    const certified = (i, size) => {
      for (let k = 0; k < halvings && size >= smallest * length; k++, size *= 0.5) {
        core.call("rr1_blend", points.subarray((i - 1) * nq, (i + 2) * nq), nq, size, blend);
        const status = core.call("rr1_certify_parabola", this.scene, this.scratch, blend, 3, 2 * size);
        if (status === core.constants.EDGE_FREE) return size;
      }
      return 0;
    };
    return sizes.values.slice().map((size, i) => (size > 0 ? certified(i, size) : 0));
  }}
