// Motions side by side: a tile of the picture for each, seen by the same camera and on one clock.

/** Layers that belong only to the motion of the page. */
const OWN_LAYERS = ["toolpath", "toolspeed", "path", "tree", "nearest", "conflicts"];

class SideBySide {
  constructor(viewer) {
    Object.assign(this, { viewer, on: false, kinds: [] });
    viewer.stage.onTile = (k) => this.show(k);
    viewer.keys.add("View", [{ keys: ["v"], text: "Motions side by side, or overlaid", when: () => this.offered, act: () => this.toggle() }]);
  }

  /** Whether there are other motions to show. */
  get offered() {
    const { others, stage } = this.viewer;
    return others.size > 0 && Boolean(stage.renderer);
  }

  toggle(on = !this.on) {
    const { viewer } = this, kinds = [...viewer.others.keys()];
    this.on = on;
    // All of them if all are hidden.
    if (on && !kinds.some((kind) => viewer.isShown(kind))) for (const kind of kinds) viewer.setShown(kind, true);
    this.load();
    viewer.controls.refreshToggles();
    viewer.show();
  }

  /** Makes a tile for each motion that is shown now. */
  load() {
    const { viewer } = this, { stage, world, others } = viewer, split = this.on && this.offered;
    this.kinds = split ? [...others.keys()].filter((kind) => viewer.isShown(kind)) : [];
    for (const [kind, { bodies }] of Object.entries(world.followers)) bodies.group.visible = !this.kinds.includes(kind);
    for (const [name, layer] of Object.entries(world.layers)) layer.visible = viewer.isShown(name) && (others.has(name) || !(name in world.followers));
    const count = this.kinds.length + 1;
    if (stage.renderer && stage.count !== count) {
      const direction = stage.turned ? stage.direction() : null;
      stage.count = count;
      viewer.look(direction, viewer.framed === "whole");
      // Restore the contact colors of all motions.
      viewer.paint();
    }
    this.place();
    viewer.redraw();
  }

  /** Makes the content of a tile visible: 0 the motion of the page, from 1 on the others. */
  show(tile) {
    const { viewer } = this, { world, overlays } = viewer, kind = tile ? this.kinds[tile - 1] : null;
    for (const name of OWN_LAYERS) if (world.layers[name]) world.layers[name].visible = !kind && viewer.isShown(name);
    for (const other of this.kinds) world.layers[other].visible = other === kind;
    if (viewer.conflicts.now.length) viewer.paint(kind || "plan");
    world.update(kind ? viewer.others.get(kind).at(viewer.time, viewer.kinematics.rest()) : viewer.q);
    if (overlays.made.frames && viewer.isShown("frames")) overlays.made.frames.update();
  }

  /** A name and a border for each tile. */
  place() {
    const { viewer } = this, { stage, player } = viewer, box = find("tiles");
    if (!this.kinds.length) { box.replaceChildren(); return; }
    const length = (track) => (track ? `, ${seconds(track.end - track.start, track.end - track.start)}` : ""), { compare } = viewer.document;
    const names = { replay: () => "Simulated", compare: () => `${compare[0].name}${length(viewer.others.get("compare"))}` };
    const texts = [`Plan${viewer.document.track.timed ? length(player.track) : ""}`, ...this.kinds.map((kind) => names[kind]())];
    const floor = Math.min(...["bar", "plots"].map((id) => find(id).getBoundingClientRect()).map(({ height, top }) => (height ? top : Infinity)));
    const lowest = floor - stage.pane.getBoundingClientRect().top;
    box.replaceChildren(...stage.tiles().map(({ left, top, width, height }, k) => {
      const tile = element("div", undefined, left ? "tile right" : top ? "tile below" : "tile");
      Object.assign(tile.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${Math.min(height, lowest - top)}px` });
      tile.append(element("b", texts[k]));
      return tile;
    }));
  }
}
