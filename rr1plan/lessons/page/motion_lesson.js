// The steps of the lesson select the content of the panel.

const { timing } = viewer;
steps.reset = () => timing.stop();
steps.on("path", () => timing.show("path"));
steps.on("shortcut", () => timing.show("shortcut"));
steps.on("blend", () => timing.show("blend"));
steps.on("plane", () => timing.show("plane"));
steps.on("limits", () => timing.show("plane"));
steps.on("phases", () => timing.show("phases"));
steps.on("cost", () => timing.show("cost"));
