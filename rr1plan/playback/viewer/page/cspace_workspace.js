// The planar arm in its workspace: the region it reaches, names of obstacles, numbers.

const NAME_HEIGHT = 17; // [px] of an obstacle's name at least, two thirds of it letters
const turn = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));

class Workspace {
  constructor() {
    const { stage } = viewer;
    this.turned = false;
    this.usual = stage.key.intensity;
    viewer.on("draw", () => this.separateNames());
  }

  /** Reads the link lengths, and makes a view without cards, lit so that obstacles have the colors of their images. */
  prepare() {
    const { stage } = viewer, planar = Boolean(data.planar);
    document.body.classList.toggle("lesson", planar);
    viewer.editing.sleep(planar);
    this.readout ||= this.makeReadout();
    this.readout.box.hidden = !planar;
    stage.key.intensity = planar ? 0.42 : this.usual;
    if (!planar) return;
    this.flat = new FlatArm(data.planar);
    this.outer = data.planar.radius;
    // The largest possible manipulability: with the elbow at a right angle, the rod extended, the link along the rail.
    const { kinds, bars } = data.planar, [first, second] = bars.map(([x, y]) => Math.hypot(x, y));
    this.lengths = [...kinds].flatMap((kind, k) => (kind === "R" && [first, second][k] ? [[first, second][k]] : []));
    for (const node of this.readout.box.querySelectorAll(".links")) node.hidden = !this.lengths.length;
    this.most = { RR: first * second, RP: this.outer, PR: second, PP: 1 }[kinds];
    this.unit = ["", " m", " m²"][[...kinds].filter((kind) => kind === "R").length];
  }

  /** The region the tool reaches, and a handle on the tool. */
  draw() {
    const { THREE } = viewer;
    if (!data.planar) {
      for (const name of ["ring", "names", "handle", "selected", "way"]) viewer.add(name, new THREE.Group());
      return;
    }
    const { rims, height } = data.planar, group = new THREE.Group();
    const flat = (geometry, color, opacity) => new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color, opacity, transparent: true, depthWrite: false, side: THREE.DoubleSide }));
    const path = (Kind, points) => new Kind(points.map(([x, y]) => new THREE.Vector2(x, y)));
    // The largest boundary encloses the others, which are holes.
    const [around, ...holes] = [...rims].sort((a, b) => Math.max(...b.flat()) - Math.max(...a.flat()));
    const region = path(THREE.Shape, around);
    region.holes = holes.map((hole) => path(THREE.Path, hole));
    group.add(flat(new THREE.ShapeGeometry(region), 0x4a74ad, 0.09));
    for (const rim of rims) group.add(flat(this.strip(rim, 0.004 * this.outer), 0x4a74ad, 0.5));
    group.position.set(0, 0, height);
    viewer.add("ring", group);
    const names = new THREE.Group();
    this.tags = new Map();
    for (const { name, color, place } of data.planar.names) {
      const tag = this.nameTag(pictureName(name), color, place);
      this.tags.set(name, { tag, place });
      names.add(tag);
    }
    viewer.add("names", names);
    this.handle = flat(new THREE.RingGeometry(0.042 * this.outer, 0.054 * this.outer, 48), ACCENT, 0.85);
    this.handle.material.depthTest = false;
    this.handle.renderOrder = 10;
    viewer.add("handle", this.handle);
  }

  /** A line of some width around a polygon. */
  strip(points, half) {
    const { THREE } = viewer, geometry = new THREE.BufferGeometry(), places = [], faces = [], n = points.length;
    points.forEach(([x, y], k) => {
      const [[x0, y0], [x1, y1]] = [points[(k + n - 1) % n], points[(k + 1) % n]];
      const far = Math.hypot(x1 - x0, y1 - y0) || 1, normal = [(half * (y1 - y0)) / far, (half * (x0 - x1)) / far];
      places.push(x - normal[0], y - normal[1], 0, x + normal[0], y + normal[1], 0);
      const [a, b] = [2 * k, 2 * ((k + 1) % n)];
      faces.push(a, a + 1, b, b, a + 1, b + 1);
    });
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
    geometry.setIndex(faces);
    return geometry;
  }

  /** An obstacle's name on it, so that no reader depends on colors. */
  nameTag(name, color, place) {
    const { THREE } = viewer, canvas = element("canvas"), height = 64;
    const font = `600 ${0.66 * height}px ${FONT}`;
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
    tag.scale.set(canvas.width / height, 1, 1); // its size depends on the view
    tag.position.set(...place);
    tag.renderOrder = 12;
    return tag;
  }

  /** Keeps the names readable in small windows and from afar, whole at the edges, and hides each that would overlap one before it. */
  separateNames() {
    const { camera, pane } = viewer.stage, least = (2 * NAME_HEIGHT * magnification()) / pane.clientHeight;
    camera.updateMatrixWorld();
    const [perWidth, , , , , perHeight] = camera.projectionMatrix.elements, shown = [];
    for (const { tag } of this.tags ? this.tags.values() : []) {
      const at = tag.getWorldPosition(new viewer.THREE.Vector3()).applyMatrix4(camera.matrixWorldInverse), depth = -at.z;
      const size = Math.max(0.075 * this.outer, (least * depth) / perHeight);
      tag.scale.set((size * tag.scale.x) / tag.scale.y, size, 1);
      const { x: middle, y } = at.applyMatrix4(camera.projectionMatrix), wide = (tag.scale.x * perWidth) / depth, tall = (tag.scale.y * perHeight) / depth;
      const x = Math.abs(middle) < 1 ? clamp(middle, wide / 2 - 1, 1 - wide / 2) : middle;
      tag.center.x = 0.5 - (x - middle) / wide;
      tag.visible = !shown.some((other) => 2 * Math.abs(other.x - x) < other.wide + wide && 2 * Math.abs(other.y - y) < other.tall + tall);
      if (tag.visible) shown.push({ x, y, wide, tall });
    }
  }

  follow(q) {
    const [x, y] = this.flat.tool(q), now = this.flat.manipulability(q), meters = (v) => `${placed(v, this.outer)} m`;
    this.handle.position.set(x, y, data.planar.height);
    // Significant digits, for arms of millimeters too.
    const digits = (v, whole, count) => (whole < 0.05 ? v.toPrecision(3) : v.toFixed(count));
    const rows = [meters(x), meters(y), `${digits(now, this.most, 3)}${this.unit}`, this.lengths.map((v) => `${digits(v, this.outer, 2)} m`).join(", ")];
    this.readout.values.forEach((out, k) => { out.textContent = rows[k]; });
    this.readout.bar.style.width = `${Math.min((100 * now) / this.most, 100)}%`;
  }

  /** Tool, link lengths and manipulability, in a corner of the workspace. */
  makeReadout() {
    const box = element("dl", undefined, "readout"), bar = element("i"), values = [];
    box.setAttribute("aria-label", "Tool, links and manipulability");
    for (const name of ["tool x", "tool y", "manipulability", "links"]) {
      const out = element("dd"), row = element("div");
      values.push(out);
      out.className = name;
      row.append(element("dt", name, name), out);
      box.append(row);
      if (name === "manipulability") {
        out.title = "|det J|, Yoshikawa’s measure: 0 where the arm is stretched or folded, most with the elbow at a right angle";
        const meter = element("dd", undefined, "meter");
        meter.append(bar);
        box.append(meter);
      }
    }
    const hint = element("dd", "Drag obstacles, links and the tool", "hint");
    hint.hidden = true;
    box.append(hint);
    find("stage").append(box);
    const head = find("headline");
    new ResizeObserver(() => find("stage").style.setProperty("--head", `${head.offsetHeight}px`)).observe(head);
    return { box, bar, values, hint };
  }

  /** A line around an obstacle that is selected, or none. */
  outline(loops, [x, y]) {
    const { THREE } = viewer, group = new THREE.Group(), wider = 1.1;
    for (const loop of loops) {
      const points = [...loop, loop[0]].map(([u, v]) => new THREE.Vector3(x + wider * u, y + wider * v, data.planar.height));
      const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineDashedMaterial({ color: INK, dashSize: 0.025 * this.outer, gapSize: 0.015 * this.outer, depthTest: false }));
      line.computeLineDistances();
      line.renderOrder = 11;
      group.add(line);
    }
    viewer.add("selected", group);
  }

  /** The path of the tool along configurations, while it changes with every drag. */
  drawWay(configurations) {
    const { THREE } = viewer, points = configurations.map((q) => new THREE.Vector3(...this.flat.tool(q), data.planar.height + 0.006 * this.outer));
    const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineBasicMaterial({ color: ACCENT }));
    line.renderOrder = 9;
    viewer.add("way", line);
  }

  /** Frames the whole region, from above unless the page has a given view. */
  look() {
    const { center, height } = data.planar, r = 1.07 * this.outer, { THREE } = viewer;
    const box = new THREE.Box3(new THREE.Vector3(center[0] - r, center[1] - r, height), new THREE.Vector3(center[0] + r, center[1] + r, height));
    Object.assign(viewer.extent, { framed: cornersOf(box), whole: box, target: null });
    viewer.look(viewer.preferred || [0, 0, 1]);
  }

  /** The point of the arm's plane under the pointer, or null. */
  under(event) {
    const { THREE } = viewer, plane = new THREE.Plane(new THREE.Vector3(0, 0, 1), -data.planar.height);
    const hit = viewer.editing.picker.ray(event).intersectPlane(plane, new THREE.Vector3());
    return hit && [hit.x, hit.y];
  }

  /** Pixels between the pointer and a point of the arm's plane. */
  distance(event, [x, y]) {
    const at = viewer.editing.picker.project({ x, y, z: data.planar.height });
    return Math.hypot(at.x - event.clientX, at.y - event.clientY);
  }

  /** Pixels between the pointer and a line in the arm's plane. */
  pixelsTo(event, [x, y], [u, v]) {
    const steps = 24;
    let nearest = Infinity;
    for (let k = 0; k <= steps; k++) nearest = Math.min(nearest, this.distance(event, [x + (k / steps) * (u - x), y + (k / steps) * (v - y)]));
    return nearest;
  }
}
