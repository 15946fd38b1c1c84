// The content of the lesson's steps; `viewer.slices` is slices_panel.js.

const { slices } = viewer;
const show = (mode, columns, more = () => {}) => () => {
  slices.setMode(mode);
  slices.setColumns(columns);
  more();
};
steps.on("slices", show("slice", [0, 2]));
steps.on("others", show("slice", [0, 2]));
steps.on("many", show("slice", [1, 2]));
steps.on("solutions", show("solutions", [0, 2]));
steps.on("self_motion", show("motion", [0, 2]));
steps.on("measure", show("measure", [0, 2], () => { if (!slices.counts.length) slices.sample(); }));
steps.on("survives", show("slice", [0, 2]));
