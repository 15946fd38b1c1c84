// Violations of the report and contacts of the simulation: red links, and red marks on the time line.

const LEAST_SHOWN = 0.1; // [s] shown before and after a contact whose duration is unknown, in a motion of a second or longer

class Conflicts {
  /** moved: names of obstacles that are not where these contacts were found; theirs are left out. */
  constructor(doc, player, kinematics, moved = []) {
    const { start, end } = player, long = end - start, half = Math.max(Math.min(LEAST_SHOWN, 0.1 * long), 0.01 * long);
    const violations = doc.report ? doc.report.violations.map((v, i) => ({ ...v, place: doc.samples.places[i] || null })) : [];
    const found = violations.filter((v) => v.time !== null);
    const simulated = doc.replay ? doc.replay.summary.contacts : [];
    this.all = [
      ...found.map((v) => ({ ...v, elements: v.subject.map((name) => kinematics.elementOf(name)), from: v.time - half, to: v.time + half })),
      ...simulated.map(({ pair, first, last }) => ({ kind: "collision", subject: pair, elements: pair, place: null, time: first, from: first - half / 2, to: last + half / 2, simulated: true })),
    ].filter(({ subject }) => !subject.some((name) => moved.includes(name))).sort((a, b) => a.time - b.time);
    this.now = [];
    this.shown = null;
  }

  /** Selects the contacts at a time (null: none); true if they differ from the last selection. */
  at(time) {
    if (!this.all.length) return false;
    const now = time === null ? [] : this.all.filter(({ from, to }) => from <= time && time <= to);
    const same = this.shown !== null && now.length === this.now.length && now.every((conflict, i) => conflict === this.now[i]);
    this.shown = this.now = now;
    return !same;
  }

  /** The elements in contact now, in a motion: "plan", "replay", "compare", null: any. */
  elements(kind) {
    return this.now.filter(({ simulated }) => !kind || kind === (simulated ? "replay" : "plan")).flatMap(({ elements }) => elements);
  }

  /** The violations now as text; the first two if there are more. */
  words() {
    return namesOf([...new Set(this.now.map(nameOf))], 2, ", ");
  }

  /** Marks {time, subject, title} for a time line of a length [s]; marks closer than a fraction of it are merged. */
  marks(length, spacing = 0.006) {
    const marks = [];
    for (const conflict of this.all) {
      const { subject, time, simulated } = conflict, name = `${nameOf(conflict)} at ${seconds(time, length)}${simulated ? " (simulated)" : ""}`, last = marks[marks.length - 1];
      if (last && time - last.time <= spacing * length) { last.names.push(name); last.subject.push(...subject); }
      else marks.push({ time, subject: [...subject], names: [name] });
    }
    return marks.map(({ time, subject, names }) => ({ time, subject, title: namesOf(names, 6, "\n") }));
  }
}

/** The elements in contact, or the joint and the limit that it violates. */
function nameOf({ kind, subject }) {
  return kind === "collision" ? subject.join(" and ") : [subject.join(" and "), kind].filter(Boolean).join(" ");
}

/** All names, as in "a, b and c". */
const listed = (names) => (names.length > 1 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : names[0]);

/** Some names, and how many more there are. */
function namesOf(names, most, between) {
  const more = names.length - most;
  return [...names.slice(0, most), ...(more > 0 ? [`and ${more} more`] : [])].join(between);
}
