// Questions to a page's planner, run by `test_page_planner.py` in Node and in pages.

const TABLE = Uint32Array.from({ length: 256 }, (_, value) => {
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value;
});

/** Checksum of the bytes of numbers, as that of zlib. */
function crc32(values) {
  let sum = 0xffffffff;
  for (const byte of new Uint8Array(values.buffer, values.byteOffset, values.byteLength)) {
    sum = TABLE[(sum ^ byte) & 255] ^ (sum >>> 8);
  }
  return (sum ^ 0xffffffff) >>> 0;
}

const packed = ({ values }) => [values.length, crc32(values)];

/** Motions for rounds of questions: moves of obstacles, then starts and goals, the seeds one after the other. */
function motions(planner, rounds, iterations) {
  let seed = 0;
  return rounds.map(({ moves, questions }) => {
    for (const [name, pose] of moves) planner.moveObstacle(name, pose);
    return questions.map(([start, goal]) => {
      const found = planner.plan(start, goal, { seed: seed++, iterations, seconds: 1e3 });
      const { status, reason, margin, path, shortened, track, certified } = found;
      if (!path) return { status, reason, margin };
      const parts = [path.waypoints, shortened.waypoints, track.breaks, track.coefficients].map(packed);
      return { status, reason, margin, certified, parts };
    });
  });
}

/** What is in contact in configurations, whether they are free, and how far from contact. */
function configurations(planner, moves, rows) {
  for (const [name, pose] of moves) planner.moveObstacle(name, pose);
  return rows.map((q) => [planner.isFree(q), planner.contacts(q), planner.clearance(q), planner.withinLimits(q)]);
}

/** Whether edges between consecutive configurations are free. */
function edges(planner, rows) {
  return rows.slice(1).map((q, i) => planner.edgeIsFree(rows[i], q));
}

/** Configurations that bring a frame to targets. */
function solutions(planner, targets) {
  return targets.map(([frame, target, q, seed]) => {
    const found = planner.inverseKinematics(frame, target, q, { attempts: 20, seed });
    return found && [...found];
  });
}

/** The numbers of iterations that a planner reports. */
function progress(planner, start, goal, iterations) {
  const found = [];
  planner.report = (text) => found.push(Number(text.replace(",", "").replace(" iterations", "")));
  planner.plan(start, goal, { iterations, seconds: 1e3 });
  return found.filter(Number.isFinite);
}

/** Faults that the referee finds in motions that were changed by hand. */
function faults(planner, start, goal) {
  const { track } = planner.plan(start, goal, { seed: 1 });
  const terms = track.coefficients.shape[1];
  const motion = (change) => {
    const made = { breaks: track.breaks.values.slice(), coefficients: track.coefficients.values.slice(), terms };
    change(made);
    return planner.referee.findFault(made, start, goal);
  };
  return {
    none: motion(() => {}),
    numbers: motion(({ coefficients }) => { coefficients[0] = NaN; }),
    fast: motion(({ breaks }) => { breaks.forEach((time, i) => { breaks[i] = time / 2; }); }),
    start: motion(({ coefficients }) => { coefficients[0] += 1e-6; }),
  };
}

/** The messages of errors. */
function errors(planner) {
  const q = planner.columns.map(() => 0), identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  const calls = {
    short: () => planner.isFree([0]),
    finite: () => planner.plan(q, q.map(() => NaN)),
    obstacle: () => planner.moveObstacle("nothing", identity),
    pose: () => planner.moveObstacle(planner.obstacles[0], identity.slice(4)),
    nan: () => planner.moveObstacle(planner.obstacles[0], identity.map(() => NaN)),
    frame: () => planner.inverseKinematics("nothing", [0, 0, 0], q),
    target: () => planner.inverseKinematics(planner.frames[0], [0, 0], q),
    margin: () => planner.plan(q, q, { margin: 1 }),
  };
  return Object.fromEntries(Object.entries(calls).map(([name, call]) => {
    try {
      call();
      return [name, "no error"];
    } catch (error) {
      return [name, error.message];
    }
  }));
}

/** Motions of arms one after the other: who moves, the parts of each leg, and the whole. */
function inTurn(planner, moves, questions) {
  for (const [name, pose] of moves) planner.moveObstacle(name, pose);
  return questions.map(({ start, goal, seed, iterations }) => {
    const { status, reason, certified, legs, track } = planner.plan(start, goal, { seed, iterations, seconds: 1e3 });
    const parts = legs.map(({ arm, answer: { path, shortened, track: own } }) => (
      [arm, [path.waypoints, shortened.waypoints, own.breaks, own.coefficients].map(packed)]));
    const motion = track && [track.breaks, track.coefficients].map(({ values, shape }) => ({ values: [...values], shape }));
    return { status, reason, certified, parts, motion };
  });
}

const names = (planner) => [...new Set(planner.joints.map((joint) => joint.split("/")[0]))];

/** What touches in configurations of many arms, and the clearance of each arm. */
function amongOthers(planner, rows) {
  return rows.map((q) => [planner.contacts(q), names(planner).map((_, arm) => planner.clearance(q, Infinity, [arm]))]);
}

const answers = { motions, progress, configurations, edges, solutions, faults, errors, inTurn, amongOthers };
