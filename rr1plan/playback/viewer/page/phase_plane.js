// The phase plane of a motion: its speed along the path, and the limit curve from velocity and acceleration limits.

const PHASE_SAMPLES = 600;

/**
 * Path length s, path speed and its limit along a motion, shape (3, n); rates: {velocity, acceleration} of its columns.
 *
 * The limit is the largest path speed at which the joints keep their velocity limits, and at which some path
 * acceleration keeps their acceleration limits (Bobrow, Dubowsky and Gibson 1985).
 */
function phasePlane(track, rates) {
  const { columns } = track, q = new Float64Array(Math.max(...columns) + 1), count = PHASE_SAMPLES;
  const out = { s: new Float64Array(count + 1), speed: new Float64Array(count + 1), limit: new Float64Array(count + 1) };
  const span = track.end - track.start, nq = columns.length;
  let s = 0, last = null;
  for (let k = 0; k <= count; k++) {
    // Denser at both ends, where the motion is slow.
    const share = 0.5 - 0.5 * Math.cos((Math.PI * k) / count);
    const inside = track.start + clamp(share, 1e-9, 1 - 1e-9) * span;
    const [rate, second] = [1, 2].map((order) => columns.map((_, slot) => track.rate(inside, slot, order)));
    track.at(track.start + share * span, q);
    const here = columns.map((c) => q[c]), speed = Math.hypot(...rate);
    if (last) s += Math.hypot(...here.map((v, j) => v - last[j]));
    last = here;
    const along = rate.map((v) => v / Math.max(speed, 1e-12)), gain = along.reduce((sum, v, j) => sum + v * second[j], 0);
    const bend = second.map((v, j) => (speed > 1e-6 ? (v - along[j] * gain) / (speed * speed) : 0));
    let most = Infinity, squared = Infinity;
    for (let j = 0; j < nq; j++) {
      const slope = Math.abs(along[j]), { velocity: v, acceleration: a } = rates;
      if (slope > 1e-9) most = Math.min(most, v[j] / slope);
      for (let i = 0; i < j; i++) {
        // Both joints must allow the same path acceleration.
        const gap = Math.abs(bend[j] * along[i] - bend[i] * along[j]);
        if (gap > 1e-9) squared = Math.min(squared, (a[j] * Math.abs(along[i]) + a[i] * slope) / gap);
      }
    }
    out.s[k] = s;
    out.speed[k] = speed;
    out.limit[k] = Math.min(most, Math.sqrt(squared));
  }
  return out;
}

/** The unit of lengths of paths of the two joints. */
const pathUnit = () => [...new Set(data.joints.map(({ straight }) => (straight ? "m" : "rad")))].sort().join(" and ");

/** Draws a phase plane into a canvas, or the reason why there is none; at: the current time of the motion, or null. */
function drawPhasePlane(canvas, plane, at, why) {
  const ratio = fineness() * magnification(), pen = canvas.getContext("2d");
  const width = (canvas.width = Math.max(1, Math.round(canvas.clientWidth * fineness())));
  const height = (canvas.height = Math.max(1, Math.round(canvas.clientHeight * fineness())));
  const left = 34 * ratio, below = 20 * ratio, top = 10 * ratio, right = 10 * ratio;
  if (!plane) {
    pen.fillStyle = SOFT;
    pen.font = `${12 * ratio}px ${FONT}`;
    pen.fillText(why, 10 * ratio, height / 2);
    return;
  }
  const length = plane.s[plane.s.length - 1] || 1, fastest = Math.max(...plane.speed, 1e-9);
  const highest = 1.12 * Math.max(fastest, Math.min(...plane.limit, Infinity), Math.min(Math.max(...plane.limit), 1.5 * fastest));
  const x = (s) => left + (s / length) * (width - left - right), y = (v) => height - below - (Math.min(v, highest) / highest) * (height - below - top);
  const line = (values) => {
    pen.beginPath();
    values.forEach((v, k) => (k ? pen.lineTo(x(plane.s[k]), y(v)) : pen.moveTo(x(plane.s[k]), y(v))));
  };
  line(plane.limit);
  pen.lineTo(x(length), top);
  pen.lineTo(x(0), top);
  pen.closePath();
  pen.fillStyle = "#f3e1e6";
  pen.fill();
  line(plane.limit);
  pen.strokeStyle = "#b03060";
  pen.lineWidth = 1.6 * ratio;
  pen.setLineDash([5 * ratio, 3 * ratio]);
  pen.stroke();
  pen.setLineDash([]);
  line(plane.speed);
  pen.strokeStyle = ACCENT;
  pen.lineWidth = 2.2 * ratio;
  pen.stroke();
  pen.strokeStyle = INK;
  pen.lineWidth = ratio;
  pen.beginPath();
  pen.moveTo(left, top);
  pen.lineTo(left, height - below);
  pen.lineTo(width - right, height - below);
  pen.stroke();
  pen.fillStyle = SOFT;
  pen.font = `${11 * ratio}px ${FONT}`;
  pen.textAlign = "right";
  pen.fillText(`s = ${shortNumber(length)} ${pathUnit()}`, width - right, height - 6 * ratio);
  pen.textAlign = "left";
  pen.fillText("ṡ", 8 * ratio, top + 10 * ratio);
  pen.fillText(shortNumber(fastest), 8 * ratio, Math.max(y(fastest) + 4 * ratio, top + 24 * ratio));
  pen.fillText("0", left, height - 6 * ratio);
  if (at !== null) {
    const k = Math.round((Math.acos(1 - 2 * clamp(at, 0, 1)) / Math.PI) * PHASE_SAMPLES);
    disc(pen, x(plane.s[k]), y(plane.speed[k]), 4.5 * ratio, ACCENT, "#fff", 1.5 * ratio);
  }
}
