// The planner of a page in a worker: the page stays responsive while it plans, and its user can cancel.
//
//   const background = new BackgroundPlanner(planner)     planner: of `loadPlanner`
//   background.start()                                    loads the worker before its first request
//   await background.plan(start, goal, {seed}, report)     the planner's result; null if canceled
//   await background.run(name, given, report)
//       the result of a method of the planner, with the obstacles at their current poses; null if canceled;
//       report(text): progress in words
//   background.isParallel                                 false where the browser refuses workers: the page then stands still
//   background.cancel()  background.end()
//
// A worker cannot read the page, so it is made from the text of the script that contains the planner, and loads the
// same data. Only its end stops a kernel that runs: the next request starts another worker.

const MOMENT = 0.01; // [s] of a search in the page: the answer of a worker waits until the page has drawn
const SLOW_PLAN = 200; // [ms] after which a page shows the progress of planning
const NEXT_FRAMES = 50; // [ms] in which the page draws; where it is out of view, browsers call no animation frames
const PLANNER_SCRIPT = "planner-script"; // id of the script element that contains this file

/** In the worker: runs methods of the planner in the order of the requests. */
function answerRequests() {
  let loading = null;
  self.onmessage = async ({ data: { load, poses, name, given } }) => {
    if (load) {
      loading = loadPlanner(load);
      loading.catch(() => self.postMessage({ refused: true }));
      return;
    }
    try {
      const planner = await loading;
      planner.report = (progress) => self.postMessage({ progress });
      for (const [obstacle, pose] of poses) planner.moveObstacle(obstacle, pose);
      self.postMessage({ answer: planner[name](...given) });
    } catch ({ message }) {
      self.postMessage({ error: message });
    }
  };
}

class BackgroundPlanner {
  static #address = null; // of the worker's script

  #planner;
  #worker = null;
  #sent = new Map(); // poses of obstacles that the worker has, by name
  #requests = []; // unanswered, in order

  constructor(planner) {
    this.#planner = planner;
    this.isParallel = true;
  }

  start() {
    if (this.#worker || !this.isParallel) return;
    try {
      const script = document.getElementById(PLANNER_SCRIPT).textContent;
      BackgroundPlanner.#address ??= URL.createObjectURL(new Blob([script, "\nanswerRequests();\n"], { type: "text/javascript" }));
      this.#worker = new Worker(BackgroundPlanner.#address);
    } catch {
      this.#refuse();
      return;
    }
    this.#worker.onmessage = ({ data }) => this.#take(data);
    // Policies that forbid workers are reported here.
    this.#worker.onerror = (event) => {
      event.preventDefault();
      this.#refuse();
    };
    this.#worker.postMessage({ load: this.#planner.data });
  }

  /** Plans one query in the page if that only takes a moment, otherwise in the worker. The result is the same. */
  async plan(start, goal, options, report) {
    if (this.#planner instanceof PagePlanner) {
      const answer = this.#planner.plan(start, goal, { ...options, seconds: MOMENT });
      if (answer.status !== "timeout") return answer;
    }
    return this.run("plan", [start, goal, options], report);
  }

  run(name, given, report = () => {}) {
    return new Promise((resolve, reject) => {
      const request = { name, given, report, resolve, reject };
      this.#requests.push(request);
      this.start();
      this.#send(request);
    });
  }

  cancel() {
    if (!this.#requests.length) return;
    this.#stop();
    for (const { resolve } of this.#requests.splice(0)) resolve(null);
  }

  end() {
    this.#stop();
    this.cancel();
  }

  #stop() {
    if (!this.#worker) return;
    this.#worker.onmessage = this.#worker.onerror = null;
    this.#worker.terminate();
    this.#worker = null;
    this.#sent.clear();
  }

  #send(request) {
    if (!this.isParallel) { this.#runHere(request); return; }
    const { name, given } = request, poses = this.#planner.obstacles.map((obstacle) => [obstacle, this.#planner.obstaclePose(obstacle)]);
    const moved = poses.filter(([obstacle, pose]) => !this.#sent.has(obstacle) || this.#sent.get(obstacle).some((v, i) => v !== pose[i]));
    for (const [obstacle, pose] of moved) this.#sent.set(obstacle, pose);
    this.#worker.postMessage({ poses: moved, name, given });
  }

  #take({ refused, progress, answer, error }) {
    if (refused) { this.#refuse(); return; }
    if (progress !== undefined) { this.#requests[0].report(progress); return; }
    const { resolve, reject } = this.#requests.shift();
    if (error === undefined) resolve(answer); else reject(new Error(error));
  }

  /** Continues without a worker. */
  #refuse() {
    this.isParallel = false;
    this.#stop();
    for (const request of this.#requests) this.#runHere(request);
  }

  /** Runs a request in the page, once it has drawn that it will stand still. */
  #runHere(request) {
    const { name, given, report, resolve, reject } = request;
    report("");
    setTimeout(() => {
      if (!this.#requests.includes(request)) return;
      this.#requests.splice(this.#requests.indexOf(request), 1);
      try {
        resolve(this.#planner[name](...given));
      } catch (error) {
        reject(error);
      }
    }, NEXT_FRAMES);
  }
}
