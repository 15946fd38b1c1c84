// Regions of the plane that the tool reaches in two ways, in one, in none, by the cells of the configuration space.

const [TWICE, ONCE] = data.own.colors;
const SIDE = 300;  // points along each side of the map

class ReachMap {
  constructor() {
    const { THREE } = viewer;
    this.space = viewer.panelData.cspace;
    this.canvas = element("canvas");
    this.canvas.width = this.canvas.height = SIDE;
    this.texture = new THREE.CanvasTexture(this.canvas);
    this.texture.encoding = THREE.sRGBEncoding;
    const { center, radius, height } = this.space.planar;
    this.span = 1.02 * radius;
    const material = new THREE.MeshBasicMaterial({ map: this.texture, transparent: true, depthWrite: false });
    this.plane = new THREE.Mesh(new THREE.PlaneGeometry(2 * this.span, 2 * this.span), material);
    // Below the arm, so that links and obstacles are not tinted.
    this.plane.position.set(center[0], center[1], height - 0.08 * this.span);
    this.plane.visible = false;
    viewer.add("reach", this.plane);
    this.corner = steps.corner("reach");
    this.corner.innerHTML = '<b></b><span><i class="twice"></i>reached in two ways</span><span><i class="once"></i>in one way</span><span><i class="never"></i>not at all</span>';
    this.ignored = null;
    this.reaching = null; // cells that reach each point of the map, see `measure`
    viewer.on("change", () => this.read());
    // The picture is repainted when its cells have changed; the map follows once they no longer change.
    const { repaint } = viewer.lesson;
    viewer.lesson.repaint = () => { repaint.call(viewer.lesson); clearTimeout(this.waiting); this.waiting = setTimeout(() => this.paint(), 80); };
  }

  /** Counts with all layers except those for which ignore(layer) is true; null hides the map. */
  show(ignore) {
    this.ignored = ignore;
    this.plane.visible = ignore !== null;
    this.paint();
    this.read();
  }

  /** Bits of the layers that count. */
  mask() {
    return this.space.layers.reduce((bits, layer, k) => (this.ignored(layer) ? bits : bits | (1 << k)), 0);
  }

  /** The cells of the configurations with the tool at a point: two, one or none. */
  cellsAt(x, y) {
    const { arm, cells } = viewer.lesson, { low, high } = this.space;
    return arm.flat.solutions(x, y).map((q) => cells.at(...q.map((v, axis) => (v - low[axis]) / (high[axis] - low[axis])))).filter((cell) => cell >= 0);
  }

  /** Number of ways in which the tool reaches a point. */
  count(x, y, mask) {
    const { bits } = viewer.lesson.cells;
    return this.cellsAt(x, y).filter((cell) => !(bits[cell] & mask)).length;
  }

  /** The cells for each point of the map, two numbers each (-1: none). */
  measure() {
    const { center } = this.space.planar, found = new Int32Array(2 * SIDE * SIDE).fill(-1);
    for (let j = 0; j < SIDE; j++) {
      for (let i = 0; i < SIDE; i++) {
        const x = center[0] + this.span * ((2 * i + 1) / SIDE - 1), y = center[1] + this.span * (1 - (2 * j + 1) / SIDE);
        found.set(this.cellsAt(x, y), 2 * (j * SIDE + i));
      }
    }
    return found;
  }

  paint() {
    if (!this.ignored) return;
    // Once, because they depend on the arm only.
    this.reaching ||= this.measure();
    const { reaching } = this, { bits } = viewer.lesson.cells, mask = this.mask();
    const pen = this.canvas.getContext("2d"), image = pen.createImageData(SIDE, SIDE), colors = { 1: hex(ONCE), 2: hex(TWICE) };
    const isOpen = (cell) => cell >= 0 && !(bits[cell] & mask);
    for (let point = 0; point < SIDE * SIDE; point++) {
      const solutions = isOpen(reaching[2 * point]) + isOpen(reaching[2 * point + 1]);
      if (!solutions) continue;
      // Hatched for one solution, so that no reader depends on colors.
      const stripe = solutions === 1 && ((point % SIDE) + Math.floor(point / SIDE)) % 9 < 2;
      image.data.set(stripe ? [190, 120, 40, 190] : [...colors[solutions], 190], 4 * point);
    }
    pen.putImageData(image, 0, 0);
    this.texture.needsUpdate = true;
    viewer.redraw();
  }

  /** Likewise for many points, with the active layers. */
  counts(points) {
    const mask = this.mask();
    return points.map(([x, y]) => this.count(x, y, mask));
  }

  /** Shows in how many ways the tool reaches its current position. */
  read() {
    if (!this.ignored) { this.corner.hidden = true; return; }
    this.corner.hidden = false;
    const { arm } = viewer.lesson, [x, y] = arm.flat.tool(this.space.columns.map((column) => viewer.q[column]));
    const ways = this.count(x, y, this.mask());
    this.corner.querySelector("b").textContent = `tool at (${placed(x, arm.outer)}, ${placed(y, arm.outer)}) m: ${["in no way", "in one way", "in two ways"][ways]}`;
  }
}

const hex = (color) => [1, 3, 5].map((k) => parseInt(color.slice(k, k + 2), 16));

const map = steps.map = new ReachMap();
const isLimit = (layer) => layer.kind === "limits";
steps.reset = () => map.show(null);
steps.on("solutions", () => map.show(() => true));
steps.on("limits", () => map.show((layer) => !isLimit(layer)));
steps.on("obstacles", () => map.show(() => false));
steps.on("question", () => map.show(() => false));
