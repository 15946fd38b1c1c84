// The time line of many arms: a row for each, and a time cursor. Statements of a panel with viewer, root and data in
// scope.

const canvas = root.querySelector("canvas"), pen = canvas.getContext("2d");
const chart = root.querySelector(".chart"), now = root.querySelector(".now"), said = root.querySelector(".said");
const AXIS = 20, CONFLICT = "#d1003f";
const FEW_ROWS = 5;
const STILL = 1e-9; // [rad or m] the least displacement in a piece that counts as motion
let line = data; // drawn content: the data of the panel, or the rows of a motion planned in the page
document.body.classList.toggle("few-rows", data.arms.length <= FEW_ROWS && document.querySelectorAll("#panels > .panel").length === 1);
let large = 1, left = 0, right = 0, rowHeight = 0, below = 0; // drawn in px of the style sheets, of which each is `large` px

const x = (time) => left + ((time - line.start) / (line.makespan || 1)) * (right - left);
const y = (row) => (row + 0.5) * rowHeight;

function draw() {
  large = magnification();
  const width = chart.clientWidth / large, rows = line.arms.length;
  if (!width) return;
  rowHeight = Math.min(26, Math.max(4, (Math.max(320, window.innerHeight / large - 220) - AXIS) / rows));
  below = rows * rowHeight;
  const scale = fineness() * large;
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round((below + AXIS) * scale);
  canvas.style.height = `${large * (below + AXIS)}px`;
  now.style.height = `${large * below}px`;
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.font = `12px ${FONT}`;
  const named = rowHeight >= 13;
  left = named ? Math.min(110, 8 + Math.max(...line.arms.map((arm) => pen.measureText(arm.name).width))) : 14;
  right = width - 8;
  drawGrid();
  line.arms.forEach((arm, row) => drawRow(arm, row, named));
  if (named) drawArrows();
  for (const conflict of conflicts()) drawConflict(conflict);
  follow();
}

function drawGrid() {
  pen.textBaseline = "alphabetic";
  niceTicks(line.start, line.start + line.makespan, 6).forEach((time, k, all) => {
    const at = x(time), isLast = k === all.length - 1;
    pen.fillStyle = GRID;
    pen.fillRect(Math.round(at), 0, 1, below);
    pen.fillStyle = SOFT;
    pen.textAlign = isLast && at > right - 12 ? "right" : "center";
    pen.fillText(`${shortNumber(time)}${isLast ? " s" : ""}`, at, below + 14);
  });
}

function drawRow(arm, row, named) {
  const thick = Math.max(2.5, 0.62 * rowHeight), thin = Math.max(1.2, 0.17 * rowHeight);
  if (named) {
    pen.fillStyle = INK;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    pen.fillText(arm.name, 0, y(row), left - 6);
  }
  pen.fillStyle = arm.color;
  pen.globalAlpha = 0.45;
  for (const [begin, last] of arm.waits) pen.fillRect(x(begin), y(row) - thin / 2, x(last) - x(begin), thin);
  pen.globalAlpha = 1;
  for (const [begin, last] of arm.moves) pen.fillRect(x(begin), y(row) - thick / 2, Math.max(1, x(last) - x(begin)), thick);
  if (arm.undelayed !== null && arm.moves.length) {
    pen.fillStyle = INK;
    pen.fillRect(x(line.start + arm.undelayed) - 0.75, y(row) - 0.42 * rowHeight, 1.5, 0.84 * rowHeight);
  }
}

/** An arrow from the awaited arm to the waiting one, at the time when the latter continues. */
function drawArrows() {
  line.arms.forEach((arm, row) => {
    for (const [, until, others] of arm.waits) {
      for (const other of others) {
        const at = x(until), from = y(other), sign = row > other ? 1 : -1, to = y(row) - sign * 0.1 * rowHeight;
        pen.strokeStyle = pen.fillStyle = line.arms[other].color;
        pen.lineWidth = 1.6;
        pen.beginPath();
        pen.moveTo(at, from);
        pen.lineTo(at, to - 5 * sign);
        pen.stroke();
        pen.beginPath();
        pen.moveTo(at, to);
        pen.lineTo(at - 4, to - 7 * sign);
        pen.lineTo(at + 4, to - 7 * sign);
        pen.fill();
        disc(pen, at, from, 3.2, line.arms[other].color, "#fff", 1.2);
      }
    }
  });
}

function drawConflict({ time, rows }) {
  if (!rows.length) return;
  pen.strokeStyle = CONFLICT;
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(x(time), y(Math.min(...rows)));
  pen.lineTo(x(time), y(Math.max(...rows)));
  pen.stroke();
  const r = Math.max(3, Math.min(5, 0.3 * rowHeight));
  for (const row of rows) rimmedCross(pen, x(time), y(row), r, CONFLICT, 2.6);
}

/** The rows of a motion planned by the page, in which no arm waits. */
function rowsPlannedHere(track) {
  const { arms } = viewer.kinematics;
  const rows = data.arms.map((row) => {
    const arm = arms.find(({ name }) => name === row.name), moves = [];
    const slots = track.columns.flatMap((c, slot) => (ownsColumn(arm, c) ? [slot] : []));
    for (let i = 0; i < track.pieces; i++) {
      const [begin, last] = [track.breaks[i], track.breaks[i + 1]], rate = (slot) => track.derived(i, slot, 0).slice(1);
      if (!slots.some((slot) => rate(slot).some((c, k) => Math.abs(c) * (last - begin) ** (k + 1) > STILL))) continue;
      if (moves.length && moves[moves.length - 1][1] === begin) moves[moves.length - 1][1] = last; else moves.push([begin, last]);
    }
    return { ...row, moves, waits: [], undelayed: null };
  });
  const makespan = track.end - track.start;
  const how = viewer.planner instanceof ManyArmsPlanner ? "one after the other" : "in their joint space";
  return { arms: rows, conflicts: [], start: track.start, makespan, summary: `${rows.length} ${rows.length === 1 ? "arm" : "arms"}, ${makespan.toFixed(2)} s, planned here ${how}` };
}

/** Moves the time cursor to the current time of the motion. */
function follow() {
  now.style.left = `${large * x(clamp(viewer.time, line.start, line.start + line.makespan))}px`;
}

/** A description of the chart at a point. */
function words(row, time) {
  const arm = line.arms[row];
  if (!arm) return "";
  const wait = arm.waits.find(([begin, last]) => begin <= time && time <= last);
  const next = arm.moves.find(([, last]) => time <= last);
  if (!wait) return `${arm.name} ${!next ? "is at its goal" : next[0] <= time ? "moves" : "stands still"}`;
  const whom = wait[2].map((other) => line.arms[other].name).join(", ");
  return `${arm.name} waits ${(wait[1] - wait[0]).toFixed(2)} s${whom ? ` for ${whom}` : ""}`;
}

function pointed(event) {
  const box = canvas.getBoundingClientRect();
  const share = ((event.clientX - box.left) / large - left) / (right - left);
  return { time: line.start + clamp(share, 0, 1) * line.makespan, row: Math.floor((event.clientY - box.top) / large / rowHeight) };
}

/** The conflicts that do not involve an obstacle that has moved since. */
function conflicts() {
  return line.conflicts.filter(({ elements }) => !elements.some((name) => viewer.moved.includes(name)));
}

/** The conflict whose cross is under the pointer. */
function conflictAt({ time, row }) {
  const near = (conflict) => Math.abs(x(conflict.time) - x(time)), rows = Math.max(1, 8 / rowHeight);
  const hit = conflicts().filter((c) => near(c) < 7 && c.rows.some((r) => Math.abs(r - row) < rows));
  return hit.sort((a, b) => near(a) - near(b))[0];
}

function say(conflict, text) {
  said.textContent = conflict ? conflict.message : text;
  said.classList.toggle("bad", Boolean(conflict));
}

/** Goes to the time under the pointer; on a cross, to the contact, whose links are painted red. */
function choose(event) {
  const place = pointed(event), conflict = conflictAt(place);
  if (conflict) viewer.point(conflict.time, conflict.elements);
  else { viewer.pause(); viewer.seek(place.time); }
}

chart.addEventListener("pointerdown", (event) => { chart.setPointerCapture(event.pointerId); choose(event); });
chart.addEventListener("pointermove", (event) => {
  const place = pointed(event);
  say(conflictAt(place), words(place.row, place.time) || line.summary);
  if (event.buttons) choose(event);
});
chart.addEventListener("pointerleave", () => say(null, line.summary));
say(null, line.summary);
onResize(chart, draw);
viewer.on("change", follow);
viewer.on("obstacle", draw);
viewer.on("load", (doc) => {
  line = doc.planned ? rowsPlannedHere(viewer.player.track) : data;
  say(null, line.summary);
  draw();
});
draw();
