// A page that follows a running Python program: only the latest document and configuration are shown.

const AGAIN = 1000; // [ms] between attempts to reach the program
const ANSWER_TIME = 10000; // [ms] for an answer: another program at the address may accept connections and never answer
const SILENCE = 25000; // [ms] without a message: the server sends one every 10 s, but not while its program is stopped
const PROTOCOL = "rr1plan"; // browsers reject a server that does not select it, such as one of another program at the port
const TRIES = 30; // attempts of a page elsewhere, e.g. in a notebook, whose program may never return
const FIRST_TRIES = 3; // attempts of a page elsewhere to which nothing has answered yet

class Live {
  /** access: token, version of the document, and the address of updates for a page served from elsewhere. */
  constructor(viewer, access) {
    this.viewer = viewer;
    this.access = access;
    this.version = access.version;
    this.count = 0; // number of the latest command
    this.newest = null;
    this.waiting = []; // a document to load, and messages after it
    this.latest = { frame: null, entries: new Map() };
    this.repeats = new Set(); // what the server sends again first
    this.ended = false;
    this.reached = false;
    this.tries = 0;
    this.connect();
  }

  connect() {
    const { token, address } = this.access, query = new URLSearchParams({ version: this.version, count: this.count, token });
    const own = `${location.protocol.replace("http", "ws")}//${location.host}${location.pathname}updates`;
    const socket = (this.socket = new WebSocket(`${address || own}?${query}`, PROTOCOL));
    const expiry = setTimeout(() => socket.close(), ANSWER_TIME);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      clearTimeout(expiry);
      this.reached = true;
      this.tries = 0;
      this.repeats = new Set(["frame", "entries"]);
      this.expect();
    };
    socket.onmessage = (message) => {
      this.expect();
      if (message.data) this.take(message.data); // an empty one is a sign of life
    };
    socket.onclose = () => {
      clearTimeout(expiry);
      clearTimeout(this.silence);
      this.lost();
    };
  }

  /** Notes a sign of life, and expects the next one. */
  expect() {
    const { controls } = this.viewer;
    clearTimeout(this.silence);
    controls.status("");
    this.silence = setTimeout(() => controls.status("The program is not answering; it may be stopped or busy"), SILENCE);
  }

  /** Reconnects; a page elsewhere that never reached the program remains static, e.g. in exported notebooks. */
  lost() {
    if (this.ended) return;
    this.tries += 1;
    if (this.access.address && !this.reached) {
      // Several attempts, because browsers also drop connections when they are busy or the network changes.
      if (this.tries < FIRST_TRIES) setTimeout(() => this.connect(), AGAIN);
      return;
    }
    if (this.access.address && this.tries > TRIES) {
      this.end();
      return;
    }
    this.viewer.controls.status("The program is not answering; trying again");
    setTimeout(() => this.connect(), AGAIN);
  }

  end() {
    this.ended = true;
    this.viewer.controls.status("The program no longer updates this page, which stays usable");
  }

  take(data) {
    if (data instanceof ArrayBuffer) { this.takeFrame(new Float64Array(data)); return; }
    const message = JSON.parse(data);
    // The configuration before it is out of date, and the server does not repeat it either.
    if (message.type !== "panels") this.newest = this.latest.frame = null;
    if (message.count) this.count = message.count;
    if (message.type === "document") {
      // Loading takes a while: a later document replaces one that waits, so that the page does not lag behind.
      if (!this.waiting.length) setTimeout(() => this.catchUp());
      this.waiting = this.waiting.filter(({ type }) => type !== "document");
    }
    if (message.type === "document" || this.waiting.length) this.waiting.push(message); else this.act(message);
  }

  catchUp() {
    const messages = this.waiting;
    this.waiting = [];
    for (const message of messages) this.act(message);
  }

  act(message) {
    const { viewer } = this;
    const acts = {
      document: () => { this.version = message.version; this.latest.entries.clear(); viewer.load(message.value, true); },
      play: () => viewer.play(),
      pause: () => viewer.pause(),
      seek: () => viewer.seek(message.value),
      speed: () => viewer.setSpeed(message.value),
      panels: () => this.takePanels(message.value),
      // The page belongs to an earlier program at the same address.
      reload: () => { this.ended = true; location.reload(); },
      end: () => this.end(),
    };
    if (Object.hasOwn(acts, message.type)) acts[message.type]();
  }

  // After a reconnection the server repeats the latest frame and data of panels, which would undo what the user has
  // changed since. Those that this page has already received are skipped.

  takeFrame(q) {
    const known = this.latest.frame, same = known && known.length === q.length && known.every((value, i) => value === q[i]);
    this.latest.frame = q;
    if (!this.repeats.delete("frame") || !same) this.newest = q;
  }

  takePanels(panels) {
    const { entries } = this.latest, repeated = this.repeats.delete("entries"), news = {};
    for (const [name, data] of Object.entries(panels)) {
      for (const [key, value] of Object.entries(data)) {
        const entry = `${name} ${key}`, text = JSON.stringify(value), known = entries.get(entry) === text;
        entries.set(entry, text);
        if (!repeated || !known) news[name] = { ...news[name], [key]: value };
      }
    }
    if (Object.keys(news).length) this.viewer.fillPanels(news);
  }

  /** Reports a moved slider to the program. */
  tellSlider(column, value) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ type: "slider", column, value }));
  }

  /** Shows the latest configuration received since the last frame. */
  flush() {
    if (!this.newest || this.waiting.length) return;
    const q = this.newest;
    this.newest = null;
    if (q.length === this.viewer.q.length) this.viewer.setQ(q, "live");
  }
}
