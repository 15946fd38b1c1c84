// The clock: where in the motion we are, and whether it runs.

class Player {
  constructor(track) {
    this.track = track;
    this.start = track ? track.start : 0;
    this.end = track ? track.end : 0;
    this.time = this.start;
    this.playing = false;
    this.speed = 1;
    this.loop = true;
    this.last = null;
    this.rest = null;
    this.pause = this.pause.bind(this);
  }

  get fraction() {
    return this.end > this.start ? (this.time - this.start) / (this.end - this.start) : 1;
  }

  play() {
    if (!this.track || this.end <= this.start) return;
    if (this.time >= this.end) this.time = this.start;
    this.playing = true;
    this.last = this.rest = null;
  }

  pause() {
    this.playing = false;
  }

  seek(t) {
    this.time = Math.min(Math.max(Number(t) || 0, this.start), this.end);
    this.rest = null;
  }

  /** Advances the clock to now [ms]; true if it advanced. */
  tick(now) {
    if (!this.playing) return false;
    const passed = this.last === null ? 0 : Math.min((now - this.last) / 1000, 0.25);
    this.last = now;
    this.time += passed * this.speed;
    if (this.time >= this.end) {
      if (this.loop && this.waited(now)) { this.time = this.start; this.rest = null; }
      else { this.time = this.end; if (!this.loop) this.playing = false; }
    }
    return true;
  }

  /** A repeated motion stands still at its end for a moment, so that the eye can follow. */
  waited(now) {
    if (this.rest === null) this.rest = now;
    return now - this.rest > 600;
  }
}
