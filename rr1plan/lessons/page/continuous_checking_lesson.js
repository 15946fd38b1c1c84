// The content of the lesson's steps; `viewer.edge` is edge_panel.js.

const { edge } = viewer;
const enter = (name, act) => steps.on(name, act);
const show = (mode, preset, shown) => {
  edge.setMode(mode);
  edge.setPreset(preset);
  edge.shown = shown === "all" ? edge.list.length : shown || 0;
  edge.refresh();
};
enter("steps", () => { show("steps", "through"); edge.stepDegrees = 12; });
enter("small_steps", () => { show("steps", "grazing"); edge.stepDegrees = 1; });
enter("bound", () => show("halve", "far", 1));
enter("halving", () => { show("halve", "just_past", 1); });
enter("contact", () => show("halve", "through", "all"));
enter("grazing", () => show("halve", "grazing", "all"));
enter("advancing", () => show("advance", "just_past", 1));
