// The planar arm in its workspace: the ring it reaches, and where its joints must be for the tool to be somewhere.

const turn = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));

class Workspace {
  constructor() {
    const { stage } = viewer;
    this.turned = false;
    this.usual = stage.key.intensity;
  }

  /** Takes in the lengths of the arm, and makes a view without cards, lit so that obstacles look like their images. */
  prepare() {
    const { stage } = viewer, planar = Boolean(data.planar);
    document.body.classList.toggle("lesson", planar);
    this.readout ||= this.makeReadout();
    this.readout.box.hidden = !planar;
    stage.key.intensity = planar ? 0.42 : this.usual;
    if (!planar) return;
    const { bars, senses } = data.planar;
    this.lengths = bars.map(([x, y]) => Math.hypot(x, y));
    this.rest = bars.map(([x, y]) => Math.atan2(y, x));
    this.senses = senses;
    this.outer = this.lengths[0] + this.lengths[1];
    this.inner = Math.abs(this.lengths[0] - this.lengths[1]);
  }

  /** The bend at the elbow, its sign says which of the two solutions this is. */
  bend(q) {
    return turn(this.senses[1] * q[1] + this.rest[1] - this.rest[0]);
  }

  /** Joint values that put the tool at a point of the plane, bent to one side; the nearest point when it is out of reach. */
  solve(x, y, side) {
    const [a, b] = this.lengths;
    const dx = x - data.planar.base[0], dy = y - data.planar.base[1];
    const far = Math.min(Math.max(Math.hypot(dx, dy), this.inner), this.outer);
    const bend = side * Math.acos(Math.min(Math.max((far * far - a * a - b * b) / (2 * a * b), -1), 1));
    const first = Math.atan2(dy, dx) - Math.atan2(b * Math.sin(bend), a + b * Math.cos(bend)) - this.rest[0];
    return [this.senses[0] * turn(first), this.senses[1] * turn(bend - this.rest[1] + this.rest[0])];
  }

  /** The other joint values with the tool where it is. */
  twin(q) {
    const [x, y] = this.tool(q);
    return this.solve(x, y, this.bend(q) >= 0 ? -1 : 1);
  }

  /** Where base, elbow and tool are. */
  places(q) {
    const first = this.senses[0] * q[0] + this.rest[0], second = first + this.bend(q), [a, b] = this.lengths;
    const [x, y] = data.planar.base, elbow = [x + a * Math.cos(first), y + a * Math.sin(first)];
    return [[x, y], elbow, [elbow[0] + b * Math.cos(second), elbow[1] + b * Math.sin(second)]];
  }

  tool(q) {
    return this.places(q)[2];
  }

  /** How well the tool can be moved in all directions, |det J| (Yoshikawa 1985) [m2], and the most it can be. */
  manipulability(q) {
    const [a, b] = this.lengths;
    return [a * b * Math.abs(Math.sin(this.bend(q))), a * b];
  }

  /** The ring the tool reaches, and a handle on the tool. */
  draw() {
    const { THREE } = viewer;
    if (!data.planar) {
      for (const name of ["ring", "names", "handle", "selected", "way"]) viewer.add(name, new THREE.Group());
      return;
    }
    const { base, height } = data.planar;
    const group = new THREE.Group();
    const flat = (geometry, color, opacity) => new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color, opacity, transparent: true, depthWrite: false, side: THREE.DoubleSide }));
    const fine = 0.004 * this.outer;
    group.add(flat(new THREE.RingGeometry(this.inner, this.outer, 128), 0x4a74ad, 0.09));
    for (const r of [this.inner, this.outer]) if (r > 0) group.add(flat(new THREE.RingGeometry(r - fine, r + fine, 128), 0x4a74ad, 0.5));
    group.position.set(base[0], base[1], height);
    viewer.add("ring", group);
    const names = new THREE.Group();
    this.tags = new Map();
    for (const { name, color, place } of data.planar.names) {
      const tag = this.nameTag(name, color, place);
      this.tags.set(name, { tag, place });
      names.add(tag);
    }
    viewer.add("names", names);
    this.handle = flat(new THREE.RingGeometry(0.042 * this.outer, 0.054 * this.outer, 48), 0xe4500e, 0.85);
    this.handle.material.depthTest = false;
    this.handle.renderOrder = 10;
    viewer.add("handle", this.handle);
  }

  /** An obstacle's name on it, so that no reader depends on colors. */
  nameTag(name, color, place) {
    const { THREE } = viewer, canvas = document.createElement("canvas"), height = 64;
    const font = `600 ${0.66 * height}px ${getComputedStyle(root).fontFamily}`;
    let pen = canvas.getContext("2d");
    pen.font = font;
    Object.assign(canvas, { width: Math.ceil(pen.measureText(name).width) + 16, height });
    pen = canvas.getContext("2d");
    Object.assign(pen, { font, textAlign: "center", textBaseline: "middle", lineJoin: "round", lineWidth: 8 });
    pen.strokeStyle = isLight(color) ? "#fff" : color;
    pen.fillStyle = isLight(color) ? INK : "#fff";
    pen.strokeText(name, canvas.width / 2, height / 2);
    pen.fillText(name, canvas.width / 2, height / 2);
    const map = new THREE.CanvasTexture(canvas);
    map.encoding = THREE.sRGBEncoding;
    const tag = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false }));
    const tall = 0.075 * this.outer;
    tag.scale.set((tall * canvas.width) / height, tall, 1);
    tag.position.set(...place);
    tag.renderOrder = 12;
    return tag;
  }

  follow(q) {
    const [x, y] = this.tool(q), [now, most] = this.manipulability(q), meters = (v) => `${v.toFixed(3)} m`.replace("-", "−");
    this.handle.position.set(x, y, data.planar.height);
    const rows = [meters(x), meters(y), `${now.toFixed(3)} m²`, this.lengths.map((v) => `${v.toFixed(2)} m`).join(", ")];
    this.readout.values.forEach((out, k) => { out.textContent = rows[k]; });
    this.readout.bar.style.width = `${(100 * now) / most}%`;
  }

  /** Tool, link lengths and manipulability, in a corner of the workspace. */
  makeReadout() {
    const box = make("dl", undefined, "readout"), bar = make("i"), values = [];
    box.setAttribute("aria-label", "Tool, links and manipulability");
    for (const name of ["tool x", "tool y", "manipulability", "links"]) {
      const out = make("dd");
      values.push(out);
      out.className = name;
      box.append(make("dt", name, name), out);
      if (name === "manipulability") {
        out.title = "|det J|, Yoshikawa’s measure: 0 where the arm is stretched or folded, most with the elbow at a right angle";
        const meter = make("dd", undefined, "meter");
        meter.append(bar);
        box.append(meter);
      }
    }
    const hint = make("dd", "Drag obstacles, links and the tool", "hint");
    hint.hidden = true;
    box.append(hint);
    document.getElementById("stage").append(box);
    return { box, bar, values, hint };
  }

  /** A line around an obstacle that is selected, or none. */
  outline(loops, [x, y]) {
    const { THREE } = viewer, group = new THREE.Group(), wider = 1.1;
    for (const loop of loops) {
      const points = [...loop, loop[0]].map(([u, v]) => new THREE.Vector3(x + wider * u, y + wider * v, data.planar.height));
      const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineDashedMaterial({ color: 0x1b2430, dashSize: 0.025 * this.outer, gapSize: 0.015 * this.outer, depthTest: false }));
      line.computeLineDistances();
      line.renderOrder = 11;
      group.add(line);
    }
    viewer.add("selected", group);
  }

  /** The way of the tool along configurations, while it changes with every drag. */
  drawWay(configurations) {
    const { THREE } = viewer, points = configurations.map((q) => new THREE.Vector3(...this.tool(q), data.planar.height + 0.01));
    const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineBasicMaterial({ color: 0xe4500e }));
    line.renderOrder = 9;
    viewer.add("way", line);
  }

  /** Looks at the whole ring, from above unless the page was given a view. */
  look() {
    const { base, height } = data.planar, r = 1.07 * this.outer, { THREE } = viewer;
    const box = new THREE.Box3(new THREE.Vector3(base[0] - r, base[1] - r, height), new THREE.Vector3(base[0] + r, base[1] + r, height));
    Object.assign(viewer.extent, { framed: cornersOf(box), whole: box, target: null });
    viewer.look(viewer.preferred || [0, 0, 1]);
  }

  /** The point of the arm's plane under the pointer, or null. */
  under(event) {
    const { THREE } = viewer, { camera, pane } = viewer.stage, box = pane.getBoundingClientRect();
    const spot = new THREE.Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
    const ray = new THREE.Raycaster();
    ray.setFromCamera(spot, camera);
    // The camera's world has its y where the scene's z is.
    const hit = ray.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 1, 0), -data.planar.height), new THREE.Vector3());
    return hit && [hit.x, -hit.z];
  }

  /** Pixels between the pointer and a point of the arm's plane. */
  distance(event, [x, y]) {
    const { camera, pane } = viewer.stage, box = pane.getBoundingClientRect();
    const at = new viewer.THREE.Vector3(x, data.planar.height, -y).project(camera);
    return Math.hypot(box.left + ((at.x + 1) / 2) * box.width - event.clientX, box.top + ((1 - at.y) / 2) * box.height - event.clientY);
  }

  /** Pixels between the pointer and a line in the arm's plane. */
  pixelsTo(event, [x, y], [u, v]) {
    const steps = 24;
    let nearest = Infinity;
    for (let k = 0; k <= steps; k++) nearest = Math.min(nearest, this.distance(event, [x + (k / steps) * (u - x), y + (k / steps) * (v - y)]));
    return nearest;
  }
}
