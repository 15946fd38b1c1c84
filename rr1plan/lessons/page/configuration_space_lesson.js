// What is emphasized in the picture of the configuration space.

const space = viewer.lesson;
const layer = (name) => viewer.panelData.cspace.layers.findIndex((one) => one.name === name);
steps.reset = () => { space.single(-1); if (space.setTorus) space.setTorus(false); };
steps.on("strip", () => space.single(data.own.largest ? layer(data.own.largest) : -1));
steps.on("seams", () => { if (space.setTorus) space.setTorus(true); });
