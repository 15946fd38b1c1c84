// The steps of a lesson. A lesson's own script, which follows this one, has `viewer`, `data.own` and `steps` in scope:
//
//   steps.on(name, enter)    enter() is called whenever the step of that name is entered
//   steps.reset = f          f() is called before every step, and undoes the changes of steps
//   steps.corner(name)       an element in a corner of the workspace, for a legend or numbers
//   steps.torus(on)          shows the configuration space as a torus or as a square, if the page can
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
    find("panels").after(root);
    this.texts = root.querySelector(".texts");
    this.texts.onscroll = () => this.fade();
    new ResizeObserver(() => this.fade()).observe(this.texts);
    for (const button of root.querySelectorAll("[data-move]")) button.onclick = () => this.go(this.index + Number(button.dataset.move));
    // Not while a slider or a handle has the focus.
    const free = (target) => !target || (target.tagName !== "INPUT" && !target.classList.contains("handle"));
    // Presenters send PageUp and PageDown.
    viewer.keys.add("Lesson", [
      { keys: ["ArrowLeft", "PageUp"], text: "The step before", when: free, act: () => this.go(this.index - 1) },
      { keys: ["ArrowRight", "PageDown"], text: "The next step", when: free, act: () => this.go(this.index + 1) },
    ]);
    window.addEventListener("hashchange", () => this.begin());
    window.addEventListener("beforeprint", () => this.fit());
    window.addEventListener("afterprint", () => this.fit(false));
  }

  /** Makes a text that scrolls small enough for paper, where nobody can scroll, or as large as before. */
  fit(on = true) {
    const { clientHeight, scrollHeight } = this.texts;
    this.texts.style.fontSize = on ? `${(100 * clientHeight) / scrollHeight}%` : "";
    this.fade();
  }

  /** Text that continues below fades out. */
  fade() {
    const { scrollHeight, scrollTop, clientHeight } = this.texts;
    this.texts.classList.toggle("more", scrollHeight - scrollTop > clientHeight + 4);
  }

  get name() { return this.articles[this.index].dataset.step; }

  on(name, enter) { this.hooks[name] = enter; }

  corner(name) {
    const corner = element("div", undefined, "corner");
    corner.id = `lesson-${name}`;
    viewer.stage.pane.parentElement.append(corner);
    return corner;
  }

  torus(on) {
    const space = viewer.lesson;
    if (space.toggleTorus && !space.tools.torus.hidden && Boolean(space.torus) !== on) space.toggleTorus();
  }

  /** Enters the first step, or the one in the page's address with the joint values there, also when it changes. */
  begin() {
    const wishes = new URLSearchParams(location.hash.slice(1)), wish = Number(wishes.get("step"));
    this.go(this.articles[wish - 1] ? wish - 1 : 0);
    const q = (wishes.get("q") || "").split(",").map((text) => (text.trim() ? Number(text) : NaN));
    if (q.length === viewer.q.length && q.every(Number.isFinite)) viewer.setQ(q);
  }

  /** Writes the step into the address, where a reload and a copied link find it; a page in a notebook has none. */
  keep(index) {
    if (location.protocol === "about:") return;
    const wishes = new URLSearchParams(location.hash.slice(1));
    wishes.set("step", index + 1);
    wishes.delete("q");
    history.replaceState(null, "", `#${wishes}`);
  }

  go(index) {
    if (index < 0 || index >= this.articles.length || index === this.index) return;
    if (this.index >= 0) this.keep(index);
    this.index = index;
    this.articles.forEach((article, k) => { article.hidden = k !== index; });
    this.texts.scrollTop = 0;
    this.fade();
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

const steps = new Steps();
viewer.steps = steps;
