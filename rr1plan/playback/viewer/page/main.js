// The viewer: the interface for panels and tests, as `viewer` in a panel's script and `RR1` on the page.
//
//   viewer.q  viewer.joints  viewer.limits       the configuration shown, its columns ("arm/joint"), [low, high]
//   viewer.slides                                whether each column is a prismatic joint, in meters
//   viewer.jointText(column, v)                  a joint's value with its unit: an angle, or a length with digits for its range
//   viewer.setQ(q)  viewer.setJoint(column, v)    show a configuration; the clock stops
//   viewer.time  viewer.duration  viewer.playing  the clock [s]
//   viewer.play()  .pause()  .toggle()  .seek(t)  .setSpeed(s)  .setLoop(on)
//   viewer.at(t)                                  the configuration of the motion at a time (null without one)
//   viewer.on("change", f)                        f(q, time, manual) whenever the configuration shown changes
//   viewer.on("load", f)                          f(document) after a document was loaded
//   viewer.on("data", f)                          f(names) when the program has put other data into the `data` of these panels
//   viewer.on("obstacle", f)                      f(name) after the user moved an obstacle
//   viewer.on("draw", f)                          f() before the picture is drawn again
//   viewer.moved                                  names of the obstacles that have moved since the motion was made
//   viewer.linkPose("arm/link")                   T_world_link as shown, 16 numbers, column-major
//   viewer.poses(q)                               the same for any q: {"arm/link": 16 numbers}
//   viewer.setShown(layer, on)                    robots, obstacles, start, goal, toolpath, path, replay, compare, collisions,
//                                                 spheres, bodyspheres, linkspheres (those that contain each link, fine to coarse),
//                                                 frames, toolspeed, tree, nearest (see overlays.js)
//   viewer.sideBySide.toggle()                    other motions next to that of the page, or overlaid
//   viewer.plots.toggle()                         the curves under the scene (see plots.js)
//   viewer.look(direction, whole)                 frame the arms (or everything), seen from a world direction
//   viewer.films.push(f)                          f() returns the current animation of a panel, {start, end, show(t)} [s], or null
//   viewer.keys.add(title, rows)                  keys of a panel, which the list of "?" shows: see keys.js
//   viewer.add(name, object3d)  viewer.redraw()   add an object of three.js (viewer.THREE) to the world, z up, in place of the last of that name
//   viewer.setMotion({track, ...})                replace the fields of the document that define the motion
//   viewer.editing                                drags, jogs, start and goal by hand, undo, `plan()`: see editing.js
//   viewer.planner                                plans in the page (`planner.js`); null before it is loaded and without one
//   viewer.noPlanner                              why there is none; empty while it is loading and if none was requested
//   viewer.on("planner", f)                       f(planner, reason) once it is loaded, or known to be missing
//   viewer.unpack(packed)                         {values, shape} of an array sent with rr1plan's `pack`

class Viewer {
  constructor() {
    this.THREE = THREE;
    this.keys = new Keys();
    this.unpack = unpack;
    this.listeners = { change: [], load: [], data: [], planner: [], obstacle: [], draw: [] };
    this.panelData = {};
    this.films = [];
    this.added = new Map();
    this.hidden = new Set(["collisions", "replay", "linkspheres", "bodyspheres", ...OVERLAYS]);
    this.byArm = true;
    this.stage = makeStage(find("pane"));
    this.stage.onResize = () => this.frame();
    this.stage.onDraw = () => { for (const f of this.listeners.draw) f(); };
    this.meshcat = this.stage.meshcat;
    this.editing = new Editing(this);
    this.controls = new Controls(this);
    this.overlays = new Overlays(this);
    this.sideBySide = new SideBySide(this);
    this.plots = new Plots(this);
    this.printing = new Printing(this.stage);
    this.frames = 0;
  }

  // ---- documents ---------------------------------------------------------------------------

  /** Shows a document; with keep, the camera does not move, unless the arms are others or stand elsewhere. */
  load(doc, keep = false) {
    const placed = ({ arms }) => JSON.stringify(arms.map(({ name, base }) => [name, base]));
    const moves = !keep || !this.framed || placed(this.document) !== placed(doc);
    if (this.world) this.world.dispose();
    this.document = doc;
    this.kinematics = new Kinematics(doc);
    if (!this.pace || !this.pace.suits(doc.arms.length)) {
      this.pace = new Pace(doc.arms.length);
      // Ghosts of very many arms hide the arms.
      for (const kind of ["start", "goal"]) this.hidden[this.pace.many ? "add" : "delete"](kind);
    }
    this.stage.setQuality(settings.play ? this.pace.least() : this.pace.full);
    this.joints = doc.columns;
    this.limits = this.kinematics.arms.flatMap((a) => a.robot.limits);
    this.shapeless = this.kinematics.arms.flatMap(({ name, robot }) => robot.unchecked.map((link) => `${name}/${link}`));
    // Of arms without any shape the frames are all there is to see.
    if (doc.arms.length && !doc.robots.some(({ visuals }) => visuals.length)) this.hidden.delete("frames");
    this.slides = this.kinematics.arms.flatMap((a) => a.robot.kinds.map((kind) => kind === "prismatic"));
    this.takeMotion();
    if (moves) this.lastDirection = this.preferred || doc.camera.direction;
    this.q = this.kinematics.rest();
    const { track } = this.player;
    if (track) track.at(track.start, this.q);
    this.world = new World(doc, this.kinematics);
    this.build(track);
    this.fillPanels(doc.panels);
    this.overlays.load();
    this.controls.load(doc);
    this.plots.load();
    this.sideBySide.load();
    this.show();
    if (moves) this.look();
    this.editing.load(doc);
    for (const f of this.listeners.load) f(doc);
    this.loadPlanner(doc);
  }

  async loadPlanner(doc) {
    this.planner = null;
    this.noPlanner = "";
    if (!doc.planner || doc.planner.stages) return; // for stages see scene_stages.js
    let planner = null, reason = "";
    try {
      planner = await loadPlanner({ ...doc.planner, modules: settings.modules });
    } catch (error) {
      reason = error.message;
    }
    if (doc.planner !== this.document.planner) return; // another document was loaded meanwhile
    [this.planner, this.noPlanner] = [planner, reason];
    for (const f of this.listeners.planner) f(planner, reason);
  }

  /** The clock and the contacts of the document's motion. */
  takeMotion() {
    const { document: doc, player: last } = this;
    const others = [["replay", doc.replay], ...doc.compare.map((row) => ["compare", row])].filter(([, row]) => row);
    this.others = new Map(others.map(([kind, row]) => [kind, new Track(row)]));
    const longer = this.others.has("compare") ? [this.others.get("compare")] : [];
    this.player = new Player(doc.track ? new Track(doc.track) : null, longer);
    if (last) Object.assign(this.player, { speed: last.speed, loop: last.loop });
    this.manual = false;
    this.touched = [];
    this.moved = [];
    this.conflicts = new Conflicts(doc, this.player, this.kinematics);
  }

  /** Names the obstacles that have moved since the motion was made: what was found with them elsewhere is not shown. */
  setMoved(names) {
    if (names.join() === this.moved.join()) return;
    this.moved = names;
    this.conflicts = new Conflicts(this.document, this.player, this.kinematics, names);
    this.loadFindings();
    this.controls.fillMarks();
    this.controls.fillToggles(this.document);
    this.paint();
    this.show();
  }

  /** Draws the contacts, the other overlays and the plots of the motion again. */
  loadFindings() {
    for (const layer of ["conflicts", ...OVERLAYS]) this.world.clear(layer);
    this.overlays.load();
    this.plots.load();
  }

  /** Plays another motion of the same arms: the changed fields of the document (`track`, `path`, `report`, `samples`, ...). */
  setMotion(changes) {
    const { world } = this;
    this.document = { ...this.document, ...changes };
    this.takeMotion();
    for (const layer of ["toolpath", "path"]) world.clear(layer);
    this.drawMotion(this.player.track);
    this.loadFindings();
    this.sideBySide.load();
    this.controls.loadMotion(this.document);
    this.paint();
    this.follow();
    for (const f of this.listeners.load) f(this.document);
  }

  /** Puts new data into the objects that panels hold, by the name of the panel. */
  fillPanels(panels) {
    if (!panels) return;
    for (const [name, data] of Object.entries(panels)) Object.assign(this.panelData[name] || {}, data);
    for (const f of this.listeners.data) f(Object.keys(panels));
  }

  build(track) {
    const { world, kinematics, document: doc } = this;
    const others = track ? track.instants(this.pace.many ? 4 : 12).map((t) => track.at(t, kinematics.rest())) : doc.ghosts.map(({ arm, q }) => kinematics.standing(arm, q));
    const samples = [kinematics.rest(), this.q, ...others];
    this.extent = { ...world.extent(samples), target: doc.camera.target };
    this.drawMotion(track);
    const thin = this.thin();
    if (this.others.has("compare")) world.group("compare").add(motionLines(kinematics, this.others.get("compare"), GHOSTS.compare));
    this.targets = doc.targets.length ? targetMarks(doc.targets, 2 * thin) : null;
    if (this.targets) world.group("goal").add(this.targets);
    this.paint();
    for (const [name, layer] of Object.entries(world.layers)) layer.visible = !this.hidden.has(name);
    this.stage.show("world", world.root);
    this.stage.furnish(this.extent.whole, this.extent.floor);
  }

  /** The radius of a drawn line [m]. */
  thin() {
    const radius = this.extent.near.getSize(new THREE.Vector3()).length() / 2;
    return Math.min(0.0034 * radius, 0.012 * this.world.span);
  }

  /** Draws the paths of the tools and the waypoints. */
  drawMotion(track) {
    const { world, kinematics, document: doc } = this, thin = this.thin();
    this.toolPath = track ? new ToolPath(kinematics, track, thin) : null;
    if (track) {
      this.toolPath.setTubes(this.pace.least().tubes);
      world.group("toolpath").add(this.toolPath.group);
    }
    if (doc.path) world.group("path").add(waypointLines(kinematics, doc.path, 1.6 * thin));
  }

  // ---- the configuration -------------------------------------------------------------------

  /** Shows a configuration, and its source in place of the clock. */
  setQ(q, origin = "by hand") {
    this.player.pause();
    this.manual = true;
    this.origin = origin;
    this.q.set(q);
    this.show();
  }

  setJoint(column, value) {
    this.setQ(withColumns(this.q, [column], [value]));
  }

  jointText(column, value) {
    if (!this.slides[column]) return `${tenths(DEGREES * value)}°`;
    const [low, high] = this.limits[column], range = high - low || 1, { unit, scale } = lengthUnit(range);
    return `${decimals(scale * value, Math.max(unit === "m" ? 3 : 1, -1 - Math.floor(Math.log10(range))))} ${unit}`;
  }

  at(t) {
    return this.player.track ? this.player.track.at(t, this.kinematics.rest()) : null;
  }

  linkPose(name) {
    return this.poses(this.q)[name];
  }

  /** What no collision check of the arms covers, because links have no collision shape; empty if all is covered. */
  get omitted() {
    const { shapeless, kinematics } = this, count = shapeless.length;
    if (!count) return "";
    return count === kinematics.links ? NONE_CHECKED : `${count} link${count > 1 ? "s" : ""} not checked`;
  }

  poses(q) {
    const flat = this.kinematics.forwardAll(q, new Float64Array(16 * this.kinematics.links)), out = {};
    for (const arm of this.kinematics.arms) {
      arm.robot.links.forEach((link, i) => {
        const at = 16 * (arm.firstLink + i);
        out[`${arm.name}/${link}`] = Array.from(flat.subarray(at, at + 16));
      });
    }
    return out;
  }

  /** Draws the configuration and notifies all listeners. */
  show() {
    const { player, world } = this;
    world.update(this.q);
    this.shownAt = performance.now();
    if (this.conflicts.at(this.manual ? null : player.time)) this.paint();
    world.updateBodies(player.time);
    for (const [kind, track] of this.others) world.updateFollower(kind, track.at(player.time, this.kinematics.rest()));
    if (this.toolPath) this.toolPath.show(this.manual ? 1 : player.fraction);
    this.overlays.follow();
    this.controls.refresh();
    this.plots.follow();
    this.redraw();
    for (const f of this.listeners.change) f(this.q, player.time, this.manual);
  }

  // ---- the clock ---------------------------------------------------------------------------

  get time() { return this.player.time; }
  get duration() { return this.player.end - this.player.start; }
  get playing() { return this.player.playing; }

  play() { this.manual = false; this.touched = []; this.conflicts.shown = null; this.player.play(); this.follow(); }
  pause() { this.player.pause(); this.controls.refresh(); }
  toggle() { if (this.playing) this.pause(); else this.play(); }
  seek(t) { this.endManual(); this.player.seek(t); this.follow(); }
  setSpeed(speed) { this.player.speed = clamp(Number(speed) || 1, 0.01, 100); this.controls.refresh(); }
  setLoop(on) { this.player.loop = Boolean(on); this.controls.refresh(); }

  /** What a video shows, {start, end, show(t)}: the last of the panels' `films` that is not null, or the motion. */
  get film() {
    const motion = { start: this.player.start, end: this.player.end, show: (t) => this.seek(t) };
    return this.films.reduce((found, film) => film() || found, motion);
  }

  /** Shows the motion again after a configuration set by the user, whose contacts are no longer red. */
  endManual() {
    if (!this.manual) return;
    this.manual = false;
    this.touched = [];
    this.paint();
  }

  /** The configuration at the time of the clock. */
  follow() {
    const { track } = this.player;
    if (track) track.at(this.player.time, this.q);
    this.show();
  }

  // ---- visibility, colors and framing ------------------------------------------------------

  hasLayer(layer) { return this.world.has(layer); }
  isShown(layer) { return !this.hidden.has(layer); }

  setShown(layer, on) {
    if (on) this.hidden.delete(layer); else this.hidden.add(layer);
    if (this.world.layers[layer]) this.world.layers[layer].visible = on;
    if (this.sideBySide.on && this.others.has(layer)) this.sideBySide.load();
    this.controls.refreshToggles();
    this.show();
  }

  setByArm(on) {
    this.byArm = on;
    this.paint();
    this.controls.refreshToggles();
    this.redraw();
  }

  /** Colors all links; elements in contact now in a motion ("plan", "replay", "compare"; null: any) or pointed out are red. */
  paint(kind = null) {
    const touched = kind === "plan" || !kind ? this.touched : [];
    this.world.paint(this.byArm && this.kinematics.arms.length > 1, [...touched, ...this.conflicts.elements(kind)], this.editing.lit);
  }

  /** Goes to a time and paints some elements red. */
  point(time, elements) {
    this.pause();
    if (time !== null) this.seek(time);
    this.touched = elements.map((name) => this.kinematics.elementOf(name));
    this.paint();
    this.redraw();
  }

  /** Goes to the next violation or contact, after the last one to the first. */
  nextConflict() {
    const { all } = this.conflicts, next = all.find(({ time }) => time > this.time + 1e-6) || all[0];
    if (next) this.point(next.time, next.elements);
  }

  /** Frames the arms and their surroundings, or everything if whole; null keeps the direction. */
  look(direction = null, whole = false) {
    this.framed = whole ? "whole" : "near";
    this.lastDirection = direction || this.lastDirection;
    if (whole) this.stage.look(cornersOf(this.extent.whole), this.lastDirection);
    else this.stage.look(this.extent.framed, this.lastDirection, this.extent.target);
    this.sideBySide.place();
  }

  /** Repeats the framing after the window or its cards have changed. */
  frame() {
    if (this.editing.dragging) return; // what is dragged stays under the pointer
    if (this.framed && !this.stage.turned) this.look(null, this.framed === "whole"); else this.sideBySide.place();
  }

  add(name, object) {
    const last = this.added.get(name);
    if (last && last !== object) disposeTree(last);
    this.added.set(name, object);
    this.stage.show(`panel-${name}`, object);
  }

  redraw() { this.meshcat.set_dirty(); }
  on(event, listener) { this.listeners[event].push(listener); }

  // ---- frames ------------------------------------------------------------------------------

  run() {
    const frame = (now) => {
      requestAnimationFrame(frame);
      if (this.live) this.live.flush();
      if (this.player.tick(now)) this.follow();
      this.setQuality(this.pace.at(now, this.moves(now)));
      this.controls.refreshHud(now);
      this.editing.frame();
      this.stage.draw();
      this.overlays.label();
      this.frames += 1;
    };
    requestAnimationFrame(frame);
    // Without frames for a while, because the page is hidden: no late frame.
    document.addEventListener("visibilitychange", () => { this.player.last = this.pace.last = null; });
    this.ignoreMorePointers();
  }

  /**
   * Lets panels follow the first finger and the main button only. In the 3-D view others zoom and shift the picture; and
   * once another button has opened the menu of the browser, pages do not learn of its release.
   */
  ignoreMorePointers() {
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
      document.addEventListener(kind, (event) => {
        const isOther = !event.isPrimary || (event.buttons > 0 && !(event.buttons & 1));
        if (isOther && !this.stage.pane.contains(event.target)) event.stopPropagation();
      }, true);
    }
  }

  /** Whether anything moves; very many arms count as moving a while longer, because full quality takes long to draw. */
  moves(now) {
    return this.playing || Boolean(this.stage.dragged || this.editing.dragging) || (this.pace.many && this.pace.level > 0 && now - this.shownAt < 250);
  }

  /** Whether the picture has full quality, as while nothing moves. */
  get settled() { return !this.stage.renderer || this.stage.quality === this.pace.full; }

  /** Applies a quality level of `pace.js`. */
  setQuality(quality) {
    const { world, stage } = this;
    stage.setQuality(quality);
    world.setRich(quality.rich);
    if (this.toolPath) this.toolPath.setTubes(quality.tubes);
    for (const kind of ["start", "goal"]) if (world.layers[kind]) world.layers[kind].visible = this.isShown(kind) && quality.ghosts;
    if (stage.meshcat.needs_render && world.chooseDetail(stage.camera, stage.pane.clientHeight || 1, quality.detail)) world.place();
  }
}

const settings = JSON.parse(find("settings").textContent);
// The browser saves an open page with what its scripts have put into it, none of which is left when the copy opens.
for (const node of [...document.body.children]) if (!node.matches("template, script")) node.remove();
document.body.className = "";
document.body.prepend(find("page").content.cloneNode(true));
const viewer = new Viewer();
window.RR1 = viewer;
viewer.preferred = settings.view;
viewer.load(JSON.parse(find("document").textContent));
for (const panel of settings.panels) {
  viewer.panelData[panel.name] = panel.data;
  // A mistake in the script of one panel stops neither the page nor other panels; the browser's console shows it. A
  // script with a syntax error has no function here.
  try {
    mounts[panel.name]?.(viewer, find(`panel-${panel.name}`), panel.data);
  } catch (error) {
    reportError(error);
  }
}
// A live page that was saved from the browser has no program to follow.
if (settings.live && (settings.live.address || location.protocol !== "file:")) viewer.live = new Live(viewer, settings.live);
const wishes = new URLSearchParams(location.hash.slice(1));
if (wishes.has("bare")) document.body.classList.add("bare");
viewer.run();
if (settings.sideBySide) viewer.sideBySide.toggle(true);
if (settings.play && !reducedMotion()) viewer.play();
viewer.ready = true;
