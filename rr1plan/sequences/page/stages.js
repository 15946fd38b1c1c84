// The stages of a sequence, with the current one marked. Statements of a panel with viewer, root and data in scope.

const STILL = 1e-4; // [rad/s or m/s] the least speed of a joint that counts as motion
const list = root.querySelector("ol"), { track } = viewer.player;
/** Whether the arm does not come to rest at the end of a stage. */
const passes = (end) => end < track.end && track.columns.some((_, slot) => Math.abs(track.rate(end, slot, 1)) > STILL);
const buttons = data.map(({ label, begin, end }) => {
  const row = element("li"), button = element("button");
  for (const [name, text] of [["label", label], ["passed", passes(end) ? "no stop" : ""], ["time", `${begin.toFixed(2)} s`]]) {
    if (text) button.append(element("span", text, name));
  }
  button.addEventListener("click", () => {
    if (viewer.editing.changed) viewer.editing.reset();
    viewer.pause();
    viewer.seek(begin);
  });
  row.append(button);
  list.append(row);
  return button;
});

let marked = -1;
function mark(time) {
  // Among stages that begin at the same time, the last one, except at the end of the sequence.
  const now = data.reduce((found, { begin, end }, i) => (begin <= time && (end > time || end > begin || found < 0) ? i : found), -1);
  if (now === marked) return;
  buttons.forEach((button, i) => button.classList.toggle("now", i === now));
  marked = now;
}

// While the user moves the arm, or a motion planned here plays, the stage is the one in which this began.
viewer.on("change", (q, time) => mark(viewer.editing.stages.rows ? viewer.editing.stages.time : time));
mark(viewer.time);
