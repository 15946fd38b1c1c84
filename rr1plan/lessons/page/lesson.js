// The steps of a lesson. A lesson's own script, which follows this one, sees `viewer`, `data.own` and `steps`:
//
//   steps.on(name, enter)    enter() is called whenever the step of that name is entered
//   steps.reset = f          f() is called before every step, and undoes what steps have shown
//   steps.corner(name)       an element in a corner of the workspace, for a legend or numbers
//   steps.overlay(draw)      draw(pen, at) draws over the square of the configuration space, again after resizing and by
//                            .paint(): at(q) is the point [px] of two joint values;  .show(on) shows or hides it
//   steps.torus(on)          shows the configuration space as a torus or as a square, where the page can
//   steps.go(index)          enter a step;  steps.index, steps.name: the present one
//
// On the page it is RR1.steps.

class Steps {
  constructor() {
    this.hooks = {};
    this.reset = () => {};
    this.index = -1;
    this.articles = [...root.querySelectorAll("article")];
    document.body.classList.add("has-steps");
    document.body.append(root);
    for (const button of root.querySelectorAll("[data-move]")) button.onclick = () => this.go(this.index + Number(button.dataset.move));
    // Before the page's own keys, of which the arrows move the clock.
    window.addEventListener("keydown", (event) => {
      const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      const busy = ["INPUT", "SELECT", "TEXTAREA", "CANVAS"].includes(event.target.tagName) || event.target.classList.contains("handle");
      if (!move || busy || event.ctrlKey || event.metaKey || event.altKey || event.shiftKey) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      this.go(this.index + move);
    }, true);
  }

  get name() { return this.articles[this.index].dataset.step; }

  on(name, enter) { this.hooks[name] = enter; }

  corner(name) {
    const corner = document.createElement("div");
    corner.className = "corner";
    corner.id = `lesson-${name}`;
    viewer.stage.pane.parentElement.append(corner);
    return corner;
  }

  overlay(draw) { return new Overlay(draw); }

  torus(on) {
    const space = viewer.lesson;
    if (space.toggleTorus && !space.tools.torus.hidden && Boolean(space.torus) !== on) space.toggleTorus();
  }

  /** Enters the first step, or the one that the page's address names. */
  begin() {
    const wish = Number(new URLSearchParams(location.hash.slice(1)).get("step"));
    this.go(wish >= 1 && wish <= this.articles.length ? wish - 1 : 0);
  }

  go(index) {
    if (index < 0 || index >= this.articles.length || index === this.index) return;
    this.index = index;
    this.articles.forEach((article, k) => { article.hidden = k !== index; });
    root.querySelector(".texts").scrollTop = 0;
    root.querySelector("output").textContent = `${index + 1} / ${this.articles.length}`;
    for (const button of root.querySelectorAll("[data-move]")) {
      const next = index + Number(button.dataset.move);
      button.disabled = next < 0 || next >= this.articles.length;
    }
    this.reset();
    if (data.poses[index]) viewer.setQ(data.poses[index]);
    if (this.hooks[this.name]) this.hooks[this.name]();
    viewer.redraw();
  }
}

/** A canvas over the square of the configuration space. */
class Overlay {
  constructor(draw) {
    this.draw = draw;
    this.canvas = document.createElement("canvas");
    Object.assign(this.canvas, { className: "overlay", hidden: true });
    this.canvas.setAttribute("aria-hidden", "true");
    const plot = viewer.lesson.canvas.parentElement;
    plot.append(this.canvas);
    new ResizeObserver(() => this.paint()).observe(plot);
  }

  show(on) {
    this.canvas.hidden = !on;
    this.paint();
  }

  paint() {
    if (this.canvas.hidden) return;
    const { canvas, plot, ratio } = viewer.lesson, { low, high } = viewer.panelData.cspace;
    this.canvas.width = canvas.width;
    this.canvas.height = canvas.height;
    const pen = this.canvas.getContext("2d");
    pen.beginPath();
    pen.rect(plot.x, plot.y, plot.size, plot.size);
    pen.clip();
    const at = (q) => [plot.x + (plot.size * (q[0] - low[0])) / (high[0] - low[0]), plot.y + plot.size * (1 - (q[1] - low[1]) / (high[1] - low[1]))];
    this.draw(pen, at, ratio);
  }
}

const steps = new Steps();
viewer.steps = steps;
