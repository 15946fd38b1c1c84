// Stages of a sequence: held objects, placed objects and allowed contacts depend on the time. The page plans in the
// scene of the stage at the time of the clock, from the configuration at that time; held objects stay in the hand.

class SceneStages {
  constructor(viewer, editing) {
    Object.assign(this, { viewer, editing, rows: null });
  }

  load(doc) {
    const { kinematics, player } = this.viewer, planner = doc.planner || {};
    this.rows = planner.stages || null;
    this.row = null;
    if (!this.rows) return;
    this.doc = doc;
    this.track = player.track;
    this.planners = planner.planners.map(() => null);
    const bodies = doc.bodies ? doc.bodies.objects.map(({ name }) => name) : [];
    this.held = new Map(this.rows.map((row) => [row, row.held.filter(({ object }) => bodies.includes(object)).map(({ object, arm, link, pose }) => (
      { body: bodies.indexOf(object), link: kinematics.linkIndex(kinematics.arms.find((a) => a.name === arm), link), pose }))]));
    this.stand(this.viewer.time);
  }

  /** The configuration of the scene; columns that the planner does not move, such as grippers', are kept. */
  get rest() {
    return this.row ? Float64Array.from(this.row.rest) : this.viewer.kinematics.rest();
  }

  /** Follows the clock of the sequence, and draws held objects while the arm is moved or plays another motion. */
  follow(time, manual) {
    if (!this.rows || !this.row) return;
    if (!manual && this.editing.motion === this.editing.asPlanned.motion) this.stand(time);
    else {
      this.viewer.world.updateBodies(this.time);
      this.viewer.world.carry(this.held.get(this.row));
    }
  }

  /** Sets the scene and the start to those at a time of the sequence. */
  stand(time) {
    const row = this.rows.findLast(({ begin }) => begin <= time) || this.rows[0], { editing } = this;
    this.time = time;
    editing.start = this.track.at(time, this.viewer.kinematics.rest());
    editing.goal = null;
    Object.assign(editing.asPlanned, { time, sceneTime: time, start: editing.start, goal: null });
    if (row === this.row) return;
    this.row = row;
    this.take(row);
  }

  /** Loads the planner of a stage on first use. */
  async take({ planner: index }) {
    const { viewer, planners, doc } = this, data = doc.planner.planners[index];
    planners[index] ??= loadPlanner({ ...data, modules: settings.modules }).then((planner) => ({ planner, reason: "" }), ({ message }) => ({ planner: null, reason: message }));
    Object.assign(viewer, { planner: null, noPlanner: "" });
    this.editing.takePlanner(null, LOADING);
    const { planner, reason } = await planners[index];
    if (doc.planner !== viewer.document.planner || this.row.planner !== index) return; // the clock has moved on
    Object.assign(viewer, { planner, noPlanner: reason });
    for (const f of viewer.listeners.planner) f(planner, reason);
  }
}
