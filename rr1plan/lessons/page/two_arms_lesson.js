// What the steps of the lesson show; `viewer.pair` is pair_panel.js.

const { pair } = viewer;
steps.reset = () => pair.stop();
for (const [name, [scenario, schedule, time, picture]] of Object.entries(data.own)) {
  steps.on(name, () => {
    pair.setArm(0);
    pair.setScenario(scenario);
    pair.setSchedule(schedule);
    pair.setTime(time);
    // In a small window the picture that the step is about.
    document.querySelector(`#panel-pair ${picture}`).scrollIntoView({ block: "nearest" });
  });
}
