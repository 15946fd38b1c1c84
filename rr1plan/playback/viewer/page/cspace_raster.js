// The images of obstacles, computed in the page by the same kernel as Python's grid (`kernels/raster.c`).

class LiveRaster {
  /** planner: a `PagePlanner`; image: the tables of the grid (`CSpaceRaster.memory_image`). */
  constructor(planner, image) {
    this.planner = planner;
    this.raster = planner.core.place(image).raster;
    this.cells = planner.core.array("uint8_t", data.size[0] * data.size[1]);
    this.half = [0, 1].map((axis) => (0.5 * (data.high[axis] - data.low[axis])) / data.size[axis]);
  }

  /** Sets the configuration of the arm, of which the two joints of the picture are replaced. */
  setConfiguration(q) {
    new Float64Array(this.planner.core.buffer, this.raster.configuration, q.length).set(q);
  }

  /** Cells in which the arm touches an obstacle (1), valid until the next call; whole: only cells entirely in contact, proven. */
  image(name, whole = false) {
    const { core, scene, scratch } = this.planner, [first, last] = data.live.ranges[name];
    core.call(
      "rr1_raster_pairs", scene.exact, scratch.exact, this.raster, first, last, 0, data.size[0], whole ? this.half : [0, 0], this.cells,
    );
    return this.cells.values;
  }
}
