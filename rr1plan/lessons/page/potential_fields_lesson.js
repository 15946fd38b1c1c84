// The steps of the lesson select the potential that is shown.

const { potential } = viewer;
const show = (mode, striped = false) => () => potential.show(mode, striped);
steps.reset = () => potential.stop();
steps.on("attraction", show("attraction"));
steps.on("repulsion", show("repulsion"));
steps.on("sum", show("sum"));
steps.on("basins", show("sum", true));
steps.on("fill", show("fill"));
steps.on("wave", show("wave"));
steps.on("use", show("sum"));
