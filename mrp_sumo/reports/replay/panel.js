/* The side panel: the run, its robots, its tasks, its events, one robot. */
import { BLOCKED, NEVER, WAITING } from "./constants.js";
import { STATE_VARIABLES, clockText, cssColor, icon, kindColor, make, spanText } from "./elements.js";
import { Rows } from "./rows.js";
import { showAisles } from "./spacetime.js";
import { showTasks } from "./tasks.js";

export class Panel {
  constructor(app) {
    this.app = app;
    this.body = document.getElementById("body");
    this.tab = "run";
    this.totals = app.motion.totals();
    this.kindsOff = new Set(app.events.kinds.filter((k) => k === "started" || k === "waited").filter(() => app.events.kinds.length > 2));
    this.robotFilter = "";
    this.robotSort = "name";
    this.part = "plan";
    for (const button of document.querySelectorAll(".tabs button")) {
      button.addEventListener("click", () => {
        if (button.dataset.tab === "robots" && this.tab === "robots" && app.view.selected >= 0) app.select(-1);
        this.open(button.dataset.tab);
      });
    }
    new ResizeObserver(() => this.lists.forEach((list) => list.draw())).observe(this.body);
    document.querySelector('.tabs [data-tab="tasks"]').hidden = !app.run.tasks;
    this.lists = [];
  }

  open(tab) {
    this.tab = tab;
    this.app.touch(); // an aisle is shown on the floor with its tab
    for (const button of document.querySelectorAll(".tabs button")) button.setAttribute("aria-selected", String(button.dataset.tab === tab));
    this.lists = [];
    this.update = () => {};
    this.redraw = null;
    if (tab === "run") this.showRun();
    else if (tab === "events") this.showEvents();
    else if (tab === "tasks") showTasks(this);
    else if (tab === "aisles") showAisles(this);
    else if (this.app.view.selected >= 0) this.showRobot(this.app.view.selected);
    else this.showRobots();
    this.lists.forEach((list) => list.draw());
    this.update(true);
  }

  /* Show what is new of a run under way, but not under a finger. */
  refresh() {
    this.totals = this.app.motion.totals();
    if (this.redraw) return this.redraw();
    if (this.body.matches(":active") || this.body.contains(document.activeElement)) return;
    const top = this.body.querySelector(".rows")?.scrollTop;
    this.open(this.tab);
    if (top !== undefined && this.body.querySelector(".rows")) this.body.querySelector(".rows").scrollTop = top;
  }

  facts(pairs) {
    return make("dl", { className: "facts" }, ...pairs.flatMap(([name, value]) => [make("dt", { textContent: name }), make("dd", { textContent: value })]));
  }

  showRun() {
    const { app } = this, { run, motion } = app;
    const parts = [make("section", { className: "pad" }, this.facts(run.facts))];
    if (run.remedy) parts.push(make("section", { className: "pad" }, make("p", { className: "note", textContent: `To change: ${run.remedy}.` })));
    if (run.note) parts.push(make("section", { className: "pad" }, make("p", { className: "note", textContent: run.note })));
    const waited = (r) => this.totals[5 * r + WAITING] + this.totals[5 * r + BLOCKED];
    const worst = [...Array(motion.numRobots).keys()].sort((a, b) => waited(b) - waited(a)).slice(0, 8).filter((r) => waited(r) >= 0.5);
    if (worst.length) {
      const most = waited(worst[0]);
      parts.push(make("section", { className: "pad" }, make("h3", { textContent: "Waited longest" }), ...worst.map((r) =>
        make("button", { className: "rank", onclick: () => app.select(r, true) },
          make("span", { className: "who", textContent: run.robots[r] }), make("i", { style: { width: `${(100 * waited(r)) / most}%` } }), make("span", { textContent: spanText(waited(r)) })))));
    }
    if (run.metrics.length) parts.push(make("section", { className: "pad" }, make("h3", { textContent: "Metrics" }), this.facts(run.metrics)));
    this.body.replaceChildren(...parts);
  }

  showRobots() {
    const { app } = this, { run, motion } = app;
    const list = new Rows((r) => make("button", { className: "row", onclick: () => app.select(r, true) },
      make("span", { className: "dot" }), make("span", { className: "what", textContent: run.robots[r] }),
      make("span", { className: "end", textContent: `waited ${spanText(this.totals[5 * r + WAITING] + this.totals[5 * r + BLOCKED])}` })),
    (row, r) => row.firstChild.style.setProperty("--dot", `var(${STATE_VARIABLES[motion.now[r]]})`));
    const fill = () => {
      const wanted = this.robotFilter.toLowerCase();
      const robots = [...Array(motion.numRobots).keys()].filter((r) => run.robots[r].toLowerCase().includes(wanted));
      const waited = (r) => this.totals[5 * r + WAITING] + this.totals[5 * r + BLOCKED];
      if (this.robotSort === "waiting") robots.sort((a, b) => waited(b) - waited(a));
      if (this.robotSort === "state") robots.sort((a, b) => ((motion.now[b] + 1) % 4) - ((motion.now[a] + 1) % 4));
      list.set(robots);
    };
    const sorts = ["name", "waiting", "state"].map((sort) => make("button", {
      textContent: { name: "in order", waiting: "waited longest", state: "blocked first" }[sort], "aria-pressed": String(sort === this.robotSort), style: { "--dot": "var(--accent)" },
      onclick: () => { this.robotSort = sort; this.open("robots"); },
    }));
    this.body.replaceChildren(make("div", { className: "filter" },
      make("input", { type: "search", placeholder: `Filter ${motion.numRobots} robots`, value: this.robotFilter, "aria-label": "Filter robots", oninput: (e) => { this.robotFilter = e.target.value; fill(); } }), ...sorts), list.element);
    this.lists = [list];
    fill();
    this.update = () => list.draw();
  }

  eventRow(i) {
    const { app } = this, { run, events } = app;
    const what = make("span", { className: "what" }, make("b", { textContent: events.robot[i] !== NEVER ? run.robots[events.robot[i]] : "run" }), ` ${this.eventText(i)}`);
    return make("button", { className: "row", title: what.textContent, onclick: () => app.showEvent(i) },
      make("span", { className: "time", textContent: clockText(events.seconds(i)) }),
      make("span", { className: "dot", style: { "--dot": `var(${kindColor(events.kinds[events.kind[i]])})` } }), what,
      events.duration[i] ? make("span", { className: "end", textContent: events.duration[i] === NEVER - 1 ? "for good" : spanText(events.duration[i] / 1000) }) : null);
  }

  /* What happened, without the robot. */
  eventText(i) {
    const { run, events } = this.app, kind = events.kinds[events.kind[i]];
    const words = [{ goal: "reached its goal", blocked: "is blocked", blocked_for_good: "is blocked for good", waited: "waits", yielded: "yields", deadlock: "is in a deadlock", started: "sets off", disturbance: "is disturbed" }[kind] || kind];
    if (events.other[i] !== NEVER) words.push(kind === "yielded" ? "to" : kind === "deadlock" ? "with" : kind.startsWith("blocked") ? "by" : "for", run.robots[events.other[i]]);
    if (events.vertex[i] !== NEVER && run.vertices[events.vertex[i]]) words.push("at", run.vertices[events.vertex[i]]);
    if (events.text[i]) words.push(`(${events.text[i]})`);
    return words.join(" ");
  }

  eventList(indices) {
    const { app } = this, { events } = app;
    let current = -1;
    const list = new Rows((i) => this.eventRow(i), (row, i, k) => row.classList.toggle("now", k === current));
    list.set(indices);
    this.lists.push(list);
    return { element: list.element, follow: (force) => {
      let low = 0, high = indices.length;
      while (low < high) {
        const middle = (low + high) >> 1;
        if (events.t[indices[middle]] <= app.view.t * 1000 + 0.5) low = middle + 1;
        else high = middle;
      }
      if (low - 1 === current && !force) return;
      current = low - 1;
      list.reveal(Math.max(0, current));
      list.draw();
    } };
  }

  showEvents() {
    const { events } = this.app;
    if (!events.count) {
      this.body.replaceChildren(make("p", { className: "empty", textContent: "No events in this run." }));
      return;
    }
    const chips = events.kinds.map((kind, k) => events.perKind[k] ? make("button", {
      "aria-pressed": String(!this.kindsOff.has(kind)), style: { "--dot": `var(${kindColor(kind)})` },
      onclick: () => { this.kindsOff.has(kind) ? this.kindsOff.delete(kind) : this.kindsOff.add(kind); this.open("events"); },
    }, make("span", { className: "dot" }), `${kind} ${events.perKind[k]}`) : null);
    const indices = [];
    for (let i = 0; i < events.count; i++) if (!this.kindsOff.has(events.kinds[events.kind[i]])) indices.push(i);
    const list = this.eventList(indices);
    this.body.replaceChildren(make("div", { className: "filter" }, ...chips.filter(Boolean)), indices.length ? list.element : make("p", { className: "empty", textContent: "No event of these kinds." }));
    this.update = list.follow;
  }

  showRobot(r) {
    const { app } = this, { run, motion: m, events, view } = app;
    const chip = make("span", { className: "chip" }), facts = make("div"), chain = make("div", { className: "chain" });
    const strip = make("canvas", { className: "strip", title: "What it did when; click to go there" }), head = make("i");
    strip.addEventListener("click", (e) => app.seek((e.offsetX / strip.clientWidth) * m.end));
    const own = events.ofRobot.get(r) || [];
    const hasPlan = m.hasPlan && m.first[r + 1] > m.first[r];
    let follow = () => {}, content;
    if (this.part === "plan" && hasPlan) {
      let current = -1;
      const list = new Rows((k) => {
        const arrived = m.visit.arrived[k];
        return make("button", { className: "row", onclick: () => app.seek(Math.min(m.end, (arrived === NEVER ? m.visit.arrive[k] : arrived) / 1000)) },
          make("span", { className: "time", textContent: clockText(m.visit.arrive[k] / 1000) }),
          make("span", { className: "what", textContent: run.vertices[m.visit.vertex[k]] }),
          make("span", { className: "end", textContent: m.isPlanOnly ? "" : arrived === NEVER ? "–" : clockText(arrived / 1000) }));
      }, (row, k) => {
        row.classList.toggle("now", k === current);
        row.classList.toggle("past", k < current);
      });
      list.set(Array.from({ length: m.first[r + 1] - m.first[r] }, (_, i) => m.first[r] + i));
      this.lists.push(list);
      content = [make("div", { className: "row", style: { position: "static", cursor: "default", height: "22px", color: "var(--faint)", "font-size": "11.5px", flex: "none" } },
        make("span", { className: "time", textContent: "planned" }), make("span", { className: "what", textContent: "vertex" }), make("span", { className: "end", textContent: m.isPlanOnly ? "" : "arrived" })), list.element];
      follow = (force) => {
        const k = m.visitAt(r, view.t);
        if (k === current && !force) return;
        current = k;
        list.reveal(k - m.first[r]);
        list.draw();
      };
    } else if (own.length) {
      const list = this.eventList(own);
      content = [list.element];
      follow = list.follow;
    } else content = [make("p", { className: "empty", textContent: "Nothing happened to this robot." })];
    const parts = ["plan", "events"].map((part) => make("button", { textContent: part === "plan" ? "Plan" : `Events ${own.length}`, disabled: part === "plan" && !hasPlan,
      "aria-pressed": String(part === (hasPlan ? this.part : "events")), onclick: () => { this.part = part; this.open("robots"); } }));
    this.body.replaceChildren(
      make("div", { className: "robot-head" }, make("button", { className: "tool", title: "All robots (Esc)", "aria-label": "All robots", onclick: () => app.select(-1) }, icon("i-back")), make("h2", { textContent: run.robots[r], title: run.robots[r] }), chip),
      make("section", { className: "pad", style: { "padding-top": "0" } }, make("div", { className: "strip-wrap" }, strip, head)),
      make("section", { className: "pad" }, chain), make("section", { className: "pad" }, facts),
      make("div", { className: "switch" }, ...parts), ...content);
    this.redraw = () => this.drawStrip(strip, r);
    this.redraw();
    this.update = (force) => {
      const state = m.now[r];
      chip.textContent = run.state_names[state];
      chip.style.setProperty("--chip", `var(${STATE_VARIABLES[state]})`);
      head.style.left = `${m.end ? (100 * view.t) / m.end : 0}%`;
      const pairs = [["Speed", `${m.speedAt(r, view.t).toFixed(2)} m/s`]];
      if (run.target.length && run.target[r] >= 0) pairs.push(["Goal", run.vertices[run.target[r]] + (run.goal_s[r] === null ? " (not reached)" : ` at ${clockText(run.goal_s[r])}`)]);
      if (hasPlan && !m.isPlanOnly) {
        const late = m.latenessAt(r, view.t);
        if (late !== null) pairs.push([late < 0 ? "Ahead of plan" : "Behind plan", spanText(Math.abs(late))]);
        pairs.push(["Off its planned place", `${Math.hypot(m.pose[3 * r] - m.ghost[3 * r], m.pose[3 * r + 1] - m.ghost[3 * r + 1]).toFixed(2)} m`]);
      }
      pairs.push(["Waited in all", spanText(this.totals[5 * r + WAITING] + this.totals[5 * r + BLOCKED])]);
      facts.replaceChildren(this.facts(pairs));
      this.showChain(chain, r);
      follow(force);
    };
  }

  /* Whom it waits for, whom that one waits for, and so on. */
  showChain(chain, r) {
    const { app } = this, { run, events, view, motion } = app;
    const links = [], seen = new Set([r]);
    for (let at = events.waitsFor(r, view.t); at !== NEVER; at = events.waitsFor(at, view.t)) {
      links.push(at);
      if (seen.has(at) || links.length > 8) break;
      seen.add(at);
    }
    const reason = links.length || !app.live ? "" : app.live.reasonAt(r, view.t), key = links.map((l) => `${l}:${motion.now[l]}`).join() + reason;
    if (chain.dataset.key === key) return;
    chain.dataset.key = key;
    chain.parentElement.hidden = !links.length && !reason;
    if (reason) return chain.replaceChildren(`Waits ${reason}`);
    chain.replaceChildren("Waits for", ...links.flatMap((l, i) => [
      i ? "← which waits for" : null,
      make("button", { className: "link", onclick: () => app.select(l, true) }, make("span", { className: "dot", style: { "--dot": `var(${STATE_VARIABLES[motion.now[l]]})` } }), run.robots[l]),
    ]).filter(Boolean), links.length > 1 && links[links.length - 1] === r ? "(a circle)" : "");
  }

  drawStrip(strip, r) {
    const { motion: m } = this.app, T = m.numSamples;
    const width = Math.max(100, Math.round((strip.clientWidth || 300) * 2));
    strip.width = width;
    strip.height = 52;
    const c = strip.getContext("2d"), colors = STATE_VARIABLES.map(cssColor);
    for (let px = 0; px < width; px++) {
      c.fillStyle = colors[m.state[r * m.stride + Math.min(T - 1, Math.round((px / width) * (T - 1)))]];
      c.fillRect(px, 0, 1, 52);
    }
  }
}
