// The document as a picture: robots, obstacles, ghosts, paths, floor and light.

const LINK_GREY = [0.77, 0.79, 0.82];
const OBSTACLE = [0.58, 0.65, 0.74];
const HELD = [0.96, 0.73, 0.27];
const TOUCHED = [0.86, 0.08, 0.2], FADED = 0.82, LIT = [1, 0.95, 0.62];
const GHOSTS = { start: [0.25, 0.47, 0.85], goal: [0.1, 0.62, 0.42], replay: [0.62, 0.3, 0.78], compare: [0, 0.57, 0.63] };
const IDENTITY = identity();

/** Colors of arms, as in `arm_colors.py`, safe for color-blind readers; beyond ten, hues are spread around the wheel. */
const ARMS = [
  [0.894, 0.314, 0.055], [0.129, 0.451, 0.851], [0.031, 0.392, 0.325], [0.969, 0.733, 0.29], [0.439, 0.192, 0.565],
  [0.29, 0.678, 0.71], [0.671, 0.537, 0.988], [0.337, 0.173, 0.035], [0.961, 0.51, 0.408], [0.686, 0.318, 0.592],
];

function armColor(index) {
  if (index < ARMS.length) return ARMS[index];
  const color = new THREE.Color().setHSL((0.055 + index * 0.381966) % 1, 0.62, index % 2 ? 0.42 : 0.53);
  return [color.r, color.g, color.b];
}

/** Saturation from which a part counts as colored, and lightness below which it counts as black. */
const COLORED = 0.25, DARK = 0.2;

function hslOf([r, g, b]) {
  return new THREE.Color().setRGB(r, g, b).getHSL({});
}

class World {
  constructor(doc, kinematics) {
    this.doc = doc;
    this.kinematics = kinematics;
    this.poses = new Float64Array(16 * kinematics.links);
    this.root = new THREE.Group();
    this.layers = {};
    this.filled = new Set();
    this.linkBodies = new Map();
    // Arms are created only after the camera is set, which avoids creating unneeded full detail.
    this.detail = { levels: new Int8Array(kinematics.arms.length).fill(-1), version: 1 };
    this.reach = kinematics.arms.map((arm) => this.reachOf(arm));
    this.colorless = kinematics.arms.map(({ robot }) => robot.visuals.every(({ color }) => !color || hslOf(color).s < COLORED));
    this.lens = { eye: new THREE.Vector3(), frustum: new THREE.Frustum(), ball: new THREE.Sphere(), view: new THREE.Matrix4() };
    const rest = kinematics.rest();
    kinematics.forwardAll(rest, this.poses);
    const count = kinematics.arms.length, sides = count > MANY ? 10 : count > 4 ? 18 : 36;
    this.robots = this.layer("robots", new Bodies(this.linkItems("visuals", LINK_GREY), { roughness: 0.5 }));
    this.held = this.layer("robots", new Bodies(this.heldItems(), {}));
    this.collisions = this.layer("collisions", new Bodies(this.linkItems("collisions", [0.05, 0.72, 0.66]), { opacity: 0.4, order: 3 }));
    this.spheres = new Spheres(doc, kinematics, sides);
    for (const [name, bodies] of this.spheres.layers) this.layer(name, bodies);
    this.moving = [this.robots, this.held, this.collisions, ...this.spheres.layers.values()];
    this.obstacles = this.layer("obstacles", new Bodies(this.obstacleItems(), { roughness: 0.75 }));
    this.obstacles.update(this.poses);
    this.addLooseBodies();
    // Unit of elements that scale with the arm, whatever its size [m].
    this.span = Math.max(0, ...this.reach) || unionOf(this.obstacleBoxes()).getSize(new THREE.Vector3()).length() / 2 || 1;
    this.addEdges();
    this.addSpecials();
    this.addGhosts();
    this.update(rest);
  }

  layer(name, bodies) {
    this.group(name).add(bodies.group);
    if (bodies.sets.length) this.filled.add(name);
    return bodies;
  }

  group(name) {
    if (!this.layers[name]) {
      this.layers[name] = new THREE.Group();
      this.root.add(this.layers[name]);
    }
    return this.layers[name];
  }

  /** Removes a layer with all its content. */
  clear(name) {
    const layer = this.layers[name];
    this.filled.delete(name);
    if (!layer) return;
    disposeTree(layer);
    layer.removeFromParent();
    delete this.layers[name];
  }

  /** Whether a layer has content, drawn yet or not. */
  has(name) {
    const layer = this.layers[name];
    return this.filled.has(name) || (Boolean(layer) && layer.children.some((c) => c.children.length > 0 || !c.isGroup));
  }

  // ---- content ---------------------------------------------------------------------------

  /** The links of arms, one body per color of a link. */
  linkItems(kind, fallback, arms = this.kinematics.arms) {
    const items = [];
    for (const arm of arms) {
      const index = this.kinematics.arms.indexOf(arm);
      for (const { body, link, color, opacity } of this.bodiesOf(arm.robot, kind, fallback)) {
        items.push({ body, local: null, frame: arm.firstLink + link, color, opacity, element: `${arm.name}/${arm.robot.links[link]}`, arm: index });
      }
    }
    return items;
  }

  /** The bodies of a robot's links, shared by its arms: one per link and color, or one per link without a fallback color. */
  bodiesOf(robot, kind, fallback) {
    if (!this.linkBodies.has(robot)) this.linkBodies.set(robot, {});
    const known = this.linkBodies.get(robot), name = fallback ? kind : `${kind} in one color`;
    if (!known[name]) {
      const sorted = new Map();
      for (const part of robot[kind]) {
        const { color, opacity } = fallback ? this.paintOf(part, fallback) : { color: null, opacity: 1 };
        const key = `${part.link} ${color} ${opacity}`;
        if (!sorted.has(key)) sorted.set(key, { link: part.link, color, opacity, parts: [] });
        sorted.get(key).parts.push({ shape: this.doc.shapes[part.shape], pose: part.pose });
      }
      const opaque = [...sorted.values()].filter(({ opacity }) => opacity === 1);
      known[name] = [...sorted.values()].map(({ parts, ...rest }) => {
        const covers = opaque.filter(({ link }) => link === rest.link).flatMap((other) => other.parts);
        return { body: new LinkBody(parts, covers), ...rest };
      });
    }
    return known[name];
  }

  paintOf({ color }, fallback) {
    if (!color) return { color: fallback, opacity: 1 };
    return { color: color.slice(0, 3), opacity: color[3] === undefined ? 1 : Math.max(0.05, color[3]) };
  }

  objectItems(object, frame, fallback, arm) {
    return object.parts.flatMap((part) => {
      const found = shapeBody(this.doc.shapes[part.shape], 40), pose = identity();
      if (!found) return [];
      multiply(pose, 0, object.pose, 0, part.pose, 0);
      return [{ body: found.body, local: scaled(pose, found.scale), frame, element: object.name, arm, part: part.pose, scale: found.scale, ...this.paintOf(part, fallback) }];
    });
  }

  obstacleItems() {
    return this.doc.obstacles.flatMap((o) => this.objectItems(o, -1, OBSTACLE, -1));
  }

  heldItems() {
    return this.doc.attachments.flatMap((held) => {
      const index = this.kinematics.arms.findIndex((a) => a.name === held.arm);
      return this.objectItems(held, this.kinematics.linkIndex(this.kinematics.arms[index], held.link), HELD, index);
    });
  }

  /** Loose bodies, which move along the replay: times, and position and quaternion of each body at each of them. */
  addLooseBodies() {
    const { objects, times, poses } = this.doc.bodies || { objects: [], times: null, poses: null };
    this.bodyTrack = times && { times: unpack(times).values, poses: unpack(poses).values, count: objects.length };
    this.bodyPoses = new Float64Array(16 * objects.length);
    const items = objects.flatMap((object, i) => this.objectItems(object, i, HELD, -1));
    this.bodies = this.layer("obstacles", new Bodies(items, { roughness: 0.75 }));
    if (this.bodyTrack) this.updateBodies(this.bodyTrack.times[0]);
  }

  /** Moves loose bodies to their poses at a time; bodies absent at that time are not drawn. */
  updateBodies(time) {
    if (!this.bodyTrack) return;
    const { times, poses, count } = this.bodyTrack, last = times.length - 1;
    const i = indexAt(times, time), next = Math.min(i + 1, last), share = next > i ? clamp((time - times[i]) / (times[next] - times[i]), 0, 1) : 0;
    const p = new THREE.Vector3(), r = new THREE.Vector3(), a = new THREE.Quaternion(), b = new THREE.Quaternion(), T = new THREE.Matrix4();
    const one = new THREE.Vector3(1, 1, 1);
    for (let k = 0; k < count; k++) {
      const from = 7 * (i * count + k), to = 7 * (next * count + k), there = Number.isFinite(poses[from]);
      if (there) {
        const moves = Number.isFinite(poses[to]) ? share : 0, at = moves ? to : from;
        p.fromArray(poses, from).lerp(r.fromArray(poses, at), moves);
        a.set(poses[from + 4], poses[from + 5], poses[from + 6], poses[from + 3]);
        a.slerp(b.set(poses[at + 4], poses[at + 5], poses[at + 6], poses[at + 3]), moves);
        T.compose(p, a, one);
      } else T.makeScale(0, 0, 0);
      T.toArray(this.bodyPoses, 16 * k);
    }
    this.bodies.update(this.bodyPoses);
  }

  /** Moves loose bodies with the links that hold them: {body, link, pose: T_link_body}. */
  carry(held) {
    for (const { body, link, pose } of held) multiply(this.bodyPoses, 16 * body, this.poses, 16 * link, pose, 0);
    this.bodies.update(this.bodyPoses);
  }

  /** Thin dark edges, so that boxes in front of boxes remain readable. */
  addEdges() {
    const known = new Map();
    let count = 0;
    this.edges = [];
    for (const { items, body } of this.obstacles.sets) {
      const geometry = body.geometry(0);
      if (geometry.type === "SphereGeometry" || geometry.attributes.position.count > 30000) continue;
      if (!known.has(geometry)) known.set(geometry, new THREE.EdgesGeometry(geometry, 40).attributes.position);
      const edges = known.get(geometry);
      for (const item of items) {
        this.edges.push({ item, edges, first: count });
        count += edges.count;
      }
    }
    if (!count) return;
    const geometry = new THREE.BufferGeometry().setAttribute("position", (this.edgePoints = new THREE.Float32BufferAttribute(3 * count, 3)));
    const material = new THREE.LineBasicMaterial({ color: 0x1b2430, transparent: true, opacity: 0.28 });
    const lines = new THREE.LineSegments(geometry, material);
    lines.frustumCulled = false;
    this.placeEdges(this.edges);
    this.group("obstacles").add(lines);
  }

  placeEdges(some) {
    const v = new THREE.Vector3(), T = new THREE.Matrix4();
    for (const { item, edges, first } of some) {
      T.fromArray(item.local);
      for (let i = 0; i < edges.count; i++) {
        v.fromBufferAttribute(edges, i).applyMatrix4(T);
        this.edgePoints.setXYZ(first + i, v.x, v.y, v.z);
      }
      this.edgePoints.needsUpdate = true;
    }
  }

  /** Whether an obstacle consists of solids only, which can be drawn at other poses. */
  canMove(name) {
    const obstacle = this.doc.obstacles.find((o) => o.name === name);
    return Boolean(obstacle) && obstacle.parts.every((part) => !["halfspace", "cloud"].includes(this.doc.shapes[part.shape].kind));
  }

  /** Draws an obstacle at a pose. */
  moveObstacle(name, T) {
    const pose = identity();
    for (const { items } of this.obstacles.sets) {
      for (const item of items) {
        if (item.element !== name) continue;
        multiply(pose, 0, T, 0, item.part, 0);
        item.local.set(scaled(pose, item.scale));
      }
    }
    this.obstacles.update(this.poses);
    this.placeEdges(this.edges.filter(({ item }) => item.element === name));
  }

  /** The center of the box around a link's shapes, in the link's frame; its origin without shapes. */
  linkCenter(arm, link) {
    const box = new THREE.Box3(), T = new THREE.Matrix4();
    for (const part of arm.robot.visuals) if (part.link === link) box.union(this.boxOf(part.shape).clone().applyMatrix4(T.fromArray(part.pose)));
    return box.isEmpty() ? new THREE.Vector3() : box.getCenter(new THREE.Vector3());
  }

  /** The box around an obstacle as it is drawn. */
  boxAround(name) {
    const box = new THREE.Box3(), T = new THREE.Matrix4();
    for (const { body, items } of this.obstacles.sets) {
      const geometry = body.geometry(0);
      if (!geometry.boundingBox) geometry.computeBoundingBox();
      for (const item of items) if (item.element === name) box.union(geometry.boundingBox.clone().applyMatrix4(T.fromArray(item.local)));
    }
    return box;
  }

  /** Half-spaces and point clouds, which are not solids with a surface. */
  addSpecials() {
    this.floor = null;
    for (const object of this.doc.obstacles) {
      for (const part of object.parts) {
        const shape = this.doc.shapes[part.shape];
        const pose = identity();
        multiply(pose, 0, object.pose, 0, part.pose, 0);
        if (shape.kind === "halfspace") this.addHalfSpace(shape, pose, part);
        if (shape.kind === "cloud") this.addCloud(shape, pose, part);
      }
    }
  }

  addHalfSpace(shape, pose, part) {
    const T = new THREE.Matrix4().fromArray(pose);
    const normal = new THREE.Vector3(...shape.normal);
    const point = normal.clone().multiplyScalar(shape.offset).applyMatrix4(T);
    normal.transformDirection(T);
    if (normal.z > 0.9999) { this.floor = Math.max(this.floor === null ? -Infinity : this.floor, point.z); return; }
    const color = light(part.color || OBSTACLE);
    const plane = new THREE.Mesh(new THREE.PlaneGeometry(4 * this.span, 4 * this.span), new THREE.MeshStandardMaterial({
      color, transparent: true, opacity: 0.25, side: THREE.DoubleSide, depthWrite: false,
    }));
    plane.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), normal);
    plane.position.copy(point);
    this.group("obstacles").add(plane);
  }

  addCloud(shape, pose, part) {
    const points = unpack(shape.points).values, count = points.length / 3;
    const cloud = new THREE.InstancedMesh(once("box"), new THREE.MeshStandardMaterial({ roughness: 0.9 }), count);
    cloud.frustumCulled = false;
    cloud.castShadow = cloud.receiveShadow = true;
    let low = Infinity, high = -Infinity;
    for (let i = 2; i < points.length; i += 3) { low = Math.min(low, points[i]); high = Math.max(high, points[i]); }
    const T = new THREE.Matrix4().fromArray(pose), P = new THREE.Matrix4(), color = new THREE.Color();
    for (let i = 0; i < count; i++) {
      P.makeScale(shape.resolution, shape.resolution, shape.resolution).setPosition(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
      cloud.setMatrixAt(i, P.premultiply(T));
      if (part.color) color.copy(light(part.color));
      else color.setHSL(0.62 - 0.5 * ((points[3 * i + 2] - low) / (high - low || 1)), 0.5, 0.52).convertSRGBToLinear();
      cloud.setColorAt(i, color);
    }
    this.group("obstacles").add(cloud);
  }

  // ---- ghosts: the same arms at other configurations ---------------------------------------

  addGhosts() {
    this.still = [];
    for (const kind of ["start", "goal"]) this.setGhosts(kind, this.doc.ghosts.filter((ghost) => ghost.kind === kind));
    this.followers = {};
    if (this.doc.replay) this.addFollower("replay", this.doc.replay);
    for (const other of this.doc.compare) this.addFollower("compare", other);
  }

  /** The arms of another motion on the same clock. */
  addFollower(kind, { columns }) {
    const bodies = this.ghost(kind, movedArms(this.kinematics, columns).flatMap((arm) => this.ghostItems(kind, arm, arm.firstLink)));
    this.followers[kind] = { bodies, poses: Float64Array.from(this.poses) };
  }

  /** Shows some arms {arm (its name), q} in the color of the start or the goal, replacing the previous ones. */
  setGhosts(kind, ghosts) {
    const old = this.still.find((still) => still.kind === kind);
    if (old) {
      this.still.splice(this.still.indexOf(old), 1);
      old.bodies.group.removeFromParent();
      old.bodies.dispose();
    }
    const arms = ghosts.map((ghost) => this.kinematics.arms.find((a) => a.name === ghost.arm)), items = [];
    const poses = new Float64Array(16 * arms.reduce((sum, arm) => sum + arm.robot.links.length, 0)), own = new Float64Array(this.poses.length);
    let first = 0;
    ghosts.forEach(({ q }, i) => {
      const arm = arms[i], count = arm.robot.links.length;
      this.kinematics.forward(arm, this.kinematics.standing(arm.name, q), own);
      poses.set(own.subarray(16 * arm.firstLink, 16 * (arm.firstLink + count)), 16 * first);
      items.push(...this.ghostItems(kind, arm, first));
      first += count;
    });
    if (items.length) this.still.push({ kind, bodies: this.ghost(kind, items), poses });
    this.place();
  }

  /** An arm of one color, its poses from the first link on. */
  ghostItems(kind, arm, first) {
    const index = this.kinematics.arms.indexOf(arm);
    return this.bodiesOf(arm.robot, "visuals", null).map(({ body, link }) => (
      { body, local: null, frame: first + link, color: GHOSTS[kind], opacity: 1, element: `${arm.name}/${arm.robot.links[link]}`, arm: index }));
  }

  ghost(kind, items) {
    return this.layer(kind, new Bodies(items, { opacity: 0.28, order: kind === "start" ? 7 : 8 }));
  }

  // ---- motion ------------------------------------------------------------------------------

  update(q) {
    this.kinematics.forwardAll(q, this.poses);
    this.place();
  }

  updateFollower(kind, q) {
    if (!this.layers[kind].visible) return;
    const { bodies, poses } = this.followers[kind];
    this.kinematics.forwardAll(q, poses);
    bodies.update(poses, this.detail);
  }

  /** Moves the visible layers of the arms to the poses of their links. */
  place() {
    for (const bodies of this.moving) if (bodies.group.parent.visible) bodies.update(this.poses, this.detail);
    for (const { bodies, poses } of this.still) if (bodies.group.parent.visible) bodies.update(poses, this.detail);
  }

  /**
   * Sets the level of detail of each arm by its size in the picture; arms outside of it are not drawn. tolerance: size
   * of features that may be omitted [px], and the window's height; returns true if anything changed.
   */
  chooseDetail(camera, height, tolerance) {
    const { levels } = this.detail, { eye, frustum, ball, view } = this.lens;
    camera.updateMatrixWorld();
    eye.setFromMatrixPosition(camera.matrixWorld);
    frustum.setFromProjectionMatrix(view.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    const wide = (2 * Math.tan((camera.fov * Math.PI) / 360)) / height;
    let changed = false;
    this.kinematics.arms.forEach((arm, i) => {
      ball.center.set(arm.base[12], arm.base[14], -arm.base[13]);
      const near = Math.max(camera.near, eye.distanceTo(ball.center) - this.reach[i]);
      // An arm outside the picture may still cast its shadow into it.
      ball.radius = 2 * this.reach[i];
      const level = frustum.intersectsSphere(ball) ? levelOf(tolerance * wide * near) : -1;
      changed = changed || level !== levels[i];
      levels[i] = level;
    });
    if (changed) this.detail.version += 1;
    return changed;
  }

  /** Largest distance of any part of an arm from its base [m]. */
  reachOf(arm) {
    const { robot } = arm, far = new Float64Array(robot.links.length), distance = (pose) => Math.hypot(pose[12], pose[13], pose[14]);
    for (const joint of robot.joints) {
      const limits = joint.kind === 1 && joint.column >= 0 ? robot.limits[joint.column].map((v) => Math.abs(joint.offset + joint.factor * (v || 0))) : [Math.abs(joint.offset)];
      far[joint.child] = far[joint.parent] + distance(joint.origin) + (joint.kind === 1 ? Math.max(...limits) : 0);
    }
    const radius = (index) => {
      const { min, max } = this.boxOf(index), corner = new THREE.Vector3(...["x", "y", "z"].map((axis) => Math.max(-min[axis], max[axis])));
      return Math.max(0, corner.x) && corner.length();
    };
    const held = this.doc.attachments.filter((h) => h.arm === arm.name).flatMap((h) => (
      h.parts.map((part) => far[robot.links.indexOf(h.link)] + distance(h.pose) + distance(part.pose) + radius(part.shape))));
    const own = [...robot.visuals, ...robot.collisions].map((part) => far[part.link] + distance(part.pose) + radius(part.shape));
    return Math.max(0, ...own, ...held) || 1;
  }

  /** Draws with highlights and shadows on everything, or plainly, which is faster. */
  setRich(on) {
    for (const bodies of [this.robots, this.held, this.obstacles, this.bodies]) bodies.setRich(on);
  }

  /** Colors by arm, elements in contact red, one element highlighted. A robot with colored parts keeps its gray and black ones,
   * another one its black ones only. */
  paint(byArm, touched = [], lit = null) {
    const red = new Set(touched);
    // Among very many colors, red is visible only if the others are faint.
    const faint = red.size && this.kinematics.arms.length > MANY ? 0.72 : 0;
    const faded = (rgb) => rgb.map((v) => (1 - faint) * v + faint * FADED);
    const brighter = (item, rgb) => (item.element === lit ? rgb.map((v, k) => 0.5 * v + 0.5 * LIT[k]) : rgb);
    const choose = (item) => brighter(item, chosen(item));
    const chosen = (item) => {
      if (red.has(item.element)) return TOUCHED;
      if (!byArm || item.arm < 0) return faded(item.color);
      const { s, l } = hslOf(item.color);
      if (this.colorless[item.arm] ? l < DARK : s < COLORED) return faded(item.color);
      const shade = Math.min(1, 0.6 + 0.8 * l);
      return faded(armColor(item.arm).map((v) => shade * v));
    };
    this.robots.paint(choose);
    for (const bodies of [this.held, this.obstacles, this.bodies]) bodies.paint((item) => brighter(item, red.has(item.element) ? TOUCHED : item.color));
    this.obstacles.update(this.poses);
    this.bodies.update(this.bodyPoses);
    this.place();
  }

  // ---- extent ------------------------------------------------------------------------------

  /** Boxes in the world: `near`, the arms along the motion and their surroundings, and `whole`; and balls: `links`, and all of near to frame. */
  extent(samples) {
    const arms = new THREE.Box3(), poses = new Float64Array(this.poses.length), point = new THREE.Vector3();
    const boxes = this.kinematics.arms.map(() => new THREE.Box3()), many = this.kinematics.arms.length > 12, links = [];
    for (const q of samples) {
      this.kinematics.forwardAll(q, poses);
      this.kinematics.arms.forEach(({ firstLink, robot }, k) => {
        for (let i = 16 * firstLink; i < 16 * (firstLink + robot.links.length); i += 16) {
          boxes[k].expandByPoint(point.fromArray(poses, i + 12));
          if (!many) links.push([...point.toArray(), 0.2 * this.reach[k]]);
        }
      });
    }
    for (const box of boxes) arms.union(box);
    // For many arms only the corners of a box around each, because framing evaluates all points dozens of times.
    if (many) boxes.forEach((box, k) => links.push(...cornersOf(box).map(([x, y, z]) => [x, y, z, 0.2 * this.reach[k]])));
    const obstacles = this.obstacleBoxes(), whole = unionOf(obstacles), nearby = obstacles.filter((box) => this.isNearby(box));
    if (arms.isEmpty() && whole.isEmpty()) whole.set(new THREE.Vector3(-0.5, -0.5, 0), new THREE.Vector3(0.5, 0.5, 0.5));
    const near = arms.isEmpty() ? whole.clone() : arms.clone(), around = new THREE.Box3();
    const lowest = Math.min(arms.isEmpty() ? Infinity : arms.min.z, whole.isEmpty() ? Infinity : whole.min.z);
    let size = 0;
    if (!arms.isEmpty()) {
      size = arms.getSize(new THREE.Vector3()).length();
      near.expandByScalar(0.07 * size);
      around.union(whole.clone().intersect(near.clone().expandByScalar(0.14 * size)));
      this.spheres.expand(around, samples);
      for (const box of [around, ...nearby]) near.union(box);
    }
    // The start, the middle and the end; for very many arms only the start.
    const instants = [1, samples.length >> 1, samples.length - 1].slice(0, many ? 1 : 3);
    const bodies = instants.flatMap((i) => this.bodyCorners(samples[i]));
    const framed = arms.isEmpty() ? cornersOf(near) : [...links.map(([x, y, z, far]) => [x, y, z, Math.min(0.08 * size, far)]), ...bodies, ...[around, ...nearby].flatMap(cornersOf)];
    whole.union(near);
    // The ground is at z = 0, unless all is far above it: then shadows fall on a floor below the lowest point.
    const ground = lowest > whole.getSize(new THREE.Vector3()).length() ? lowest : Math.min(0, lowest);
    return { near, framed, links, whole, floor: this.floor ?? ground };
  }

  /** Corners of the boxes around the parts of arms at a configuration, as balls of radius zero; for many arms one box each. */
  bodyCorners(q) {
    const poses = new Float64Array(this.poses.length), T = new THREE.Matrix4(), placed = identity(), found = [];
    this.kinematics.forwardAll(q, poses);
    for (const arm of this.kinematics.arms) {
      const whole = new THREE.Box3();
      for (const { shape: index, pose, link } of arm.robot.visuals) {
        multiply(placed, 0, poses, 16 * (arm.firstLink + link), pose, 0);
        T.fromArray(placed);
        const box = this.boxOf(index);
        if (this.kinematics.arms.length > 12) whole.union(box.clone().applyMatrix4(T));
        else for (const [x, y, z] of cornersOf(box)) found.push([...new THREE.Vector3(x, y, z).applyMatrix4(T).toArray(), 0]);
      }
      found.push(...cornersOf(whole));
    }
    return found;
  }

  /** The box around a shape of the document. */
  boxOf(index) {
    const shape = this.doc.shapes[index];
    if (!shape.box) shape.box = shapeBox(shape);
    return shape.box;
  }

  /** Whether an arm can reach an obstacle, which is no longer than the arm: tables and walls would make the arm small. */
  isNearby(box) {
    const extent = box.getSize(new THREE.Vector3()).length(), base = new THREE.Vector3();
    return this.kinematics.arms.some((arm, k) => extent < this.reach[k] && box.distanceToPoint(base.fromArray(arm.base, 12)) < this.reach[k]);
  }

  /** A box around each obstacle and loose body; half-spaces have none. */
  obstacleBoxes() {
    const boxes = new Map(), T = new THREE.Matrix4();
    const add = (name, box) => { boxes.set(name, (boxes.get(name) || new THREE.Box3()).union(box)); };
    for (const { body, items } of this.obstacles.sets) {
      const geometry = body.geometry(0);
      if (!geometry.boundingBox) geometry.computeBoundingBox();
      for (const item of items) add(item.element, geometry.boundingBox.clone().applyMatrix4(T.fromArray(item.local)));
    }
    for (const object of this.doc.obstacles) {
      for (const part of object.parts) {
        const shape = this.doc.shapes[part.shape];
        if (shape.kind !== "cloud") continue;
        T.fromArray(object.pose).multiply(new THREE.Matrix4().fromArray(part.pose));
        add(object.name, new THREE.Box3().setFromArray(unpack(shape.points).values).applyMatrix4(T));
      }
    }
    if (this.bodyTrack) this.addBodyBoxes(add);
    return [...boxes.values()];
  }

  /** Adds boxes around the first and last poses of loose bodies. */
  addBodyBoxes(add) {
    const { times } = this.bodyTrack, T = new THREE.Matrix4(), placed = identity();
    for (const time of [times[times.length - 1], times[0]]) {
      this.updateBodies(time);
      this.doc.bodies.objects.forEach((object, k) => {
        if (!this.bodyPoses.subarray(16 * k, 16 * k + 3).some(Boolean)) return;
        for (const part of object.parts) {
          multiply(placed, 0, this.bodyPoses, 16 * k, part.pose, 0);
          add(object.name, this.boxOf(part.shape).clone().applyMatrix4(T.fromArray(placed)));
        }
      });
    }
  }

  dispose() {
    disposeTree(this.root);
  }
}

/** The box around some boxes. */
function unionOf(boxes) {
  return boxes.reduce((whole, box) => whole.union(box), new THREE.Box3());
}

/** Frees the graphics memory of an object and its parts. */
function disposeTree(root) {
  root.traverse((o) => {
    if (o.geometry && !Object.values(unit).includes(o.geometry)) o.geometry.dispose();
    if (o.material) {
      if (o.material.map) o.material.map.dispose();
      o.material.dispose();
    }
    if (o.isInstancedMesh) o.dispose();
  });
}
