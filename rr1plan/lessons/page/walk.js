// Panels that show the state after k steps, with a button that plays, buttons for single steps and a slider.
//
// A class that extends Walk has `length`, `rate` [steps/s], `verb` (the button's name), `at` and `go(k)`.

class Walk {
  play() {
    if (this.playing) { this.stop(); return; }
    if (this.at >= this.length) this.go(0);
    if (reducedMotion()) { this.go(this.length); return; }
    const from = this.at, { rate } = this, began = performance.now();
    const frame = (now) => {
      this.go(Math.min(this.length, from + Math.max(0, Math.floor((rate * (now - began)) / 1000))));
      if (this.at < this.length) this.playing = requestAnimationFrame(frame); else this.stop();
    };
    part(".play").textContent = "Pause";
    this.playing = requestAnimationFrame(frame);
  }

  stop() {
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    part(".play").textContent = this.verb;
  }

  walk(move) {
    this.stop();
    this.go(clamp(this.at + move, 0, this.length));
  }
}
