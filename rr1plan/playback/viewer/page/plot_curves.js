// Curves over time for one arm: exact derivatives of the polynomials of its motion, and values sampled in Python.

/** The quantities that can be plotted; order: the derivative of the position; samples: a name in the document's samples. */
const QUANTITIES = {
  clearance: { label: "Clearance", samples: "clearance" },
  position: { label: "Position", order: 0, unit: "" },
  velocity: { label: "Velocity", order: 1, unit: "/s" },
  acceleration: { label: "Acceleration", order: 2, unit: "/s²" },
  jerk: { label: "Jerk", order: 3, unit: "/s³" },
  torque: { label: "Torque", samples: "torque", limit: "effort" },
  error: { label: "Tracking error", samples: "error" },
};
/** Distinct for color-blind readers, and dark enough for thin lines on white. */
const CURVES = ["#d4450c", "#1f6fd0", "#00724f", "#a4630a", "#7b3fa0", "#0a7f8a", "#c0307a", "#5b4636", "#4a58b8", "#667080"];
const PLANNER_SAMPLES = 200; // clearances of a motion computed by the planner of the page
const DASHES = { compare: [7, 4], replay: [2, 3] };

/** A number with three significant digits, without an exponent. */
function shortNumber(value) {
  const size = Math.abs(value);
  if (!Number.isFinite(value)) return "–";
  return (size < 1e-4 ? 0 : Number(value.toPrecision(3)) + 0).toLocaleString("en", { maximumFractionDigits: 6, useGrouping: false }).replace("-", "−");
}

/**
 * A curve over time.
 * name: of its joint; mark, color: distinguish it from others; motion: null, or the name of a motion other than the
 * page's; dash: of its line; bounds: allowed range [low, high], null where unlimited; unit; at(t): its value;
 * points(width): {times, values} for a drawing of that width [px].
 */
class PolynomialCurve {
  constructor(track, slot, order, scale, bounds) {
    Object.assign(this, { track, slot, order, scale, bounds });
  }

  at(t) {
    return this.scale * this.track.rate(t, this.slot, this.order);
  }

  /** Both ends of every piece, so that jumps are vertical, and as many points between them as the width can show. */
  points(width) {
    const { track, slot, order, scale } = this, times = [], values = [], { breaks } = track, span = track.end - track.start || 1;
    for (let i = 0; i < track.pieces; i++) {
      const coefficients = track.derived(i, slot, order), long = (breaks[i + 1] ?? breaks[i]) - breaks[i];
      const steps = coefficients.length < 3 ? 1 : clamp(Math.ceil((0.5 * width * long) / span), 4, 400);
      for (let k = 0; k <= steps; k++) {
        times.push(breaks[i] + (k / steps) * long);
        values.push(scale * horner(coefficients, (k / steps) * long));
      }
    }
    return thinned(times, values, width);
  }
}

class SampledCurve {
  constructor(times, values, bounds) {
    Object.assign(this, { times, values, bounds });
  }

  at(t) {
    const { times, values } = this, last = times.length - 1;
    if (t <= times[0]) return values[0];
    if (t >= times[last]) return values[last];
    const k = indexAt(times, t);
    return values[k] + ((t - times[k]) / (times[k + 1] - times[k])) * (values[k + 1] - values[k]);
  }

  points(width) {
    return thinned(this.times, this.values, width);
  }
}

/** Reduces very many points to the first, lowest, highest and last in each column of pixels, which give the same line. */
function thinned(times, values, width) {
  const count = times.length;
  if (count <= 8 * width) return { times, values };
  const out = { times: [], values: [] }, columns = 2 * width, span = times[count - 1] - times[0];
  for (let i = 0; i < count;) {
    const column = Math.floor(((times[i] - times[0]) / span) * columns), kept = [i, i, i, i];
    for (; i < count && Math.floor(((times[i] - times[0]) / span) * columns) === column; i++) {
      if (values[i] < values[kept[1]]) kept[1] = i;
      if (values[i] > values[kept[2]]) kept[2] = i;
      kept[3] = i;
    }
    for (const k of [...new Set(kept)].sort((a, b) => a - b)) { out.times.push(times[k]); out.values.push(values[k]); }
  }
  return out;
}

/** The motions of a page and their quantities that can be plotted. */
class PlotSource {
  /** onMeasured: called when clearances are known that the page has measured. */
  constructor(viewer, onMeasured = () => {}) {
    const { document: doc, player, others } = viewer;
    this.onMeasured = onMeasured;
    this.kinematics = viewer.kinematics;
    this.lengths = lengthUnit(viewer.world.span); // one unit for all curves of a quantity
    this.planner = viewer.planner;
    this.moved = viewer.moved.length > 0;
    this.measured = new Map(); // clearances that the page measures, by track: see `meter`
    // The planner has the obstacles at one time only.
    this.background = doc.bodies ? null : viewer.editing.background;
    this.motions = [];
    if (player.track && doc.track.timed) this.motions.push({ kind: "plan", name: null, track: player.track, exact: doc.track.exact, samples: doc.samples });
    else if (doc.samples.error) this.motions.push({ kind: "plan", name: null, track: null, exact: false, samples: doc.samples });
    for (const row of doc.compare) this.motions.push({ kind: "compare", name: row.name, track: others.get("compare"), exact: row.exact, samples: row.samples });
    if (others.has("replay")) this.motions.push({ kind: "replay", name: "simulated", track: others.get("replay"), exact: false, samples: {} });
    this.unpacked = new Map();
  }

  /** The arms that move. */
  arms() {
    return movedArms(this.kinematics, this.motions.flatMap(({ track, samples }) => [...(track ? track.columns : []), ...(samples.error ? samples.error.columns : [])]));
  }

  quantities(arm) {
    return Object.keys(QUANTITIES).filter((key) => this.curves(arm, key).length > 0);
  }

  /** The curves of a quantity of an arm: of each joint, or of its clearances; the motion of the page first. */
  curves(arm, key) {
    const { order, samples } = QUANTITIES[key];
    return this.motions.flatMap((motion) => {
      const found = order !== undefined ? this.derivatives(arm, key, motion) : samples === "clearance" ? this.clearances(arm, motion) : this.samples(arm, key, motion);
      return found.map((curve) => Object.assign(curve, { motion: motion.name, dash: DASHES[motion.kind] || [] }));
    });
  }

  derivatives(arm, key, { kind, track, exact }) {
    const { order, unit } = QUANTITIES[key];
    // A motion sent as samples has no derivatives.
    if (!track || (order > 0 && !exact) || (kind === "replay" && this.motions.length === 1 && order > 0)) return [];
    return arm.robot.names.flatMap((name, i) => {
      const slot = track.columns.indexOf(arm.firstColumn + i), straight = arm.robot.kinds[i] === "prismatic", scale = straight ? this.lengths.scale : DEGREES;
      if (slot < 0) return [];
      const limit = order > 0 ? arm.robot.rates[key][i] : null, [low, high] = order > 0 ? [limit === null ? null : -limit, limit] : arm.robot.limits[i];
      const bounds = low === null || high === null ? null : [scale * low, scale * high];
      return [Object.assign(new PolynomialCurve(track, slot, order, scale, bounds), { name, mark: String(i + 1), color: CURVES[i % CURVES.length], unit: (straight ? this.lengths.unit : "°") + unit })];
    });
  }

  samples(arm, key, { samples }) {
    const sent = samples[QUANTITIES[key].samples];
    if (!sent) return [];
    const { times, values, width } = this.unpack(sent, sent.columns.length);
    return arm.robot.names.flatMap((name, i) => {
      const slot = sent.columns.indexOf(arm.firstColumn + i), straight = arm.robot.kinds[i] === "prismatic", torque = key === "torque";
      if (slot < 0) return [];
      const scale = torque ? 1 : straight ? 1000 : DEGREES, limit = torque ? arm.robot.rates.effort[i] : null;
      const own = Float64Array.from(times, (_, k) => scale * values[k * width + slot]);
      const unit = torque ? (straight ? "N" : "Nm") : straight ? "mm" : "°";
      return [Object.assign(new SampledCurve(times, own, limit === null ? null : [-limit, limit]), { name, mark: String(i + 1), color: CURVES[i % CURVES.length], unit })];
    });
  }

  clearances(arm, motion) {
    const sent = motion.samples.clearance, k = sent ? sent.arms.indexOf(arm.name) : -1;
    if (k < 0 || this.moved) return this.measuredClearance(arm, motion, k >= 0);
    const { times, values, width } = this.unpack(sent, 2 * sent.arms.length);
    return ["to surroundings", "among own links"].flatMap((name, own) => {
      const distances = Float64Array.from(times, (_, i) => this.lengths.scale * values[i * width + 2 * k + own]);
      return distances.some(Number.isFinite) ? [Object.assign(new SampledCurve(times, distances, [0, null]), { name, mark: "ES"[own], color: CURVES[7 + own], unit: this.lengths.unit })] : [];
    });
  }

  /**
   * If Python has sent no clearances, or for obstacles elsewhere: the least clearance of all pairs, once it is measured;
   * of many arms it would take seconds. A chart that is there (`hasChart`) stays, without a curve until then.
   */
  measuredClearance(arm, { track, kind }, hasChart) {
    const { planner, background } = this, curve = (times, values) => [Object.assign(new SampledCurve(times, values, [0, null]), { name: "of all pairs", mark: "C", color: CURVES[7], unit: this.lengths.unit })];
    const isMeasured = planner && background && !(planner instanceof ManyArmsPlanner) && track && kind !== "replay" && planner.columns.includes(arm.firstColumn);
    if (isMeasured && !this.measured.has(track)) this.measure(this.meter(track, hasChart));
    const { times, values, hasChart: stays } = (isMeasured && this.measured.get(track)) || { values: null, hasChart };
    return values && values.some(Number.isFinite) ? curve(times, values) : stays ? curve([], []) : [];
  }

  /** The clearances along a motion, which are still unknown (null). */
  meter(track, hasChart) {
    const times = track.instants(PLANNER_SAMPLES);
    const rows = times.map((t) => {
      const q = track.at(t, this.kinematics.rest());
      return this.planner.columns.map((column) => q[column]);
    });
    this.measured.set(track, { track, times, rows, values: null, hasChart, isStale: false, isBusy: false });
    return this.measured.get(track);
  }

  /** Measures in the background, until no obstacle has moved meanwhile. */
  async measure(meter) {
    meter.isStale = true;
    if (meter.isBusy) return;
    meter.isBusy = true;
    while (meter.isStale) {
      meter.isStale = false;
      const meters = await this.background.run("clearances", [meter.rows]);
      if (!meters) { this.measured.delete(meter.track); return; } // canceled
      if (!meter.isStale) meter.values = meters.map((value) => this.lengths.scale * value);
    }
    meter.isBusy = false;
    this.onMeasured();
  }

  /** After an obstacle was moved: what was measured is no longer true. */
  measureAgain() {
    for (const meter of this.measured.values()) {
      meter.hasChart ||= Boolean(meter.values) && meter.values.some(Number.isFinite);
      meter.values = null;
      this.measure(meter);
    }
    if (this.measured.size) this.onMeasured();
  }

  unpack(sent, width) {
    if (!this.unpacked.has(sent)) this.unpacked.set(sent, { times: unpack(sent.times).values, values: unpack(sent.values).values, width });
    return this.unpacked.get(sent);
  }

  remark(key) {
    const { samples, exact, track } = this.motions[0] || { samples: {} };
    if (key === "torque" && samples.torque) return samples.torque.remark;
    if (key === "clearance" && track && track.end > track.start) {
      const meter = this.measured.get(track), isSent = samples.clearance && !this.moved;
      if (meter && !meter.values) return "being measured";
      return isSent || meter ? `at ${isSent ? samples.clearance.times.shape[0] : meter.times.length} instants` : "not measured since obstacles have moved";
    }
    return key === "position" && track && !exact ? "sent as samples, without derivatives" : "";
  }
}
