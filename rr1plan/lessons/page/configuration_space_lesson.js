// Emphasis in the picture of the configuration space.

const space = viewer.lesson;
const layer = (name) => viewer.panelData.cspace.layers.findIndex((one) => one.name === name);
steps.reset = () => { space.single(-1); steps.torus(false); };
steps.on("strip", () => space.single(data.own.largest ? layer(data.own.largest) : -1));
steps.on("seams", () => steps.torus(true));
