// Certified cells over the picture of the configuration space.

const space = viewer.lesson, { size, lower, upper, colors } = data.own;
const kinds = viewer.unpack(data.own.kinds).values;

const cells = steps.overlay((pen, at, ratio) => {
  const wide = (upper[0] - lower[0]) / size, tall = (upper[1] - lower[1]) / size;
  for (let i = 0; i < size; i++) {
    for (let j = 0; j < size; j++) {
      const kind = kinds[i * size + j];
      if (!kind) continue;
      const [x0, y0] = at([lower[0] + i * wide, lower[1] + (j + 1) * tall]), [x1, y1] = at([lower[0] + (i + 1) * wide, lower[1] + j * tall]);
      pen.globalAlpha = kind === 1 ? 0.6 : 0.4;
      pen.fillStyle = kind === 1 ? colors.full : colors.reached;
      pen.fillRect(x0 + 0.4 * ratio, y0 + 0.4 * ratio, x1 - x0 - 0.8 * ratio, y1 - y0 - 0.8 * ratio);
    }
  }
});

const show = ({ tint = false, tree = false, torus = false, proof = false, verdict = true }) => {
  space.tinted = tint;
  space.showTree = tree;
  space.repaint();
  steps.torus(torus);
  cells.show(proof);
  // The answer is not given away before the question has been tried.
  document.querySelector("#panel-cspace .verdict").hidden = !verdict;
};
steps.reset = () => show({});
for (const name of ["ends", "by-hand"]) steps.on(name, () => show({ verdict: false }));
steps.on("components", () => show({ tint: true }));
steps.on("seams", () => show({ tint: true, torus: true }));
steps.on("planner", () => { show({ tree: true }); space.grow(); });
steps.on("proof", () => show({ proof: true }));
