// The clock: the current time of the motion, and whether it runs.

/** Whether the reader's system asks for less motion: then nothing moves unless it is started, and drawings appear at once. */
const reducedMotion = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

const LONGEST_STEP = 0.25; // [s] by which one frame advances the clock at most

class Player {
  /** track: the motion, or null; others: further motions, for whose end the clock waits. */
  constructor(track, others = []) {
    this.track = track;
    this.start = track ? track.start : 0;
    this.end = track ? Math.max(track.end, ...others.map((other) => other.end)) : 0;
    this.time = this.start;
    this.playing = false;
    this.speed = 1;
    this.loop = true;
    this.pacing = { clock: 0, wall: 0 };
    this.last = null;
    this.rest = null;
    this.pause = this.pause.bind(this);
  }

  /** Completed share of the motion. */
  get fraction() {
    const { start, end } = this.track || this;
    return end > start ? Math.min((this.time - start) / (end - start), 1) : 1;
  }

  play() {
    if (!this.track || this.end <= this.start) return;
    if (this.time >= this.end) this.time = this.start;
    this.playing = true;
    this.rest = null;
    // The first frame shows the time that has passed until then.
    this.last = performance.now();
    this.pacing = { clock: 0, wall: 0 };
  }

  pause() {
    this.playing = false;
  }

  seek(t) {
    this.time = clamp(Number(t) || 0, this.start, this.end);
    this.rest = null;
  }

  /** Advances the clock to now [ms]; true if it advanced. */
  tick(now) {
    if (!this.playing) return false;
    // The time stamp of a frame may be a little before that of the key press that started the clock.
    const wall = this.last === null ? 0 : Math.max(0, now - this.last) / 1000, passed = Math.min(wall, LONGEST_STEP);
    this.last = now;
    this.time += passed * this.speed;
    this.count(passed * this.speed, wall);
    if (this.time >= this.end) {
      if (this.loop && this.waited(now)) { this.time = this.start; this.rest = null; }
      else { this.time = this.end; if (!this.loop) this.playing = false; }
    }
    return true;
  }

  /** Rate of the clock over about the last second [s/s]; null before it has run. */
  get realTimeFactor() {
    return this.pacing.wall > 0 ? this.pacing.clock / this.pacing.wall : null;
  }

  count(clock, wall) {
    const fade = Math.exp(-wall);
    this.pacing = { clock: fade * this.pacing.clock + clock, wall: fade * this.pacing.wall + wall };
  }

  /** A repeated motion pauses briefly at its end, so that the eye can follow. */
  waited(now) {
    if (this.rest === null) this.rest = now;
    return now - this.rest > 600;
  }
}
