// Printing: the page as it is in the window, on a sheet of the window's proportions.

class Printing {
  constructor(stage) {
    this.stage = stage;
    this.sheet = element("style");
    this.copy = element("canvas", undefined, "printed");
    window.addEventListener("beforeprint", () => this.prepare());
    window.addEventListener("afterprint", () => { this.sheet.remove(); this.copy.remove(); });
  }

  prepare() {
    this.sheet.textContent = `@page { size: ${window.innerWidth}px ${window.innerHeight}px; margin: 0; }`;
    document.head.append(this.sheet);
    const { renderer, meshcat, pane } = this.stage;
    if (!renderer) return;
    // WebGL's drawing buffer is empty once its frame has been shown, so paper gets a copy of a new frame.
    meshcat.set_dirty();
    this.stage.draw();
    Object.assign(this.copy, { width: renderer.domElement.width, height: renderer.domElement.height });
    this.copy.getContext("2d").drawImage(renderer.domElement, 0, 0);
    pane.append(this.copy);
  }
}
