// Keys of the page, and the list of them that "?" shows.
//
//   viewer.keys.add(title, rows, {on, first})    rows: [{ keys, text, act(event), when(target) }]
//       keys: as in `KeyboardEvent.key`, letters in lower case, "Ctrl+z" also for the Command key; text: for the list
//       when(target): whether the row is active while target has the focus (null: anywhere)
//       on: an element that must have the focus;  first: takes precedence over rows of others
//   viewer.keys.arrows(title, text, on, act)     act([right, up], event) for the arrow keys while `on` has the focus
//
// Among several rows for a key, the one whose element has the focus wins, then one with `first`, then the last added.

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const SLIDER_KEYS = [...Object.keys(ARROWS), "Home", "End", "PageUp", "PageDown"];
const KEY_NAMES = { " ": "Space", ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", PageUp: "Page ↑", PageDown: "Page ↓", Escape: "Esc" };
const REPEATING = /^([,.<>]|..+)$/; // keys that repeat while held down

class Keys {
  constructor() {
    this.rows = [];
    this.dialog = find("help");
    this.dialog.onclick = (event) => { if (event.target === this.dialog) this.dialog.close(); };
    for (const button of document.querySelectorAll("[data-help]")) button.onclick = () => this.help();
    // Registered last, so that panels can override keys.
    window.addEventListener("keydown", (event) => this.press(event));
    this.add("Page", [{ keys: ["?"], text: "This list", act: () => this.help() }]);
  }

  add(title, rows, { on = null, first = false } = {}) {
    for (const row of rows) this.rows.push({ title, on, rank: on ? 2 : first ? 1 : 0, when: () => true, ...row });
  }

  arrows(title, text, on, act) {
    this.add(title, [{ keys: Object.keys(ARROWS), text, act: (event) => act(ARROWS[event.key], event) }], { on });
  }

  /** The active row of a key while an element has the focus; null: without focus. */
  rowOf(key, target) {
    let best = null;
    for (const row of this.rows) {
      if (row.keys.includes(key) && (!row.on || row.on === target) && row.when(target) && (!best || row.rank >= best.rank)) best = row;
    }
    return best;
  }

  press(event) {
    if (event.defaultPrevented || event.altKey || isTaken(event)) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, name = event.ctrlKey || event.metaKey ? `Ctrl+${key}` : key;
    const row = this.rowOf(name, event.target);
    if (!row || (this.dialog.open && name !== "?")) return;
    event.preventDefault();
    if (!event.repeat || REPEATING.test(name)) row.act(event);
  }

  /** Shows or hides the list of the active keys. */
  help() {
    if (this.dialog.open) { this.dialog.close(); return; }
    const groups = new Map();
    for (const row of this.rows) {
      const own = row.keys.filter((key) => this.rowOf(key, row.on) === row);
      if (!row.text || !own.length) continue;
      if (!groups.has(row.title)) groups.set(row.title, []);
      groups.get(row.title).push(element("dt"), element("dd", row.text));
      groups.get(row.title).at(-2).append(...own.map((key) => element("kbd", keyName(key))));
    }
    // Keys specific to this page come first.
    const lists = [...groups].reverse().map(([title, items]) => {
      const section = element("section"), list = element("dl");
      list.append(...items);
      section.append(element("h3", title), list);
      return section;
    });
    this.dialog.querySelector("div").replaceChildren(...lists);
    this.dialog.showModal();
  }
}

/** Whether the focused element handles a key itself: characters in a text, arrows on a slider, a press of a button. */
function isTaken({ target, key }) {
  if (["SELECT", "TEXTAREA"].includes(target.tagName) || target.isContentEditable) return true;
  if (target.tagName === "INPUT") return target.type !== "range" || (target.id !== "scrub" && SLIDER_KEYS.includes(key));
  return ["BUTTON", "SUMMARY", "A"].includes(target.tagName) && [" ", "Enter"].includes(key);
}

function keyName(key) {
  return key.split("+").map((part) => KEY_NAMES[part] || (part.length === 1 ? part.toUpperCase() : part)).join("+");
}
