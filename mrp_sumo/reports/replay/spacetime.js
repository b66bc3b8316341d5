/* The tab of aisles: who was where in one of them and when, robots as lines over time, which go downwards. */
import { ABSENT, AT_GOAL, BLOCKED, MOVING, WAITING } from "./constants.js";
import { aislesOf } from "./aisles.js";
import { STATE_VARIABLES, clockText, cssColor, make, spanText } from "./elements.js";

const SPANS = [[30, "30 s"], [120, "2 min"], [600, "10 min"], [Infinity, "all"]];
const OFFERED = 12; // aisles by name
const MOST_SAMPLES = 6e6; // robots times samples that are looked at for one picture
const SLACK_PX = 9;
const GUTTER = 40; // pixels for times

export function showAisles(panel) {
  const { app } = panel, { run, motion, view } = app;
  app.aisles ??= aislesOf(run.map);
  const offered = app.aisles.slice(0, OFFERED);
  if (!offered.length) return panel.body.replaceChildren(make("p", { className: "empty", textContent: "This map has no lanes." }));
  view.aisle ??= offered[0];
  panel.span ??= motion.end <= 150 ? Infinity : 120;
  const chosen = offered.includes(view.aisle) ? offered : [view.aisle, ...offered];
  const choice = make("select", { "aria-label": "Aisle", onchange: (e) => { view.aisle = chosen[Number(e.target.value)]; app.touch(); panel.open("aisles"); } },
    ...chosen.map((aisle, i) => make("option", { value: String(i), textContent: nameOf(aisle, run.map), selected: aisle === view.aisle })));
  const spans = make("div", { className: "switch" }, ...SPANS.filter(([s]) => s === Infinity || s < motion.end).map(([s, text]) =>
    make("button", { textContent: text, "aria-pressed": String(s === panel.span), onclick: () => { panel.span = s; panel.open("aisles"); } })));
  const canvas = make("canvas", { className: "spacetime", title: "Along the aisle from left to right, time downwards. Click to go there" });
  const head = make("i"), tip = make("div", { className: "tip", hidden: true }), words = make("p", { className: "caption", "aria-live": "polite" }), waits = make("div");
  const wrap = make("div", { className: "spacetime-wrap" }, canvas, head, tip);
  panel.body.replaceChildren(make("section", { className: "pad aisle" }, choice, make("p", { className: "caption", textContent: "or click a lane on the floor" })), spans, wrap,
    make("section", { className: "pad" }, words, waits));
  let drawn = null, picture = null;
  const place = (e) => {
    const box = canvas.getBoundingClientRect();
    return [e.clientX - box.left, e.clientY - box.top];
  };
  canvas.addEventListener("click", (e) => {
    const [x, y] = place(e), robot = picture.robotAt(x, y);
    app.play(false);
    app.seek(picture.timeAt(y));
    if (robot >= 0) app.select(robot, true), panel.open("aisles");
  });
  canvas.addEventListener("pointermove", (e) => {
    const [x, y] = place(e), robot = picture.robotAt(x, y);
    tip.textContent = `${clockText(picture.timeAt(y))}${robot >= 0 ? `  ${run.robots[robot]}` : ""}`;
    tip.hidden = false;
    tip.style.left = `${Math.max(GUTTER, Math.min(canvas.clientWidth - tip.offsetWidth, x + 12))}px`;
    tip.style.top = `${Math.max(0, y - 26)}px`;
  });
  canvas.addEventListener("pointerleave", () => (tip.hidden = true));
  panel.redraw = () => panel.update(false); // of a run under way
  panel.update = (force) => {
    const [from, to] = windowOf(view.t, panel.span, motion.end), wanted = `${from} ${to} ${view.selected} ${Math.floor(motion.numSamples / 10)} ${canvas.clientWidth}`;
    if (force || wanted !== drawn) {
      drawn = wanted;
      picture = drawAisle(canvas, app, from, to);
      describe(words, waits, app, picture);
    }
    head.style.top = `${picture.y(view.t)}px`;
    head.hidden = view.t < from || view.t > to;
  };
}

/* The times that are shown: they follow the clock by quarters, so that the picture stands still most of the time. */
function windowOf(t, span, end) {
  if (span >= end) return [0, Math.max(end, 1)];
  const quarter = span / 4, from = Math.max(0, Math.min(end - span, Math.floor(t / quarter) * quarter - 2 * quarter));
  return [from, from + span];
}

/* What robots that pass did: who stood where how long, the longest first. */
function drawAisle(canvas, app, from, to) {
  const { motion: m, run, view } = app, { ax, ay, bx, by, length } = view.aisle, ratio = Math.min(2, window.devicePixelRatio || 1);
  const width = Math.max(200, canvas.clientWidth || 300), height = canvas.clientHeight || 380;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const c = canvas.getContext("2d"), ux = (bx - ax) / length, uy = (by - ay) / length, reach = Math.max(0.75 * widest(run.width), Math.min(0.45, 0.75 * run.spacing_m));
  c.scale(ratio, ratio);
  c.fillStyle = cssColor("--soft");
  c.fillRect(GUTTER, 0, width - GUTTER, height);
  const toX = (s) => GUTTER + 6 + (Math.max(0, Math.min(length, s)) / length) * (width - GUTTER - 12), toY = (t) => ((t - from) / (to - from)) * height;
  drawGrid(c, from, to, length, toX, toY, width, height);
  const a = m.sampleAt(from), b = m.sampleAt(to), step = Math.max(1, Math.round((b - a) / (2 * height)), Math.ceil(((b - a) * m.numRobots) / MOST_SAMPLES));
  const colors = STATE_VARIABLES.map(cssColor), lines = [], stands = [];
  let passing = 0, stood = 0;
  for (const r of [...Array(m.numRobots).keys()].filter((r) => r !== view.selected).concat(view.selected >= 0 ? [view.selected] : [])) {
    const base = r * m.stride, line = [];
    let state = -1, lastX = 0, lastY = 0, seen = false, stand = null;
    c.globalAlpha = view.selected >= 0 && r !== view.selected ? 0.45 : 1;
    for (let k = a; k <= b; k += step) {
      const dx = m.x[base + k] * m.unit - ax, dy = m.y[base + k] * m.unit - ay, s = dx * ux + dy * uy, off = Math.abs(dy * ux - dx * uy);
      const inside = m.state[base + k] !== ABSENT && off <= reach && s >= -reach && s <= length + reach;
      const now = inside ? m.state[base + k] : -1, x = toX(s), y = toY(k * m.period);
      if (state >= 0 && (now >= 0 || inside)) {
        c.strokeStyle = colors[state];
        c.lineWidth = r === view.selected ? 3.5 : state === MOVING ? 1.3 : state === AT_GOAL ? 2 : 3;
        c.beginPath();
        c.moveTo(lastX, lastY);
        c.lineTo(x, y);
        c.stroke();
      }
      if (inside) line.push(x, y);
      else if (line.length) line.push(NaN, NaN);
      const stands_ = now === WAITING || now === BLOCKED;
      if (stand && (!stands_ || k + step > b)) stands.push({ ...stand, seconds: k * m.period - stand.t }), (stood += k * m.period - stand.t), (stand = null);
      else if (!stand && stands_) stand = { robot: r, t: k * m.period, at: Math.max(0, Math.min(length, s)) };
      state = now;
      lastX = x;
      lastY = y;
      seen ||= inside;
    }
    if (seen) passing++, lines.push([r, line]);
  }
  c.globalAlpha = 1;
  const robotAt = (x, y) => {
    let best = -1, nearest = SLACK_PX;
    for (const [r, line] of lines) for (let i = 0; i < line.length; i += 2) {
      const d = Math.hypot(line[i] - x, line[i + 1] - y);
      if (d < nearest) (nearest = d), (best = r);
    }
    return best;
  };
  stands.sort((p, q) => q.seconds - p.seconds);
  return { from, to, passing, stood, stands, robotAt, y: toY, timeAt: (y) => Math.max(from, Math.min(to, from + (y / height) * (to - from))) };
}

function drawGrid(c, from, to, length, toX, toY, width, height) {
  const nice = (rough) => [1, 2, 5, 10].map((f) => f * 10 ** Math.floor(Math.log10(rough))).find((v) => v >= rough);
  const every = [5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600].find((v) => ((to - from) / v) * 34 <= height) || 7200, metres = nice(length / 5);
  c.strokeStyle = cssColor("--line");
  c.fillStyle = cssColor("--faint");
  c.font = "500 10.5px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
  c.lineWidth = 1;
  c.beginPath();
  c.textAlign = "right";
  c.textBaseline = "middle";
  for (let t = Math.ceil(from / every) * every; t <= to; t += every) {
    const y = Math.round(toY(t)) + 0.5;
    c.moveTo(GUTTER, y);
    c.lineTo(width, y);
    if (y > 4 && y < height - 4) c.fillText(clockText(t, 0), GUTTER - 5, y);
  }
  for (let s = 0; s <= length; s += metres) {
    const x = Math.round(toX(s)) + 0.5;
    c.moveTo(x, 0);
    c.lineTo(x, height);
  }
  c.stroke();
  c.textAlign = "center";
  c.textBaseline = "bottom";
  for (let s = metres; s <= length - metres / 2; s += metres) c.fillText(`${Number(s.toFixed(2))} m`, toX(s), height - 2);
}

/* The picture in words, for those who do not see it, and its longest waits to go to. */
function describe(words, waits, app, picture) {
  const { run, view } = app, span = `${clockText(picture.from, 0)} to ${clockText(picture.to, 0)}`;
  const robots = picture.passing === 1 ? "1 robot is" : `${picture.passing || "no"} robots are`, waits_ = picture.stood >= 0.5 ? `; ${spanText(picture.stood)} of waiting in all` : picture.passing ? "; nobody waits" : "";
  words.textContent = `${view.aisle.length.toFixed(1)} m, ${span}: ${robots} there${waits_}.`;
  const most = picture.stands.filter((stand) => stand.seconds >= 1).slice(0, 5);
  waits.replaceChildren(...(most.length ? [make("h3", { textContent: "Longest waits there" })] : []), ...most.map((stand) =>
    make("button", { className: "rank", onclick: () => { app.play(false); app.seek(stand.t); app.select(stand.robot, true); app.panel.open("aisles"); } },
      make("span", { className: "who", textContent: run.robots[stand.robot] }), make("i", { style: { width: `${(100 * stand.seconds) / most[0].seconds}%` } }),
      make("span", { textContent: `${spanText(stand.seconds)} from ${clockText(stand.t, 0)}` }))));
}

function widest(widths) {
  return widths.reduce((a, b) => Math.max(a, b), 0);
}

/* An aisle by the stations at its ends, or by where it lies. */
function nameOf(aisle, map) {
  const near = (x, y) => map.stations.find((s) => s.name && Math.hypot(s.x - x, s.y - y) < 0.3)?.name;
  const ends = [near(aisle.ax, aisle.ay), near(aisle.bx, aisle.by)], flat = Math.abs(aisle.bx - aisle.ax) >= Math.abs(aisle.by - aisle.ay);
  const where = ends[0] && ends[1] ? `${ends[0]} to ${ends[1]}` : flat ? `along y = ${((aisle.ay + aisle.by) / 2).toFixed(1)} m` : `along x = ${((aisle.ax + aisle.bx) / 2).toFixed(1)} m`;
  return `${where}, ${aisle.length.toFixed(1)} m`;
}
