// A page that follows a running Python program: the newest configuration wins, older ones are dropped.

class Live {
  constructor(viewer, version) {
    this.viewer = viewer;
    this.version = version;
    this.newest = null;
    this.ended = false;
    this.connect();
  }

  connect() {
    const url = `${location.protocol.replace("http", "ws")}//${location.host}/updates?version=${this.version}`;
    const socket = (this.socket = new WebSocket(url));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.viewer.controls.status("");
    socket.onmessage = (message) => this.take(message.data);
    socket.onclose = () => {
      if (this.ended) return;
      this.viewer.controls.status("The program is not answering; trying again");
      setTimeout(() => this.connect(), 1000);
    };
  }

  take(data) {
    if (data instanceof ArrayBuffer) { this.newest = new Float64Array(data); return; }
    const message = JSON.parse(data);
    const { viewer } = this;
    const acts = {
      document: () => { this.version = message.version; this.newest = null; viewer.load(message.value, true); },
      play: () => viewer.play(),
      pause: () => viewer.pause(),
      seek: () => viewer.seek(message.value),
      speed: () => viewer.setSpeed(message.value),
      panels: () => viewer.fillPanels(message.value),
      end: () => { this.ended = true; viewer.controls.status("The program has ended; the page stays usable"); },
    };
    if (Object.hasOwn(acts, message.type)) acts[message.type]();
  }

  /** Reports a moved slider to the program. */
  tellSlider(column, value) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ type: "slider", column, value }));
  }

  /** Shows the newest configuration that came in since the last frame. */
  flush() {
    if (!this.newest) return;
    const q = this.newest;
    this.newest = null;
    if (q.length === this.viewer.q.length) this.viewer.setQ(q, "live");
  }
}
