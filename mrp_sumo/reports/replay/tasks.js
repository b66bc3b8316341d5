/* The tab of tasks: how many are done and open over time, what stations do now, and every task; one that is chosen shows its way. */
import { clockText, cssColor, make, spanText } from "./elements.js";
import { Rows } from "./rows.js";

const STATES = ["not yet", "revealed", "assigned", "open", "done"];
const COLORS = ["--absent", "--blocked", "--waiting", "--moving", "--goal"];

/* 0 to 4 of STATES. */
function stateAt(times, t) {
  let state = 0;
  for (let k = 0; k < 4; k++) if (times[k] !== null && times[k] <= t) state = k + 1;
  return state;
}

export function showTasks(panel) {
  const { app } = panel, { run, motion, view } = app, { tasks } = run;
  const chart = make("canvas", { className: "strip tall", title: "Orders done (bars) and open (line) over time; click to go there" }), head = make("i"), facts = make("div");
  chart.addEventListener("click", (e) => app.seek((e.offsetX / chart.clientWidth) * motion.end));
  const stations = tasks.stations.map(([name]) => make("div", { className: "row still" },
    make("span", { className: "what", textContent: name }), make("span", { className: "end" })));
  const list = new Rows((k) => make("button", { className: "row", onclick: () => app.showTask(k) },
    make("span", { className: "time", textContent: clockText(tasks.times[k][0], 0) }), make("span", { className: "dot" }),
    make("span", { className: "what" }, make("b", { textContent: tasks.name[k] }), tasks.robot[k] >= 0 ? ` ${run.robots[tasks.robot[k]]}` : ""),
    make("span", { className: "end" })),
  (row, k) => {
    const times = tasks.times[k], state = stateAt(times, view.t);
    row.children[1].style.setProperty("--dot", `var(${COLORS[state]})`);
    row.children[3].textContent = state === 4 ? spanText(times[3] - times[0]) : STATES[state];
    row.classList.toggle("now", k === view.task);
    row.classList.toggle("past", state === 0);
  });
  panel.body.replaceChildren(
    make("section", { className: "pad" }, make("div", { className: "strip-wrap" }, chart, head), make("p", { className: "caption", textContent: "bars: done, line: known and not done" })), make("section", { className: "pad" }, facts),
    ...(stations.length ? [make("section", { className: "stations" }, ...stations)] : []), list.element);
  list.set([...tasks.name.keys()]);
  panel.lists = [list];
  drawChart(chart, tasks, motion.end);
  if (view.task >= 0) list.reveal(view.task);
  panel.update = () => {
    head.style.left = `${motion.end ? (100 * view.t) / motion.end : 0}%`;
    const count = [0, 0, 0, 0, 0];
    for (const times of tasks.times) count[stateAt(times, view.t)]++;
    facts.replaceChildren(panel.facts([["Done", `${count[4]}`], ["Under way", `${count[2] + count[3]}`], ["Without a robot", `${count[1]}`]]));
    tasks.stations.forEach(([, stops], i) => {
      let served = 0, waiting = 0;
      for (const [waits, begin, end] of stops) {
        if (begin <= view.t && view.t < end) served++;
        else if (waits <= view.t && view.t < begin) waiting++;
      }
      stations[i].lastChild.textContent = `${served} served, ${waiting} waiting`;
      stations[i].classList.toggle("past", !served && !waiting);
    });
    list.draw();
  };
}

/* Bars: tasks done in each of 60 parts of the run. Line: tasks known and not done. */
function drawChart(canvas, tasks, end) {
  const width = Math.max(100, Math.round((canvas.clientWidth || 300) * 2)), height = 120, parts = 60;
  canvas.width = width;
  canvas.height = height;
  const c = canvas.getContext("2d"), done = new Array(parts).fill(0), part = (t) => Math.min(parts - 1, Math.floor((t / (end || 1)) * parts));
  const changes = [];
  for (const [released, , , over] of tasks.times) {
    if (released !== null) changes.push([released, 1]);
    if (over === null) continue;
    done[part(over)]++;
    changes.push([over, -1]);
  }
  changes.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  let open = 0, most = 1;
  for (const change of changes) most = Math.max(most, (open += change[1]));
  const tallest = Math.max(1, ...done);
  c.fillStyle = cssColor("--goal");
  done.forEach((n, k) => n && c.fillRect((k * width) / parts + 1, height - (n / tallest) * (height - 8), width / parts - 2, height));
  c.strokeStyle = cssColor("--ink");
  c.lineWidth = 3;
  c.beginPath();
  let level = 0;
  c.moveTo(0, height - 2);
  for (const [t, by] of changes) {
    c.lineTo((t / (end || 1)) * width, height - 2 - (level / most) * (height - 10));
    level += by;
    c.lineTo((t / (end || 1)) * width, height - 2 - (level / most) * (height - 10));
  }
  c.lineTo(width, height - 2 - (level / most) * (height - 10));
  c.stroke();
}
