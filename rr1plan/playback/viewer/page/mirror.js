// The measurements of a mirror. Statements of a panel with viewer, root and data in scope.

const part = (name) => root.querySelector(name);
const verdict = part(".verdict"), facts = part(".facts"), canvas = part(".use"), event = part(".event");
const pen = canvas.getContext("2d"), LASTS = 20, uses = [];
const inSeconds = (t) => `${t.toFixed(2)} s`;
const slides = data.joints.map((name) => viewer.slides[viewer.joints.indexOf(name)]);
const deviation = (v, i) => (slides[i] ? `${decimals(1000 * v, 2)} mm` : `${decimals(DEGREES * v, 2)}°`);
const oneArm = new Set(data.joints.map((name) => name.split("/")[0])).size === 1;

const rows = data.joints.map((name) => {
  const row = element("div", undefined, "deviation"), groove = element("i", undefined, "groove"), bar = element("b");
  const label = element("span", oneArm ? name.slice(name.indexOf("/") + 1) : name), now = element("span"), most = element("span");
  label.title = name;
  groove.append(bar);
  row.append(label, groove, now, most);
  return { row, bar, now, most };
});
if (rows.length) {
  const head = element("div", undefined, "deviation head");
  head.append(...["Off the plan", "", "now", "most"].map((text) => element("span", text)));
  part(".deviations").append(head, ...rows.map(({ row }) => row));
} else for (const node of [canvas, part("h3")]) node.hidden = true;

function drawUses() {
  const large = magnification(), width = canvas.clientWidth / large, height = canvas.clientHeight / large;
  if (!width) return;
  const scale = fineness() * large, left = 42, top = 6, bottom = height - 16;
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.font = `11px ${FONT}`;
  const last = uses.length ? uses[uses.length - 1].time : LASTS, begin = Math.max(last - LASTS, uses.length ? uses[0].time : 0);
  const high = Math.max(1.25, Math.min(3, 1.1 * Math.max(0, ...uses.map(({ use }) => use))));
  const x = (time) => left + ((time - begin) / Math.max(last - begin, 1)) * (width - left - 4);
  const y = (use) => bottom - (Math.min(use, high) / high) * (bottom - top);
  pen.fillStyle = "#fde0ea";
  pen.fillRect(left, top, width - left - 4, y(1) - top);
  pen.fillStyle = SOFT;
  pen.textAlign = "right";
  for (const use of [0, 1, 2, 3].filter((value) => value <= high)) pen.fillText(`${100 * use} %`, left - 5, y(use) + 4);
  pen.textAlign = "left";
  pen.fillText(inSeconds(begin), left, height - 3);
  pen.textAlign = "right";
  pen.fillText(inSeconds(last), width - 4, height - 3);
  pen.strokeStyle = BAD;
  pen.setLineDash([4, 3]);
  pen.beginPath();
  pen.moveTo(left, y(1));
  pen.lineTo(width - 4, y(1));
  pen.stroke();
  pen.setLineDash([]);
  pen.strokeStyle = INK;
  pen.lineWidth = 1.5;
  pen.beginPath();
  uses.forEach(({ time, use }, i) => pen[i ? "lineTo" : "moveTo"](x(time), y(use)));
  pen.stroke();
}

function show() {
  const { state, late } = data;
  event.textContent = data.event || "";
  if (!state) {
    if (late) verdict.textContent = "No usable message yet";
    return;
  }
  const touching = state.contacts.length > 0, moved = state.moved.length > 0;
  const outside = !moved && state.use !== null && state.use >= 1;
  verdict.className = `verdict ${touching || outside ? "bad" : late || moved || state.use === null ? "open" : "good"}`;
  verdict.textContent = touching ? `${state.contacts[0].join(" and ")} touch`
    : late && !outside ? `No usable message since ${inSeconds(state.time)}: the arm may be elsewhere`
    : moved ? `Not proven: the plan assumes ${listed(state.moved)} elsewhere`
    : outside ? `Outside the certified corridor: ${state.pair.join(" and ")} might touch`
    : state.use === null ? "No plan to compare with" : "Inside the certified corridor: proven free of collision";
  facts.textContent = late ? inSeconds(state.time) : `${inSeconds(state.time)} · ${state.rate.toFixed(0)} messages/s · delay ${(1000 * state.delay).toFixed(1)} ms`;
  if (state.deviation) {
    rows.forEach(({ bar, now, most }, i) => {
      // Bars of angles and of lengths have scales of their own.
      const off = state.deviation[i] / Math.max(1e-3, ...state.most.filter((_, k) => slides[k] === slides[i]));
      bar.style.left = `${50 + 50 * Math.min(off, 0)}%`;
      bar.style.width = `${50 * Math.abs(off)}%`;
      now.textContent = deviation(state.deviation[i], i);
      most.textContent = deviation(state.most[i], i);
    });
  }
  if (state.use !== null && (!uses.length || state.time !== uses[uses.length - 1].time)) {
    if (uses.length && state.time < uses[uses.length - 1].time) uses.length = 0;
    uses.push({ time: state.time, use: state.use });
    while (uses[0].time < state.time - LASTS) uses.shift();
  }
  drawUses();
}

viewer.on("data", show);
onResize(canvas, drawUses);
drawUses();
show();
