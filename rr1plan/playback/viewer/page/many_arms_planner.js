// A planner for pages of many arms: one arm moves after the other, while all others rest.
//
//   const planner = await ManyArmsPlanner.load(data)    data: from Python's `page_planner`, with the modules
//   planner.columns  .joints  .obstacles                as of a `PagePlanner`: all joints of the scene
//   planner.contacts(q)  .isFree(q)  .withinLimits(q)  .outOfLimits(q)   in the whole scene; contacts by the kernels of the referee
//   planner.clearance(q, most, arms)                    least clearance of some arms (indices; default: all) [m]
//   planner.obstaclePose(name)  .moveObstacle(name, pose)  .leastClearance(track)  .report(text)
//   planner.plan(start, goal, {seed, iterations, seconds})    arms whose start and goal differ move
//       as `PagePlanner.plan`, without trees, and all seconds are of `plan`; `legs`: for each arm that moves, in
//       order, {arm, from, answer}, where `answer` is that of the planner of its template (`arm_templates.py`), in the frame of its base
//
// A leg is the motion of `plan_motion(Problem(scene, start, goal, arms=[arm]), planner="rrt_connect", rng=seed)` in the
// scene with all other arms at their current configurations. The referee proves each leg in the whole scene.

const FAR_AWAY = Float64Array.of(1, 0, 0, 100, 0, 1, 0, 100, 0, 0, 1, 100, 0, 0, 0, 1); // row-major
const ROUNDED_JOINT = 1e-5; // [rad or m] largest rounding error of a shown configuration of an arm at rest
const QUICK = 2000; // iterations for an arm that may be blocked until others have moved

/** The inverse of a rigid transform, column-major. */
function rigidInverse(T) {
  const out = identity();
  for (let r = 0; r < 3; r++) {
    for (let c = 0; c < 3; c++) out[4 * c + r] = T[4 * r + c];
    out[12 + r] = -(T[4 * r] * T[12] + T[4 * r + 1] * T[13] + T[4 * r + 2] * T[14]);
  }
  return out;
}

class ManyArmsPlanner {
  /** See above. */
  static async load(data) {
    const { modules, referee, templates } = data;
    const proof = await PageReferee.load(referee, modules);
    const planner = new ManyArmsPlanner(data, proof);
    const loaded = templates.map((template) => PagePlanner.loadWith({ ...template, modules, obstacles: {} }, planner.#witness));
    planner.#templates = await Promise.all(loaded);
    return planner;
  }

  #data;
  #referee;
  #templates = [];
  #kinematics;
  #poses; // of the links of all arms
  #toBase; // T_base_world of each arm
  #obstacles; // T_world_object by name
  #standing = null; // configurations of all arms while one moves, and the index of that one
  #moving = -1;

  report = () => {};

  constructor(data, referee) {
    this.#data = data;
    this.#referee = referee;
    this.#kinematics = new Kinematics(data);
    this.#poses = new Float64Array(16 * this.#kinematics.links);
    this.#toBase = this.#kinematics.arms.map((arm) => rigidInverse(arm.base));
    this.#obstacles = new Map(Object.entries(data.obstacles).map(([name, pose]) => [name, Float64Array.from(pose)]));
    this.columns = data.columns;
    this.joints = data.joints;
    this.obstacles = Object.keys(data.obstacles);
  }

  /** The referee with the interface that the planner of a template needs, for the whole scene. */
  get #witness() {
    return {
      findFault: ({ breaks, coefficients, terms }, start, goal) => {
        const [from, to] = [start, goal].map((own) => this.#whole(own));
        return this.#referee.findFault({ breaks, coefficients: this.#widened(coefficients, terms), terms }, from, to);
      },
    };
  }

  get data() { return this.#data; }
  get referee() { return this.#referee; }

  // ---- configurations --------------------------------------------------------------------------

  isFree(q) {
    return this.contacts(q).length === 0;
  }

  contacts(q) {
    return this.#referee.contacts(this.#checked(q));
  }

  withinLimits(q) {
    return this.outOfLimits(q).length === 0;
  }

  outOfLimits(q) {
    const whole = this.#checked(q);
    return this.#kinematics.arms.flatMap((arm, i) => this.#template(i).outOfLimits(this.#own(arm, whole)).map((j) => arm.firstColumn + j));
  }

  clearance(q, most = Infinity, arms = this.#kinematics.arms.keys()) {
    const whole = this.#checked(q);
    let least = Math.min(most, this.#data.reach ?? Infinity);
    for (const i of arms) {
      this.#place(i, whole);
      least = this.#template(i).clearance(this.#own(this.#kinematics.arms[i], whole), least);
    }
    return least;
  }

  leastClearance(track) {
    let before = null;
    return leastClearanceOf(track, (q, most) => {
      // Arms that have not moved since the last instant have no less clearance than then, except from those that have.
      const moved = before ? this.#differing(before, q, 0) : undefined;
      before = q;
      return this.clearance(q, most, moved);
    });
  }

  obstaclePose(name) {
    const pose = this.#obstacles.get(name);
    if (!pose) throw new TypeError(`no obstacle ${name} can be moved, only ${this.obstacles.join(", ") || "none"}`);
    return pose.slice();
  }

  moveObstacle(name, pose) {
    this.obstaclePose(name);
    const plain = checkedPose(name, pose);
    this.#obstacles.set(name, plain);
    this.#referee.moveObstacle(name, transposed(plain));
  }

  #checked(q) {
    const plain = Float64Array.from(q);
    if (plain.length !== this.columns.length || !plain.every(Number.isFinite)) {
      throw new TypeError(`q has ${plain.length} numbers, expected ${this.columns.length} finite ones`);
    }
    return plain;
  }

  #template(i) {
    return this.#templates[this.#data.arms[i].template];
  }

  #own(arm, q) {
    return q.slice(arm.firstColumn, arm.firstColumn + arm.robot.names.length);
  }

  /** Moves obstacles and neighbors in the template of an arm to their poses at q. */
  #place(i, q) {
    const { arms } = this.#kinematics, rows = this.#data.arms, template = this.#data.templates[rows[i].template];
    const placed = identity(), part = identity();
    const objects = [...this.#obstacles.values()].map((pose) => {
      multiply(placed, 0, this.#toBase[i], 0, pose, 0);
      return transposed(placed);
    });
    for (const [kind, count] of template.neighbors) {
      const { parts } = this.#data.templates[kind], others = rows[i].near.filter((other) => rows[other].template === kind);
      for (const other of others) {
        this.#kinematics.forward(arms[other], q, this.#poses);
        for (const { link, pose } of parts) {
          multiply(part, 0, this.#poses, 16 * (arms[other].firstLink + link), pose, 0);
          multiply(placed, 0, this.#toBase[i], 0, part, 0);
          objects.push(transposed(placed));
        }
      }
      for (let k = parts.length * (count - others.length); k > 0; k--) objects.push(FAR_AWAY);
    }
    this.#template(i).placeObjects(template.first_object, objects);
  }

  // ---- planning --------------------------------------------------------------------------------

  plan(start, goal, { seed = 0, iterations = 1e9, seconds = 10 } = {}) {
    const [from, to] = [this.#checked(start), this.#checked(goal)], began = performance.now(), deadline = began + 1000 * seconds;
    const answer = {
      status: "found", reason: "", path: null, shortened: null, track: null, retiming: null, certified: false, fault: "",
      trees: [], margin: Infinity, iterations: 0, seconds: {}, legs: [],
    };
    for (const [name, q] of [["start", from], ["goal", to]]) {
      const touching = this.contacts(q).map(([a, b]) => `${a} and ${b}`).join(", ");
      const outside = this.outOfLimits(q).map((j) => this.joints[j]).join(", ");
      const wrong = touching ? `is in collision: ${touching}` : outside && `is out of limits: ${outside}`;
      if (wrong) return Object.assign(answer, { status: `invalid_${name}`, reason: `the ${name} ${wrong}` });
    }
    const now = from.slice();
    let waiting = this.#differing(from, to), reason = "", quick = waiting.length > 1;
    const total = waiting.length;
    while (waiting.length) {
      const left = waiting.filter((arm) => {
        const most = quick ? Math.min(QUICK, iterations) : iterations;
        const leg = this.#planArm(arm, now, to, { seed, iterations: most, seconds: (deadline - performance.now()) / 1000 });
        answer.iterations += leg.iterations;
        this.report(`${answer.legs.length + (leg.track ? 1 : 0)} of ${total} ${total === 1 ? "arm" : "arms"}`);
        if (!leg.track) {
          reason = leg.reason;
          return true;
        }
        answer.legs.push({ arm, from: now.slice(), answer: leg });
        const { firstColumn, robot } = this.#kinematics.arms[arm];
        now.set(to.subarray(firstColumn, firstColumn + robot.names.length), firstColumn);
        return false;
      });
      const stuck = left.length === waiting.length;
      waiting = left;
      if (!stuck) continue;
      if (!quick || performance.now() >= deadline) {
        const names = waiting.map((arm) => this.#kinematics.arms[arm].name).join(", ");
        return Object.assign(answer, { status: "timeout", reason: `while the other arms stand still, ${names}: ${reason}` });
      }
      quick = false;
    }
    answer.seconds.plan = (performance.now() - began) / 1000;
    return this.#joined(answer, from);
  }

  /** The arms whose configurations differ. */
  #differing(one, two, little = ROUNDED_JOINT) {
    const { arms } = this.#kinematics;
    return [...arms.keys()].filter((i) => this.#own(arms[i], one).some((value, j) => Math.abs(value - two[arms[i].firstColumn + j]) > little));
  }

  #planArm(i, q, goal, options) {
    const arm = this.#kinematics.arms[i], template = this.#template(i), ends = [q, goal].map((end) => this.#own(arm, end));
    this.#standing = q;
    this.#moving = i;
    this.#place(i, q);
    if (!ends.every((end) => template.isFree(end))) return { track: null, iterations: 0, reason: "another arm is in the way" };
    return template.plan(ends[0], ends[1], options);
  }

  /** A configuration of all arms, from that of the moving one. */
  #whole(own) {
    const q = this.#standing.slice();
    q.set(own, this.#kinematics.arms[this.#moving].firstColumn);
    return q;
  }

  /** Coefficients or waypoints of all columns, from those of the moving arm; higher powers of the others are zero. */
  #widened(coefficients, terms) {
    const arm = this.#kinematics.arms[this.#moving], nq = arm.robot.names.length, width = this.columns.length;
    const rows = coefficients.length / nq, out = new Float64Array(rows * width);
    for (let row = 0; row < rows; row++) {
      if (row % terms === 0) out.set(this.#standing, row * width);
      out.set(coefficients.subarray(row * nq, (row + 1) * nq), row * width + arm.firstColumn);
    }
    return out;
  }

  /** All legs as one motion. */
  #joined(answer, from) {
    const { legs } = answer, { columns } = this, width = columns.length;
    const most = Math.max(1, ...legs.map((leg) => leg.answer.track.coefficients.shape[1]));
    const parts = { path: [], shortened: [], breaks: [Float64Array.of(0)], coefficients: [] };
    for (const { arm, from: standing, answer: leg } of legs) {
      this.#standing = standing;
      this.#moving = arm;
      for (const name of ["path", "shortened"]) parts[name].push(this.#widened(leg[name].waypoints.values, 1));
      const { breaks, coefficients } = leg.track, [pieces, terms] = coefficients.shape;
      const wide = this.#widened(coefficients.values, terms), padded = new Float64Array(pieces * most * width);
      for (let i = 0; i < pieces; i++) padded.set(wide.subarray(i * terms * width, (i + 1) * terms * width), i * most * width);
      const last = parts.breaks.at(-1).at(-1);
      parts.breaks.push(breaks.values.slice(1).map((t) => last + t));
      parts.coefficients.push(padded);
    }
    if (!legs.length) for (const name of ["path", "shortened", "coefficients"]) parts[name].push(from.slice());
    const joined = (arrays) => {
      const out = new Float64Array(arrays.reduce((sum, array) => sum + array.length, 0));
      let at = 0;
      for (const array of arrays) { out.set(array, at); at += array.length; }
      return out;
    };
    const asPath = (values) => ({ columns, waypoints: { values, shape: [values.length / width, width] } });
    const breaks = joined(parts.breaks), coefficients = joined(parts.coefficients);
    const unproven = legs.find((leg) => !leg.answer.certified);
    return Object.assign(answer, {
      path: asPath(joined(parts.path)),
      shortened: asPath(joined(parts.shortened)),
      track: {
        columns, exact: true, timed: true, breaks: { values: breaks, shape: [breaks.length] },
        coefficients: { values: coefficients, shape: [coefficients.length / most / width, most, width] },
      },
      retiming: legs.length ? legs.at(-1).answer.retiming : "stop",
      certified: !unproven,
      fault: unproven ? unproven.answer.fault : "",
      margin: Math.min(...legs.map((leg) => leg.answer.margin)),
    });
  }
}
