// Certified cells over the picture of the configuration space.

const space = viewer.lesson, { size, lower, upper, colors } = data.own;
const kinds = viewer.unpack(data.own.kinds).values;

const { low, high } = viewer.panelData.cspace;
const at = (values) => space.chart.at(...values.map((v, axis) => (v - low[axis]) / (high[axis] - low[axis])));
let proves = false;

space.chart.overlays.push((pen) => {
  if (!proves) return;
  const wide = (upper[0] - lower[0]) / size, tall = (upper[1] - lower[1]) / size, rim = 0.4 * space.chart.ratio;
  pen.save();
  for (let i = 0; i < size; i++) {
    for (let j = 0; j < size; j++) {
      const kind = kinds[i * size + j];
      if (!kind) continue;
      const [x0, y0] = at([lower[0] + i * wide, lower[1] + (j + 1) * tall]), [x1, y1] = at([lower[0] + (i + 1) * wide, lower[1] + j * tall]);
      pen.globalAlpha = kind === 1 ? 0.6 : 0.4;
      pen.fillStyle = kind === 1 ? colors.full : colors.reached;
      pen.fillRect(x0 + rim, y0 + rim, x1 - x0 - 2 * rim, y1 - y0 - 2 * rim);
    }
  }
  pen.restore();
});

const show = ({ tint = false, tree = false, torus = false, proof = false, verdict = true }) => {
  space.tinted = tint;
  space.showTree = tree;
  proves = proof;
  space.repaint();
  steps.torus(torus);
  // The result is hidden until the student has tried.
  document.querySelector("#panel-cspace .verdict").hidden = !verdict;
};
steps.reset = () => {
  space.pauseTree();
  space.growTo(space.tree.length);
  show({});
};
for (const name of ["ends", "by-hand"]) steps.on(name, () => show({ verdict: false }));
steps.on("components", () => show({ tint: true }));
steps.on("seams", () => show({ tint: true, torus: true }));
steps.on("planner", () => { show({ tree: true }); space.grow(); });
steps.on("proof", () => show({ proof: true }));
