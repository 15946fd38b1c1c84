// The steps of the lesson select the search that the panel shows in its final state; P replays it from the beginning.

const { search } = viewer, { usual } = viewer.panelData.search;
const show = (planner) => () => search.choose({ planner, step: usual[planner], bias: 0.05 });

steps.reset = () => search.stop();
steps.on("question", () => { search.choose({ planner: "RRT", step: usual.RRT, bias: 0.05 }); search.go(0); });
steps.on("dijkstra", show("Dijkstra"));
steps.on("astar", show("A*"));
steps.on("rrt", show("RRT"));
steps.on("connect", show("RRT-Connect"));
steps.on("rrtstar", show("RRT*"));
steps.on("prm", show("PRM"));
steps.on("race", () => search.choose({ planner: "RRT*", step: usual["RRT*"] }));
steps.on("options", () => search.choose({ planner: "RRT", step: 2 * usual.RRT, bias: 0.05 }));
