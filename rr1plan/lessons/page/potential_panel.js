// Potential fields over the configuration space, computed in the page for its present obstacles, start and goal as in
// potential_field.py. On the page it is RR1.potential:
//
//   potential.show(mode, striped)   "attraction", "repulsion", "sum", "fill" (best-first search) or "wave"; striped: cells
//                                   from which the descent does not end at the goal
//   potential.go(k)                 the arm at the k-th cell of the way;  potential.at, potential.length
//   potential.play()                go on from there, or stop

const PATH = "#d55e00", TITLES = { attraction: "Attraction", repulsion: "Repulsion", sum: "Sum", fill: "Fill", wave: "Wave" };
const LOW = [33, 61, 112], HIGH = [250, 232, 150], BANDS = 16;
const part = (selector) => root.querySelector(selector);

class PotentialField extends Walk {
  constructor() {
    super();
    this.space = viewer.lesson;
    this.at = 0;
    this.mode = "attraction";
    this.striped = false;
    [this.gain, this.reach] = data.usual;
    this.wire();
    this.canvas = element("canvas");
    // Cells change when an obstacle is dragged; start and goal are compared whenever the picture is drawn.
    const { repaint } = this.space;
    this.space.repaint = () => { this.stale = true; repaint.call(this.space); };
    this.stale = true;
    this.space.chart.overlays.push((pen) => this.draw(pen));
    viewer.on("change", () => { if (this.playing && viewer.origin !== "potential") this.stop(); });
    viewer.films.push(() => ({ start: 0, end: 4, show: (t) => { this.stop(); this.go(Math.round((t / 4) * this.length)); } }));
  }

  // ---- controls ----------------------------------------------------------------------------

  wire() {
    for (const [mode, title] of Object.entries(TITLES)) {
      const chip = element("button", title, "chip");
      chip.dataset.mode = mode;
      chip.onclick = () => this.show(mode, this.striped && mode === "sum");
      part(".modes").append(chip);
    }
    part(".play").onclick = () => this.play();
    for (const button of root.querySelectorAll("[data-move]")) button.onclick = () => this.walk(Number(button.dataset.move));
    part(".at").oninput = () => { this.stop(); this.go(Number(part(".at").value)); };
    part(".gain").max = data.gains.length - 1;
    part(".reach").max = data.reaches.length - 1;
    part(".gain").oninput = () => this.choose(data.gains[part(".gain").value], this.reach);
    part(".reach").oninput = () => this.choose(this.gain, data.reaches[part(".reach").value]);
    viewer.keys.add("Potential field", [
      { keys: [" ", "p"], text: "Descend, or pause", act: () => this.play() },
      { keys: [",", "."], text: "One cell back or on", act: ({ key }) => this.walk(key === "." ? 1 : -1) },
    ]);
  }

  show(mode, striped = false) {
    this.stop();
    Object.assign(this, { mode, striped, at: 0, stale: true });
    for (const chip of part(".modes").children) chip.setAttribute("aria-pressed", String(chip.dataset.mode === mode));
    this.refresh();
    this.go(0);
  }

  choose(gain, reach) {
    this.stop();
    Object.assign(this, { gain, reach, stale: true });
    this.refresh();
    this.go(0);
  }

  get length() { return this.way.length - 1; }

  /** Cells per second: the whole way in four seconds, or less. */
  get rate() { return Math.max(12, this.length / 4); }

  get verb() { return "Descend"; }

  go(k) {
    this.at = k;
    this.tell();
    viewer.setQ(withColumns(viewer.q, viewer.panelData.cspace.columns, this.way[k] || this.ends[0]), "potential");
    this.space.chart.draw();
  }

  tell() {
    const slider = part(".at"), length = Math.max(this.length, 0);
    Object.assign(slider, { max: length, value: this.at });
    showValue(slider, part(".count"), `${this.at} / ${length}`);
    const knob = (name, values, value, text, on) => {
      const input = part(name);
      Object.assign(input, { value: values.indexOf(value), disabled: !on });
      input.parentElement.classList.toggle("off", !on);
      showValue(input, input.parentElement.querySelector("output"), text);
    };
    const repels = ["repulsion", "sum", "fill"].includes(this.mode);
    knob(".gain", data.gains, this.gain, String(Number(this.gain.toPrecision(2))), repels);
    knob(".reach", data.reaches, this.reach, `${Number(placed(this.reach, 2 * data.scale, 2))}${data.unit}`, repels);
    announce(part(".said"), this.say(), this.playing && this.at < this.length);
  }

  /** What the way ends in. */
  say() {
    const cells = this.length === 1 ? "1 cell" : `${this.length} cells`;
    if (!this.way.length) return "The cell of the start is blocked: move the start, or the obstacle.";
    if (this.mode === "fill") {
      const visited = `${this.visited} of ${this.free} free cells visited`;
      return this.arrives ? `Reaches the goal: a way of ${cells}, ${visited}.` : `No way to the goal on this grid, ${visited}.`;
    }
    if (this.mode === "wave" && !Number.isFinite(this.values[this.start])) return "The wave does not come to the start: no path exists on this grid.";
    const end = this.arrives ? `Reaches the goal after ${cells}.` : `Ends in a minimum after ${cells}, ${placed(this.gap, 2 * data.scale, 2)}${data.unit} from the goal.`;
    return this.mode === "repulsion" ? `Ends where nothing repels, after ${cells}: no goal attracts.` : `${end} From ${(100 * this.share).toFixed(0)} % of the free cells the descent ends at the goal.`;
  }

  // ---- the field -----------------------------------------------------------------------------

  /** Computes everything again if cells, start, goal or options have changed. */
  refresh() {
    const { start, goals } = viewer.panelData.cspace, key = JSON.stringify([start, goals[0]]);
    if (!this.stale && key === this.key) return;
    Object.assign(this, { stale: false, key, ends: [start, goals[0]] });
    this.coarsen();
    const [from, to] = this.ends.map((q) => this.cell(q));
    Object.assign(this, { start: from, goal: to });
    this.values = this.potential();
    this.next = this.downhill();
    this.basins = this.drained();
    const free = this.blocked.filter((b) => !b).length;
    this.free = free;
    this.share = this.basins.filter((end) => end === to).length / Math.max(free, 1);
    const cells = this.blocked[from] ? [] : this.mode === "fill" ? this.fill() : this.descend();
    this.way = cells.map((cell, k) => (k ? this.center(cell) : start));
    const last = cells[cells.length - 1];
    this.arrives = last === to;
    if (this.arrives) this.way.push(this.ends[1]);
    this.gap = cells.length ? Math.sqrt(2 * this.attraction(last)) : 0;
    this.at = Math.min(this.at, Math.max(this.length, 0));
    this.paint();
    this.tell();
  }

  /** Cells of 3 x 3 cells of the picture; blocked if one of them is. */
  coarsen() {
    const { n, m, bits } = this.space.cells, { low, high } = viewer.panelData.cspace, f = data.finer;
    this.n = Math.floor(n / f);
    this.m = Math.floor(m / f);
    this.sides = [0, 1].map((axis) => (f * (high[axis] - low[axis])) / [n, m][axis]);
    this.blocked = new Uint8Array(this.n * this.m);
    for (let i = 0; i < this.n * f; i++) for (let j = 0; j < this.m * f; j++) if (bits[i * m + j]) this.blocked[Math.floor(i / f) * this.m + Math.floor(j / f)] = 1;
    this.allowed = data.moves.map((move) => this.blocked.map((_, cell) => Number(!this.blocked[cell] && this.isOpen(cell, move))));
  }

  center(cell) {
    const { low } = viewer.panelData.cspace;
    return [Math.floor(cell / this.m), cell % this.m].map((k, axis) => low[axis] + this.sides[axis] * (k + 0.5));
  }

  cell(q) {
    const { low, periodic } = viewer.panelData.cspace;
    return this.neighbor(0, q.map((v, axis) => {
      const sides = (v - low[axis]) / this.sides[axis], last = [this.n, this.m][axis];
      // The upper limit of a joint is in the last cell.
      return !periodic[axis] && Math.abs(sides - last) <= 1e-9 ? last - 1 : Math.floor(sides + 1e-9);
    }));
  }

  /** The cell after a move, or -1 outside the picture. */
  neighbor(cell, [di, dj]) {
    const { periodic } = viewer.panelData.cspace, { n, m } = this;
    let i = Math.floor(cell / m) + di, j = (cell % m) + dj;
    if (periodic[0]) i = ((i % n) + n) % n;
    if (periodic[1]) j = ((j % m) + m) % m;
    return i >= 0 && j >= 0 && i < n && j < m ? i * m + j : -1;
  }

  /** Whether a move stays in free cells; diagonal moves cut no corner. */
  isOpen(cell, [di, dj]) {
    return [[di, dj], [di, 0], [0, dj]].every((move) => { const there = this.neighbor(cell, move); return there >= 0 && !this.blocked[there]; });
  }

  potential() {
    if (this.mode === "wave") return this.wave();
    const repels = this.mode !== "attraction", attracts = this.mode !== "repulsion", pushed = repels ? this.repulsion() : null;
    return Float64Array.from(this.blocked, (blocked, cell) => (blocked ? (repels ? Infinity : this.attraction(cell)) : (attracts ? this.attraction(cell) : 0) + (repels ? pushed[cell] : 0)));
  }

  attraction(cell) {
    if (cell === this.goal) return 0;
    const { periodic } = viewer.panelData.cspace, turn = 2 * Math.PI;
    const [a, b] = this.center(cell).map((v, axis) => {
      const d = v - this.ends[1][axis];
      return periodic[axis] ? ((((d + Math.PI) % turn) + turn) % turn) - Math.PI : d;
    });
    return 0.5 * (a * a + b * b);
  }

  /** Repulsion in every cell: the nearest blocked cell is sought at growing distances. */
  repulsion() {
    const [a, b] = this.sides, offsets = [], [wide, tall] = [Math.ceil(this.reach / a), Math.ceil(this.reach / b)];
    for (let i = -wide; i <= wide; i++) for (let j = -tall; j <= tall; j++) {
      const rho = Math.sqrt((a * i) ** 2 + (b * j) ** 2);
      if (rho > 0 && rho < this.reach) offsets.push([rho, [i, j]]);
    }
    offsets.sort((one, two) => one[0] - two[0]);
    return Float64Array.from(this.blocked, (blocked, cell) => {
      if (blocked) return Infinity;
      const found = offsets.find(([, move]) => { const there = this.neighbor(cell, move); return there >= 0 && this.blocked[there]; });
      return found ? 0.5 * this.gain * (1 / found[0] - 1 / this.reach) ** 2 : 0;
    });
  }

  wave() {
    const values = new Float64Array(this.n * this.m).fill(Infinity);
    let front = this.blocked[this.goal] ? [] : [this.goal];
    for (let step = 0; front.length; step++) {
      const following = [];
      for (const cell of front) values[cell] = step;
      for (const cell of front) for (let k = 0; k < 4; k++) {
        if (!this.allowed[k][cell]) continue;
        const there = this.neighbor(cell, data.moves[k]);
        if (values[there] === Infinity) { values[there] = step + 1; following.push(there); }
      }
      front = following;
    }
    return values;
  }

  /** For each cell its lowest neighbor, or the cell itself. */
  downhill() {
    return Int32Array.from(this.values, (value, cell) => {
      let best = this.blocked[cell] ? Infinity : value, target = cell;
      data.moves.forEach((move, k) => {
        if (!this.allowed[k][cell]) return;
        const there = this.neighbor(cell, move);
        if (this.values[there] < best) { best = this.values[there]; target = there; }
      });
      return target;
    });
  }

  /** For each free cell the minimum at which the descent ends, -1 in blocked cells. */
  drained() {
    const ends = new Int32Array(this.next.length).fill(-1);
    for (let cell = 0; cell < ends.length; cell++) {
      if (this.blocked[cell]) continue;
      const way = [];
      let at = cell;
      while (ends[at] < 0 && this.next[at] !== at) { way.push(at); at = this.next[at]; }
      const end = ends[at] < 0 ? at : ends[at];
      ends[at] = end;
      for (const one of way) ends[one] = end;
    }
    return ends;
  }

  descend() {
    const cells = [this.start];
    while (this.next[cells[cells.length - 1]] !== cells[cells.length - 1]) cells.push(this.next[cells[cells.length - 1]]);
    return cells;
  }

  /** Best-first search: the way to the goal, or to the last cell visited. */
  fill() {
    const parents = new Map([[this.start, -1]]), heap = [this.start], lower = (a, b) => this.values[a] < this.values[b] || (this.values[a] === this.values[b] && a < b);
    this.visits = [];
    let cell = this.start;
    while (heap.length) {
      cell = pop(heap, lower);
      this.visits.push(cell);
      if (cell === this.goal) break;
      data.moves.forEach((move, k) => {
        if (!this.allowed[k][cell]) return;
        const there = this.neighbor(cell, move);
        if (parents.has(there)) return;
        parents.set(there, cell);
        push(heap, there, lower);
      });
    }
    this.visited = this.visits.length;
    const cells = [];
    for (let at = cell; at >= 0; at = parents.get(at)) cells.push(at);
    return cells.reverse();
  }

  // ---- drawing -------------------------------------------------------------------------------

  /** Free cells in bands of equal potential, dark where it is low. */
  paint() {
    const { n, m, values } = this, pen = this.canvas.getContext("2d"), scale = 4, visited = new Set(this.mode === "fill" ? this.visits : []);
    Object.assign(this.canvas, { width: n * scale, height: m * scale });
    const image = pen.createImageData(n * scale, m * scale), [a, b] = this.sides;
    let top = 0;
    for (let cell = 0; cell < values.length; cell++) {
      const value = this.mode === "repulsion" || this.mode === "wave" ? values[cell] : this.attraction(cell);
      if (!this.blocked[cell] && value < Infinity) top = Math.max(top, value);
    }
    if (this.mode === "repulsion") top = Math.min(top, 0.5 * this.gain * Math.max(1 / (2 * Math.min(a, b)) - 1 / this.reach, 0) ** 2 || top);
    for (let cell = 0; cell < values.length; cell++) {
      if (this.blocked[cell]) continue;
      const known = values[cell] < Infinity, share = top ? Math.min(values[cell] / top, 1) : 0, t = Math.min(Math.floor(BANDS * share), BANDS - 1) / (BANDS - 1);
      const color = known ? LOW.map((low, k) => low + t * (HIGH[k] - low)) : [255, 255, 255];
      const marked = visited.has(cell), lost = this.striped && this.basins[cell] !== this.goal;
      const i = Math.floor(cell / m) * scale, j = (m - 1 - (cell % m)) * scale;
      for (let x = 0; x < scale; x++) for (let y = 0; y < scale; y++) {
        const at = 4 * ((j + y) * n * scale + i + x);
        const stripe = lost && (i + x + j + y) % 12 < 4, dot = marked && x > 0 && x < 3 && y > 0 && y < 3;
        const [red, green, blue] = stripe ? [120, 20, 60] : dot ? [255, 255, 255] : color;
        image.data.set([red, green, blue, known || stripe ? 225 : 120], at);
      }
    }
    pen.putImageData(image, 0, 0);
  }

  /** Minima that end the descent from many cells. */
  minima() {
    const sizes = new Map();
    for (const end of this.basins) if (end >= 0 && end !== this.goal) sizes.set(end, (sizes.get(end) || 0) + 1);
    return [...sizes].filter(([, size]) => size >= 30).map(([cell]) => cell);
  }

  draw(pen) {
    this.refresh();
    const { space: { chart } } = this, { unit, plot: { x, y, size } } = chart;
    pen.save();
    pen.imageSmoothingEnabled = false;
    pen.drawImage(this.canvas, x, y, size, size);
    pen.lineJoin = pen.lineCap = "round";
    const trail = [];
    for (const q of this.way.slice(0, this.at + 1)) trail.push(trail.length ? chart.near(trail[trail.length - 1], q) : q);
    if (trail.length > 1) {
      pen.strokeStyle = "#fff"; pen.lineWidth = 6 * unit; chart.trace(pen, trail);
      pen.strokeStyle = PATH; pen.lineWidth = 3 * unit; chart.trace(pen, trail);
    }
    if (["attraction", "sum"].includes(this.mode)) for (const cell of this.minima()) chart.around(chart.shares(this.center(cell)), (px, py) => rimmedCross(pen, px, py, 5 * unit, INK, 2.4 * unit));
    pen.restore();
  }
}

/** A binary heap in an array, the lowest first. */
function push(heap, item, lower) {
  let k = heap.push(item) - 1;
  for (let up = (k - 1) >> 1; k > 0 && lower(item, heap[up]); k = up, up = (k - 1) >> 1) heap[k] = heap[up];
  heap[k] = item;
}

function pop(heap, lower) {
  const [first] = heap, last = heap.pop();
  if (!heap.length) return first;
  let k = 0;
  for (;;) {
    let child = 2 * k + 1;
    if (child >= heap.length) break;
    if (child + 1 < heap.length && lower(heap[child + 1], heap[child])) child += 1;
    if (!lower(heap[child], last)) break;
    heap[k] = heap[child];
    k = child;
  }
  heap[k] = last;
  return first;
}

viewer.potential = new PotentialField();
viewer.potential.show("attraction");
