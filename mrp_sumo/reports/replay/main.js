/* The page: what the user does, and the loop that shows it. */
import { AT_GOAL, BLOCKED, MOVING, NEVER, WAITING } from "./constants.js";
import { aisleAt } from "./aisles.js";
import { CanvasPainter } from "./canvas.js";
import { bytesOfBase64, inflate, readRun } from "./data.js";
import { STATE_VARIABLES, clockText, make, spanText } from "./elements.js";
import { Events, Motion } from "./motion.js";
import { GlPainter } from "./gl.js";
import { Panel } from "./panel.js";
import { Scene } from "./scene.js";
import { Timeline } from "./timeline.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16, 32];
const $ = (id) => document.getElementById(id);

class App {
  constructor(run) {
    this.run = run;
    this.motion = new Motion(run);
    this.events = new Events(run);
    this.scene = new Scene(run, this.motion, this.events);
    const few = this.motion.numRobots <= 60;
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.view = { t: 0, playing: false, speed: SPEEDS.find((s) => s >= 1 && this.motion.end / s <= 90) || 16, selected: -1, task: -1, aisle: null, apart: [], hovered: -1, only: -1, trails: true, ghosts: few && this.motion.hasPlan, heat: "", labels: true, follow: false, level: "", found: null, still };
    this.live = this.events.live = run.live ? window.liveOf(this) : null;
    this.speeds = run.live ? this.live.speeds : SPEEDS;
    if (run.live) Object.assign(this.view, { playing: true, speed: 1 });
    this.clock = 0;
    this.dirty = true;
    this.frames = 0;
  }

  async start(painter) {
    await this.scene.start(painter, $("floor"), $("names"), $("stage"));
    this.timeline = new Timeline($("track"), $("track-canvas"), this.motion, this.events);
    this.writeHeader();
    this.panel = new Panel(this);
    this.setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    this.readAddress();
    this.motion.seek(this.view.t);
    if (this.motion.hasPlan) this.motion.seekPlan(this.view.t);
    this.panel.open(this.view.selected >= 0 ? "robots" : "run");
    this.listen();
    if (this.isPhone() && this.run.map.levels.length) this.showLevel(this.busiestLevel()); // all of them would be small
    this.showToggles();
    if (this.live) {
      this.live.connect();
      this.showLive();
    }
    const frame = (now) => {
      this.frame(now);
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  writeHeader() {
    const { run, motion } = this;
    document.title = `${run.name} – replay`;
    $("title").textContent = run.name;
    $("subtitle").textContent = run.subtitle;
    $("status").textContent = run.status_text;
    $("status").style.setProperty("--chip", run.is_good ? "var(--goal)" : "var(--blocked)");
    $("status").title = run.remedy ? `To change: ${run.remedy}` : "";
    $("legend").replaceChildren(...[MOVING, WAITING, BLOCKED, AT_GOAL].map((state) => {
      const count = make("b"), button = make("button", { "aria-pressed": "false", style: { "--dot": `var(${STATE_VARIABLES[state]})` }, title: `Only robots that are ${run.state_names[state]}`,
        onclick: () => { this.view.only = this.view.only === state ? -1 : state; this.showToggles(); this.touch(); } }, count,
        make("span", { style: { display: "flex", gap: "6px", "align-items": "center", order: "-1" } }, make("span", { className: "dot" }), run.state_names[state]));
      button.count = count;
      button.dataset.state = state;
      return button;
    }));
    if (motion.people) {
      this.peopleCount = make("b");
      $("legend").append(make("span", { className: "people", title: "People who are there now" }, make("span", { className: "dot" }), "people", this.peopleCount));
    }
    $("levels").hidden = !run.map.levels.length;
    $("levels").replaceChildren(...[undefined, ...run.map.levels].map((level) => make("button", { textContent: level ? level.name : "all levels", value: level ? level.name : "", onclick: () => this.showLevel(level) })));
    $("speed").replaceChildren(...this.speeds.map((s) => make("option", { value: String(s), textContent: s === Infinity ? "fast" : `${s}×`, selected: s === this.view.speed })));
    $("track").setAttribute("aria-valuemax", motion.end.toFixed(1));
  }

  /* ---- a run under way ---- */

  restart() {
    this.motion.received = 0;
    this.events.listed = [];
    if (this.run.tasks) Object.assign(this.run.tasks, { name: [], robot: [], times: [], stations: [] });
  }

  /* What the server has said of its clock. */
  showLive() {
    const { live, view } = this;
    if (live.following && !live.over) this.showPlaying(!live.paused);
    $("speed").value = String(view.speed);
    $("live").hidden = $("step").hidden = live.over;
    $("live").setAttribute("aria-pressed", String(live.following));
    $("step").disabled = !(live.following && live.paused);
    this.touch();
  }

  showEnd() {
    const { live, view } = this;
    if (!Number.isFinite(view.speed)) view.speed = 8;
    this.speeds = SPEEDS;
    this.play(view.playing && view.t < this.motion.end - 0.1);
    this.writeHeader();
    this.showLive();
    this.refresh();
    live.following = false;
  }

  refresh() {
    this.timeline.refresh();
    this.timeline.draw();
    this.panel.refresh();
    $("track").setAttribute("aria-valuemax", this.motion.end.toFixed(1));
  }

  /* ---- the loop ---- */

  touch() {
    this.dirty = true;
  }

  frame(now) {
    const { view, motion } = this, passed = Math.min(100, now - (this.last || now));
    this.last = now;
    const { live } = this;
    if (live && !live.over && live.isDue(now)) this.refresh();
    if (live && live.following && !live.over) {
      if (!live.paused) this.clock += passed;
      view.t = live.advance(view.t, passed / 1000);
      this.dirty = true;
    } else if (view.playing) {
      this.clock += passed;
      view.t = Math.min(motion.end, view.t + (passed / 1000) * view.speed);
      if (view.t >= motion.end) live && !live.over ? this.seek(motion.end) : this.play(false);
      this.dirty = true;
    }
    if (!this.dirty) return;
    this.dirty = false;
    if (view.follow && view.selected >= 0) {
      motion.seek(view.t);
      this.scene.centreOn(motion.pose[3 * view.selected], motion.pose[3 * view.selected + 1]);
    }
    view.showsAisle = this.panel.tab === "aisles";
    this.scene.draw(view, this.clock);
    this.frames++;
    this.timeline.showTime($("head"), view.t);
    if (!view.playing || now - (this.updated || 0) > 100) {
      this.updated = now;
      this.updateTexts();
    }
  }

  /* What need not change sixty times a second. */
  updateTexts() {
    const { view, motion } = this;
    $("clock").replaceChildren(clockText(view.t), make("small", { textContent: ` / ${clockText(motion.end)}` }));
    $("track").setAttribute("aria-valuenow", view.t.toFixed(1));
    $("track").setAttribute("aria-valuetext", clockText(view.t));
    const count = [0, 0, 0, 0, 0];
    for (const state of motion.now) count[state]++;
    for (const button of $("legend").querySelectorAll("button")) button.count.textContent = count[button.dataset.state];
    if (motion.people) this.peopleCount.textContent = motion.people.at.length / 2;
    this.panel.update(false);
  }

  /* ---- what the user can do ---- */

  play(on) {
    const { view, motion, live } = this;
    if (live && live.following && !live.over) {
      live.paused = !on;
      live.order({ do: on ? "play" : "pause" });
      return this.showLive();
    }
    if (on && view.t >= motion.end) view.t = 0;
    this.showPlaying(on);
    if (!on) this.writeAddress();
    this.touch();
  }

  showPlaying(on) {
    this.view.playing = on;
    $("play-icon").setAttribute("href", on ? "#i-pause" : "#i-play");
    $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  }

  seek(t) {
    const { live, motion } = this;
    this.view.t = Math.max(0, Math.min(motion.end, t));
    if (live && !live.over) {
      live.following = t >= motion.end - 1.5 * motion.period;
      this.showLive();
    }
    this.writeAddress();
    this.touch();
  }

  select(robot, show = false) {
    const { view, scene, motion } = this;
    view.selected = robot;
    if (view.task >= 0 && this.run.tasks.robot[view.task] !== robot) view.task = -1;
    view.found = null;
    if (robot < 0) view.follow = false;
    this.showToggles();
    if (this.panel.tab === "aisles") this.panel.open("aisles");
    else if (robot >= 0 || this.panel.tab === "robots") this.panel.open("robots");
    if (this.isPhone()) this.openSheet(robot >= 0);
    if (robot >= 0 && show) {
      const [x, y] = scene.toScreen(motion.pose[3 * robot], motion.pose[3 * robot + 1]);
      if (x < 40 || y < 60 || x > scene.width - 60 || y > scene.height - scene.inset - 30) this.bring(motion.pose[3 * robot], motion.pose[3 * robot + 1]);
    }
    this.writeAddress();
    this.touch();
  }

  /* The floor as it is shown, with the run's name and the time, as a PNG. */
  savePicture() {
    const { scene, view, run } = this, { ratio } = scene.painter, picture = document.createElement("canvas");
    scene.draw(view, this.clock); // what WebGL drew is there until the browser shows it
    picture.width = scene.overlay.width;
    picture.height = scene.overlay.height;
    const c = picture.getContext("2d");
    c.drawImage(scene.canvas, 0, 0, picture.width, picture.height);
    c.drawImage(scene.overlay, 0, 0);
    c.scale(ratio, ratio);
    c.fillStyle = scene.theme.ink;
    c.textBaseline = "top";
    c.font = "650 17px system-ui, sans-serif";
    c.fillText(run.name, 16, 14);
    c.fillStyle = scene.theme.muted;
    c.font = "500 13px system-ui, sans-serif";
    c.fillText(`${run.subtitle} · ${clockText(view.t)}`, 16, 38);
    picture.toBlob((blob) => {
      const link = make("a", { href: URL.createObjectURL(blob), download: `${run.name.replace(/[^\w.-]+/g, "_")}_${view.t.toFixed(1)}s.png` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    }, "image/png");
  }

  /* The level of the selected robot, else the one on which most robots are. */
  busiestLevel() {
    const { motion, view } = this, { levels } = this.run.map, count = levels.map(() => 0);
    for (let r = 0; r < motion.numRobots; r++) {
      if (view.selected >= 0 && r !== view.selected) continue;
      const x = motion.pose[3 * r], y = motion.pose[3 * r + 1];
      const at = levels.findIndex((l) => x >= l.x - 1 && x <= l.x + l.width + 1 && y <= l.y + 1 && y >= l.y - l.height - 1);
      if (at >= 0) count[at]++;
    }
    return levels[count.indexOf(Math.max(...count))];
  }

  /* A level alone; all of them without one. */
  showLevel(level) {
    Object.assign(this.view, { follow: false, level: level ? level.name : "" });
    this.scene.fit(level);
    this.showToggles();
    this.touch();
  }

  bring(x, y, scale) {
    this.scene.centreOn(x, y, scale);
    this.touch();
  }

  showEvent(i) {
    const { events, motion } = this;
    this.play(false);
    this.seek(events.seconds(i));
    motion.seek(this.view.t);
    if (events.robot[i] === NEVER) return;
    const tab = this.panel.tab;
    this.select(events.robot[i], true);
    if (tab === "events") this.panel.open("events");
  }

  /* Go to where a task got its robot, and show the way of it. */
  showTask(k) {
    const { tasks } = this.run, [, assigned] = tasks.times[k];
    this.play(false);
    this.view.task = k;
    if (assigned === null) return this.panel.open("tasks");
    this.seek(assigned);
    this.motion.seek(this.view.t);
    this.select(tasks.robot[k], true);
    this.panel.open("tasks");
  }

  /* The aisle under a point of the screen is the one whose diagram is shown. */
  chooseAisle(px, py) {
    const { camera } = this.scene, aisle = aisleAt(this.aisles, (px - camera.x) / camera.scale, (camera.y - py) / camera.scale, 14 / camera.scale);
    if (!aisle) return false;
    this.view.aisle = aisle;
    this.panel.open("aisles");
    return true;
  }

  step(direction) {
    const { events, view, panel } = this;
    const own = view.selected;
    const i = events.nextAfter(view.t, direction, (e) => (own >= 0 ? events.robot[e] === own || events.other[e] === own : !panel.kindsOff.has(events.kinds[events.kind[e]])));
    if (i >= 0 && own >= 0) this.play(false), this.seek(events.seconds(i));
    else if (i >= 0) this.play(false), this.seek(events.seconds(i)), this.panel.open("events");
  }

  /* One sample on; at the head of a run under way, the run makes one. */
  next() {
    const { live, motion, view } = this;
    if (live && live.following && !live.over) {
      live.paused = true;
      live.order({ do: "step" });
      this.showLive();
    } else this.seek((motion.sampleAt(view.t) + 1) * motion.period);
  }

  setSpeed(speed) {
    this.view.speed = speed;
    $("speed").value = String(speed);
    this.live?.order({ do: "speed", speed: Number.isFinite(speed) ? speed : null });
  }

  setTheme(name) {
    this.theme = name;
    document.documentElement.dataset.theme = name;
    this.scene.setTheme(name);
    this.timeline.draw();
    if (this.panel && this.panel.update) this.panel.open(this.panel.tab);
    this.touch();
  }

  toggle(what) {
    const { view } = this;
    if (what === "follow" && view.selected < 0) return;
    if (what === "ghosts" && (!this.motion.hasPlan || this.motion.isPlanOnly)) return;
    if (what === "heat") {
      view.heat = { "": "waiting", waiting: "density", density: "" }[view.heat];
      this.scene.showHeat(view.heat);
      if (view.heat) $("heat-top").textContent = `up to ${spanText(this.scene.heat.raw)}`;
      $("heat-what").textContent = view.heat === "density" ? "driving" : "waiting";
      $("heat-key").hidden = !view.heat;
    } else view[what] = !view[what];
    this.showToggles();
    this.touch();
  }

  showToggles() {
    const { view } = this;
    for (const button of document.querySelectorAll("[data-toggle]")) button.setAttribute("aria-pressed", String(Boolean(view[button.dataset.toggle])));
    document.querySelector('[data-toggle="follow"]').disabled = view.selected < 0;
    document.querySelector('[data-toggle="ghosts"]').disabled = !this.motion.hasPlan || this.motion.isPlanOnly;
    for (const button of $("legend").querySelectorAll("button")) button.setAttribute("aria-pressed", String(view.only === Number(button.dataset.state)));
    for (const button of $("levels").children) button.setAttribute("aria-pressed", String(button.value === view.level));
  }

  isPhone() {
    return matchMedia("(max-width: 760px)").matches;
  }

  /* On a phone the details lie over the lower part of the floor: the rest moves up into what is left. */
  openSheet(open) {
    const { scene } = this, inset = open && this.isPhone() ? Math.max(0, $("stage").getBoundingClientRect().bottom - window.innerHeight * 0.44) : 0;
    scene.camera.y -= (inset - scene.inset) / 2;
    scene.inset = inset;
    this.touch();
    $("side").classList.toggle("open", open);
    $("sheet").setAttribute("aria-expanded", String(open));
    if (open) this.panel.open(this.panel.tab);
  }

  do(what) {
    const { scene, view } = this;
    if (what === "fit") this.showLevel();
    if (what === "zoom-in") scene.zoomAt(scene.width / 2, scene.height / 2, 1.5);
    if (what === "zoom-out") scene.zoomAt(scene.width / 2, scene.height / 2, 1 / 1.5);
    if (what === "start") this.seek(0);
    if (what === "previous") this.step(-1);
    if (what === "next") this.step(1);
    this.touch();
  }

  /* ---- the address: #t=12.3&robot=name brings a reader to the moment ---- */

  readAddress() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    const t = Number(wanted.get("t"));
    if (Number.isFinite(t)) this.view.t = Math.max(0, Math.min(this.motion.end, t));
    if (wanted.has("robot")) this.view.selected = this.robotOf(wanted.get("robot"));
    if (["light", "dark"].includes(wanted.get("theme"))) this.setTheme(wanted.get("theme"));
  }

  /* A robot by its name, or by the number that its name ends with: robot_3 is 3, too. */
  robotOf(name) {
    const { robots } = this.run, found = robots.indexOf(name);
    return found >= 0 || !/^\d+$/.test(name) ? found : robots.findIndex((other) => (other.match(/\d+$/) || [])[0] === name);
  }

  writeAddress() {
    const wanted = new URLSearchParams({ t: this.view.t.toFixed(1) });
    if (this.view.selected >= 0) wanted.set("robot", this.run.robots[this.view.selected]);
    clearTimeout(this.writing);
    this.writing = setTimeout(() => {
      try {
        history.replaceState(null, "", `#${wanted}`);
      } catch {
        // a frame without an address of its own: there is nothing to share
      }
    }, 250);
  }

  /* ---- listening ---- */

  listen() {
    $("play").addEventListener("click", () => this.play(!this.view.playing));
    $("speed").addEventListener("change", (e) => this.setSpeed(Number(e.target.value)));
    $("live").addEventListener("click", () => this.seek(this.motion.end));
    $("step").addEventListener("click", () => this.next());
    $("picture").addEventListener("click", () => this.savePicture());
    $("theme").addEventListener("click", () => this.setTheme(this.theme === "dark" ? "light" : "dark"));
    $("help").addEventListener("click", () => $("keys").showModal());
    $("sheet").addEventListener("click", () => this.openSheet(!$("side").classList.contains("open")));
    $("grip").addEventListener("click", () => this.openSheet(false));
    for (const button of document.querySelectorAll("[data-do]")) button.addEventListener("click", () => this.do(button.dataset.do));
    for (const button of document.querySelectorAll("[data-toggle]")) button.addEventListener("click", () => this.toggle(button.dataset.toggle));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (e) => this.setTheme(e.matches ? "dark" : "light"));
    window.addEventListener("hashchange", () => {
      this.readAddress();
      this.select(this.view.selected, true);
    });
    new ResizeObserver(() => {
      const { scene } = this, [w, h] = [scene.width, scene.height];
      scene.resize();
      if (!this.isPhone() && scene.inset) this.openSheet(false);
      scene.camera.x += (scene.width - w) / 2;
      scene.camera.y += (scene.height - h) / 2;
      if (scene.camera.scale * 4 === scene.minScale * 16) scene.fit(); // nobody has zoomed yet
      this.timeline.draw();
      this.touch();
    }).observe($("stage"));
    document.addEventListener("keydown", (e) => this.key(e));
    this.listenToFloor($("floor"));
    this.listenToTrack($("track"));
    this.listenToSearch($("search"), $("found"));
  }

  key(e) {
    const typing = e.target.matches("input, select") || $("keys").open;
    if (e.key === "Escape" && e.target.matches("input")) return e.target.blur();
    if (typing || e.ctrlKey || e.metaKey || e.altKey) return;
    const { view, motion } = this, jump = e.shiftKey ? 10 : 1, speed = this.speeds.indexOf(view.speed);
    const actions = {
      " ": () => this.play(!view.playing), k: () => this.play(!view.playing),
      ArrowLeft: () => this.seek(view.t - jump), ArrowRight: () => this.seek(view.t + jump),
      ",": () => this.seek((motion.sampleAt(view.t) - 1) * motion.period), ".": () => this.next(),
      "[": () => this.setSpeed(this.speeds[Math.max(0, speed - 1)]), "]": () => this.setSpeed(this.speeds[Math.min(this.speeds.length - 1, speed + 1)]),
      Home: () => this.seek(0), End: () => this.seek(motion.end), n: () => this.step(1), p: () => this.step(-1),
      "+": () => this.do("zoom-in"), "=": () => this.do("zoom-in"), "-": () => this.do("zoom-out"), f: () => this.do("fit"),
      t: () => this.toggle("trails"), g: () => this.toggle("ghosts"), h: () => this.toggle("heat"), l: () => this.toggle("labels"), c: () => this.toggle("follow"),
      a: () => this.panel.open("aisles"), d: () => $("theme").click(), e: () => this.savePicture(), "/": () => $("search").focus(), "?": () => $("keys").showModal(),
      Escape: () => { view.only = -1; this.select(-1); },
    };
    if (e.key === " " && e.target.closest("button")) return; // the button's own key
    const action = actions[e.key];
    if (!action) return;
    e.preventDefault();
    action();
  }

  listenToFloor(floor) {
    const { scene, view } = this, down = new Map();
    let moved = 0, spread = 0;
    const at = (e) => [e.offsetX, e.offsetY];
    const middle = () => {
      const points = [...down.values()];
      return [points.reduce((s, p) => s + p[0], 0) / points.length, points.reduce((s, p) => s + p[1], 0) / points.length];
    };
    const gap = () => {
      const [a, b] = [...down.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    floor.addEventListener("pointerdown", (e) => {
      floor.setPointerCapture(e.pointerId);
      down.set(e.pointerId, at(e));
      if (down.size === 1) moved = 0;
      if (down.size === 2) spread = gap();
    });
    floor.addEventListener("pointermove", (e) => {
      if (!down.has(e.pointerId)) {
        if (e.pointerType === "touch") return;
        const over = scene.pick(...at(e), 9);
        floor.classList.toggle("over", over >= 0);
        if (over !== view.hovered) (view.hovered = over), this.touch();
        return;
      }
      const before = middle();
      down.set(e.pointerId, at(e));
      const after = middle();
      moved += Math.hypot(after[0] - before[0], after[1] - before[1]);
      if (moved < 5 && down.size === 1) return;
      floor.classList.add("dragging");
      if (view.follow) this.toggle("follow");
      scene.camera.x += after[0] - before[0];
      scene.camera.y += after[1] - before[1];
      if (down.size === 2) {
        const wide = gap();
        scene.zoomAt(...after, wide / Math.max(1, spread));
        spread = wide;
        moved = 99;
      }
      this.touch();
    });
    const up = (e) => {
      if (!down.delete(e.pointerId)) return;
      floor.classList.remove("dragging");
      if (e.type !== "pointerup" || down.size || moved >= 5) return;
      const robot = scene.pick(...at(e), e.pointerType === "touch" ? 22 : 10);
      if (robot < 0 && this.panel.tab === "aisles" && this.chooseAisle(...at(e))) return;
      this.select(robot);
      this.live?.offer(at(e), robot, e.pointerType === "touch" ? 16 : 9);
    };
    floor.addEventListener("pointerup", up);
    floor.addEventListener("pointercancel", up);
    floor.addEventListener("pointerleave", () => {
      if (view.hovered >= 0) (view.hovered = -1), this.touch();
    });
    floor.addEventListener("wheel", (e) => {
      e.preventDefault();
      const pixels = e.deltaY * (e.deltaMode === 1 ? 18 : 1);
      scene.zoomAt(...at(e), Math.exp(-Math.max(-240, Math.min(240, pixels)) * (e.ctrlKey ? 0.008 : 0.0016)));
      this.touch();
    }, { passive: false });
    floor.addEventListener("dblclick", (e) => {
      scene.zoomAt(...at(e), 2);
      this.touch();
    });
  }

  listenToTrack(track) {
    const { timeline, view } = this, tip = $("tip");
    let dragging = false;
    const place = (e) => {
      const box = track.getBoundingClientRect();
      return [e.clientX - box.left, e.clientY - box.top];
    };
    const hint = (e) => {
      const [x, y] = place(e), i = dragging ? -1 : timeline.eventAt(x, y), t = i >= 0 ? this.events.seconds(i) : timeline.timeAt(x);
      const who = i >= 0 && this.events.robot[i] !== NEVER ? `${this.run.robots[this.events.robot[i]]} ` : "";
      tip.textContent = i >= 0 ? `${clockText(t)}  ${who}${this.panel.eventText(i)}` : clockText(t);
      tip.hidden = false;
      const half = tip.offsetWidth / 2, box = track.getBoundingClientRect();
      tip.style.left = `${Math.max(half - box.left + 6, Math.min(window.innerWidth - box.left - half - 6, x))}px`;
    };
    track.addEventListener("pointerdown", (e) => {
      const [x, y] = place(e), i = timeline.eventAt(x, y);
      if (i >= 0) return this.showEvent(i);
      dragging = true;
      track.setPointerCapture(e.pointerId);
      this.seek(timeline.timeAt(x));
    });
    track.addEventListener("pointermove", (e) => {
      if (dragging) this.seek(timeline.timeAt(place(e)[0]));
      hint(e);
    });
    for (const end of ["pointerup", "pointercancel"]) track.addEventListener(end, () => (dragging = false));
    track.addEventListener("pointerleave", () => (tip.hidden = true));
    void view;
  }

  listenToSearch(input, list) {
    const { run, scene, motion } = this;
    let results = [], at = 0;
    const close = () => {
      list.hidden = true;
      input.setAttribute("aria-expanded", "false");
    };
    const choose = (result) => {
      if (!result) return;
      input.value = "";
      close();
      input.blur();
      if (result.robot !== undefined) {
        this.select(result.robot, true);
        if (motion.numRobots > 60) this.bring(motion.pose[3 * result.robot], motion.pose[3 * result.robot + 1], Math.max(scene.camera.scale, 50));
      } else if (result.level) {
        this.showLevel(result.level);
      } else {
        this.view.found = result.station;
        this.bring(result.station.x, result.station.y, Math.max(scene.camera.scale, 30));
      }
    };
    const show = () => {
      const wanted = input.value.trim().toLowerCase();
      if (!wanted) return close();
      const ranked = (name) => (name.toLowerCase() === wanted ? 0 : name.toLowerCase().startsWith(wanted) ? 1 : 2);
      results = [];
      run.robots.forEach((name, robot) => name.toLowerCase().includes(wanted) && results.push({ name, robot }));
      run.map.stations.forEach((station) => station.name.toLowerCase().includes(wanted) && results.push({ name: station.name, station }));
      run.map.levels.forEach((level) => level.name.toLowerCase().includes(wanted) && results.push({ name: level.name, level }));
      results = results.sort((a, b) => ranked(a.name) - ranked(b.name)).slice(0, 12);
      at = Math.min(at, Math.max(0, results.length - 1));
      list.replaceChildren(...results.map((result, i) => make("div", { role: "option", "aria-selected": String(i === at), onpointerdown: (e) => { e.preventDefault(); choose(result); } },
        make("span", { className: "dot", style: { "--dot": `var(${result.robot !== undefined ? STATE_VARIABLES[motion.now[result.robot]] : "--other"})`, "border-radius": result.robot !== undefined ? "3px" : "50%" } }),
        make("span", { textContent: result.name }), make("small", { textContent: result.robot !== undefined ? run.state_names[motion.now[result.robot]] : result.level ? "level" : result.station.kind || "station" }))));
      if (!results.length) list.replaceChildren(make("p", { textContent: "Nothing of that name." }));
      list.hidden = false;
      input.setAttribute("aria-expanded", "true");
    };
    input.addEventListener("input", () => { at = 0; show(); });
    input.addEventListener("focus", show);
    input.addEventListener("blur", close);
    input.addEventListener("keydown", (e) => {
      if (e.key === "ArrowDown" || e.key === "ArrowUp") {
        e.preventDefault();
        at = (at + (e.key === "ArrowDown" ? 1 : -1) + Math.max(1, results.length)) % Math.max(1, results.length);
        show();
      }
      if (e.key === "Enter" && !list.hidden) choose(results[at]);
    });
  }
}

/* Whether WebGL 2 is there and drawn by more than the processor; `&draw=gl` and `&draw=canvas` in the address decide otherwise. */
function hasGraphicsCard() {
  const wanted = new URLSearchParams(location.hash.slice(1)).get("draw");
  if (wanted === "canvas") return false;
  const probe = document.createElement("canvas").getContext("webgl2"), told = probe?.getExtension("WEBGL_debug_renderer_info");
  const name = probe ? String(probe.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : probe.RENDERER)) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return Boolean(probe) && (wanted === "gl" || !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(name));
}

async function open() {
  const cover = $("cover");
  const began = performance.now();
  document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  try {
    if (typeof DecompressionStream === "undefined") throw new Error("This browser cannot inflate the data: it needs one of 2023 or later.");
    const withCard = hasGraphicsCard();
    if (withCard) document.head.append(make("script", { textContent: new TextDecoder().decode(await inflate(bytesOfBase64($("library").textContent))) }));
    $("library").remove();
    const app = new App(await readRun());
    window.replay = app;
    await app.start(withCard ? new GlPainter() : new CanvasPainter());
    cover.remove();
    app.loaded_ms = performance.now() - began;
    document.documentElement.dataset.ready = "yes";
  } catch (error) {
    cover.classList.add("failed");
    cover.querySelector("b").textContent = "This replay cannot be shown";
    $("cover-text").textContent = error.message;
    document.documentElement.dataset.ready = "failed";
  }
}
open();
