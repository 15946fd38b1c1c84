// The content of the lesson's steps; `viewer.pair` is pair_panel.js.

const { pair } = viewer;
steps.reset = () => pair.stop();
for (const [name, [scenario, schedule, time, picture]] of Object.entries(data.own)) {
  steps.on(name, () => {
    pair.setArm(0);
    pair.setScenario(scenario);
    pair.setSchedule(schedule);
    pair.setTime(time);
    // In a small window, scroll to the picture of the step.
    document.querySelector(`#panel-pair ${picture}`).scrollIntoView({ block: "nearest" });
  });
}
