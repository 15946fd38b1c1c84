// A picture of two joints into which a lesson draws: cells, axes, and a pointer. Follows cspace_picture.js.

const FREE = "#14855a", OPEN = "#e08a00", TOUCH = "#c2255c", BLUE = "#2f66c8";

/** A canvas as wide as its parent element, sharp on every screen. */
class Sketch {
  constructor(canvas, aspect, draw) {
    Object.assign(this, { canvas, aspect, draw, pen: canvas.getContext("2d") });
    onResize(canvas.parentElement, () => this.resize());
  }

  resize() {
    const wide = this.canvas.parentElement.clientWidth, ratio = fineness(), large = magnification();
    if (!wide || (wide === this.wide && ratio === this.ratio)) return;
    Object.assign(this, { wide, ratio });
    this.unit = ratio * large * clamp(wide / large / 480, 0.85, 1.5);
    this.canvas.width = Math.round(wide * this.ratio);
    this.canvas.height = Math.round(this.canvas.width * this.aspect);
    this.canvas.style.height = `${this.canvas.height / this.ratio}px`;
    this.laid();
  }

  laid() { this.redraw(); }

  redraw() {
    if (!this.wide) return;
    this.pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.draw(this.pen, this.unit);
  }

  /** Makes the canvas fit a square with room for its axes: `plot`, in pixels. */
  makePlot() {
    const { unit } = this, left = Math.round(38 * unit), below = Math.round(25 * unit), rim = Math.round(8 * unit);
    const size = this.canvas.width - left - rim;
    this.plot = { x: left, y: rim, size };
    this.canvas.height = rim + size + below;
    this.canvas.style.height = `${this.canvas.height / this.ratio}px`;
  }

  font(size, weight = 400) {
    this.pen.font = `${weight} ${size * this.unit}px ${FONT}`;
  }

  /** Text that is readable on every background. */
  write(text, x, y, { color = INK, size = 12, weight = 600, align = "center", base = "middle" } = {}) {
    const { pen } = this;
    this.font(size, weight);
    Object.assign(pen, { textAlign: align, textBaseline: base, lineJoin: "round", lineWidth: 4 * this.unit, strokeStyle: "rgba(255,255,255,.94)", fillStyle: color });
    pen.strokeText(text, x, y);
    pen.fillText(text, x, y);
  }
}

/** The square of two joints; `draw` draws over the cells, in pixels from `at(u, v)`. */
class Square extends Sketch {
  constructor(canvas, draw) {
    super(canvas, 1, () => this.drawAll(draw));
  }

  laid() {
    this.makePlot();
    this.show(this.cells);
  }

  /** Shows other cells. */
  show(cells) {
    this.cells = cells;
    if (!this.plot || !cells) return;
    const { size } = this.plot, area = element("canvas");
    area.width = area.height = size;
    area.getContext("2d").putImageData(cells.paint(size, this.ratio, false, -1), 0, 0);
    this.area = area;
    this.redraw();
  }

  drawAll(draw) {
    if (!this.plot) return;
    const { pen, plot, unit } = this;
    if (this.area) pen.drawImage(this.area, plot.x, plot.y);
    pen.save();
    pen.beginPath();
    pen.rect(plot.x, plot.y, plot.size, plot.size);
    pen.clip();
    draw(pen, unit);
    pen.restore();
    drawFrame(pen, plot, unit);
  }

  at(u, v) {
    const { x, y, size } = this.plot;
    return [x + u * size, y + (1 - v) * size];
  }

  /** The position of a configuration in the picture. */
  of(q) { return this.at(share(0, q[0]), share(1, q[1])); }

  /** Joint values under the pointer. */
  under(event) {
    const box = this.canvas.getBoundingClientRect(), { x, y, size } = this.plot, { ratio } = this;
    return [value(0, ((event.clientX - box.left) * ratio - x) / size), value(1, 1 - ((event.clientY - box.top) * ratio - y) / size)];
  }

  /** A line through configurations, drawn in every copy of the square that it enters. */
  line(points) {
    for (const copy of wrappedCopies(points.map((q) => [share(0, q[0]), share(1, q[1])]))) {
      this.pen.beginPath();
      copy.forEach(([u, v], k) => (k ? this.pen.lineTo(...this.at(u, v)) : this.pen.moveTo(...this.at(u, v))));
      this.pen.stroke();
    }
  }

  /** Calls mark(x, y) for every visible copy of a configuration. */
  mark(q, mark) {
    const shares = [0, 1].map((axis) => share(axis, wrapped(axis, q[axis])));
    for (const [u, v] of copiesNear(shares)) mark(...this.at(u, v));
  }
}

/** Shows a sentence below the pictures, in the colors of its tone. */
function showVerdict(words, tone, animated = false) {
  const text = root.querySelector(".verdict");
  announce(text, words, animated);
  for (const name of ["good", "bad", "open"]) text.classList.toggle(name, name === tone);
}

/** Buttons, one of which is pressed; pick(name) is called with its name. */
function choices(box, names, pick) {
  const buttons = names.map(([name, text, title]) => {
    const button = element("button", text, "chip");
    button.title = title || "";
    button.dataset.choice = name;
    button.onclick = () => pick(name);
    return button;
  });
  box.replaceChildren(...buttons);
  return (name) => buttons.forEach((b) => b.setAttribute("aria-pressed", String(b.dataset.choice === name)));
}

/** Frames a part of the plane from above, [[x, y], [x, y]], until the user rotates the view; returns f(another part). */
function lookFromAbove(view, height) {
  const { THREE, stage } = viewer;
  stage.key.intensity = 0.42;
  const look = () => {
    const [low, high] = view;
    const box = new THREE.Box3(new THREE.Vector3(...low, height), new THREE.Vector3(...high, height));
    Object.assign(viewer.extent, { framed: cornersOf(box), whole: box, target: null });
    viewer.look(viewer.preferred || [0, 0, 1]);
  };
  look();
  viewer.on("load", look);
  const follow = () => { if (!stage.turned) look(); };
  new ResizeObserver(follow).observe(stage.pane);
  return (other) => { view = other; follow(); };
}
