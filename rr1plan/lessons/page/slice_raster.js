// Slices of a configuration space: two joints move, the others are fixed, and the kernels of the page's planner decide
// which cells are in contact (`kernels/raster.c`). Follows cspace_picture.js.

class SliceRaster {
  /**
   * layers: names and colors; layerOf: for each pair of solids the index of its layer, or -1 for ignored pairs.
   */
  constructor(planner, layers, layerOf, cells) {
    const { core } = planner, exact = core.at("ExactTables", planner.scene.exact);
    const { size } = core.declarations.structs.ExactPair, count = layerOf.length;
    const order = layerOf.map((_, k) => k).filter((k) => layerOf[k] >= 0).sort((a, b) => layerOf[a] - layerOf[b] || a - b);
    const pairs = core.array("ExactPair", order.length), padding = core.array("double", order.length);
    const bytes = new Uint8Array(core.buffer), paddings = new Float64Array(core.buffer, exact.padding, count);
    order.forEach((k, i) => {
      bytes.copyWithin(core.addressOf(pairs) + i * size, exact.pairs + k * size, exact.pairs + (k + 1) * size);
      padding.values[i] = paddings[k];
    });
    this.ranges = layers.map((_, layer) => [order.findIndex((k) => layerOf[k] === layer), order.filter((k) => layerOf[k] === layer).length]);
    Object.assign(this, { planner, core, layers, cells });
    this.axes = [core.array("double", cells), core.array("double", cells)];
    this.configuration = core.array("double", planner.columns.length);
    this.tables = core.struct("RasterTables", {
      first: this.axes[0], second: this.axes[1], configuration: this.configuration, pair_count: order.length, pairs, padding,
      directions: core.array("Vec3", order.length),
      open: core.array("int64_t", core.constants.RASTER_LEVELS * order.length),
    });
    this.tables.counts.set([BigInt(cells), BigInt(cells)]);
    this.out = core.array("uint8_t", cells * cells);
  }

  /** The layers that block each cell as bits, shape (cells, cells); q: all columns of the planner. */
  bits(columns, low, high, q) {
    const { core, cells, tables } = this, bits = new Uint32Array(cells * cells);
    tables.columns.set(columns.map(BigInt));
    this.configuration.values.set(q);
    for (const axis of [0, 1]) {
      const step = (high[axis] - low[axis]) / cells;
      this.axes[axis].values.forEach((_, i, all) => { all[i] = low[axis] + (i + 0.5) * step; });
    }
    const { exact } = this.planner.scene, scratch = this.planner.scratch.exact;
    this.ranges.forEach(([first, count], layer) => {
      if (!count) return;
      core.call("rr1_raster_pairs", exact, scratch, tables, first, first + count, 0, cells, [0, 0], this.out);
      this.out.values.forEach((hit, c) => { if (hit) bits[c] |= 1 << layer; });
    });
    return bits;
  }
}

/** Poses of the obstacles that can be moved in the page. */
const obstaclePoses = () => (viewer.planner ? viewer.planner.obstacles.flatMap((name) => [...viewer.planner.obstaclePose(name)]) : []);

/** Cells for `Square`, from bits of layers. */
function cellsOf(bits, count) {
  return Object.assign(Object.create(Cells.prototype), { n: count, m: count, bits, labels: new Uint8Array(bits.length) });
}
