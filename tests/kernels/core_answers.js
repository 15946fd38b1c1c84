// Questions to core.wasm, run by `test_core_wasm.py` in Node and in a page.

/** Sizes, offsets and sizes of fields as the compiler has them, and as they are declared. */
export function layouts(core) {
  const declared = [];
  const sizes = { double: 8, float: 4, int64_t: 8, uint64_t: 8, int16_t: 2, int8_t: 1, uint8_t: 1, f64x8: 64 };
  for (const { size, fields } of Object.values(core.declarations.structs)) {
    declared.push(size);
    for (const [kind, offset, count, pointer] of Object.values(fields)) {
      declared.push(offset, pointer ? 4 : count * (sizes[kind] ?? core.declarations.structs[kind].size));
    }
  }
  const compiled = new BigInt64Array(core.buffer, core.addressOf("rr1_layout"), declared.length + 1);
  return [Array.from(compiled, Number), [...declared, -1]];
}

/** Sines and cosines of angles, by one of the kernels. */
export function sines(core, name, angles) {
  const out = [0, 1].map(() => core.array("double", angles.length));
  core.call(name, angles, angles.length, ...out);
  return out.map((part) => part.values);
}

/** The cells of ranges of pairs, one after the other, once objects have been moved. */
export function raster(core, image, tables, ranges, half, moves) {
  const { scene, scratch } = core.place(image), { raster } = core.place(tables), [n, m] = Array.from(raster.counts, Number);
  for (const [object, pose] of moves) core.call("rr1_move_objects", scene, scratch, object, 1, pose);
  return ranges.map(([first, last]) => {
    const cells = core.array("uint8_t", n * m);
    core.call("rr1_raster_pairs", scene.exact, scratch.exact, raster, first, last, 0, n, half, cells);
    return Float64Array.from(cells.values);
  });
}

/** Status, fraction and pair of each edge, begin and end one after the other, once objects have been moved. */
export function edges(core, image, ends, moves = []) {
  const { scene, scratch } = core.place(image);
  for (const [object, pose] of moves) core.call("rr1_move_objects", scene, scratch, object, 1, pose);
  const nq = scene.column_count, count = ends.length / nq / 2;
  const answers = new Float64Array(3 * count);
  for (let i = 0; i < count; i++) {
    const [q0, q1] = [2 * i, 2 * i + 1].map((k) => ends.subarray(k * nq, (k + 1) * nq));
    const status = core.call("rr1_certify_edge", scene, scratch, q0, q1);
    answers.set([status, scratch.result.fraction, scratch.result.pair], 3 * i);
  }
  return answers;
}

/** The same of parabolas; each is three coefficients of all columns. */
export function parabolas(core, image, curves) {
  const { scene, scratch } = core.place(image);
  const size = 3 * scene.column_count, count = curves.length / size;
  const answers = new Float64Array(3 * count);
  for (let i = 0; i < count; i++) {
    const status = core.call("rr1_certify_parabola", scene, scratch, curves.subarray(i * size, (i + 1) * size), 3, 1);
    answers.set([status, scratch.result.fraction, scratch.result.pair], 3 * i);
  }
  return answers;
}

/** The path of RRT-Connect, and that path after random shortcuts. */
export function plan(core, image, problem) {
  const { scene, scratch } = core.place(image);
  const nq = scene.column_count, capacity = 4096;
  const { start, goals, lower, extent, step, domain } = problem;
  const query = core.struct("TreeQuery", { start, goals, lower, extent, step, domain });
  query.goal_count = goals.length / nq;
  query.bound = Infinity;
  const path = core.array("double", 2 * capacity * nq);
  const trees = core.struct("Trees", { column_count: nq, capacity, path, scratch: core.array("double", 6 * nq) });
  for (const side of trees.sides) {
    side.vertices = core.array("double", nq * capacity);
    side.parents = core.array("int64_t", capacity);
    side.lengths = core.array("double", capacity);
    side.blocked = core.array("uint8_t", capacity);
  }
  const random = core.array("uint64_t", [problem.seed]);
  const code = core.call("rr1_grow_trees", trees, query, random, 20000, scene, scratch);
  if (code !== core.constants.SEARCH_SOLVED) throw new Error(`the trees do not meet: ${code}`);
  const found = path.values.slice(0, trees.path_rows * nq);
  return [found, shorten(core, core.place(image), found, problem)];
}

function shorten(core, { scene, scratch }, waypoints, { iterations, patience, shortcut_seed }) {
  const nq = scene.column_count, rows = waypoints.length / nq, capacity = rows + 2 * iterations;
  const points = core.array("double", capacity * nq);
  points.values.set(waypoints);
  const path = core.struct("ShortcutPath", { points, column_count: nq, size: rows });
  path.piece = core.array("double", capacity * nq);
  path.along = core.array("double", capacity);
  const random = core.array("uint64_t", [shortcut_seed]);
  while (!core.call("rr1_shorten", path, random, 128, iterations, patience, scene, scratch));
  return points.values.slice(0, path.size * nq);
}

/**
 * Recorded calls once more (`recorded_calls.py`): results, numbers in structs, and bytes of arrays, filled up to eights.
 *
 * Arguments are numbers or names of things in the call's own image, or in that of a scene.
 */
export function replay(core, image, calls) {
  const world = image.length ? core.place(image) : {};
  return calls.map(({ kernel, image, given, numbers, arrays }) =>
    core.scoped(() => {
      const named = { ...world, ...core.place(image) };
      const result = core.call(kernel, ...given.map((one) => (typeof one === "string" ? named[one] : one)));
      const values = numbers.map(([name, fields]) => Float64Array.from(fields, (field) => named[name][field]));
      const parts = arrays.map(([name, field, size]) => {
        const address = field ? named[name][field] : core.addressOf(named[name]);
        const part = new Uint8Array(8 * Math.ceil(size / 8));
        part.set(new Uint8Array(core.buffer, address, size));
        return new Float64Array(part.buffer);
      });
      return [Float64Array.of(result), ...values, ...parts];
    }),
  );
}

/** The messages of errors, each of another wrong call. */
export function errors(core, image) {
  const { scene, scratch } = core.place(image);
  const other = new TextDecoder("latin1").decode(image).replace(/"digest":"./, '"digest":"-');
  const calls = {
    function: () => core.call("rr1_nothing"),
    count: () => core.call("rr1_certify_edge", scene, scratch),
    struct: () => core.call("rr1_certify_edge", scratch, scene, [0, 0], [0, 0]),
    missing: () => core.call("rr1_certify_edge", scene, scratch, [0, 0], undefined),
    number: () => core.call("rr1_sine_cosine", new Float32Array(2), 2, core.array("double", 2), core.array("double", 2)),
    array: () => core.call("rr1_draw_uniform", core.array("int64_t", 1)),
    rows: () => core.call("rr1_certify_edge", [1, 2], scratch, [0, 0], [0, 0]),
    field: () => core.struct("Trees", { capacities: 1 }),
    pointer: () => core.struct("Trees", { path: core.array("float", 1) }),
    kind: () => core.array("Nothing", 1),
    image: () => core.place(new Uint8Array(10)),
    stale: () => core.place(Uint8Array.from(other, (letter) => letter.charCodeAt(0))),
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

/** Whether memory that is taken in `scoped` and by arguments of calls is free again, and zero when taken anew. */
export function memory(core) {
  const grown = () => core.scoped(() => core.array("double", 1e5).values.fill(1).byteOffset);
  const places = new Set([grown(), grown()]);
  const size = core.buffer.byteLength;
  for (let i = 0; i < 100; i++) core.call("rr1_sine_cosine", new Float64Array(1e4), 0, null, null);
  const clean = core.array("double", 1e5).values.every((number) => number === 0);
  return [places.size, core.buffer.byteLength === size, clean];
}
