// The tool's Jacobian: its speed, and by damped least squares the joint motion for a dragged tool.

const MOST_STEP = 0.35; // [rad or m] largest change of a joint in one iteration
const ITERATIONS = 40;
const NEAR_ENOUGH = 1e-5; // of the length of the chain or [m]: weighted error at which iterations end

/** The angle-axis vector from one rotation to another, both as the 3 x 3 part of a transform at an offset. */
function rotationError(from, i, to) {
  const R = new Float64Array(9); // to * from^T, row after row
  for (let r = 0; r < 3; r++) for (let c = 0; c < 3; c++) for (let k = 0; k < 3; k++) R[3 * r + c] += to[4 * k + r] * from[i + 4 * k + c];
  const v = [R[7] - R[5], R[2] - R[6], R[3] - R[1]], s = Math.hypot(...v) / 2, c = (R[0] + R[4] + R[8] - 1) / 2;
  const angle = Math.atan2(s, c);
  if (s > 1e-9) return v.map((value) => (value / (2 * s)) * angle);
  if (c > 0) return [0, 0, 0];
  // Half a turn: the axis is the largest column of R + I.
  const k = [0, 1, 2].reduce((best, j) => (R[4 * j] > R[4 * best] ? j : best), 0);
  const axis = [0, 1, 2].map((r) => R[3 * r + k] + (r === k ? 1 : 0)), size = Math.hypot(...axis);
  return axis.map((value) => (value / size) * Math.PI);
}

/** Solves A x = b for a symmetric positive definite A (n x n, rows), which is overwritten (Cholesky). */
function solveSymmetric(A, b, n) {
  for (let j = 0; j < n; j++) {
    for (let i = j; i < n; i++) {
      let sum = A[i * n + j];
      for (let k = 0; k < j; k++) sum -= A[i * n + k] * A[j * n + k];
      A[i * n + j] = i === j ? Math.sqrt(Math.max(sum, 1e-300)) : sum / A[j * n + j];
    }
  }
  const x = Float64Array.from(b);
  for (let i = 0; i < n; i++) { for (let k = 0; k < i; k++) x[i] -= A[i * n + k] * x[k]; x[i] /= A[i * n + i]; }
  for (let i = n - 1; i >= 0; i--) { for (let k = i + 1; k < n; k++) x[i] -= A[k * n + i] * x[k]; x[i] /= A[i * n + i]; }
  return x;
}

class DifferentialIk {
  /** poses: memory for the poses of all links, which several solvers may share. */
  constructor(kinematics, arm, poses) {
    Object.assign(this, { kinematics, arm, poses, count: arm.robot.names.length, tool: 16 * kinematics.toolIndex(arm) });
    this.J = new Float64Array(6 * this.count); // column-major: linear, angular
    this.chain = this.jointsTo(arm.robot.tool);
    // An error of one radian weighs as much as this length [m]: about the reach of a wrist.
    const far = this.chain.reduce((sum, { origin }) => sum + Math.hypot(origin[12], origin[13], origin[14]), 0);
    this.turn = this.count >= 6 ? 0.25 * (far || 1) : 0;
    this.enough = NEAR_ENOUGH * Math.min(1, far || 1);
  }

  /** The joints from the base to a link. */
  jointsTo(link) {
    const { joints } = this.arm.robot, chain = [];
    for (let child = link; ;) {
      const joint = joints.find((j) => j.child === child);
      if (!joint) return chain.reverse();
      chain.push(joint);
      child = joint.parent;
    }
  }

  /** The column (of the arm) that moves a link next, or -1: the last movable joint before it. */
  columnOf(link) {
    const moving = this.jointsTo(link).filter((joint) => joint.column >= 0);
    return moving.length ? moving[moving.length - 1].column : -1;
  }

  /** T_world_tool at q (of all arms). */
  toolPose(q) {
    this.kinematics.forward(this.arm, q, this.poses);
    return this.poses.slice(this.tool, this.tool + 16);
  }

  /** The tool's Jacobian in world axes, (6, n) column-major: linear, angular. */
  jacobian(q) {
    const { J, poses, tool, arm } = this;
    this.kinematics.forward(arm, q, poses);
    J.fill(0);
    for (const { kind, child, axis, column, factor } of this.chain) {
      if (column < 0) continue;
      const at = 16 * (arm.firstLink + child), [x, y, z] = axis;
      const a = [0, 1, 2].map((r) => factor * (poses[at + r] * x + poses[at + 4 + r] * y + poses[at + 8 + r] * z));
      const p = [12, 13, 14].map((k) => poses[tool + k] - poses[at + k]);
      const linear = kind === 1 ? a : [a[1] * p[2] - a[2] * p[1], a[2] * p[0] - a[0] * p[2], a[0] * p[1] - a[1] * p[0]];
      for (let r = 0; r < 3; r++) { J[6 * column + r] += linear[r]; J[6 * column + 3 + r] += kind === 1 ? 0 : a[r]; }
    }
    return J;
  }

  /** The speed of the tool [m/s] at q, for velocities of all joints. */
  toolSpeed(q, rates) {
    const J = this.jacobian(q), own = rates.subarray(this.arm.firstColumn, this.arm.firstColumn + this.count);
    return Math.hypot(...[0, 1, 2].map((r) => own.reduce((sum, rate, column) => sum + J[6 * column + r] * rate, 0)));
  }

  /** Yoshikawa's manipulability: the product of the Jacobian's singular values; 0 if the arm is singular. */
  manipulability(q) {
    const J = this.jacobian(q), n = this.count, size = Math.min(6, n), A = new Float64Array(size * size);
    for (let i = 0; i < size; i++) {
      for (let j = 0; j < size; j++) {
        const length = n < 6 ? 6 : n;
        for (let k = 0; k < length; k++) A[size * i + j] += n < 6 ? J[6 * i + k] * J[6 * j + k] : J[6 * k + i] * J[6 * k + j];
      }
    }
    return Math.sqrt(Math.max(determinant(A, size), 0));
  }

  /** The weighted error of the tool at q, shape (6,), and the distances {off [m], turned [rad]}. */
  error(q, target) {
    const pose = this.toolPose(q), e = new Float64Array(6), turned = rotationError(pose, 0, target);
    for (let r = 0; r < 3; r++) { e[r] = target[12 + r] - pose[12 + r]; e[3 + r] = this.turn * turned[r]; }
    return { e, size: Math.hypot(...e), off: Math.hypot(e[0], e[1], e[2]), turned: this.turn ? Math.hypot(...turned) : 0 };
  }

  /**
   * The configuration within the limits whose tool is locally nearest to a pose, starting from q; arms of fewer than
   * six joints follow the position only. Returns {q, off [m], turned [rad], atLimit: columns of the arm at a limit}.
   * Source: Levenberg-Marquardt, Sugihara 2011, with an active set of limits.
   */
  solve(q, target) {
    const { arm, count: n, turn } = this, { limits } = arm.robot, first = arm.firstColumn;
    let now = q.slice(), best = this.error(now, target), damping = 1e-4;
    for (let k = 0; k < ITERATIONS && best.size > this.enough && damping < 1e3; k++) {
      const J = Float64Array.from(this.jacobian(now)), e = best.e, free = Array(n).fill(true);
      for (let c = 0; c < n; c++) for (let r = 3; r < 6; r++) J[6 * c + r] *= turn;
      let step = null;
      for (let round = 0; round <= n; round++) {
        step = this.step(J, e, free, damping);
        const pushed = limits.findIndex(([low, high], c) => free[c]
          && ((high !== null && now[first + c] >= high && step[c] > 0) || (low !== null && now[first + c] <= low && step[c] < 0)));
        if (pushed < 0) break;
        free[pushed] = false;
      }
      const most = Math.max(...step.map(Math.abs)), scale = most > MOST_STEP ? MOST_STEP / most : 1, next = now.slice();
      if (most < 1e-9) break;
      for (let c = 0; c < n; c++) {
        const [low, high] = limits[c], value = now[first + c] + scale * step[c];
        next[first + c] = clamp(value, low, high);
      }
      const better = this.error(next, target);
      if (better.size < best.size) { now = next; best = better; damping = Math.max(1e-8, damping / 4); }
      else damping *= 6;
    }
    const atLimit = limits.flatMap(([low, high], c) => (now[first + c] === low || now[first + c] === high ? [c] : []));
    return { q: now, off: best.off, turned: best.turned, atLimit };
  }

  step(J, e, free, damping) {
    const n = this.count, A = new Float64Array(n * n), b = new Float64Array(n);
    for (let i = 0; i < n; i++) {
      if (!free[i]) { A[n * i + i] = 1; continue; }
      for (let r = 0; r < 6; r++) b[i] += J[6 * i + r] * e[r];
      for (let j = 0; j < n; j++) if (free[j]) for (let r = 0; r < 6; r++) A[n * i + j] += J[6 * i + r] * J[6 * j + r];
      A[n * i + i] += damping;
    }
    return solveSymmetric(A, b, n);
  }
}

/** The determinant of a matrix (n x n, rows), which is overwritten (elimination with pivots). */
function determinant(A, n) {
  let product = 1;
  for (let j = 0; j < n; j++) {
    let pivot = j;
    for (let i = j + 1; i < n; i++) if (Math.abs(A[i * n + j]) > Math.abs(A[pivot * n + j])) pivot = i;
    if (A[pivot * n + j] === 0) return 0;
    if (pivot !== j) {
      product = -product;
      for (let k = 0; k < n; k++) [A[pivot * n + k], A[j * n + k]] = [A[j * n + k], A[pivot * n + k]];
    }
    product *= A[j * n + j];
    for (let i = j + 1; i < n; i++) {
      const share = A[i * n + j] / A[j * n + j];
      for (let k = j; k < n; k++) A[i * n + k] -= share * A[j * n + k];
    }
  }
  return product;
}
