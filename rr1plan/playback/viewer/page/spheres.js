// The spheres that contain links and held objects, coarse to fine.

/** Layers: one sphere around each link, one around each of its convex bodies, many inside these; and their opacity. */
const SPHERE_LAYERS = [["linkspheres", 0.5], ["bodyspheres", 0.6], ["spheres", 0.75]];

class Spheres {
  constructor(doc, kinematics, sides) {
    this.doc = doc;
    this.kinematics = kinematics;
    // The drawn polyhedron contains the sphere; otherwise the link would protrude through its facets.
    this.sides = sides;
    this.wider = Math.cos(Math.PI / sides) ** -2;
    const items = this.items();
    const oneBodyEach = items[0].length === items[1].length;
    this.finest = items[2];
    this.layers = new Map(SPHERE_LAYERS.map(([name, opacity], level) => [
      name, new Bodies(level === 1 && oneBodyEach ? [] : items[level], { opacity, order: 6 - level, rim: true }),
    ]));
  }

  /** The spheres of each level. */
  items() {
    const levels = [[], [], []];
    this.kinematics.arms.forEach((arm, index) => {
      const rows = unpackSpheres(arm.robot.spheres), covered = [...new Set(rows.map((row) => row.link))];
      for (const row of rows) {
        levels[row.level].push(this.item(row, IDENTITY, arm.firstLink + row.link, armColor(covered.indexOf(row.link)),
          `${arm.name}/${arm.robot.links[row.link]}`, index));
      }
      for (const held of this.doc.attachments.filter((h) => h.arm === arm.name)) {
        const frame = this.kinematics.linkIndex(arm, held.link);
        for (const row of unpackSpheres(held.spheres)) levels[row.level].push(this.item(row, held.pose, frame, HELD, held.name, index));
      }
    });
    return levels;
  }

  item({ center, radius }, pose, frame, color, element, arm) {
    const shift = identity(), placed = identity();
    shift.set(center, 12);
    multiply(placed, 0, pose, 0, shift, 0);
    const { body, scale } = shapeBody({ kind: "sphere", radius: this.wider * radius }, this.sides);
    return { body, local: scaled(placed, scale), radius, pose: placed, frame, color, element, arm, opacity: 1 };
  }

  /** A summary in words; empty without spheres. */
  summary() {
    if (!this.finest.length) return null;
    const things = new Set(this.finest.map((item) => item.element));
    const held = this.doc.attachments.some((h) => things.has(h.name));
    return `${this.finest.length} contain ${things.size} ${held ? "links and held objects" : "links"}`;
  }

  /** Makes room for the finest spheres at some configurations. */
  expand(box, samples) {
    const poses = new Float64Array(16 * this.kinematics.links), placed = identity();
    for (const q of this.finest.length ? samples : []) {
      this.kinematics.forwardAll(q, poses);
      for (const { pose, radius: r, frame } of this.finest) {
        multiply(placed, 0, poses, 16 * frame, pose, 0);
        const [x, y, z] = placed.subarray(12, 15);
        box.expandByPoint(new THREE.Vector3(x - r, y - r, z - r)).expandByPoint(new THREE.Vector3(x + r, y + r, z + r));
      }
    }
  }
}

/** Rows {link, level, center, radius}; none if no spheres were sent. */
function unpackSpheres(packed) {
  if (!packed) return [];
  const links = unpack(packed.links).values, levels = unpack(packed.levels).values, spheres = unpack(packed.spheres).values;
  return Array.from(links, (link, i) => ({
    link, level: levels[i], center: spheres.subarray(4 * i, 4 * i + 3), radius: spheres[4 * i + 3],
  }));
}
