// Instanced solids: many copies in one draw call, each at the level of detail that its size on the screen requires.

/** Reflection of the surrounding lamps and walls by matte surfaces, independent of their color. */
const SHEEN = 0x030303;

/** Levels of detail: features smaller than this [m] are omitted; level 0 is the full geometry. */
const RESOLUTIONS = [0, 0.001, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064];

/** The coarsest level that keeps all features of a size [m]. */
function levelOf(size) {
  return size < RESOLUTIONS[1] ? 0 : Math.min(RESOLUTIONS.length - 1, 1 + Math.floor(Math.log2(size / RESOLUTIONS[1])));
}

/** Number of sides of a round part such that its facets deviate from the circle by at most half a resolution [m]. */
function sidesOf(radius, resolution) {
  const cosine = 1 - (0.5 * resolution) / radius;
  return cosine > 0 ? Math.max(5, Math.min(36, Math.ceil(Math.PI / Math.acos(cosine)))) : 5;
}

/** Apparent size of a shape [m]: cube root of the volume of its bounding box, with a minimum thickness. */
function sizeOf(shape) {
  const sizes = shapeBox(shape).getSize(new THREE.Vector3()).toArray(), thin = Math.max(...sizes) / 16;
  return Math.cbrt(sizes.reduce((product, size) => product * Math.max(size, thin), 1));
}

/** Some shapes of one link as one body: all copies of the link are drawn in one call. */
class LinkBody {
  /** parts: {shape, pose (in the link's frame)}; all: the opaque parts of the link, which hide geometry inside them */
  constructor(parts, all) {
    this.parts = parts.filter(({ shape }) => solid(shape, 5));
    this.all = all;
    this.geometries = [];
  }

  /** The geometry of a level, created on first use; null if everything is smaller than the level's resolution. */
  geometry(level) {
    if (this.geometries[level] === undefined) this.geometries[level] = this.merged(RESOLUTIONS[level]);
    return this.geometries[level];
  }

  merged(resolution) {
    const placed = [];
    for (const part of this.parts) {
      const { shape, pose } = part, size = sizeOf(shape);
      if (size < resolution) continue;
      const { geometry, scale } = solid(shape, sidesOf(shape.radius || 1, resolution), resolution);
      const own = geometry.clone().applyMatrix4(new THREE.Matrix4().fromArray(scaled(pose, scale)));
      // If two parts hide each other, the larger one is kept, or the first.
      const larger = resolution > 0 ? this.all.filter((other) => other !== part && sizeOf(other.shape) >= size
        && (sizeOf(other.shape) > size || this.all.indexOf(other) < this.all.indexOf(part))) : [];
      const left = larger.reduce((g, other) => withoutInside(g, other, resolution / 2), own);
      if (left.index === null || left.index.count) placed.push(left);
    }
    return placed.length ? joined(placed) : null;
  }
}

/** A geometry without the triangles inside of a convex part, or no farther than a distance [m] outside. */
function withoutInside(geometry, { shape, pose }, slack) {
  const inside = {
    box: (p) => Math.abs(p.x) <= shape.size[0] / 2 + slack && Math.abs(p.y) <= shape.size[1] / 2 + slack && Math.abs(p.z) <= shape.size[2] / 2 + slack,
    sphere: (p) => p.length() <= shape.radius + slack,
    cylinder: (p) => Math.hypot(p.x, p.y) <= shape.radius + slack && Math.abs(p.z) <= shape.length / 2 + slack,
    capsule: (p) => Math.hypot(p.x, p.y, Math.max(0, Math.abs(p.z) - shape.length / 2)) <= shape.radius + slack,
  }[shape.kind];
  if (!inside || !geometry.index) return geometry;
  const { position } = geometry.attributes, T = new THREE.Matrix4().fromArray(pose), p = new THREE.Vector3();
  if (!geometry.boundingBox) geometry.computeBoundingBox();
  if (!shapeBox(shape).expandByScalar(slack).applyMatrix4(T).intersectsBox(geometry.boundingBox)) return geometry;
  T.invert();
  const hidden = Array.from({ length: position.count }, (_, i) => inside(p.fromBufferAttribute(position, i).applyMatrix4(T)));
  const index = [...geometry.index.array], kept = [];
  for (let i = 0; i < index.length; i += 3) {
    const triangle = index.slice(i, i + 3);
    if (!triangle.every((v) => hidden[v])) kept.push(...triangle);
  }
  return kept.length === index.length ? geometry : geometry.setIndex(kept);
}

/** Merges the triangles of several geometries. */
function joined(geometries) {
  const position = [], normal = [], index = [];
  for (const g of geometries) {
    const places = new Map(), count = (g.index || g.attributes.position).count;
    for (let i = 0; i < count; i++) {
      const v = g.index ? g.index.getX(i) : i;
      if (!places.has(v)) {
        places.set(v, position.length / 3);
        for (const [all, own] of [[position, g.attributes.position], [normal, g.attributes.normal]]) all.push(own.getX(v), own.getY(v), own.getZ(v));
      }
      index.push(places.get(v));
    }
  }
  const whole = new THREE.BufferGeometry();
  whole.setAttribute("position", new THREE.Float32BufferAttribute(position, 3));
  whole.setAttribute("normal", new THREE.Float32BufferAttribute(normal, 3));
  return whole.setIndex(index);
}

/** A shape that is identical at every level; shapes with the same geometry are one body. */
const shapeBodies = new WeakMap();
function shapeBody(shape, sides) {
  const found = solid(shape, sides);
  if (!found) return null;
  if (!shapeBodies.has(found.geometry)) shapeBodies.set(found.geometry, { geometry: () => found.geometry, alike: true });
  return { body: shapeBodies.get(found.geometry), scale: found.scale };
}

/** All arms at full detail. */
const IN_FULL = { levels: null, version: 0 };

/**
 * Solids drawn together: one call for each body, opacity and level of detail.
 * Transparent solids hide those behind them that are drawn later; the order is: solids of the document, collision
 * shapes, spheres from fine to coarse, ghosts.
 * items: {body, local (with its frame; null: the frame itself), frame (link number, or -1: the world), color, opacity,
 * element, arm}; detail: {levels (of each arm; below zero it is not drawn), version}.
 */
class Bodies {
  constructor(items, style) {
    this.group = new THREE.Group();
    const sets = new Map();
    for (const item of items) {
      const opacity = style.opacity || item.opacity;
      if (!sets.has(item.body)) sets.set(item.body, new Map());
      const of = sets.get(item.body);
      if (!of.has(opacity)) of.set(opacity, []);
      of.get(opacity).push(item);
    }
    this.sets = [...sets].flatMap(([body, of]) => [...of].map(([opacity, own]) => new BodySet(body, own, opacity, style, this.group)));
  }

  /** Moves all items to the poses of their links. */
  update(poses, detail = IN_FULL) {
    for (const set of this.sets) set.update(poses, detail);
  }

  /** Gives every item the color that choose(item) returns (rgb, 0..1). */
  paint(choose) {
    for (const set of this.sets) set.paint(choose);
  }

  /** With highlights and shadows, or plainly. */
  setRich(on) {
    for (const set of this.sets) set.setRich(on);
  }

  dispose() {
    for (const set of this.sets) set.dispose();
  }
}

/** Copies of one body. */
class BodySet {
  constructor(body, items, opacity, style, group) {
    Object.assign(this, { body, items, style, group, clear: opacity < 1, meshes: [], counts: new Int32Array(RESOLUTIONS.length) });
    this.rich = this.clear ? clearMaterial(opacity, style) : new THREE.MeshStandardMaterial({
      roughness: style.roughness || 0.55, metalness: 0.02, emissive: SHEEN,
    });
    this.plain = this.clear ? this.rich : new THREE.MeshLambertMaterial();
    this.isRich = true;
    this.colors = new Float32Array(3 * items.length);
    this.paint((item) => item.color);
  }

  /** The copies at full detail. */
  get drawn() {
    return this.mesh(0);
  }

  /** The copies drawn at a level, created on first use; null if they are invisible at that level. */
  mesh(level) {
    if (this.meshes[level] === undefined) {
      const geometry = this.body.geometry(level);
      this.meshes[level] = geometry && this.add(geometry);
    }
    return this.meshes[level];
  }

  add(geometry) {
    const { clear, style, items, group } = this;
    const drawn = new THREE.InstancedMesh(geometry, this.isRich ? this.rich : this.plain, items.length);
    drawn.setColorAt(0, new THREE.Color());
    drawn.frustumCulled = drawn.matrixAutoUpdate = false;
    drawn.castShadow = !clear && style.shadow !== false;
    drawn.receiveShadow = !clear && this.isRich;
    drawn.renderOrder = clear ? style.order || 2 : 0;
    group.add(drawn);
    if (clear) {
      // Depth first, then color: only the nearest surface of a transparent body is visible.
      const depth = new THREE.InstancedMesh(geometry, new THREE.MeshBasicMaterial({
        colorWrite: false, transparent: true, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2,
      }), items.length);
      depth.instanceMatrix = drawn.instanceMatrix;
      depth.frustumCulled = depth.matrixAutoUpdate = false;
      depth.renderOrder = drawn.renderOrder - 0.5;
      drawn.userData.depth = depth;
      group.add(depth);
    }
    return drawn;
  }

  /** Fills the copies of each level one after the other; updates colors only where the copies may have changed. */
  update(poses, detail) {
    const { body, items, counts, colors } = this, recolor = this.shown !== detail.version;
    this.shown = detail.version;
    counts.fill(0);
    for (let i = 0; i < items.length; i++) {
      const { arm, frame, local } = items[i], wanted = arm < 0 || !detail.levels ? 0 : detail.levels[arm];
      const level = body.alike ? Math.min(wanted, 0) : wanted, mesh = level < 0 ? null : this.mesh(level);
      if (!mesh) continue;
      const slot = counts[level]++, out = mesh.instanceMatrix.array;
      if (frame < 0) out.set(local, 16 * slot);
      else if (local) multiply(out, 16 * slot, poses, 16 * frame, local, 0);
      else for (let k = 0; k < 16; k++) out[16 * slot + k] = poses[16 * frame + k];
      if (recolor) for (let k = 0; k < 3; k++) mesh.instanceColor.array[3 * slot + k] = colors[3 * i + k];
    }
    for (let level = 0; level < this.meshes.length; level++) {
      const mesh = this.meshes[level];
      if (!mesh) continue;
      const { depth } = mesh.userData;
      mesh.count = counts[level];
      mesh.visible = mesh.count > 0;
      if (depth) { depth.count = mesh.count; depth.visible = mesh.visible; }
      mesh.instanceMatrix.needsUpdate = true;
      if (recolor) mesh.instanceColor.needsUpdate = true;
    }
  }

  /** Colors take effect at the next update. */
  paint(choose) {
    this.items.forEach((item, i) => light(choose(item)).toArray(this.colors, 3 * i));
    this.shown = null;
  }

  setRich(on) {
    if (on === this.isRich || this.clear) return;
    this.isRich = on;
    for (const mesh of this.meshes) if (mesh) { mesh.material = on ? this.rich : this.plain; mesh.receiveShadow = on; }
  }

  dispose() {
    const meshes = this.meshes.filter(Boolean).flatMap((mesh) => [mesh, mesh.userData.depth].filter(Boolean));
    for (const mesh of meshes) { mesh.material.dispose(); mesh.dispose(); }
    this.rich.dispose();
    this.plain.dispose();
  }
}

function clearMaterial(opacity, style) {
  return style.rim ? rimMaterial(opacity) : new THREE.MeshLambertMaterial({
    transparent: true, opacity, depthWrite: false, emissive: 0x555555, emissiveIntensity: 0.3,
    polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2,
  });
}
