// Frames, the other elbow, the columns of the Jacobian and the ellipses at the arm; |det J| in the configuration space.

const { own } = data, { THREE } = viewer, space = viewer.lesson, { flat } = space.arm;
const fixed = (v, digits = 3) => (Number.isFinite(v) ? (Math.abs(v) < 0.5 * 10 ** -digits ? 0 : v).toFixed(digits).replace("-", "−") : "∞");
const meters = (v, least) => placed(v, 2 * space.arm.outer, least);
const reading = (v, k) => (flat.kinds[k] === "P" ? `${meters(v)} m` : `${tenths(DEGREES * v)}°`);

class KinematicsDrawing {
  constructor() {
    this.shown = new Set();
    this.group = new THREE.Group();
    this.size = own.size; // scales the drawing
    this.makeFrames();
    this.makeTwin();
    this.columns = [own.colors.x, own.colors.y].map((color) => this.arrow(color));
    this.velocity = this.loop(own.colors.velocity, false);
    this.force = this.loop(own.colors.force, true);
    const [n, m] = [120, 120], { values } = viewer.unpack(own.map);
    this.paintMap(values, n, m);
    space.chart.overlays.push((pen) => this.drawMap(pen));
    viewer.add("kinematics", this.group);
    viewer.on("load", () => viewer.add("kinematics", this.group));
    viewer.on("change", () => this.follow());
    this.live = [...root.querySelectorAll("[data-live]")];
    this.legend = steps.corner("kinematics");
  }

  show(...names) {
    this.shown = new Set(names);
    const words = {
      twin: ["●", "#768394", "the other solution"],
      columns: ["→", own.colors.x, "joint 1 moves", "→", own.colors.y, "joint 2 moves"],
      velocity: ["—", own.colors.velocity, "velocity ellipse"],
      force: ["╌", own.colors.force, "force ellipse"],
      frames: ["→", own.colors.x, "x", "→", own.colors.y, "y"],
    };
    this.legend.replaceChildren();
    this.legend.hidden = true;
    for (const name of names) {
      const row = words[name] || [];
      for (let k = 0; k < row.length; k += 3) {
        const line = element("span"), mark = element("i", row[k]);
        mark.style.color = row[k + 1];
        line.append(mark, ` ${row[k + 2]}`);
        this.legend.append(line);
        this.legend.hidden = false;
      }
    }
    this.follow();
    space.chart.draw();
  }

  // ---- objects of the workspace ------------------------------------------------------------

  put(object) {
    object.renderOrder = 15;
    object.frustumCulled = false;
    this.group.add(object);
    return object;
  }

  material(color, more = {}) {
    return new THREE.MeshBasicMaterial({ color: new THREE.Color(color).convertSRGBToLinear(), depthTest: false, transparent: true, side: THREE.DoubleSide, ...more });
  }

  /** A flat arrow in the plane, from (x, y) along (dx, dy). */
  arrow(color) {
    const mesh = this.put(new THREE.Mesh(new THREE.BufferGeometry(), this.material(color)));
    mesh.set = (x, y, dx, dy) => {
      const long = Math.hypot(dx, dy), w = 0.013 * this.size, head = Math.min(0.09 * this.size, 0.6 * long);
      mesh.visible = long > 1e-9;
      if (!mesh.visible) return;
      const [u, v] = [dx / long, dy / long], at = (s, t) => [x + s * u - t * v, y + s * v + t * u, flat.height];
      const neck = long - head;
      const corners = [at(0, -w), at(neck, -w), at(neck, w), at(0, -w), at(neck, w), at(0, w), at(neck, -0.42 * head), at(long, 0), at(neck, 0.42 * head)];
      mesh.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(corners.flat()), 3));
    };
    return mesh;
  }

  /** A closed curve as a flat ribbon, optionally dashed. */
  loop(color, dashed) {
    const mesh = this.put(new THREE.Mesh(new THREE.BufferGeometry(), this.material(color)));
    const wide = 0.011 * this.size, count = 96;
    mesh.set = (points) => {
      const corners = [];
      for (let k = 0; k < count; k++) {
        if (dashed && k % 4 > 1) continue;
        const [x0, y0] = points(k / count), [x1, y1] = points((k + 1) / count), long = Math.hypot(x1 - x0, y1 - y0) || 1;
        const nx = (-wide * (y1 - y0)) / long, ny = (wide * (x1 - x0)) / long, z = flat.height;
        const [a, b, c, d] = [[x0 + nx, y0 + ny, z], [x0 - nx, y0 - ny, z], [x1 + nx, y1 + ny, z], [x1 - nx, y1 - ny, z]];
        corners.push(a, b, c, b, d, c);
      }
      mesh.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(corners.flat()), 3));
    };
    return mesh;
  }

  makeFrames() {
    this.frames = [0, 1, 2].map((k) => [this.arrow(own.colors.x), this.arrow(own.colors.y), this.put(nameTag(`{${k}}`, 0.13 * this.size))]);
  }

  /** Frames of base, first and second link, at their far ends: [x, y, heading]. */
  headings(q) {
    // The far end of the first link is where a second one that slides begins.
    const ends = [flat.places(flat.kinds[1] === "P" ? [q[0], 0] : q)[1], flat.places(q)[2]];
    const found = [[...flat.base.slice(0, 2), own.yaw]];
    let heading = own.yaw;
    [...flat.kinds].forEach((kind, k) => {
      if (kind === "R") heading += flat.senses[k] * q[k];
      found.push([...ends[k], heading]);
    });
    return found;
  }

  makeTwin() {
    const material = this.material("#5f6b7a", { opacity: 0.45 });
    this.twinBars = [0, 1].map(() => this.put(new THREE.Mesh(new THREE.PlaneGeometry(1, 1), material)));
    this.twinSpots = [0, 1].map(() => this.put(new THREE.Mesh(new THREE.CircleGeometry(0.045 * this.size, 32), material)));
  }

  // ---- kinematics ----------------------------------------------------------------------------

  /** Current joint values. */
  get q() { return viewer.panelData.cspace.columns.map((column) => viewer.q[column]); }

  /** The tool's velocity per joint velocity, rows x and y. */
  jacobian(q) {
    const [[a, c], [b, d]] = flat.columns(q);
    return [[a, b], [c, d]];
  }

  /** Singular values of a 2 x 2 matrix and the direction of the larger one. */
  axes([[a, b], [c, d]]) {
    const sum = (a * a + b * b + c * c + d * d) / 2, difference = (a * a + b * b - c * c - d * d) / 2, mixed = a * c + b * d;
    const spread = Math.hypot(difference, mixed);
    return { sizes: [Math.sqrt(sum + spread), Math.sqrt(Math.max(0, sum - spread))], turn: 0.5 * Math.atan2(mixed, difference) };
  }

  /** Whether both solutions for the tool's position coincide; a gantry has one. */
  isSingle(q) { return Math.abs(flat.side(q)) < 1e-4; }

  /** The other joint values with the same tool position, or null. */
  twin(q) {
    if (this.isSingle(q)) return null;
    const other = flat.twin(q);
    return flat.kinds === "RR" || !space.place(other).outside ? other : null;
  }

  // ---- elements that move with the arm ----------------------------------------------------------

  follow() {
    const { q } = this, points = flat.places(q), J = this.jacobian(q), tip = points[2], on = (name) => this.shown.has(name);
    const frames = this.headings(q);
    this.frames.forEach(([x, y, tag], k) => {
      const [px, py, turn] = frames[k], long = 0.26 * this.size, [c, s] = [Math.cos(turn), Math.sin(turn)];
      x.set(px, py, long * c, long * s);
      y.set(px, py, -long * s, long * c);
      tag.position.set(px - 0.1 * this.size * (c - s), py - 0.1 * this.size * (s + c), flat.height);
      x.visible = y.visible = tag.visible = on("frames");
    });
    const twin = this.twin(q), bars = twin && flat.places(twin);
    if (on("twin")) this.legend.hidden = !twin;
    this.twinBars.forEach((bar, k) => {
      bar.visible = on("twin") && Boolean(twin);
      if (!bar.visible) return;
      const [[x0, y0], [x1, y1]] = [bars[k], bars[k + 1]];
      bar.position.set((x0 + x1) / 2, (y0 + y1) / 2, flat.height);
      bar.rotation.z = Math.atan2(y1 - y0, x1 - x0);
      bar.scale.set(Math.hypot(x1 - x0, y1 - y0), 0.055 * this.size, 1);
    });
    this.twinSpots.forEach((spot, k) => { spot.visible = on("twin") && Boolean(twin); if (twin) spot.position.set(...bars[k + 1], flat.height); });
    const [speed, pull, columns] = own.scales;
    this.columns.forEach((arrow, k) => { arrow.set(...tip, columns[k] * J[0][k], columns[k] * J[1][k]); arrow.visible &&= on("columns"); });
    const { sizes, turn } = this.axes(J), far = 2.2 * this.size;
    const ellipse = (lengths) => (t) => {
      const [a, b] = [lengths[0] * Math.cos(2 * Math.PI * t), lengths[1] * Math.sin(2 * Math.PI * t)];
      return [tip[0] + a * Math.cos(turn) - b * Math.sin(turn), tip[1] + a * Math.sin(turn) + b * Math.cos(turn)];
    };
    this.velocity.set(ellipse(sizes.map((s) => speed * s)));
    this.force.set(ellipse(sizes.map((s) => Math.min(pull / Math.max(s, 1e-9), far))));
    this.velocity.visible = on("velocity");
    this.force.visible = on("force");
    this.write(q, points, J, sizes, frames, twin);
  }

  write(q, points, J, sizes, frames, twin) {
    const det = J[0][0] * J[1][1] - J[0][1] * J[1][0];
    const A = between(frames[0], frames[1]), B = between(frames[1], frames[2]), C = between(frames[0], frames[2]);
    const say = (v) => v && `(${v.map((x, k) => reading(x, k)).join(", ")})`;
    // Columns of revolute joints are lengths [m], those of prismatic joints have no unit.
    const turning = [...flat.kinds].filter((kind) => kind === "R").length, unit = ["", " m", " m²"][turning];
    const determinant = (v) => fixed(v, Math.max(3, 2 - Math.floor(Math.log10(own.largest || 1)))) + unit;
    const values = {
      x: `${meters(points[2][0])} m`, y: `${meters(points[2][1])} m`, det: determinant(det), w: determinant(Math.abs(det)),
      s1: meters(sizes[0]) + (turning === 2 ? " m" : ""), s2: meters(sizes[1]) + (turning === 2 ? " m" : ""),
      one: say(q), two: say(twin) || (this.isSingle(q) ? "the same" : "out of range"),
      q0: reading(q[0], 0), q1: reading(q[1], 1),
    };
    const isLength = (name, i, k) => (name === "J" ? flat.kinds[k] === "R" : k === 2 && i < 2);
    for (const [name, matrix] of Object.entries({ A, B, C, J })) matrix.forEach((row, i) => row.forEach((v, k) => { values[`${name}${i}${k}`] = isLength(name, i, k) ? meters(v, 2) : fixed(v, 2); }));
    for (const node of this.live) if (node.textContent !== values[node.dataset.live]) node.textContent = values[node.dataset.live];
  }

  // ---- the configuration space --------------------------------------------------------------------

  /** |det J| as shades: dark where it is small. */
  paintMap(values, n, m) {
    this.canvas = element("canvas");
    Object.assign(this.canvas, { width: n, height: m });
    const pen = this.canvas.getContext("2d"), image = pen.createImageData(n, m);
    const dark = [38, 62, 112], light = [250, 232, 150];
    for (let i = 0; i < n; i++) {
      for (let j = 0; j < m; j++) {
        const t = values[i * m + j] / (own.largest || 1), at = 4 * ((m - 1 - j) * n + i);
        for (let k = 0; k < 3; k++) image.data[at + k] = dark[k] + t * (light[k] - dark[k]);
        image.data[at + 3] = 255;
      }
    }
    pen.putImageData(image, 0, 0);
  }

  drawMap(pen) {
    const { chart } = space, { unit, plot: { x, y, size } } = chart;
    if (!this.shown.has("map")) return;
    pen.globalAlpha = 0.85;
    pen.drawImage(this.canvas, x, y, size, size);
    pen.globalAlpha = 1;
    for (const curve of own.singular) {
      pen.setLineDash([]); pen.strokeStyle = "#fff"; pen.lineWidth = 5.5 * unit;
      chart.trace(pen, curve);
      pen.setLineDash([7 * unit, 5 * unit]); pen.strokeStyle = "#d55e00"; pen.lineWidth = 3 * unit;
      chart.trace(pen, curve);
    }
    pen.setLineDash([]);
  }
}

/** The transform between two frames [x, y, heading] of the plane, rows of a 3 x 3 matrix. */
function between([ax, ay, a], [bx, by, b]) {
  const [c, s] = [Math.cos(a), Math.sin(a)], [dx, dy] = [bx - ax, by - ay];
  return [[Math.cos(b - a), -Math.sin(b - a), c * dx + s * dy], [Math.sin(b - a), Math.cos(b - a), -s * dx + c * dy], [0, 0, 1]];
}

/** A name that always faces the reader. */
function nameTag(text, tall) {
  const canvas = element("canvas"), pen = canvas.getContext("2d");
  Object.assign(canvas, { width: 96, height: 64 });
  Object.assign(pen, { font: `600 40px ${FONT}`, textAlign: "center", textBaseline: "middle", lineWidth: 8, lineJoin: "round", strokeStyle: "#fff", fillStyle: INK });
  pen.strokeText(text, 48, 34);
  pen.fillText(text, 48, 34);
  const map = new THREE.CanvasTexture(canvas);
  map.encoding = THREE.sRGBEncoding;
  const tag = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false }));
  tag.scale.set(1.5 * tall, tall, 1);
  return tag;
}

const kinematics = new KinematicsDrawing();
viewer.arm = kinematics;
steps.on("transforms", () => kinematics.show("frames"));
steps.on("dh", () => kinematics.show("frames"));
steps.on("inverse", () => kinematics.show("twin"));
steps.on("jacobian", () => kinematics.show("columns"));
steps.on("ellipses", () => kinematics.show("velocity", "force", "map"));
steps.on("singularities", () => kinematics.show("velocity", "map"));
