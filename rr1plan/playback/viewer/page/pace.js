// The quality of the picture: full if frames are fast or nothing moves, reduced if frames are late.

/** Up to this many arms a page starts at full quality; with more it starts low and rises while frames are fast. */
const FEW = 4;
/** Above this many arms: no legend, ghosts hidden at first, plain surfaces also for still pictures if frames are slow. */
const MANY = 24;

/**
 * Quality levels, from the best to the fastest.
 * pixels: resolution relative to the window's, each way; detail: size of features that may be omitted [px]; smooth:
 * edges are antialiased (see multisampling.js); shadows: "moving", "still" or "none"; rich: highlights and shadows on
 * surfaces; tubes: tool paths as tubes instead of lines; ghosts: start and goal are drawn.
 */
const FEW_ARMS = [
  { pixels: 1, detail: 0.3, smooth: true, shadows: "moving", rich: true, tubes: true, ghosts: true },
  { pixels: 0.75, detail: 0.6, smooth: true, shadows: "moving", rich: true, tubes: true, ghosts: true },
  { pixels: 0.75, detail: 1, smooth: false, shadows: "still", rich: true, tubes: true, ghosts: true },
  { pixels: 0.5, detail: 1.5, smooth: false, shadows: "still", rich: true, tubes: true, ghosts: false },
];
const MANY_ARMS = [
  { pixels: 1, detail: 0.5, smooth: true, shadows: "moving", rich: true, tubes: true, ghosts: true },
  { pixels: 1, detail: 1, smooth: true, shadows: "moving", rich: false, tubes: false, ghosts: true },
  { pixels: 0.75, detail: 2, smooth: false, shadows: "moving", rich: false, tubes: false, ghosts: true },
  { pixels: 0.75, detail: 4, smooth: false, shadows: "none", rich: false, tubes: false, ghosts: false },
  { pixels: 0.67, detail: 8, smooth: false, shadows: "none", rich: false, tubes: false, ghosts: false },
];

const levelsFor = (arms) => (arms > FEW ? MANY_ARMS : FEW_ARMS);

const BEGIN = 3; // the level of many arms at first
const LATE = 45, EARLY = 28; // [ms] between frames: above LATE quality is reduced, below EARLY it may rise
const PATIENCE = 400; // [ms] of early frames before quality rises; doubled each time that was too much

class Pace {
  constructor(arms) {
    this.levels = levelsFor(arms);
    this.level = this.levels === MANY_ARMS ? BEGIN : 0;
    this.many = arms > MANY;
    // Still pictures have full quality; with very many arms, surfaces remain plain until a rich level was fast enough.
    this.full = this.many ? { ...this.levels[0], rich: false } : this.levels[0];
    this.patience = PATIENCE;
    this.late = this.early = 0;
    this.last = null;
    this.rate = 0;
  }

  suits(arms) {
    return this.levels === levelsFor(arms) && this.many === arms > MANY;
  }

  /** The quality while something moves. */
  least() {
    return this.levels[this.level];
  }

  /** The quality of the frame at a time [ms], while something moves or not. */
  at(now, moves) {
    if (moves && this.last !== null) this.count(now - this.last);
    this.last = moves ? now : null;
    return moves ? this.least() : this.full;
  }

  count(passed) {
    const weight = Math.min(1, passed / 500);
    this.rate += weight * (1000 / Math.max(passed, 1) - this.rate);
    this.late = Math.max(0, this.late + (passed > LATE ? Math.min(passed / LATE, 8) : -0.5));
    this.early = passed < EARLY ? this.early + passed : Math.max(0, this.early - 4 * passed);
    if (this.late > 16 && this.level + 1 < this.levels.length) {
      if (this.raised) this.patience *= 2;
      this.change(1);
    } else if (this.early > this.patience && this.level > 0) this.change(-1);
  }

  change(step) {
    this.level += step;
    this.raised = step < 0;
    this.late = this.early = 0;
    if (this.levels[this.level].rich) this.full = this.levels[0];
  }
}
