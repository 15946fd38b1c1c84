// The steps of the lesson choose the search that the panel shows; it grows when its step is entered.

const { search } = viewer;
const grow = (planner) => () => {
  search.choose({ planner, step: viewer.panelData.search.usual[planner], bias: 0.05 });
  search.go(0);
  search.play();
};

steps.reset = () => search.stop();
steps.on("question", () => { search.choose({ planner: "RRT", step: 0.3, bias: 0.05 }); search.go(0); });
steps.on("dijkstra", grow("Dijkstra"));
steps.on("astar", grow("A*"));
steps.on("rrt", grow("RRT"));
steps.on("connect", grow("RRT-Connect"));
steps.on("rrtstar", grow("RRT*"));
steps.on("prm", grow("PRM"));
steps.on("race", () => search.choose({ planner: "RRT*", step: 0.6 }));
steps.on("options", () => search.choose({ planner: "RRT", step: 0.6, bias: 0.05 }));
