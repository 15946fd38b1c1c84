// Contacts found by the report or the simulation: red links, and red marks on the time line.

const LEAST_SHOWN = 0.1; // [s] before and after the moment of a contact of which nothing else is known

class Conflicts {
  constructor(doc, player) {
    const { start, end } = player, half = Math.max(LEAST_SHOWN, 0.01 * (end - start));
    const found = doc.report ? doc.report.violations.filter((v) => v.kind === "collision" && v.time !== null) : [];
    const simulated = doc.replay ? doc.replay.summary.contacts : [];
    this.all = [
      ...found.map(({ subject, time }) => ({ subject, time, from: time - half, to: time + half })),
      ...simulated.map(({ pair, first, last }) => ({ subject: pair, time: first, from: first - half / 2, to: last + half / 2, simulated: true })),
    ].sort((a, b) => a.time - b.time);
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

  /** The elements that touch now. */
  elements() {
    return this.now.flatMap(({ subject }) => subject);
  }

  /** The pairs in contact now as text; the first two if there are more. */
  words() {
    return namesOf(this.now.map(({ subject }) => subject.join(" and ")), 2, ", ");
  }

  /** Marks {time, subject, title} for a time line of a length [s]; marks closer than a fraction of it are merged. */
  marks(length, spacing = 0.006) {
    const marks = [];
    for (const { subject, time, simulated } of this.all) {
      const name = `${subject.join(" and ")} at ${seconds(time)}${simulated ? " (simulated)" : ""}`, last = marks[marks.length - 1];
      if (last && time - last.time <= spacing * length) { last.names.push(name); last.subject.push(...subject); }
      else marks.push({ time, subject: [...subject], names: [name] });
    }
    return marks.map(({ time, subject, names }) => ({ time, subject, title: namesOf(names, 6, "\n") }));
  }
}

function namesOf(names, most, between) {
  const more = names.length - most;
  return [...names.slice(0, most), ...(more > 0 ? [`and ${more} more`] : [])].join(between);
}
