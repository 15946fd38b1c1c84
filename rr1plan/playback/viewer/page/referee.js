// The referee in the page: `validate` for a motion, by the kernels of `referee.wasm`, which share no code with the planners'.
//
//   const referee = await PageReferee.load(data, modules)    data: from Python's `referee_image`, with the image
//   referee.contacts(q)                                      [[element, element], ...] in contact, or too near to decide
//   referee.moveObstacle(name, rows)                         T_world_object, 16 numbers, row-major
//   referee.findFault(motion, start, goal)                   why a motion is not proven; empty if it is proven
//       motion: {breaks, coefficients, terms}; start and goal: its required first and last configurations
//
// A motion is proven if it has no contact in continuous time, keeps the limits of position, velocity and acceleration
// between samples too, neither jumps nor kinks, and goes from rest at the start to rest at the goal.

// Tolerance for reaching start and goal [rad or m].
const SAME = 1e-9;
// Intervals of the search between two checks of its findings.
const INTERVALS = 512;

class PageReferee {
  static async load(data, modules) {
    const [module, image] = await Promise.all([modules.referee, data.image].map(inflate));
    return new PageReferee(data, await loadCore(module), image);
  }

  #core;
  #memory;
  #data;
  #pristine; // the bytes of a search before it begins
  #block = null; // memory of searches, which need not be zero

  constructor(data, core, image) {
    this.#data = data;
    this.#core = core;
    this.#memory = core.place(image);
    this.#pristine = this.#bytes(this.#memory.search, "RefereeSearch").slice();
  }

  #bytes(struct, kind) {
    return new Uint8Array(this.#core.buffer, this.#core.addressOf(struct), this.#core.declarations.structs[kind].size);
  }

  moveObstacle(name, rows) {
    const core = this.#core, { obstacle_model, obstacle_shapes, obstacle_frames, obstacle_poses } = this.#memory;
    obstacle_poses.values.set(rows, 16 * this.#data.obstacles.indexOf(name));
    const bodies = core.at("RefereeBodies", obstacle_model.bodies);
    // Only sizes depend on poses; the rows of bodies contain more than the kernel writes.
    core.scoped(() => core.call(
      "rr1_fill_bodies", obstacle_shapes, obstacle_frames, obstacle_poses, obstacle_model.element_bodies,
      obstacle_model.element_count, core.array("RefereeBody", bodies.body_count), bodies.sizes,
    ));
  }

  findFault(motion, start, goal) {
    return this.#search(motion, (search, times, numbers) => (
      this.#judge(search, times, numbers, start, goal) || this.#describe(this.#marked(search).next().value)
    )) ?? "the numbers make no motion";
  }

  contacts(q) {
    const found = this.#search({ breaks: Float64Array.of(0), coefficients: q, terms: 1 }, (search) => [...this.#marked(search)]);
    return found.map(({ pair }) => pair);
  }

  /** The result of a function on the search for a motion; null if the numbers do not define a motion. */
  #search({ breaks, coefficients, terms }, find) {
    const core = this.#core, search = this.#memory.search, nq = Number(search.column_count);
    const pieces = coefficients.length / terms / nq;
    this.#bytes(search, "RefereeSearch").set(this.#pristine);
    Object.assign(search, { break_count: breaks.length, piece_count: pieces, terms });
    const size = core.call("rr1_size_search", search) / 8;
    if (!this.#block || this.#block.length < size) this.#block = core.array("double", 2 * size);
    return core.scoped(() => {
      const times = core.array("double", breaks), numbers = core.array("double", coefficients);
      if (!core.call("rr1_makes_motion", times, breaks.length, numbers, pieces, terms, nq, this.#data.farthest)) return null;
      Object.assign(search, { breaks: times, coefficients: numbers });
      return find(search, times, numbers);
    });
  }

  /** The violation of limits, continuity, rest, start or goal, if any. */
  #judge(search, times, numbers, start, goal) {
    const core = this.#core, c = core.constants;
    const { break_count, piece_count, terms, column_count: nq } = search;
    const peaks = core.array("Peaks", 4 * nq), jumps = core.array("Jump", 3 * nq), end = core.array("double", 4 * nq);
    const scratch = core.array("double", terms * (c.EXTREMES_DEPTH + 24 + 4 * terms));
    core.call("rr1_find_extremes", times, break_count, numbers, piece_count, terms, nq, peaks, jumps, end, scratch);
    const tightest = core.array("Tightest", c.TIGHTEST_ROWS), allowed = core.array("double", 3 * nq);
    const flaws = core.call(
      "rr1_judge_columns", break_count, numbers, piece_count, terms, nq, peaks, jumps, end, this.#memory.limits,
      tightest, allowed, core.array("int64_t", nq),
    );
    const limits = this.#memory.limits.values;
    // For joints without position limits, whole turns do not count.
    const turn = (j) => (limits[c.LIMIT_UPPER * nq + j] - limits[c.LIMIT_LOWER * nq + j] === Infinity ? 2 * Math.PI : Infinity);
    const differ = (one, two, turns) => one.some((value, j) => {
      const by = value - two[j], whole = turns ? Math.round(by / turn(j)) : 0;
      return !(Math.abs(whole ? by - whole * turn(j) : by) <= SAME);
    });
    const first = numbers.values.subarray(0, nq), last = end.values.subarray(0, nq);
    const faults = [
      [flaws & (c.FLAW_ABOVE | c.FLAW_BELOW), "a joint leaves its position limits"],
      [flaws & c.FLAW_VELOCITY, "a joint exceeds its velocity limit"],
      [flaws & c.FLAW_ACCELERATION, "a joint exceeds its acceleration limit"],
      [flaws & (c.FLAW_POSITION_JUMP | c.FLAW_VELOCITY_JUMP), "a joint jumps"],
      [flaws & (c.FLAW_START | c.FLAW_END), "the motion does not begin and end at rest"],
      [differ(first, start, false), "the motion does not begin at the start"],
      [differ(last, goal, true), "the motion does not end at the goal"],
    ];
    return faults.find(([wrong]) => wrong)?.[1] ?? "";
  }

  /** The pairs in contact in continuous time, or undecided, in the order in which they are found: {pair, touches}. */
  *#marked(search) {
    const core = this.#core, { size } = core.declarations.structs.ElementPair;
    core.call("rr1_begin_search", search, this.#block);
    while (search.stage !== core.constants.SEARCH_DONE) {
      core.call("rr1_prove_motion", search, INTERVALS);
      for (let k = 0; k < search.marked_count; k++) {
        const { a, b, mark } = core.at("ElementPair", search.marked + k * size);
        yield { pair: [a, b].map((element) => this.#data.elements[element]), touches: mark === core.constants.PAIR_TOUCHES };
      }
      search.marked_count = 0;
    }
  }

  #describe(found) {
    return found ? `${found.pair.join(" and ")} ${found.touches ? "touch" : "come too near to tell from contact"}` : "";
  }
}
