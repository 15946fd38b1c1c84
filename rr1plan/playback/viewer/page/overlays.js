// Layers that are created when first shown: frames, speed of the tools, nearest points, search tree; and rings at
// violations.

const OVERLAYS = ["frames", "toolspeed", "tree", "nearest"];
const AXES = [0xd6336c, 0x2b8a3e, 0x1c7ed6], NEAR = [0.11, 0.14, 0.19], TREES = [GHOSTS.start, GHOSTS.goal];
const TREE_STEPS = 4; // straight pieces per edge, which is a curve in the workspace

/** Colors from slow to fast ("viridis"): brightness increases evenly, also for color-blind readers. */
const SPEEDS = [
  [0.267, 0.005, 0.329], [0.254, 0.265, 0.530], [0.164, 0.471, 0.558], [0.135, 0.659, 0.518], [0.478, 0.821, 0.318], [0.993, 0.906, 0.144],
];

function speedColor(share) {
  const at = clamp(share, 0, 1) * (SPEEDS.length - 1), i = Math.min(Math.floor(at), SPEEDS.length - 2), part = at - i;
  return SPEEDS[i].map((low, k) => (1 - part) * low + part * SPEEDS[i + 1][k]);
}

class Overlays {
  constructor(viewer) {
    this.viewer = viewer;
  }

  load() {
    const { document: doc, world, toolPath, moved } = this.viewer;
    const offered = { frames: doc.arms.length, toolspeed: toolPath && doc.track.timed, tree: doc.tree, nearest: doc.samples.clearance && !moved.length };
    this.made = {};
    for (const name of OVERLAYS) if (offered[name]) { world.group(name); world.filled.add(name); }
    for (const name of OVERLAYS) if (world.layers[name]) world.layers[name].visible = this.viewer.isShown(name);
    this.rings = this.makeRings();
  }

  /** Updates the visible layers to the configurations of the arms. */
  follow() {
    const { viewer } = this, { world } = viewer;
    const makers = { frames: Frames, tree: SearchTrees, nearest: NearestLines };
    for (const [name, Maker] of Object.entries(makers)) {
      if (!world.layers[name] || !viewer.isShown(name)) continue;
      if (!this.made[name]) world.layers[name].add((this.made[name] = new Maker(viewer)).group);
      this.made[name].update();
    }
    if (world.layers.toolspeed) this.colorBySpeed(viewer.isShown("toolspeed"));
    this.showRings();
  }

  // ---- speeds ----------------------------------------------------------------------------------

  colorBySpeed(on) {
    const { toolPath } = this.viewer, bar = find("speedbar");
    if (toolPath) toolPath.setBySpeed(on);
    bar.hidden = !toolPath || !on || !this.viewer.isShown("toolpath");
    if (bar.hidden || this.scaled === toolPath.fastest) return;
    this.scaled = toolPath.fastest;
    const strip = element("i");
    strip.style.background = `linear-gradient(to right, ${SPEEDS.map(css).join(", ")})`;
    const most = this.scaled < 0.1 ? `${length(this.scaled)}/s` : `${this.scaled.toFixed(2)} m/s`;
    bar.setAttribute("aria-label", `Tool speed, from 0 to ${most}`);
    bar.replaceChildren(element("span", "Tool speed"), element("span", "0"), strip, element("span", most));
  }

  // ---- violations ------------------------------------------------------------------------------

  /** A red ring at the position of each violation, visible through all objects at its time. */
  makeRings() {
    const { viewer } = this, group = viewer.world.group("conflicts"), size = 0.05 * viewer.extent.near.getSize(new THREE.Vector3()).length();
    if (viewer.conflicts.all.length) this.picture = this.picture || ringPicture();
    return viewer.conflicts.all.map((conflict) => {
      const material = new THREE.SpriteMaterial({ map: this.picture, depthTest: false, depthWrite: false, transparent: true });
      const ring = new THREE.Sprite(material);
      ring.scale.set(size, size, 1);
      ring.renderOrder = 20;
      ring.visible = false;
      group.add(ring);
      return { conflict, ring };
    });
  }

  showRings() {
    const { viewer } = this;
    for (const { conflict, ring } of this.rings) {
      const place = viewer.manual || !viewer.conflicts.now.includes(conflict) ? null : this.placeOf(conflict);
      ring.visible = place !== null;
      if (place) ring.position.fromArray(place);
    }
  }

  /** The position of the contact, if known; otherwise the origin of the first link. */
  placeOf({ place, elements, simulated }) {
    if (place) return place;
    if (simulated) return null;
    const [arm, link] = (elements[0] || "").split("/"), found = this.viewer.kinematics.arms.find(({ name }) => name === arm);
    if (!found || found.robot.links.indexOf(link) < 0) return null;
    const at = 16 * this.viewer.kinematics.linkIndex(found, link) + 12;
    return this.viewer.world.poses.subarray(at, at + 3);
  }

  // ---- labels ----------------------------------------------------------------------------------

  /** Keeps the label of the nearest bodies next to their line, in each frame. */
  label() {
    const { viewer } = this, label = find("nearest"), lines = viewer.isShown("nearest") ? this.made.nearest : null;
    const least = lines && lines.least, { pane, camera } = viewer.stage;
    const shown = Boolean(least) && pane.clientWidth > 0;
    if (label.hidden === shown) label.hidden = !shown;
    if (!shown) return;
    const [x, y, z] = least.middle, p = cameraPoint(x, y, z).project(camera);
    label.style.transform = `translate(${((p.x + 1) / 2) * pane.clientWidth}px, ${((1 - p.y) / 2) * pane.clientHeight}px) translate(${p.x > 0.2 ? "calc(-100% - 1rem)" : "1rem"}, -50%)`;
    if (label.textContent !== least.words) label.textContent = least.words;
  }
}

function ringPicture() {
  const canvas = element("canvas"), pen = canvas.getContext("2d");
  canvas.width = canvas.height = 128;
  for (const [color, width] of [["#fff", 22], [css(TOUCHED), 13]]) {
    Object.assign(pen, { strokeStyle: color, lineWidth: width, lineCap: "round" });
    pen.beginPath();
    pen.arc(64, 64, 50, 0, 7);
    for (const sign of [-1, 1]) { pen.moveTo(50, 64 - 14 * sign); pen.lineTo(78, 64 + 14 * sign); }
    pen.stroke();
  }
  return new THREE.CanvasTexture(canvas);
}

/** The frames of all links: x red, y green, z blue; those of the tools are longer. */
class Frames {
  constructor({ kinematics, world }) {
    Object.assign(this, { kinematics, world, group: new THREE.Group(), turn: new THREE.Matrix4(), pose: new THREE.Matrix4() });
    const rod = new THREE.CylinderGeometry(1, 1, 1, 8).translate(0, 0.5, 0);
    const material = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true, opacity: 0.9 });
    this.rods = new THREE.InstancedMesh(rod, material, 3 * kinematics.links);
    this.rods.frustumCulled = false;
    this.rods.renderOrder = 12;
    for (let i = 0; i < this.rods.count; i++) this.rods.setColorAt(i, new THREE.Color(AXES[i % 3]).convertSRGBToLinear());
    this.axes = kinematics.arms.flatMap((arm, k) => arm.robot.links.map((_, link) => this.axesOf((link === arm.robot.tool ? 0.13 : 0.08) * world.reach[k])));
    this.group.add(this.rods);
  }

  /** Rods of a given length [m], rotated from y to x, y and z. */
  axesOf(length) {
    const scale = new THREE.Matrix4().makeScale(0.035 * length, length, 0.035 * length), turn = (make, angle) => new THREE.Matrix4()[make](angle).multiply(scale);
    return [turn("makeRotationZ", -Math.PI / 2), scale, turn("makeRotationX", Math.PI / 2)];
  }

  update() {
    const { poses } = this.world;
    this.axes.forEach((axes, link) => {
      this.pose.fromArray(poses, 16 * link);
      axes.forEach((axis, k) => this.rods.setMatrixAt(3 * link + k, this.turn.multiplyMatrices(this.pose, axis)));
    });
    this.rods.instanceMatrix.needsUpdate = true;
  }
}

/** The search tree as paths of the tools: the start's tree blue, a goal's green and dashed. */
class SearchTrees {
  constructor({ kinematics, document: doc }) {
    const { columns, vertices, edges, sides } = doc.tree;
    const q = unpack(vertices).values, ends = unpack(edges).values, side = unpack(sides).values;
    this.group = new THREE.Group();
    for (const tree of [0, 1]) {
      const rows = [];
      for (let e = 0; e < side.length; e++) {
        if ((side[e] === 0) !== (tree === 0)) continue;
        for (let k = 0; k <= TREE_STEPS; k++) {
          const row = kinematics.rest();
          columns.forEach((column, j) => {
            row[column] = q[ends[2 * e] * columns.length + j] + (k / TREE_STEPS) * (q[ends[2 * e + 1] * columns.length + j] - q[ends[2 * e] * columns.length + j]);
          });
          rows.push(row);
        }
      }
      for (const { points } of rows.length ? toolLines(kinematics, columns, rows) : []) this.group.add(this.lines(points, tree));
    }
  }

  lines(points, tree) {
    const pairs = points.flatMap((p, i) => (i % (TREE_STEPS + 1) < TREE_STEPS && (tree === 0 || i % 2 === 0) ? [p, points[i + 1]] : []));
    const material = new THREE.LineBasicMaterial({ color: light(TREES[tree]), transparent: true, opacity: 0.75, depthWrite: false });
    const drawn = new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(pairs), material);
    drawn.frustumCulled = false;
    return drawn;
  }

  update() {}
}

/**
 * Lines between the nearest points of each arm and its surroundings, and among its own links. The points were computed
 * at samples of the motion; between samples they move with their links.
 */
class NearestLines {
  constructor(viewer) {
    const { times, values, pairs, points, names, arms } = viewer.document.samples.clearance;
    Object.assign(this, { viewer, names, arms, group: new THREE.Group(), least: null });
    [this.times, this.values, this.pairs, this.points] = [times, values, pairs, points].map((packed) => unpack(packed).values);
    const rod = new THREE.CylinderGeometry(1, 1, 1, 8).translate(0, 0.5, 0);
    this.radius = 0.0032 * viewer.extent.near.getSize(new THREE.Vector3()).length();
    const material = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true });
    this.rods = new THREE.InstancedMesh(rod, material, 2 * arms.length);
    this.dots = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 12, 8), material, 4 * arms.length);
    for (const mesh of [this.rods, this.dots]) {
      for (let i = 0; i < mesh.count; i++) mesh.setColorAt(i, new THREE.Color());
      mesh.frustumCulled = false;
      mesh.renderOrder = 13;
      this.group.add(mesh);
    }
    this.poses = new Float64Array(16 * viewer.kinematics.links);
    this.posed = -1;
  }

  update() {
    const { viewer } = this, from = new THREE.Vector3(), to = new THREE.Vector3();
    this.least = null;
    this.group.visible = !viewer.manual;
    if (viewer.manual) return;
    const sample = nearestIndex(this.times, viewer.time);
    if (this.posed !== sample) viewer.kinematics.forwardAll(viewer.player.track.at(this.times[sample], viewer.kinematics.rest()), this.poses);
    this.posed = sample;
    for (let k = 0; k < this.arms.length; k++) {
      for (let own = 0; own < 2; own++) {
        const at = 2 * (sample * this.arms.length + k) + own, line = 2 * k + own, sampled = this.values[at], pair = this.names[this.pairs[at]];
        if (!Number.isFinite(sampled)) { this.put(line, from, from, sampled, own); continue; }
        const then = from.fromArray(this.points, 6 * at).distanceTo(to.fromArray(this.points, 6 * at + 3));
        this.carried(pair[0], 6 * at, from);
        this.carried(pair[1], 6 * at + 3, to);
        // The distance of nearest points that move with their bodies has the same slope as that of the bodies.
        const clearance = sampled + (sampled < 0 ? -1 : 1) * (from.distanceTo(to) - then);
        this.put(line, from, to, clearance, own);
        // Links of an arm are always near each other: they are named only if no other pair is.
        if (!this.least || own < this.least.own || (own === this.least.own && clearance < this.least.clearance)) {
          this.least = { clearance, own, middle: from.clone().lerp(to, 0.5).toArray(), words: `${length(clearance)}  ${pair.join(" – ")}` };
        }
      }
    }
    for (const mesh of [this.rods, this.dots]) mesh.instanceMatrix.needsUpdate = mesh.instanceColor.needsUpdate = true;
  }

  /** A point of an element at its sample, moved along with its link. */
  carried(element, at, out) {
    const { kinematics, world, document: doc } = this.viewer;
    out.fromArray(this.points, at);
    const held = doc.attachments.find(({ name }) => name === element), [armName, link] = held ? [held.arm, held.link] : element.split("/");
    const arm = kinematics.arms.find(({ name }) => name === armName);
    if (!link || !arm) return out;
    const first = 16 * kinematics.linkIndex(arm, link), T = new THREE.Matrix4();
    return out.applyMatrix4(T.fromArray(this.poses, first).invert()).applyMatrix4(T.fromArray(world.poses, first));
  }

  put(line, from, to, clearance, own) {
    const far = from.distanceTo(to), T = new THREE.Matrix4(), turn = new THREE.Quaternion(), thick = (own ? 0.55 : 1) * this.radius;
    if (far > 0) turn.setFromUnitVectors(new THREE.Vector3(0, 1, 0), to.clone().sub(from).divideScalar(far));
    const there = Number.isFinite(clearance) ? 1 : 0, color = light(clearance <= 0 ? TOUCHED : NEAR);
    this.rods.setMatrixAt(line, T.compose(from, turn, new THREE.Vector3(thick, far, thick).multiplyScalar(there)));
    this.rods.setColorAt(line, color);
    for (const [i, p] of [from, to].entries()) {
      this.dots.setMatrixAt(2 * line + i, T.makeScale(...Array(3).fill(1.9 * thick * there)).setPosition(p));
      this.dots.setColorAt(2 * line + i, color);
    }
  }
}

/** The index of the time that is nearest to t. */
function nearestIndex(times, t) {
  const low = indexAt(times, t), high = Math.min(low + 1, times.length - 1);
  return t - times[low] <= times[high] - t ? low : high;
}
