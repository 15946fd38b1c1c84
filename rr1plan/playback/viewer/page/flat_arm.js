// A planar arm of two revolute (R) or prismatic (P) joints in closed form; the same formulas as
// `rr1plan/model/flat_arm.py`. Points and directions of the plane are complex numbers [re, im].

const cadd = ([a, b], [c, d]) => [a + c, b + d];
const cmul = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c];
const cdiv = ([a, b], [c, d]) => { const n = c * c + d * d; return [(a * c + b * d) / n, (b * c - a * d) / n]; };
const cscale = ([a, b], s) => [a * s, b * s];
const cturn = (angle) => [Math.cos(angle), Math.sin(angle)];
const cangle = ([a, b]) => Math.atan2(b, a);

class FlatArm {
  /** planar: {kinds, base, bars, senses, slides} */
  constructor(planar) {
    Object.assign(this, planar);
    this.base = planar.base.slice(0, 2);
  }

  /** Positions of first joint, second joint and tool. */
  places(q) {
    let at = this.base, rot = [1, 0];
    const found = [];
    [...this.kinds].forEach((kind, k) => {
      if (kind === "R") { found.push(at); rot = cmul(rot, cturn(this.senses[k] * q[k])); } else {
        at = cadd(at, cscale(cmul(rot, this.slides[k]), q[k]));
        found.push(at);
      }
      at = cadd(at, cmul(rot, this.bars[k]));
    });
    return [...found, at];
  }

  tool(q) {
    return this.places(q)[2];
  }

  /** The velocity of the tool for one unit of each joint, and how a joint follows a drag from one point to another. */
  columns(q) {
    const places = this.places(q), tool = places[2];
    let rot = [1, 0];
    return [...this.kinds].map((kind, k) => {
      if (kind === "P") return cmul(rot, this.slides[k]);
      rot = cmul(rot, cturn(this.senses[k] * q[k]));
      return cmul([0, this.senses[k]], cadd(tool, cscale(places[k], -1)));
    });
  }

  /** Manipulability |det J| (Yoshikawa 1985) [m to the power of the number of revolute joints]. */
  manipulability(q) {
    const [[a, b], [c, d]] = this.columns(q);
    return Math.abs(a * d - b * c);
  }

  /** Which of two solutions a configuration is: positive or negative; zero if they coincide or there is only one. */
  side(q) {
    const [a, c] = this.bars, [u1, u2] = this.slides;
    if (this.kinds === "RR") return Math.sin(this.senses[1] * q[1] + cangle(cdiv(c, a)));
    if (this.kinds === "RP") return q[1] + cdiv(cadd(a, c), u2)[0];
    if (this.kinds === "PR") return cdiv(cmul(c, cturn(this.senses[1] * q[1])), u1)[0];
    return 0;
  }

  /** Joint values that put the tool at a point, on one side; as near as possible if it is out of reach. */
  solve(x, y, side) {
    const target = [x - this.base[0], y - this.base[1]], [a, c] = this.bars, [s1, s2] = this.senses, [u1, u2] = this.slides;
    const rooted = (v) => Math.sqrt(Math.max(v, 0));
    const far = Math.hypot(...target), [la, lc] = [Math.hypot(...a), Math.hypot(...c)];
    if (this.kinds === "RR") {
      const bend = side * Math.acos(clamp((far * far - la * la - lc * lc) / (2 * la * lc), -1, 1));
      const reach = cmul(a, cadd([1, 0], cscale(cturn(bend), lc / la)));
      return [s1 * cangle(cdiv(target, reach)), s2 * cangle(cturn(bend - cangle(cdiv(c, a))))];
    }
    if (this.kinds === "RP") {
      const offset = cdiv(cadd(a, c), u2), along = side * rooted(far * far - offset[1] ** 2);
      return [s1 * cangle(cdiv(target, cmul(u2, [along, offset[1]]))), along - offset[0]];
    }
    if (this.kinds === "PR") {
      const local = cdiv(cadd(target, cscale(a, -1)), u1), across = lc * clamp(local[1] / lc, -1, 1);
      const first = local[0] - side * rooted(lc * lc - across * across);
      return [first, s2 * cangle(cdiv(cmul([local[0] - first, across], u1), c))];
    }
    const local = cdiv(cadd(target, cscale(cadd(a, c), -1)), u1), slope = cdiv(u2, u1);
    const second = local[1] / slope[1];
    return [local[0] - second * slope[0], second];
  }

  /** The same on the side of a configuration. */
  follow(q, [x, y]) {
    return this.solve(x, y, this.side(q) >= 0 ? 1 : -1);
  }

  /** The other joint values with the same tool position. */
  twin(q) {
    return this.solve(...this.tool(q), this.side(q) >= 0 ? -1 : 1);
  }

  /** All solutions for a point, ignoring limits; none if it is out of reach. */
  solutions(x, y) {
    const sides = this.kinds === "PP" ? [1] : [1, -1], near = 1e-6;
    return sides.map((side) => this.solve(x, y, side)).filter((q) => {
      const tool = this.tool(q);
      return Math.hypot(tool[0] - x, tool[1] - y) < near;
    });
  }
}
