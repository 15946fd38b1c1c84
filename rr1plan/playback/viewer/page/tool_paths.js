// Paths and goals of the tools, and paths without times.

/** Whether a column is a joint of an arm. */
const ownsColumn = ({ firstColumn, robot }, column) => column >= firstColumn && column < firstColumn + robot.names.length;

/** The arms that some columns move. */
function movedArms(kinematics, columns) {
  return kinematics.arms.filter((arm) => columns.some((column) => ownsColumn(arm, column)));
}

/** Positions of an arm's tool at each configuration. */
function toolPoints(kinematics, arm, configurations) {
  const poses = new Float64Array(16 * kinematics.links), at = 16 * kinematics.toolIndex(arm);
  return configurations.map((q) => {
    kinematics.forward(arm, q, poses);
    return new THREE.Vector3().fromArray(poses, at + 12);
  });
}

/** Positions of the tools of the moving arms at each configuration: {arm, points} of each. */
function toolLines(kinematics, columns, configurations) {
  return movedArms(kinematics, columns).map((arm) => ({ arm, points: toolPoints(kinematics, arm, configurations) }));
}

/** Appends rings of points around a line, and their normals; where the line does not advance, its last ring is repeated. */
function addRings(points, radius, sides, positions, normals) {
  const tangent = new THREE.Vector3(1, 0, 0), u = new THREE.Vector3(), w = new THREE.Vector3(), n = new THREE.Vector3();
  points.forEach((p, i) => {
    const d = points[Math.min(i + 1, points.length - 1)].clone().sub(points[Math.max(i - 1, 0)]);
    if (d.length() > 1e-4 * radius) tangent.copy(d).normalize();
    u.addScaledVector(tangent, -u.dot(tangent));
    if (u.lengthSq() < 1e-6) u.set(0, 0, 1).cross(tangent);
    if (u.lengthSq() < 1e-6) u.set(1, 0, 0);
    u.normalize();
    w.crossVectors(tangent, u);
    for (let k = 0; k < sides; k++) {
      const a = (2 * Math.PI * k) / sides;
      n.copy(u).multiplyScalar(Math.cos(a)).addScaledVector(w, Math.sin(a));
      positions.push(p.x + radius * n.x, p.y + radius * n.y, p.z + radius * n.z);
      normals.push(n.x, n.y, n.z);
    }
  });
}

/**
 * The tool paths as tubes, or as lines, which are faster: faint as a whole, bright up to the current time.
 * The pieces of all paths are sorted by time, so that one call draws the bright part of all.
 */
class ToolPath {
  constructor(kinematics, track, radius) {
    const many = kinematics.arms.length;
    const most = Math.max(60, Math.min(400, Math.floor(6000 / many)));
    this.radius = radius;
    this.sides = many > MANY ? 4 : 7;
    this.pieces = Math.max(2, Math.min(most, Math.ceil(60 * (track.end - track.start))));
    this.kinematics = kinematics;
    this.track = track;
    this.times = track.instants(this.pieces);
    const rows = this.times.map((t) => track.at(t, kinematics.rest()));
    this.lines = toolLines(kinematics, track.columns, rows).map(({ arm, points }) => ({ arm, points, color: light(armColor(kinematics.arms.indexOf(arm))) }));
    this.group = new THREE.Group();
    this.drawn = {};
    this.done = 0;
  }

  setTubes(on) {
    const kind = on ? "tubes" : "lines";
    if (kind === this.kind) return;
    this.kind = kind;
    if (!this.drawn[kind]) this.group.add((this.drawn[kind] = on ? this.makeTubes() : this.makeLines()).group);
    for (const [name, { group }] of Object.entries(this.drawn)) group.visible = name === kind;
    this.show(this.done);
  }

  makeTubes() {
    const { sides } = this, positions = [], normals = [], indices = [];
    for (const { points } of this.lines) addRings(points, this.radius, sides, positions, normals);
    this.eachPiece((ring) => {
      for (let k = 0; k < sides; k++) {
        const a = sides * ring + k, b = sides * ring + ((k + 1) % sides);
        indices.push(a, b, a + sides, b, b + sides, a + sides);
      }
    });
    const attributes = { position: positions, normal: normals, color: this.colors(sides) };
    return this.paths(THREE.Mesh, attributes, indices, 6 * sides,
      new THREE.MeshBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.22, depthWrite: false }),
      new THREE.MeshLambertMaterial({ vertexColors: true, emissive: 0x333333 }));
  }

  makeLines() {
    const indices = [];
    this.eachPiece((ring) => indices.push(ring, ring + 1));
    const attributes = { position: this.lines.flatMap(({ points }) => points.flatMap((p) => [p.x, p.y, p.z])), color: this.colors(1) };
    return this.paths(THREE.LineSegments, attributes, indices, 2,
      new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.3, depthWrite: false }),
      new THREE.LineBasicMaterial({ vertexColors: true }));
  }

  /** Calls f(index of the ring at its beginning) for all pieces in the order of time. */
  eachPiece(f) {
    for (let i = 0; i < this.pieces; i++) for (let line = 0; line < this.lines.length; line++) f(line * (this.pieces + 1) + i);
  }

  colors(sides) {
    return this.lines.flatMap(({ points, color, speeds }) => points.flatMap((_, i) => (
      Array(sides).fill((this.bySpeed ? light(speedColor(speeds[i] / (this.fastest || 1))) : color).toArray()).flat())));
  }

  /** Colors by the speed of the tool, or by arm. */
  setBySpeed(on) {
    if (on === Boolean(this.bySpeed)) return;
    this.bySpeed = on;
    if (on && this.fastest === undefined) this.measureSpeeds();
    for (const [kind, { part }] of Object.entries(this.drawn)) {
      part.attributes.color.copyArray(this.colors(kind === "tubes" ? this.sides : 1)).needsUpdate = true;
    }
  }

  /** The speed of each tool [m/s] at the ends of all pieces, and the largest speed. */
  measureSpeeds() {
    const { kinematics, track } = this, poses = new Float64Array(16 * kinematics.links), q = kinematics.rest();
    const solvers = this.lines.map(({ arm }) => new DifferentialIk(kinematics, arm, poses));
    for (const line of this.lines) line.speeds = new Float64Array(this.times.length);
    this.times.forEach((t, i) => {
      const rates = kinematics.rest().fill(0);
      track.at(t, q);
      track.columns.forEach((column, slot) => { rates[column] = track.rate(t, slot, 1); });
      this.lines.forEach(({ speeds }, k) => { speeds[i] = solvers[k].toolSpeed(q, rates); });
    });
    this.fastest = Math.max(0, ...this.lines.map(({ speeds }) => Math.max(...speeds)));
  }

  paths(Kind, attributes, indices, perPiece, faint, bright) {
    const [whole, part] = [new THREE.BufferGeometry(), new THREE.BufferGeometry()];
    for (const [name, values] of Object.entries(attributes)) {
      const attribute = new THREE.Float32BufferAttribute(values, 3);
      whole.setAttribute(name, attribute);
      part.setAttribute(name, attribute);
    }
    whole.setIndex(indices);
    part.setIndex(whole.index);
    const group = new THREE.Group();
    group.add(new Kind(whole, faint), new Kind(part, bright));
    for (const part of group.children) part.frustumCulled = false;
    return { group, part, count: perPiece * this.lines.length };
  }

  show(fraction) {
    this.done = fraction;
    const drawn = this.drawn[this.kind];
    if (drawn) drawn.part.setDrawRange(0, drawn.count * Math.round(fraction * this.pieces));
  }
}

/** The paths of the tools along another motion, as thin lines of one color. */
function motionLines(kinematics, track, rgb) {
  const pieces = Math.max(2, Math.min(200, Math.ceil(60 * (track.end - track.start)), Math.floor(6000 / kinematics.arms.length)));
  const rows = track.instants(pieces).map((t) => track.at(t, kinematics.rest()));
  const group = new THREE.Group(), material = new THREE.LineBasicMaterial({ color: light(rgb) });
  for (const { points } of toolLines(kinematics, track.columns, rows)) group.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), material));
  return group;
}

/** A path without times: thin dark lines of the tools, a dot at each waypoint at which the arm has moved. */
function waypointLines(kinematics, row, radius) {
  const lines = [], dots = [];
  for (const arm of movedArms(kinematics, row.columns)) {
    const stops = ownWaypoints(kinematics, row, arm), pieces = Math.max(2, Math.min(24, Math.floor(2000 / stops.length)));
    const mixed = (from, to, share) => from.map((v, c) => (1 - share) * v + share * to[c]);
    const rows = stops.slice(1).flatMap((to, i) => Array.from({ length: pieces }, (_, k) => mixed(stops[i], to, k / pieces)));
    const points = toolPoints(kinematics, arm, [...rows, stops.at(-1)]);
    for (let i = 1; i < points.length; i++) lines.push(points[i - 1], points[i]);
    dots.push(...points.filter((_, i) => i % pieces === 0));
  }
  const group = new THREE.Group(), ink = 0x1b2430, material = new THREE.LineBasicMaterial({ color: ink, transparent: true, opacity: 0.55 });
  const balls = new THREE.InstancedMesh(solid({ kind: "sphere", radius: 1 }, 18).geometry, new THREE.MeshBasicMaterial({ color: ink }), dots.length);
  balls.frustumCulled = false;
  dots.forEach((p, i) => balls.setMatrixAt(i, new THREE.Matrix4().makeScale(radius, radius, radius).setPosition(p)));
  group.add(new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(lines), material), balls);
  return group;
}

/** The waypoints of one arm, as configurations of all, without those at which it is where it was at the last one. */
function ownWaypoints(kinematics, row, arm) {
  const { values, shape } = unpack(row.waypoints), [count, width] = shape, stops = [];
  const own = row.columns.flatMap((c, k) => (ownsColumn(arm, c) ? [[c, k]] : []));
  for (let i = 0; i < count; i++) {
    if (i && own.every(([, k]) => values[i * width + k] === values[(i - 1) * width + k])) continue;
    const q = kinematics.rest();
    for (const [c, k] of own) q[c] = values[i * width + k];
    stops.push(q);
  }
  return stops;
}

/** Goals in the world: a ball, with axes if the orientation is given; a region as a transparent box. */
function targetMarks(targets, radius) {
  const group = new THREE.Group();
  const green = light(GHOSTS.goal);
  for (const target of targets) {
    if (target.kind === "region") {
      const low = new THREE.Vector3(...target.lower), size = new THREE.Vector3(...target.upper).sub(low);
      const box = new THREE.BoxGeometry(...size.toArray().map((v) => Math.max(v, 0.5 * radius)));
      const clear = new THREE.Mesh(box, new THREE.MeshBasicMaterial({ color: green, transparent: true, opacity: 0.14, depthWrite: false }));
      clear.add(new THREE.LineSegments(new THREE.EdgesGeometry(box), new THREE.LineBasicMaterial({ color: green })));
      clear.position.copy(low).addScaledVector(size, 0.5);
      clear.renderOrder = 9;
      group.add(clear);
      continue;
    }
    const mark = new THREE.Group();
    mark.applyMatrix4(new THREE.Matrix4().fromArray(target.pose));
    mark.add(new THREE.Mesh(new THREE.SphereGeometry(2.6 * radius, 24, 16), new THREE.MeshStandardMaterial({ color: green, emissive: green, emissiveIntensity: 0.4 })));
    if (target.turned) mark.add(axes(22 * radius, radius));
    group.add(mark);
  }
  return group;
}

function axes(length, radius) {
  const group = new THREE.Group();
  [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((d, i) => {
    const rod = new THREE.Mesh(new THREE.CylinderGeometry(0.6 * radius, 0.6 * radius, length, 12), new THREE.MeshBasicMaterial({ color: AXES[i] }));
    rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(...d));
    rod.position.set(...d).multiplyScalar(length / 2);
    group.add(rod);
  });
  return group;
}
