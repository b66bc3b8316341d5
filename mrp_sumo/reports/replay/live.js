/* A run under way: takes what the server says, and has it pause, step, and go at a speed. */
import { NEVER } from "./constants.js";
import { bytesOfBase64 } from "./data.js";
import { make } from "./elements.js";

const LIVE_SPEEDS = [0.25, 0.5, 1, 2, 4, 10, 32, 100, Infinity];
const REDRAW_MS = 400;
const REASONS = { [-2]: "for the time its plan says", [-3]: "until a disturbance is over", [-4]: "to let others pass" };

class Live {
  constructor(app) {
    this.app = app;
    this.following = true; // at the head of the run, rather than in what has been
    this.over = false;
    this.paused = false;
    this.drawn = 0;
    this.speeds = LIVE_SPEEDS;
  }

  connect() {
    const source = new EventSource("events"), { app } = this, hear = (name, act) => source.addEventListener(name, (e) => act(e.data));
    source.onopen = () => app.restart(); // the server says everything again
    source.onerror = () => { if (!this.over) this.lost(source); };
    hear("samples", (data) => app.motion.append(bytesOfBase64(data)));
    hear("events", (data) => {
      const events = JSON.parse(data);
      app.events.append(events);
      for (const [ms, kind, robot] of events) if (kind === "goal") app.run.goal_s[robot] = ms / 1000;
    });
    hear("arrived", (data) => {
      const [visits, ms] = JSON.parse(data);
      visits.forEach((k, i) => (app.motion.visit.arrived[k] = ms[i]));
    });
    hear("tasks", (data) => this.takeTasks(JSON.parse(data)));
    hear("clock", (data) => {
      const { paused, speed } = JSON.parse(data);
      this.paused = paused;
      app.view.speed = speed === null ? Infinity : speed;
      app.showLive();
    });
    hear("end", (data) => {
      this.over = true;
      source.close();
      Object.assign(app.run, JSON.parse(data));
      app.showEnd();
    });
  }

  lost(source) {
    source.close();
    this.over = true;
    this.app.run.status_text = "connection lost";
    this.app.run.is_good = false;
    this.app.showEnd();
  }

  takeTasks({ changed, stops }) {
    const { tasks } = this.app.run;
    for (const [k, name, robot, times] of changed) (tasks.name[k] = name), (tasks.robot[k] = robot), (tasks.times[k] = times);
    for (const [name, ...times] of stops) {
      let at = tasks.stations.find((station) => station[0] === name);
      if (!at) tasks.stations.push((at = [name, []]));
      at[1].push(times);
    }
    this.tasksChanged = true;
  }

  async order(what) {
    if (this.over) return;
    await fetch("control", { method: "POST", body: JSON.stringify(what) }).catch(() => {});
  }

  /* What can be done where somebody has clicked: a robot breaks down, a lane is closed, a robot is sent to a station. */
  offer([px, py], robot, slack) {
    document.getElementById("ask")?.remove();
    if (this.over) return;
    const { run } = this.app, parts = [];
    const asks = (title, ...choices) => parts.push(make("b", { textContent: title }), ...choices.map(([textContent, what]) => make("button", { textContent, onclick: () => this.ask(what) })));
    if (robot >= 0) {
      asks(`${run.robots[robot]} breaks down`, ["for 30 s", { do: "break", robot, duration_s: 30 }], ["for good", { do: "break", robot, duration_s: null }]);
    } else {
      const { station, lane } = this.nearest(px, py, slack);
      if (station && run.tasks) asks(`An order at ${station.name}`, ["add", { do: "add", stops: [station.name] }]);
      if (lane >= 0) asks("This lane", ["close for 1 min", { do: "close", lane, duration_s: 60 }], ["close for good", { do: "close", lane, duration_s: null }]);
    }
    if (!parts.length) return;
    const box = make("div", { id: "ask", className: "ask", role: "group", "aria-label": "What to do here", onkeydown: (e) => e.key === "Escape" && box.remove() }, ...parts);
    document.getElementById("stage").append(box);
    box.style.left = `${Math.max(4, Math.min(px + 12, box.parentElement.clientWidth - box.offsetWidth - 4))}px`;
    box.style.top = `${Math.max(4, Math.min(py + 12, box.parentElement.clientHeight - box.offsetHeight - 4))}px`;
  }

  /* The named station and the lane (-1: none) that lie within so many pixels of a place on the screen. */
  nearest(px, py, slack) {
    const { scene } = this.app, { stations = [], lanes = [] } = scene.map;
    let station = null, lane = -1, best = slack + 4;
    for (const one of stations) {
      const [x, y] = scene.toScreen(one.x, one.y), d = Math.hypot(x - px, y - py);
      if (one.name && d < best) (best = d), (station = one);
    }
    best = slack;
    for (let i = 0; i < lanes.length; i += 5) {
      const [ax, ay] = scene.toScreen(lanes[i], lanes[i + 1]), [bx, by] = scene.toScreen(lanes[i + 2], lanes[i + 3]);
      const long = (bx - ax) ** 2 + (by - ay) ** 2, share = long ? Math.max(0, Math.min(1, ((px - ax) * (bx - ax) + (py - ay) * (by - ay)) / long)) : 0;
      const d = Math.hypot(px - ax - share * (bx - ax), py - ay - share * (by - ay));
      if (d < best) (best = d), (lane = i / 5);
    }
    return { station, lane };
  }

  async ask(what) {
    const box = document.getElementById("ask");
    const answer = await fetch("control", { method: "POST", body: JSON.stringify(what) }).catch(() => null);
    if (answer?.ok) box?.remove();
    else box?.replaceChildren(make("b", { textContent: answer ? await answer.text() : "the run does not answer" }));
  }

  /* The time to show, a moment behind the newest sample so that robots glide rather than jump. */
  advance(t, passed) {
    const { motion, view } = this.app, head = motion.end;
    if (this.over) return Math.min(head, t + passed * (Number.isFinite(view.speed) ? view.speed : 1e9));
    if (this.paused) return Math.min(head, t + Math.max(passed, head - t) * 0.5 + 1e-3);
    const lag = Math.max(2 * motion.period, Math.min(view.speed, 1000) * 0.15);
    if (t < head - 6 * lag) return head - lag; // far behind: catch up at once
    return Math.min(head, Math.max(t, t + passed * Math.min(view.speed, 1000) * (1 + 0.5 * Math.max(-1, Math.min(1, (head - lag - t) / lag)))));
  }

  /* Whether it is time to draw again what shows the whole run. */
  isDue(now) {
    if (now - this.drawn < REDRAW_MS) return false;
    this.drawn = now;
    return true;
  }

  /* Why a robot stands that waits for no robot, '' where there is nothing to say. */
  reasonAt(robot, t) {
    return REASONS[this.app.motion.waitsAt(robot, t)] || "";
  }

  otherAt(robot, t) {
    const other = this.app.motion.waitsAt(robot, t);
    return other >= 0 ? other : NEVER;
  }
}

window.liveOf = (app) => new Live(app);
