// The card above the time line: whether the current configuration is free, tool pose, start and goal, Plan, undo.

class PlanCard {
  constructor(viewer, editing) {
    Object.assign(this, { viewer, editing, shown: "" });
    find("edit").append(icon("edit"));
    find("shut").append(icon("close"));
    find("edit").onclick = find("shut").onclick = () => editing.toggle();
    const acts = [
      ["start", "Start here", "A", "The arm as shown becomes the start", () => editing.setEnd("start")],
      ["goal", "Goal here", "Z", "The arm as shown becomes the goal", () => editing.setEnd("goal")],
      ["plan", "Plan", "P", "Plan a certified motion from the start to the goal, and play it", () => editing.requestPlan()],
      ["drop", "Plan on drop", "", "Plan whenever an obstacle is let go", () => { editing.planOnDrop = !editing.planOnDrop; this.refreshActs(); }],
      ["undo", "Undo", "", "Undo (Ctrl+Z)", () => editing.undo()],
      ["reset", "As planned", "O", "Everything as it was: motion, obstacles, start and goal", () => editing.reset()],
    ];
    this.acts = Object.fromEntries(acts.map(([name, label, key, title, act]) => {
      const button = element("button", label, `act ${name}`);
      button.title = key ? `${title} (${key})` : title;
      if (key) {
        button.append(" ", element("kbd", key));
        button.setAttribute("aria-keyshortcuts", key);
      }
      button.onclick = act;
      return [name, button];
    }));
    this.acts.undo.setAttribute("aria-keyshortcuts", "Control+Z");
    find("acts").append(...Object.values(this.acts));
    new ResizeObserver(() => { this.makeRoom(); this.uncoverArms(); }).observe(find("editing"));
  }

  load() {
    find("edit").hidden = !this.editing.active;
    if (!this.editing.active) this.editing.open(false);
    this.acts.reset.firstChild.data = this.viewer.document.track ? "As planned" : "As it was";
    this.say("");
    this.refreshActs();
  }

  show(on) {
    find("editing").hidden = !on;
    find("edit").setAttribute("aria-pressed", String(on));
    document.body.classList.toggle("editing", on);
    if (on) this.refreshReadout(); // its lines make the card as high as it will be
    this.viewer.plots.fit(); // on phones the card hides the plots, maybe before a frame shows them
    this.makeRoom();
  }

  /** Elements that float above the time line stay above the card. */
  makeRoom() {
    const { isOpen } = this.editing;
    document.body.style.setProperty("--above", isOpen ? `${find("editing").offsetHeight + 10 * magnification()}px` : "0px");
  }

  /** Frames the picture again if a card covers the arms; otherwise it stays as it is. */
  uncoverArms() {
    const { viewer, editing } = this, [card, head] = ["editing", "headline"].map((id) => find(id).getBoundingClientRect());
    const isCovered = ([x, y, z]) => {
      const at = editing.picker.project({ x, y, z });
      return (at.y > card.top && at.x > card.left && at.x < card.right) || (at.y < head.bottom && at.x < head.right);
    };
    if (editing.isOpen && viewer.extent.links.some(isCovered)) viewer.frame();
  }

  /** Shows the result of an action, as good, open or bad. */
  say(text, tone = "open") {
    const answer = find("answer");
    answer.hidden = !text;
    answer.textContent = text;
    answer.className = tone;
    this.refreshActs();
  }

  /** Shows that the page plans, and its progress, which screen readers do not read out. */
  sayPlanning(progress) {
    const answer = find("answer");
    if (!answer.querySelector("span")) {
      this.say("Planning … ");
      answer.append(element("span"));
      answer.lastChild.ariaLive = "off";
    }
    if (answer.lastChild.textContent !== progress) answer.lastChild.textContent = progress;
  }

  refreshPlanner() {
    const { planner, isLoading, reason } = this.editing;
    this.acts.drop.hidden = !planner;
    this.acts.plan.classList.toggle("missing", !planner && !isLoading);
    this.acts.plan.title = planner || isLoading ? "Plan a certified motion from the start to the goal, and play it (P)" : `Cannot plan here: ${reason}`;
  }

  refreshActs() {
    const { editing, acts } = this;
    acts.plan.firstChild.data = editing.isPlanning ? "Cancel" : "Plan";
    acts.undo.disabled = !editing.past || !editing.past.length;
    acts.reset.disabled = !editing.past || !editing.changed;
    acts.drop.setAttribute("aria-pressed", String(Boolean(editing.planOnDrop)));
  }

  refresh({ tone, title, text }) {
    const [state, more] = find("verdict").children;
    if (state.textContent !== title) state.textContent = title;
    if (find("verdict").className !== tone) find("verdict").className = tone;
    if (more.textContent !== text) more.textContent = more.title = text;
    this.refreshReadout();
    this.refreshActs();
  }

  refreshReadout() {
    const { viewer, editing } = this, arm = viewer.kinematics.arms[editing.arm], solver = editing.solver(editing.arm);
    const T = solver.toolPose(viewer.q), rows = [];
    rows.push([viewer.kinematics.arms.length > 1 ? `Tool of ${arm.name}` : "Tool", ["x", "y", "z"].map((axis, k) => [axis, placed(T[12 + k], viewer.world.span)]), "m"]);
    rows.push(["", rollPitchYaw(T).map((angle, k) => [["roll", "pitch", "yaw"][k], `${tenths(DEGREES * angle)}°`]), ""]);
    rows.push(["", [["manipulability", digits(solver.manipulability(viewer.q))]], ""]);
    const nodes = rows.flatMap(([label, values, unit]) => {
      const value = element("dd");
      for (const [name, number] of values) value.append(element("i", name), " ", element("span", number), " ");
      if (unit) value.append(element("i", unit));
      return [...(label ? [element("dt", label)] : []), value];
    });
    find("readout").replaceChildren(...nodes);
  }
}

/** Roll, pitch and yaw [rad] of a transform: R = Rz(yaw) Ry(pitch) Rx(roll). */
function rollPitchYaw(T) {
  const flat = Math.hypot(T[0], T[1]);
  return flat > 1e-9 ? [Math.atan2(T[6], T[10]), Math.atan2(-T[2], flat), Math.atan2(T[1], T[0])]
    : [Math.atan2(-T[9], T[5]), Math.atan2(-T[2], flat), 0];
}
