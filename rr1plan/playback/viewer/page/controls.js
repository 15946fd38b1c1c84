// The controls around the picture. Strings from files are only inserted as text, never as HTML.

const ICONS = {
  play: "M8 5.5v13l11-6.5z",
  pause: "M7 5h3.6v14H7zM13.4 5H17v14h-3.6z",
  loop: "M7 7h9.2l-2-2 1.4-1.4L20 8l-4.4 4.4-1.4-1.4 2-2H9v3H7zM17 17H7.8l2 2-1.4 1.4L4 16l4.4-4.4 1.4 1.4-2 2H15v-3h2z",
  edit: "M12 1.6l3.2 3.6h-2.2V11h5.8V8.8l3.6 3.2-3.6 3.2V13H13v5.8h2.2L12 22.4l-3.2-3.6H11V13H5.2v2.2L1.6 12l3.6-3.2V11H11V5.2H8.8z",
  close: "M6.4 5L12 10.6 17.6 5 19 6.4 13.4 12 19 17.6 17.6 19 12 13.4 6.4 19 5 17.6 10.6 12 5 6.4z",
  plots: "M4 4h2v14h14v2H4zM8 15.2l3.4-4.6 3 2.4L18.6 7l1.6 1.2-5.4 7.6-3.1-2.4-2.1 2.9z",
  home: "M4 4h6v2H6v4H4zM14 4h6v6h-2V6h-4zM4 14h2v4h4v2H4zM18 14h2v6h-6v-2h4z",
};

function icon(name) {
  const space = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(space, "svg"), path = document.createElementNS(space, "path");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  path.setAttribute("d", ICONS[name]);
  path.setAttribute("fill", "currentColor");
  svg.append(path);
  return svg;
}

/** A new element with a text and a class; a button sends no form. */
function element(tag, text, name) {
  const node = document.createElement(tag);
  if (tag === "button") node.type = "button";
  if (text !== undefined) node.textContent = text;
  if (name) node.className = name;
  return node;
}

const find = (id) => document.getElementById(id);
const css = (rgb) => `rgb(${rgb.map((v) => Math.round(255 * v)).join(",")})`;

/** Pixels of the screen for each CSS pixel, which change with the browser's zoom and from one monitor to another. */
const fineness = () => Math.min(window.devicePixelRatio || 1, 2);

/** The page's font, for canvases; read once, because each access would make the browser recompute styles. */
const FONT = getComputedStyle(document.documentElement).fontFamily;

/** Pixels of the window for each px of the style sheets, which grow with the window. */
const magnification = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 10;

/** Calls f when the size of a node on the screen, with its padding, changes in CSS pixels or in pixels of the screen. */
function onResize(node, f) {
  new ResizeObserver(() => f()).observe(node, { box: "border-box" });
  const watch = () => {
    matchMedia(`(resolution: ${window.devicePixelRatio}dppx)`).addEventListener("change", () => { watch(); f(); }, { once: true });
  };
  watch();
}

/**
 * Fills a slider up to its thumb, and shows its value as text, also to screen readers, which otherwise read the bare
 * number of a slider. They read the text on a visit, not at each of its changes while a motion plays.
 */
function showValue(slider, out, text) {
  const low = Number(slider.min), high = Number(slider.max);
  slider.style.setProperty("--part", `${(100 * (Number(slider.value) - low)) / (high - low || 1)}%`);
  if (out.textContent === text) return;
  slider.setAttribute("aria-valuetext", text);
  out.setAttribute("aria-live", "off");
  out.textContent = text;
}

/** Changes a text that screen readers read out: only if it is another one, and not at each frame of an animation. */
function announce(node, text, animated) {
  node.setAttribute("aria-live", animated ? "off" : "polite");
  if (node.textContent !== text) node.textContent = text;
}

/** A time [s], with more digits if it is in a short span [s]. */
const seconds = (t, span = Infinity) => `${t.toFixed(span > 0 && span < 0.2 ? 4 : 2)} s`;

// The label of a motion without a report.
const UNCHECKED = {
  certified: false, valid: true, violations: [], margins: {}, checked: [], title: "Not checked",
  not_checked: { "the motion": "it came without a report" },
};
const SHAPELESS = "has no collision shape", NONE_CHECKED = "collisions not checked";
const WIDEST_REPORT = 400, LEAST_BESIDE = 270; // [px]

class Controls {
  constructor(viewer) {
    this.viewer = viewer;
    this.rows = [];
    this.wireBar();
    this.addKeys();
    find("fold").onclick = () => this.fold();
  }

  // ---- once ------------------------------------------------------------------------------

  wireBar() {
    const { viewer } = this;
    find("loop").append(icon("loop"));
    find("home").append(icon("home"));
    find("plotter").append(icon("plots"));
    find("plotter").onclick = () => viewer.plots.toggle();
    find("play").onclick = () => viewer.toggle();
    find("scrub").oninput = (event) => {
      const time = Number(event.target.value);
      viewer.pause();
      viewer.seek(time);
    };
    find("speed").onchange = (event) => viewer.setSpeed(Number(event.target.value));
    find("loop").onclick = () => viewer.setLoop(!viewer.player.loop);
    find("home").onclick = () => viewer.look(null, viewer.framed === "near");
  }

  addKeys() {
    const { viewer } = this, moves = () => viewer.player.end > viewer.player.start;
    const step = (sign) => (event) => { viewer.pause(); viewer.seek(viewer.time + (sign * (event.shiftKey ? 10 : 1)) / 60); };
    viewer.keys.add("Motion", [
      { keys: [" "], text: "Play or pause", when: moves, act: () => viewer.toggle() },
      { keys: ["ArrowLeft", ","], text: "A 60th of a second back; with Shift ten of them", when: moves, act: step(-1) },
      { keys: ["ArrowRight", "."], text: "A 60th of a second on; with Shift ten of them", when: moves, act: step(1) },
      { keys: ["Home", "End"], text: "Begin, end", when: moves, act: ({ key }) => viewer.seek(viewer.player[key === "Home" ? "start" : "end"]) },
      { keys: ["ArrowUp", "ArrowDown"], text: "Faster, slower", when: moves, act: ({ key }) => this.nextSpeed(key === "ArrowUp" ? 1 : -1) },
      { keys: ["l"], text: "Repeat", when: moves, act: () => viewer.setLoop(!viewer.player.loop) },
      { keys: ["n"], text: "The next violation or contact", when: () => viewer.conflicts.all.length > 0, act: () => viewer.nextConflict() },
      { keys: ["g"], text: "Plots of joints, torques, clearances", when: () => !find("plotter").hidden, act: () => viewer.plots.toggle() },
    ]);
    viewer.keys.add("View", [
      { keys: ["r"], text: "Look at everything, or at the arms", act: () => viewer.look(null, viewer.framed === "near") },
      { keys: ["h"], text: "Hide or show the cards", act: () => this.fold() },
    ]);
  }

  nextSpeed(direction) {
    const menu = find("speed");
    const index = clamp(menu.selectedIndex + direction, 0, menu.options.length - 1);
    menu.selectedIndex = index;
    this.viewer.setSpeed(Number(menu.value));
  }

  fold() {
    document.body.classList.toggle("folded");
    this.viewer.frame();
  }

  // ---- for each document -------------------------------------------------------------------

  load(doc) {
    document.title = doc.title;
    find("title").textContent = doc.title;
    find("description").textContent = doc.description;
    this.fillJoints();
    this.loadMotion(doc);
  }

  /** The text about the document's motion. */
  loadMotion(doc) {
    this.fillFacts(doc);
    this.fillReport(doc.report);
    this.fillToggles(doc);
    const { player } = this.viewer;
    find("bar").classList.toggle("still", player.end <= player.start);
    const scrub = find("scrub");
    scrub.min = player.start;
    scrub.max = player.end;
    find("length").textContent = `/ ${seconds(player.end, player.end - player.start)}`;
    this.fillMarks();
    this.shownPlaying = null;
    this.refresh();
  }

  /** A red mark on the time line for each contact; a click goes to its time. */
  fillMarks() {
    const { player, conflicts } = this.viewer, span = player.end - player.start;
    const marks = conflicts.marks(span).map(({ time, subject, title }) => {
      const mark = element("button");
      mark.title = title;
      mark.setAttribute("aria-label", title);
      mark.style.setProperty("--at", (time - player.start) / (span || 1));
      mark.onclick = () => this.viewer.point(time, subject);
      return mark;
    });
    find("marks").replaceChildren(...marks);
  }

  fillFacts(doc) {
    const facts = find("facts");
    const rows = [];
    const margins = doc.report ? doc.report.margins : {};
    if (doc.planned) rows.push(["Planned here", doc.planned]);
    if (doc.track) rows.push(doc.track.timed ? ["Duration", seconds(this.viewer.player.track.end - this.viewer.player.track.start, this.viewer.duration)] : ["Path", "no times yet, steady speed"]);
    if (margins.clearance) rows.push(["Clearance", length(margins.clearance.value)]);
    if (margins.self_clearance) rows.push(["Self clearance", length(margins.self_clearance.value)]);
    const around = this.viewer.world.spheres.summary();
    if (around) rows.push(["Spheres", around]);
    for (const other of doc.compare) {
      const { start, end } = this.viewer.others.get("compare");
      rows.push([other.name, seconds(end - start, end - start)]);
    }
    if (doc.replay) {
      const { worst_error: worst, worst_joint: joint, tracked, contacts, mode } = doc.replay.summary;
      const unit = this.viewer.slides[this.viewer.joints.indexOf(joint)] ? "mm" : "mrad";
      rows.push(["MuJoCo", `${mode === "dynamic" ? `${tracked ? "" : "motion not followed, "}off by ${shortNumber(1000 * worst)} ${unit} at most` : "kinematic"}, ${contacts.length ? `${contacts.length} contact${contacts.length > 1 ? "s" : ""}` : "no contact"}`]);
    }
    facts.replaceChildren(...rows.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
  }

  fillReport(given) {
    const { player, document: { track } } = this.viewer, moves = track && track.exact && player.end > player.start;
    const report = given || (moves ? UNCHECKED : null), badge = find("badge"), box = find("report");
    badge.hidden = !report;
    box.hidden = true;
    badge.setAttribute("aria-expanded", "false");
    if (!report) return;
    const { omitted } = this.viewer, rank = report.certified && !omitted ? "good" : report.valid ? "open" : "bad";
    badge.className = rank;
    badge.textContent = report.title || {
      good: "Certified free in continuous time",
      open: `Valid, ${(report.certified && omitted) || NONE_CHECKED}`,
      bad: `Invalid: ${report.violations.length} found`,
    }[rank];
    badge.onclick = () => {
      box.hidden = !box.hidden;
      badge.setAttribute("aria-expanded", String(!box.hidden));
    };
    // Not if it would cover the arms.
    const beside = (find("stage").clientWidth - find("side").offsetWidth) / magnification() - WIDEST_REPORT;
    if (rank === "bad" && beside > LEAST_BESIDE) badge.onclick();
    const rows = [];
    for (const violation of report.violations) {
      const button = element("button", violation.message, "violation");
      button.onclick = () => this.viewer.point(violation.time, violation.subject);
      rows.push(button);
    }
    for (const [name, margin] of Object.entries(report.margins)) rows.push(this.margin(name, margin));
    const checked = report.checked.filter((rule) => omitted !== NONE_CHECKED || !rule.startsWith("collision"));
    if (checked.length) rows.push(element("p", `Checked: ${checked.join(", ")}.`));
    const reasons = new Map();
    for (const [name, why] of Object.entries(report.not_checked)) reasons.set(why, [...(reasons.get(why) || []), name]);
    for (const [why, names] of reasons) rows.push(element("p", `Not checked: ${names.join(", ")} – ${why}.`));
    box.replaceChildren(...rows);
  }

  /** The largest share of a limit that the motion uses; a click goes to its time. */
  margin(name, { value, unit, subject, time }) {
    const row = element("button", undefined, unit !== "m" && value > 1 ? "meter over" : "meter");
    row.title = [subject.join(" and "), time === null ? "" : `at ${seconds(time, this.viewer.duration)}`].join(" ");
    row.onclick = () => this.viewer.point(time, unit === "m" ? subject : []);
    const groove = element("i"), bar = element("b");
    bar.style.width = unit === "m" ? "0" : `${Math.min(100, 100 * value)}%`;
    groove.append(bar);
    const amount = value === null ? "–" : unit === "m" ? length(value) : `${(100 * value).toFixed(0)} %`;
    row.append(element("span", name.replaceAll("_", " ")), unit === "m" ? element("span") : groove, element("span", amount));
    return row;
  }

  fillToggles(doc) {
    const { viewer } = this;
    const names = {
      robots: "Robot", obstacles: "Obstacles", start: "Start", goal: "Goal", toolpath: "Tool path",
      path: "Waypoints", replay: "Simulated", compare: doc.compare.map(({ name }) => name)[0], collisions: "Collision shapes",
      frames: "Frames", toolspeed: "Tool speed", nearest: "Clearance lines", tree: "Search tree",
      spheres: "Spheres", bodyspheres: "Body spheres", linkspheres: "Link spheres",
    };
    const chips = Object.entries(names).filter(([layer, label]) => label && viewer.hasLayer(layer)).map(([layer, label]) => {
      const chip = element("button", label, "chip");
      chip.dataset.layer = layer;
      chip.onclick = () => viewer.setShown(layer, !viewer.isShown(layer));
      return chip;
    });
    if (viewer.sideBySide.offered) {
      const chip = element("button", "Side by side", "chip");
      chip.dataset.layer = "sidebyside";
      chip.title = "Each motion in its own picture, or overlaid (V)";
      chip.onclick = () => viewer.sideBySide.toggle();
      chips.push(chip);
    }
    if (doc.arms.length > 1) {
      const chip = element("button", "Arm colors", "chip");
      chip.dataset.layer = "armcolors";
      chip.onclick = () => viewer.setByArm(!viewer.byArm);
      chips.push(chip);
    }
    find("toggles").replaceChildren(...chips);
    this.refreshToggles();
  }

  refreshToggles() {
    for (const chip of find("toggles").children) {
      const { layer } = chip.dataset;
      const on = { armcolors: this.viewer.byArm, sidebyside: this.viewer.sideBySide.on }[layer] ?? this.viewer.isShown(layer);
      chip.setAttribute("aria-pressed", String(on));
    }
  }

  /** One fold for each arm; its sliders are created when it is first opened. */
  fillJoints() {
    const { arms } = this.viewer.kinematics;
    this.rows = [];
    const folds = arms.map((arm, index) => {
      const fold = element("details"), summary = element("summary");
      if (arms.length > 1) fold.style.setProperty("--accent", css(armColor(index)));
      const swatch = element("span", "", "swatch");
      swatch.style.background = css(armColor(index));
      summary.append(swatch, element("span", arm.name));
      fold.append(summary);
      const row = { fold, arm, joints: null };
      fold.addEventListener("toggle", () => { this.fillArm(row); this.refreshJoints(); });
      if (arms.length <= 2) { fold.open = true; this.fillArm(row); }
      this.rows.push(row);
      return fold;
    });
    // More colors than a reader can distinguish: no legend.
    if (arms.length > MANY) {
      const fold = element("details");
      fold.append(element("summary", `${arms.length} arms`), ...folds);
      find("joints").replaceChildren(fold);
    } else find("joints").replaceChildren(...folds);
  }

  fillArm(row) {
    if (row.joints) return;
    const { arm } = row;
    row.joints = arm.robot.names.map((name, i) => {
      const line = element("div", undefined, "joint"), label = element("label", name), out = element("output");
      const slider = element("input");
      const column = arm.firstColumn + i;
      const [low, high] = arm.robot.limits[i], straight = arm.robot.kinds[i] === "prismatic", turns = !straight && low === null;
      Object.assign(slider, { type: "range", min: low === null ? -Math.PI : low, max: high === null ? Math.PI : high, step: "any", id: `joint-${column}` });
      label.htmlFor = slider.id;
      label.title = name;
      slider.oninput = () => {
        const value = Number(slider.value), { q, editing } = this.viewer;
        // A joint without limits stays within its current turn.
        editing.jog(column, turns ? value + TURN * Math.round((q[column] - value) / TURN) : value);
      };
      line.append(label, out, slider);
      row.fold.append(line);
      return { slider, out, column, turns };
    });
  }

  // ---- at each frame -----------------------------------------------------------------------

  refresh() {
    const { player, manual } = this.viewer;
    const scrub = find("scrub");
    scrub.value = player.time;
    showValue(scrub, find("clock"), manual ? this.viewer.origin : seconds(player.time, player.end - player.start));
    if (this.shownPlaying !== player.playing) {
      this.shownPlaying = player.playing;
      find("play").replaceChildren(icon(player.playing ? "pause" : "play"));
      find("play").setAttribute("aria-label", player.playing ? "Pause" : "Play");
    }
    find("loop").setAttribute("aria-pressed", String(player.loop));
    this.showSpeed(player.speed);
    const { conflicts } = this.viewer, words = conflicts.words();
    if (find("conflict").textContent !== words) {
      find("conflict").textContent = words;
      find("conflict").hidden = !words;
    }
    this.refreshJoints();
  }

  /** Selects a speed in the menu, which has a row for it while it is none of the usual ones. */
  showSpeed(speed) {
    const menu = find("speed");
    if (Number(menu.value) === speed) return;
    if (this.ownSpeed) this.ownSpeed.remove();
    this.ownSpeed = null;
    const rows = [...menu.options];
    if (!rows.some(({ value }) => Number(value) === speed)) {
      this.ownSpeed = new Option(`${Number(speed.toPrecision(3))}×`, speed);
      menu.add(this.ownSpeed, rows.find(({ value }) => Number(value) > speed) || null);
    }
    menu.value = String(speed);
  }

  /** Number of arms, frame rate and real-time factor; only for many arms, and a few times a second. */
  refreshHud(now) {
    const { kinematics, player, pace } = this.viewer, arms = kinematics.arms.length;
    if (now - (this.hudAt || 0) < 300) return;
    this.hudAt = now;
    const rate = player.playing && pace.rate ? [`${pace.rate.toFixed(pace.rate < 10 ? 1 : 0)} frames/s`] : [];
    if (rate.length && player.realTimeFactor !== null) rate.push(`${player.realTimeFactor.toFixed(2)} × real time`);
    find("hud").textContent = arms > MANY ? [`${arms} arms`, ...rate].join(" · ") : "";
  }

  refreshJoints() {
    const { q } = this.viewer;
    for (const { fold, joints } of this.rows) {
      if (!fold.open || !joints) continue;
      for (const { slider, out, column, turns } of joints) {
        // Not during a drag: a simulated joint follows later.
        if (!slider.matches(":active")) slider.value = turns ? q[column] - TURN * Math.round(q[column] / TURN) : q[column];
        showValue(slider, out, this.viewer.jointText(column, q[column]));
      }
    }
  }

  status(text) {
    find("status").hidden = !text;
    if (find("status").textContent !== (text || "")) find("status").textContent = text || ""; // read out once
  }
}

const TURN = 2 * Math.PI;
const DEGREES = 180 / Math.PI;
/** A value with some decimals and a minus sign, never "−0.0": the sum of -0 and 0 is 0. */
const decimals = (value, digits) => (Math.round(10 ** digits * value) / 10 ** digits + 0).toFixed(digits).replace("-", "−");
const tenths = (value) => decimals(value, 1);
/** The unit of lengths up to a given one [m], and its scale. */
const lengthUnit = (largest) => (largest < 10 ? { unit: "mm", scale: 1000 } : { unit: "m", scale: 1 });
/**
 * A coordinate [m] with digits down to less than a thousandth of a given size [m], at least some decimals, and a minus
 * sign, never "−0.000".
 */
const placed = (meters, span, least = 3) => {
  const text = meters.toFixed(clamp(2 - Math.floor(Math.log10(span / 2)), least, 9));
  return text.replace("-", Number(text) === 0 ? "" : "−");
};
/** A distance in its most readable unit, with digits down to a micrometer where it is small. */
const length = (meters) => {
  const size = Math.abs(meters);
  if (size >= 0.1) return `${decimals(meters, 3)} m`;
  return `${decimals(1000 * meters, size === 0 || size >= 1e-3 ? 1 : size >= 1e-4 ? 2 : 3)} mm`;
};
/** A number with three significant digits, and without an exponent if it is large. */
const digits = (value) => (Math.abs(value) >= 1000 ? value.toFixed(0) : value.toPrecision(3));
