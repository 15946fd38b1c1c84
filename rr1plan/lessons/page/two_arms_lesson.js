// What the steps of the lesson show; `viewer.pair` is pair_panel.js.

const { pair } = viewer;
/** Shows a schedule at a time; in a small window the picture that the step is about. */
const show = (scenario, schedule, time, picture = ".diagram") => () => {
  pair.setArm(0);
  pair.setScenario(scenario);
  pair.setSchedule(schedule);
  pair.setTime(time);
  document.querySelector(`#panel-pair ${picture}`).scrollIntoView({ block: "nearest" });
};
steps.reset = () => pair.stop();
steps.on("slices", show("take_turns", "right_first", 0, ".slice"));
steps.on("moving", show("take_turns", "right_first", 2.6, ".slice"));
steps.on("diagram", show("take_turns", "at_once", 2.4));
steps.on("orders", show("take_turns", "right_first", 0));
steps.on("back_up", show("back_up", "back_up", 0));
steps.on("barrier", show("swap_sides", "at_once", 0));
steps.on("joint", show("swap_sides", "joint", 0));
