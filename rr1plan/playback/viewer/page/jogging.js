// Moving by keyboard: J selects the next tool, joint or obstacle, arrows and page keys move the selection.

const JOG = { turn: Math.PI / 90, far: 5 }; // [rad], factor with Shift (for a joint)

class Jogging {
  constructor(viewer, editing) {
    Object.assign(this, { viewer, editing });
    const { keys } = viewer, active = () => editing.active, changed = () => active() && editing.past.length + editing.future.length > 0;
    const isHandle = () => active() && document.activeElement.classList.contains("handle");
    keys.add("By hand", [
      { keys: ["m"], text: "Move by hand and plan", when: active, act: () => editing.toggle() },
      { keys: ["j"], text: "Select the next tool, joint or obstacle; with Shift the one before", when: active, act: (event) => this.next(event.shiftKey ? -1 : 1) },
      { keys: ["a"], text: "The start is where the arm is", when: active, act: () => { editing.open(); editing.setEnd("start"); } },
      { keys: ["z"], text: "The goal is where the arm is", when: active, act: () => { editing.open(); editing.setEnd("goal"); } },
      { keys: ["p"], text: "Plan and play, or cancel planning", when: active, act: () => editing.requestPlan() },
      { keys: ["o"], text: "Everything as it was at first", when: () => active() && editing.changed, act: () => editing.reset() },
      { keys: ["Ctrl+z"], text: "Undo; with Shift redo", when: changed, act: (event) => (event.shiftKey ? editing.redo() : editing.undo()) },
      { keys: ["Ctrl+y"], text: "Redo", when: changed, act: () => editing.redo() },
      { keys: ["Escape"], text: "", when: active, act: () => this.leave() },
    ]);
    keys.add("By hand", [
      { keys: [...Object.keys(ARROWS), "PageUp", "PageDown"], text: "Move what is selected; with Shift turn it (joints: faster)", when: isHandle, act: (event) => this.move(document.activeElement, event.key, event.shiftKey) },
    ], { first: true });
  }

  /** Everything that can be moved: the tools, the joints of the active arm, obstacles. */
  things() {
    const { viewer, editing } = this, { arms } = viewer.kinematics, arm = arms[editing.arm], { world } = viewer;
    const joints = arm.robot.names.map((_, i) => {
      // The link that the joint moves, or the first drawn one after it.
      const links = arm.robot.links.map((__, link) => link).filter((link) => editing.solver(editing.arm).columnOf(link) === i);
      const seen = links.find((link) => arm.robot.visuals.some((part) => part.link === link)) ?? links[0];
      return links.length ? { kind: "joint", arm: editing.arm, column: arm.firstColumn + i, frame: arm.firstLink + seen, local: world.linkCenter(arm, seen), element: `${arm.name}/${arm.robot.links[seen]}` } : null;
    });
    const obstacles = viewer.document.obstacles.map(({ name }) => name).filter((name) => editing.canMove(name));
    return [
      ...arms.map((_, index) => ({ kind: "tool", arm: index })), ...joints.filter(Boolean),
      ...obstacles.map((name) => ({ kind: "obstacle", arm: -1, name, element: name })),
    ];
  }

  next(direction) {
    const { editing } = this, things = this.things(), key = (thing) => thing && [thing.kind, thing.kind === "tool" ? thing.arm : thing.column ?? thing.name].join();
    const at = things.findIndex((thing) => key(thing) === key(editing.selected));
    const fresh = !document.activeElement.classList.contains("handle");
    editing.open();
    editing.select(things[fresh && at >= 0 ? at : (at + direction + things.length) % things.length]);
    editing.hands.handles.focus();
  }

  leave() {
    const { editing } = this;
    if (editing.isPlanning) editing.cancel();
    else if (document.activeElement.classList.contains("handle")) document.activeElement.blur();
    else if (editing.isOpen) editing.toggle();
  }

  /** Length of one step [m]: a round number, 10 mm for arms of half a meter to five. */
  get shift() {
    return 10 ** Math.floor(Math.log10(this.viewer.world.span / 50));
  }

  /** Moves the target of a handle by one step. */
  move(handle, key, shift) {
    const { editing, viewer } = this, direction = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowUp: [1, 1], ArrowDown: [1, -1], PageUp: [2, 1], PageDown: [2, -1] }[key];
    const thing = editing.hands.handles.thing(handle.classList.contains("tool") ? "tool" : "");
    if (!thing) return;
    const [axis, sign] = direction, { kinds } = viewer.kinematics.arms[Math.max(thing.arm, 0)].robot;
    viewer.pause();
    editing.open();
    editing.remember(`${thing.kind} ${thing.arm} ${thing.column} ${thing.name}`);
    if (thing.kind === "joint") {
      const own = thing.column - viewer.kinematics.arms[thing.arm].firstColumn, step = kinds[own] === "prismatic" ? this.shift : JOG.turn;
      editing.turn(thing.column, viewer.q[thing.column] + sign * step * (shift ? JOG.far : 1));
      return;
    }
    const T = thing.kind === "tool" ? editing.solver(thing.arm).toolPose(viewer.q) : editing.poses.get(thing.name);
    const center = thing.kind === "tool" ? new THREE.Vector3(...T.slice(12, 15)) : viewer.world.boxAround(thing.name).getCenter(new THREE.Vector3());
    const mode = shift ? "turn" : handle.dataset.mode, along = this.axes();
    const pose = mode === "turn" ? turnedAbout(T, thing.kind === "obstacle" ? along[2] : [along[2], along[0], along[1]][axis], sign * JOG.turn * 2.5, center)
      : shifted(T, along[mode === "lift" ? 2 : axis].clone().multiplyScalar(sign * this.shift));
    if (thing.kind === "tool") editing.moveTool(thing.arm, pose);
    else editing.moveObstacle(thing.name, pose);
  }

  /** The axes of the world that point to the right, away and up in the picture, signed. */
  axes() {
    const { right } = this.editing.picker.axes(), sideways = Math.abs(right.x) >= Math.abs(right.y);
    const x = sideways ? new THREE.Vector3(Math.sign(right.x) || 1, 0, 0) : new THREE.Vector3(0, Math.sign(right.y), 0), z = new THREE.Vector3(0, 0, 1);
    return [x, z.clone().cross(x), z];
  }
}
