// Transforms are 16 numbers, column-major, in flat arrays; motions are polynomials.

const ARRAYS = { f4: Float32Array, f8: Float64Array, u4: Uint32Array };

/** Bytes from base64; by a loop, because `Uint8Array.from` takes several times as long. */
function bytesOf(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

/** Unpacks an array to {values, shape}; arrays created in the page already have this form. */
function unpack(packed) {
  return packed.values ? packed : { values: new ARRAYS[packed.dtype](bytesOf(packed.data).buffer), shape: packed.shape };
}

/** out[o..] = a[i..] * b[j..], rigid or affine; out is neither a nor b. */
function multiply(out, o, a, i, b, j) {
  for (let c = 0; c < 16; c += 4) {
    const x = b[j + c], y = b[j + c + 1], z = b[j + c + 2], last = c === 12 ? 1 : 0;
    out[o + c] = a[i] * x + a[i + 4] * y + a[i + 8] * z + last * a[i + 12];
    out[o + c + 1] = a[i + 1] * x + a[i + 5] * y + a[i + 9] * z + last * a[i + 13];
    out[o + c + 2] = a[i + 2] * x + a[i + 6] * y + a[i + 10] * z + last * a[i + 14];
    out[o + c + 3] = last;
  }
}

function identity() {
  return Float64Array.of(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1);
}

/** T_joint_child of a joint at a value [rad or m]; out is a transform. */
function jointMotion(out, joint, value) {
  const [x, y, z] = joint.axis, turning = joint.kind === 2, shift = joint.kind === 1 ? value : 0;
  const s = turning ? Math.sin(value) : 0, c = turning ? Math.cos(value) : 1, u = 1 - c;
  out[0] = c + x * x * u; out[1] = x * y * u + z * s; out[2] = x * z * u - y * s;
  out[4] = x * y * u - z * s; out[5] = c + y * y * u; out[6] = y * z * u + x * s;
  out[8] = x * z * u + y * s; out[9] = y * z * u - x * s; out[10] = c + z * z * u;
  out[12] = shift * x; out[13] = shift * y; out[14] = shift * z;
}

/** Whether a point is inside a polygon. */
function insidePolygon([x, y], corners) {
  let inside = false;
  corners.forEach(([ax, ay], k) => {
    const [bx, by] = corners[(k + 1) % corners.length];
    if (ay > y !== by > y && x < ax + ((y - ay) / (by - ay)) * (bx - ax)) inside = !inside;
  });
  return inside;
}

/** Poses of all links of all arms. Links are numbered arm after arm, columns of q likewise. */
class Kinematics {
  constructor(doc) {
    this.arms = [];
    this.links = 0;
    this.columns = 0;
    for (const row of doc.arms) {
      const robot = doc.robots[row.robot];
      this.arms.push({
        name: row.name, robot, base: Float64Array.from(row.base),
        firstLink: this.links, firstColumn: this.columns, q: Float64Array.from(row.q),
      });
      this.links += robot.links.length;
      this.columns += robot.names.length;
    }
    this.motion = identity();
    this.step = identity();
  }

  /** All arms at their configurations in the scene. */
  rest() {
    const q = new Float64Array(this.columns);
    for (const arm of this.arms) q.set(arm.q, arm.firstColumn);
    return q;
  }

  /** All arms at their configurations in the scene, except one at a given configuration. */
  standing(name, own) {
    const q = this.rest();
    q.set(own, this.arms.find((arm) => arm.name === name).firstColumn);
    return q;
  }

  linkIndex(arm, link) {
    return arm.firstLink + arm.robot.links.indexOf(link);
  }

  toolIndex(arm) {
    return arm.firstLink + arm.robot.tool;
  }

  /** The element that a joint ("arm/joint") moves, "arm/link"; other names are returned unchanged. */
  elementOf(name) {
    for (const arm of this.arms) {
      const column = arm.robot.names.findIndex((joint) => `${arm.name}/${joint}` === name);
      if (column < 0) continue;
      const joint = arm.robot.joints.find((one) => one.column === column && one.factor === 1) || arm.robot.joints.find((one) => one.column === column);
      return `${arm.name}/${arm.robot.links[joint.child]}`;
    }
    return name;
  }

  /** Poses of one arm's links into poses, at 16 * its first link. */
  forward(arm, q, poses) {
    const first = arm.firstLink;
    poses.set(arm.base, 16 * first);
    for (const joint of arm.robot.joints) {
      const value = joint.offset + (joint.column < 0 ? 0 : joint.factor * q[arm.firstColumn + joint.column]);
      jointMotion(this.motion, joint, value);
      multiply(this.step, 0, joint.origin, 0, this.motion, 0);
      multiply(poses, 16 * (first + joint.child), poses, 16 * (first + joint.parent), this.step, 0);
    }
  }

  forwardAll(q, poses) {
    for (const arm of this.arms) this.forward(arm, q, poses);
    return poses;
  }
}

/** A value between bounds, of which null means none. */
function clamp(value, low, high) {
  return Math.min(Math.max(value, low ?? -Infinity), high ?? Infinity);
}

/** A configuration with other values in some columns. */
function withColumns(q, columns, values) {
  const out = q.slice();
  columns.forEach((column, k) => { out[column] = values[k]; });
  return out;
}

/** The index of the last of some ascending times that is not after t, up to a last index; 0 before the first. */
function indexAt(times, t, last = times.length - 1) {
  let low = 0;
  for (let high = last; low < high;) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

/** Piecewise polynomials of time: sum_k c[piece][k] (t - start of the piece)^k. */
class Track {
  constructor(row) {
    this.columns = row.columns;
    this.breaks = unpack(row.breaks).values;
    const { values, shape } = unpack(row.coefficients);
    this.coefficients = values;
    this.pieces = shape[0];
    this.terms = shape[1];
    this.width = shape[2];
    this.start = this.breaks[0];
    this.end = this.breaks[this.breaks.length - 1];
  }

  /** Instants at equal intervals, both ends included. */
  instants(intervals) {
    return Array.from({ length: intervals + 1 }, (_, i) => this.start + (i / intervals) * (this.end - this.start));
  }

  piece(t) {
    return indexAt(this.breaks, t, this.pieces - 1);
  }

  /** Writes the columns of this motion into q. */
  at(t, q) {
    t = clamp(t, this.start, this.end);
    const i = this.piece(t), local = t - this.breaks[i];
    const { coefficients, terms, width } = this;
    for (let j = 0; j < width; j++) {
      let value = 0;
      for (let k = terms - 1; k >= 0; k--) value = value * local + coefficients[(i * terms + k) * width + j];
      q[this.columns[j]] = value;
    }
    return q;
  }

  /** The coefficients of a derivative of one slot on piece i, lowest power first. */
  derived(i, slot, order) {
    const { coefficients, terms, width } = this, out = [];
    for (let k = order; k < terms; k++) {
      let factor = 1;
      for (let n = k; n > k - order; n--) factor *= n;
      out.push(factor * coefficients[(i * terms + k) * width + slot]);
    }
    return out;
  }

  /** A derivative of one slot at a time; zero beyond the ends; at a break, that of the piece that begins there. */
  rate(t, slot, order) {
    if (order > 0 && (t < this.start || t > this.end)) return 0;
    const time = clamp(t, this.start, this.end), i = this.piece(time);
    return horner(this.derived(i, slot, order), time - this.breaks[i]);
  }
}

const horner = (coefficients, x) => coefficients.reduceRight((value, c) => value * x + c, 0);
