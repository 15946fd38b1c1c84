// The steps of the lesson select the search that the panel shows in its final state; P replays it from the beginning.

const { search } = viewer;
const show = (planner) => () => search.choose({ planner, step: viewer.panelData.search.usual[planner], bias: 0.05 });

steps.reset = () => search.stop();
steps.on("question", () => { search.choose({ planner: "RRT", step: 0.3, bias: 0.05 }); search.go(0); });
steps.on("dijkstra", show("Dijkstra"));
steps.on("astar", show("A*"));
steps.on("rrt", show("RRT"));
steps.on("connect", show("RRT-Connect"));
steps.on("rrtstar", show("RRT*"));
steps.on("prm", show("PRM"));
steps.on("race", () => search.choose({ planner: "RRT*", step: 0.6 }));
steps.on("options", () => search.choose({ planner: "RRT", step: 0.6, bias: 0.05 }));
