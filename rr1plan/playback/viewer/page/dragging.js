// Drags: a link turns its joint, a tool moves its arm, an obstacle moves in its plane. Every other drag rotates the
// camera.

const CLICK = 4; // [px] largest motion of the pointer in a click
const PER_PIXEL = 0.008; // [rad] rotation per pixel
const LEVER = 40; // [px/rad or px/m] least motion of the grabbed point in the picture for the joint to follow it
const LEAN = 0.25; // sine of the camera's elevation below which obstacles move in a plane that faces the camera

/** A rigid transform turned about a point, as 16 numbers. */
function turnedAbout(pose, axis, angle, center) {
  const R = new THREE.Matrix4().makeRotationAxis(axis, angle), T = new THREE.Matrix4().fromArray(pose);
  T.setPosition(new THREE.Vector3(...pose.slice(12, 15)).sub(center)).premultiply(R);
  const p = new THREE.Vector3().setFromMatrixPosition(T).add(center);
  return T.setPosition(p).toArray();
}

/** A rigid transform shifted by a vector. */
function shifted(pose, by) {
  const out = Float64Array.from(pose);
  ["x", "y", "z"].forEach((axis, k) => { out[12 + k] += by[axis]; });
  return out;
}

/** Gives a pressed pointer to the camera. */
function giveToCamera(pane, { pointerId, pointerType, clientX, clientY }) {
  const press = new PointerEvent("pointerdown", { pointerId, pointerType, clientX, clientY, bubbles: true, button: 0, buttons: 1, isPrimary: true });
  press.given = true;
  pane.dispatchEvent(press);
}

class Dragging {
  constructor(viewer, editing) {
    Object.assign(this, { viewer, editing, picker: editing.picker, gesture: null, pointer: null });
    this.handles = new Handles(viewer, editing, this);
    const { pane } = viewer.stage;
    pane.addEventListener("pointerdown", (event) => this.press(event), true);
    pane.addEventListener("pointermove", (event) => {
      this.pointer = !this.gesture && event.pointerType === "mouse" && !event.buttons ? event : null;
    }, true);
    pane.addEventListener("pointerleave", () => { this.pointer = null; this.hover(null); });
    window.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, (event) => this.release(event), true);
  }

  get dragging() {
    return Boolean(this.gesture);
  }

  load() {
    if (this.gesture) this.end();
    this.handles.load();
  }

  // ---- what can be grabbed -----------------------------------------------------------------

  /** The target of a press: a joint or an obstacle; null if nothing moves. */
  thingAt(hit) {
    if (!hit) return null;
    const { kinematics, world } = this.viewer;
    if (hit.arm >= 0) {
      const arm = kinematics.arms[hit.arm], column = this.editing.solver(hit.arm).columnOf(hit.frame - arm.firstLink);
      if (column < 0) return null;
      const local = hit.point.clone().applyMatrix4(new THREE.Matrix4().fromArray(world.poses, 16 * hit.frame).invert());
      return { kind: "joint", arm: hit.arm, column: arm.firstColumn + column, frame: hit.frame, local, element: hit.element };
    }
    return this.editing.canMove(hit.element) ? { kind: "obstacle", arm: -1, name: hit.element, element: hit.element } : null;
  }

  /** Whether a drag moves it directly; large obstacles, such as the table or the room, need a selecting click first. */
  follows(thing) {
    if (!thing || thing.kind === "joint") return Boolean(thing);
    const { selected } = this.editing, size = this.viewer.world.boxAround(thing.name).getSize(new THREE.Vector3());
    return (selected && selected.name === thing.name) || Math.max(size.x, size.y, size.z) < Math.max(...this.viewer.world.reach);
  }

  describe(thing) {
    const { joints, kinematics } = this.viewer, arm = kinematics.arms[thing.arm];
    return { joint: () => joints[thing.column], tool: () => `tool of ${arm.name}`, obstacle: () => thing.name }[thing.kind]();
  }

  // ---- the pointer -------------------------------------------------------------------------

  press(event) {
    const { editing } = this;
    if (!editing.active || event.button !== 0 || event.given) return;
    if (this.gesture) {
      // A second finger gives the gesture to the camera.
      if (event.pointerType === "touch" && event.pointerId !== this.gesture.id) this.handBack();
      return;
    }
    if (!event.isPrimary) return; // the second finger of a gesture that the camera has
    const hit = this.picker.at(event), thing = this.thingAt(hit);
    if (!thing) return;
    if (!this.follows(thing)) { this.beginClick(event, thing); return; }
    event.stopImmediatePropagation();
    event.preventDefault();
    this.viewer.stage.pane.setPointerCapture(event.pointerId);
    this.begin(event, thing, thing.kind === "joint" ? this.jointMove(event, thing) : this.rigidMove(event, thing, modeOf(event), hit.point));
  }

  /** A press that selects if the pointer does not move; a drag rotates the camera instead. */
  beginClick(event, thing) {
    this.click = { id: event.pointerId, x: event.clientX, y: event.clientY, thing };
  }

  begin(event, thing, follow) {
    this.gesture = { id: event.pointerId, event, thing, follow, moved: false };
    this.hover(null);
    document.body.classList.add("grabbing");
  }

  move(event) {
    const { gesture } = this;
    if (!gesture || event.pointerId !== gesture.id) return;
    // The button was released outside the window.
    if (event.pointerType === "mouse" && !event.buttons) { this.finish("lost"); return; }
    if (!gesture.moved) {
      if (Math.hypot(event.clientX - gesture.event.clientX, event.clientY - gesture.event.clientY) < CLICK) return;
      gesture.moved = true;
      this.viewer.pause();
      this.editing.remember(null);
      this.editing.select(gesture.thing);
      // The panels that the card replaces stay during the drag, or the picture would move away from the pointer.
      document.body.classList.toggle("opening", !this.editing.isOpen);
      this.editing.open();
    }
    gesture.last = event;
    gesture.due = true; // handled at the next frame, because pointers report more often
  }

  /** Follows the pointer to its latest position. */
  follow() {
    const { gesture } = this;
    if (!gesture || !gesture.due) return;
    gesture.due = false;
    gesture.follow(gesture.last);
    this.tell(gesture.thing, gesture.last);
  }

  release(event) {
    const { gesture, click } = this;
    if (click && click.id === event.pointerId) {
      this.click = null;
      if (event.type === "pointerup" && Math.hypot(event.clientX - click.x, event.clientY - click.y) < CLICK) this.choose(click.thing);
    }
    if (gesture && event.pointerId === gesture.id) this.finish(event.type);
  }

  /** Ends a gesture according to the type of its last event: a press without motion selects. */
  finish(type) {
    const { gesture } = this;
    this.follow();
    this.end();
    if (!gesture.moved) { if (type === "pointerup") this.choose(gesture.thing); }
    else if (type === "pointercancel") this.editing.discard();
    else if (gesture.thing.kind === "obstacle") this.editing.dropped();
  }

  end() {
    this.gesture = null;
    this.tell(null);
    document.body.classList.remove("grabbing", "opening");
    this.editing.card.uncoverArms();
  }

  choose(thing) {
    this.editing.open();
    this.editing.select(thing);
    this.handles.focus();
  }

  /** Gives the pointer of a gesture to the camera, as if it had never moved anything. */
  handBack() {
    const { gesture } = this;
    if (gesture.moved) this.editing.discard();
    this.end();
    giveToCamera(this.viewer.stage.pane, gesture.last || gesture.event);
  }

  // ---- moves -------------------------------------------------------------------------------

  /** Turns the joint of a link so that the grabbed point stays under the pointer. */
  jointMove(event, { arm: index, column, frame, local }) {
    const { viewer, editing, picker } = this, { kinematics } = viewer, arm = kinematics.arms[index];
    const poses = new Float64Array(16 * kinematics.links), T = new THREE.Matrix4(), [low, high] = viewer.limits[column];
    const seen = (value) => {
      kinematics.forward(arm, withColumns(viewer.q, [column], [value]), poses);
      return picker.project(local.clone().applyMatrix4(T.fromArray(poses, 16 * frame)));
    };
    const slope = (value) => {
      const now = seen(value), next = seen(value + 1e-4);
      return { x: now.x, y: now.y, dx: 1e4 * (next.x - now.x), dy: 1e4 * (next.y - now.y) };
    };
    const begin = viewer.q[column], first = slope(begin), off = [first.x - event.clientX, first.y - event.clientY];
    // A point near the axis hardly moves in the picture: then the pointer's displacement along the tangent counts.
    const lever = Math.hypot(first.dx, first.dy), tangent = lever > 1e-3 ? [first.dx / lever, first.dy / lever] : [1, 0];
    if (lever < LEVER) {
      return (now) => editing.turn(column, begin + ((now.clientX - event.clientX) * tangent[0] + (now.clientY - event.clientY) * tangent[1]) / LEVER);
    }
    return (now) => {
      let value = viewer.q[column];
      // Gauss-Newton for the distance in the picture, damped if the joint hardly moves the point there.
      for (let k = 0; k < 12; k++) {
        const { x, y, dx, dy } = slope(value), ex = now.clientX + off[0] - x, ey = now.clientY + off[1] - y;
        const step = (ex * dx + ey * dy) / (dx * dx + dy * dy + 400);
        value += clamp(step, -0.25, 0.25);
        value = clamp(value, low, high);
        if (Math.abs(step) < 1e-5) break;
      }
      editing.turn(column, value);
    };
  }

  /** Moves a tool or an obstacle in a plane or vertically, or rotates it. */
  rigidMove(event, thing, mode, grabbed) {
    const { picker, editing, viewer } = this, { forward, right, up } = picker.axes();
    const T = thing.kind === "tool" ? editing.solver(thing.arm).toolPose(viewer.q) : editing.poses.get(thing.name);
    const center = thing.kind === "tool" ? new THREE.Vector3(...T.slice(12, 15)) : viewer.world.boxAround(thing.name).getCenter(new THREE.Vector3());
    const put = (pose) => (thing.kind === "tool" ? editing.moveTool(thing.arm, pose) : editing.moveObstacle(thing.name, pose));
    const vertical = new THREE.Vector3(0, 0, 1), begin = { clientX: event.clientX, clientY: event.clientY };
    if (mode === "turn") {
      return ({ clientX, clientY }) => {
        const x = PER_PIXEL * (clientX - begin.clientX), y = PER_PIXEL * (clientY - begin.clientY);
        if (thing.kind === "obstacle") put(turnedAbout(T, vertical, x, center));
        else put(turnedAbout(turnedAbout(T, up, x, center), right, y, center));
      };
    }
    const point = grabbed || center, flat = forward.clone().setZ(0).normalize();
    const normal = mode === "lift" ? flat : thing.kind === "tool" || Math.abs(forward.z) < LEAN ? forward : vertical;
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(normal, point), from = picker.ray(begin).intersectPlane(plane, new THREE.Vector3());
    const farthest = 4 * viewer.extent.whole.getSize(new THREE.Vector3()).length();
    return (now) => {
      const to = picker.ray(now).intersectPlane(plane, new THREE.Vector3());
      if (!from || !to) return;
      const by = to.sub(from);
      if (mode === "lift") by.set(0, 0, Math.abs(forward.z) > 0.98 ? (begin.clientY - now.clientY) * 1e-3 * viewer.world.span : by.z);
      else if (thing.kind === "obstacle") by.setZ(0);
      put(shifted(T, by.clampLength(0, farthest)));
    };
  }

  // ---- labels and highlights ---------------------------------------------------------------

  hover(thing, event = null) {
    this.viewer.stage.pane.style.cursor = thing ? (this.follows(thing) ? "grab" : "pointer") : "";
    document.body.classList.toggle("over", Boolean(thing));
    this.editing.light(thing && this.follows(thing) ? thing.element : null);
    if (!this.gesture) this.tell(thing && this.follows(thing) ? thing : null, event);
  }

  /** A label next to the pointer: the element that is grabbed, or would be. */
  tell(thing, event = null) {
    const tip = find("tip");
    tip.hidden = !thing || !event;
    if (tip.hidden) return;
    const text = this.describe(thing), { stage } = this.viewer, box = stage.pane.getBoundingClientRect();
    const about = { joint: () => this.viewer.jointText(thing.column, this.viewer.q[thing.column]), tool: () => "", obstacle: () => this.placeText(thing.name) }[thing.kind]();
    tip.textContent = about && this.gesture ? `${text}  ${about}` : text;
    const x = event.clientX - box.left, y = event.clientY - box.top;
    tip.style.transform = `translate(${Math.round(Math.min(x + 16, box.width - tip.offsetWidth - 6))}px, ${Math.round(Math.max(y - 34, 4))}px)`;
  }

  placeText(name) {
    return [...this.editing.poses.get(name).slice(12, 15)].map((v) => placed(v, this.viewer.world.span)).join("  ");
  }

  frame() {
    this.follow();
    if (this.pointer && !this.gesture && this.editing.active) {
      const event = this.pointer;
      this.pointer = null;
      this.hover(this.thingAt(this.picker.at(event)), event);
    }
    this.handles.frame();
  }
}

/** Shift turns, Ctrl or Command lifts. */
const modeOf = (event) => (event.shiftKey ? "turn" : event.ctrlKey || event.metaKey ? "lift" : "move");

/** Handles of the selected tool, joint or obstacle, drawn as buttons over the picture. */
class Handles {
  constructor(viewer, editing, dragging) {
    Object.assign(this, { viewer, editing, dragging });
    this.buttons = Object.fromEntries(["tool", "joint", "move", "lift", "turn"].map((name) => [name, this.button(name)]));
    find("handles").append(...Object.values(this.buttons));
    const { pane } = viewer.stage;
    // With a mouse, the tool's handle is shown while the pointer is over the picture; on a touch screen, after a touch.
    pane.addEventListener("pointerenter", (event) => { if (event.pointerType === "mouse") find("handles").classList.add("near"); });
    viewer.stage.pane.parentElement?.addEventListener("pointerleave", () => find("handles").classList.remove("near"));
  }

  button(name) {
    const button = element("button", undefined, `handle ${name}`);
    button.dataset.mode = { tool: "move", joint: "move", move: "move", lift: "lift", turn: "turn" }[name];
    button.addEventListener("pointerdown", (event) => this.press(event, name));
    return button;
  }

  load() {
    for (const button of Object.values(this.buttons)) button.hidden = true;
  }

  /** The target of a handle: the tool of the active arm, or the selection. */
  thing(name) {
    return name === "tool" ? { kind: "tool", arm: this.editing.arm } : this.editing.selected;
  }

  press(event, name) {
    if (event.button !== 0 || this.dragging.gesture) return;
    const thing = this.thing(name), { dragging } = this;
    event.preventDefault();
    event.stopPropagation();
    event.target.setPointerCapture(event.pointerId);
    event.target.focus({ preventScroll: true });
    const asked = modeOf(event), mode = asked === "move" ? event.target.dataset.mode : asked;
    if (thing.kind === "joint") dragging.begin(event, thing, dragging.jointMove(event, thing));
    else dragging.begin(event, thing, dragging.rigidMove(event, thing, mode, null));
  }

  /** Position of the handle of an element in the world. */
  place(thing) {
    const { world, kinematics } = this.viewer;
    if (thing.kind === "tool") return new THREE.Vector3().fromArray(world.poses, 16 * kinematics.toolIndex(kinematics.arms[thing.arm]) + 12);
    if (thing.kind === "joint") return thing.local.clone().applyMatrix4(new THREE.Matrix4().fromArray(world.poses, 16 * thing.frame));
    const { min, max } = world.boxAround(thing.name);
    return new THREE.Vector3((min.x + max.x) / 2, (min.y + max.y) / 2, max.z);
  }

  focus() {
    const { selected } = this.editing;
    this.frame();
    const button = this.buttons[{ tool: "tool", joint: "joint", obstacle: "move" }[selected.kind]];
    if (!button.hidden) button.focus({ preventScroll: true });
  }

  frame() {
    const { viewer, editing, buttons } = this, { selected, isOpen } = editing, alive = editing.active && viewer.stage.renderer;
    const shown = find("handles");
    shown.classList.toggle("open", isOpen);
    const rigid = selected && selected.kind !== "joint" && isOpen;
    const spot = (name, thing, dx, dy, words) => {
      const button = buttons[name], at = thing && alive ? editing.picker.project(this.place(thing)) : null;
      const box = at && viewer.stage.pane.getBoundingClientRect(), x = at && at.x - box.left + dx, y = at && at.y - box.top + dy;
      const hidden = !at || !at.front || x < 0 || y < 0 || x > box.width || y > box.height;
      if (button.hidden !== hidden) button.hidden = hidden;
      if (hidden) return;
      const transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
      if (button.style.transform !== transform) button.style.transform = transform;
      const label = words(this.dragging.describe(thing));
      if (button.title !== label) { button.title = label; button.setAttribute("aria-label", label); }
    };
    const arm = viewer.kinematics.arms.length ? { kind: "tool", arm: editing.arm } : null;
    spot("tool", arm, 0, 0, (what) => `Move the ${what}: drag, or arrow keys; Shift turns, Ctrl lifts`);
    spot("joint", isOpen && selected && selected.kind === "joint" ? selected : null, 0, 0, (what) => `Turn ${what}: drag, or arrow keys`);
    spot("move", rigid && selected.kind === "obstacle" ? selected : null, 0, 0, (what) => `Move ${what}: drag, or arrow keys; Shift turns, Ctrl lifts`);
    spot("lift", rigid ? selected : null, 0, -46, (what) => `Lift or lower ${what}: drag, or up and down keys`);
    spot("turn", rigid ? selected : null, 46, 0, (what) => `Turn ${what}: drag, or arrow keys`);
  }
}
