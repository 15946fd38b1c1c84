// Drags in the workspace of a planar arm: its tool, its links, obstacles. Every other drag rotates the view.

const GRAB = 30; // [px] around the tool
const THICK = 12; // [px] around the center line of a link, at least

/** Handlers while the pointer is pressed: move(point of the plane), drop(), and cancel(), as if nothing had moved. */
class PlanarDrags {
  constructor(lesson, arm) {
    Object.assign(this, { lesson, arm, held: null, down: null });
    const { pane } = viewer.stage;
    pane.addEventListener("pointerdown", (event) => this.press(event), true);
    pane.addEventListener("pointermove", (event) => this.move(event), true);
    for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, (event) => this.release(event), true);
    pane.addEventListener("wheel", () => { arm.turned = true; }, { passive: true });
  }

  /** The element under the pointer: {cursor, begin()}, or null. */
  find(event) {
    const { arm, lesson } = this, q = q2(), joints = arm.flat.places(q), point = arm.under(event);
    if (arm.distance(event, joints[2]) < GRAB) return { begin: () => this.holdTool() };
    const name = point && lesson.live && lesson.edits.obstacleAt(point);
    if (name) return { name, begin: () => this.holdObstacle(name, point) };
    for (const link of [1, 0]) {
      if (point && arm.pixelsTo(event, joints[link], joints[link + 1]) < THICK) return { begin: () => this.holdLink(link, point) };
    }
    return null;
  }

  holdTool() {
    const { arm, lesson } = this, q = q2();
    return { move: (point) => lesson.pose(arm.flat.follow(q2(), point)), drop() {}, cancel: () => lesson.pose(q) };
  }

  /** A link rotates about its joint, or slides along it. */
  holdLink(link, point) {
    const { arm, lesson } = this, { kinds, senses } = arm.flat, angle = (at) => Math.atan2(at[1] - center[1], at[0] - center[0]);
    const q = q2(), center = arm.flat.places(q)[link], from = angle(point), along = arm.flat.columns(q)[link];
    const moved = (at) => (kinds[link] === "R" ? senses[link] * turn(angle(at) - from) : (at[0] - point[0]) * along[0] + (at[1] - point[1]) * along[1]);
    return { move: (at) => lesson.pose(q.map((v, axis) => (axis === link ? v + moved(at) : v))), drop() {}, cancel: () => lesson.pose(q) };
  }

  holdObstacle(name, point) {
    const { edits } = this.lesson, [x, y] = edits.obstaclePlace(name);
    edits.select(name);
    edits.remember();
    return {
      move: (at) => edits.dragObstacle(name, x + at[0] - point[0], y + at[1] - point[1]),
      drop: () => edits.drop(),
      cancel: () => edits.cancelDrag(),
    };
  }

  press(event) {
    if (event.given) return;
    // A second finger gives what the first one has grabbed to the camera.
    if (!event.isPrimary) { if (this.grip) this.handBack(); return; }
    this.down = data.planar && event.button === 0 ? [event.clientX, event.clientY] : null;
    const found = this.down && this.find(event);
    if (!found) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    viewer.stage.pane.setPointerCapture(event.pointerId);
    this.grip = found;
    this.last = event;
  }

  handBack() {
    if (this.held) this.held.cancel();
    this.held = this.grip = null;
    giveToCamera(viewer.stage.pane, this.last);
  }

  move(event) {
    const { pane } = viewer.stage;
    if (this.grip && !this.held && this.far(event) > 3) this.held = this.grip.begin();
    if (this.grip) this.last = event;
    if (this.held) {
      const point = this.arm.under(event);
      if (point) this.held.move(point);
    } else if (data.planar && !this.grip) pane.style.cursor = this.find(event) ? "move" : "";
  }

  far(event) {
    return this.down ? Math.hypot(event.clientX - this.down[0], event.clientY - this.down[1]) : 0;
  }

  release(event) {
    const { held, grip, down, arm, lesson } = this;
    this.held = this.grip = this.down = null;
    const canceled = event.type === "pointercancel";
    if (held) { if (canceled) held.cancel(); else held.drop(); return; }
    if (!down || canceled) return;
    if (this.isClick(event, down)) {
      if (grip && grip.name) lesson.edits.select(grip.name); else this.click(event);
    } else if (!grip) arm.turned = true;
  }

  isClick(event, [x, y]) {
    return Math.hypot(event.clientX - x, event.clientY - y) < 4;
  }

  /** A click in the reachable ring moves the tool there. */
  click(event) {
    const { arm, lesson } = this, point = arm.under(event);
    lesson.edits.select(null);
    if (!point) return;
    if (arm.flat.solutions(...point).length) lesson.pose(arm.flat.follow(q2(), point));
  }
}
