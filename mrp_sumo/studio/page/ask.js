/* The step of questions: how many robots, and what a change of the layout brings on the same orders. */
import { make } from "./elements.js";
import { get, post } from "./api.js";
import { banner, button, field, fields, jobState, muted, next, note } from "./parts.js";
import { actions, folderOf, follows, isRunning, of, refresh, shared, start, stemOf } from "./shared.js";
import { changed, isDirty, replaced, site } from "./site.js";

const question = { quick: true, robots: "", demand: "", budget: "3min" };
const two = { first: "", second: "", seeds: 5 };

export function askPanel() {
  if (!shared.scenario) return [next("A question needs a scenario with orders."), button("Orders", () => actions.show("orders"), { className: "main" })];
  return [...studyPart(), ...whatIfPart(), ...comparisonsPart(), ...anyTwoPart()];
}

/* How many robots? */

follows.capacity = {
  async during(job) {
    shared.study = job.out;
    shared.points = (await get("curve", { out: job.out }).catch(() => ({ points: shared.points }))).points;
  },
  after(job) { shared.answer = job.answer?.answer ?? null; },
};

function ask() {
  Object.assign(shared, { answer: null, points: [] });
  start({ what: "capacity", scenario: shared.scenario, ...question });
}

async function openStudy(path) {
  const said = await get("curve", { out: path });
  Object.assign(shared, { study: path, points: said.points, answer: said.answer });
  changed("panel");
}

function studyPart() {
  const parts = [next(shared.answer ? "The answer is below, and its page for others is in the folder. Change the drawing, and see what that brings." : "Ask how many robots the orders need: fleets of several sizes are driven on several draws of the orders.")];
  parts.push(fields(
    field("quick", { type: "boolean", value: question.quick, says: "3 seeds of 20 simulated minutes at first, wider limits" }, (value) => (question.quick = value)),
    field("at most", { value: question.budget, says: "what the study may take on two cores", placeholder: "20min" }, (value) => (question.budget = value || "")),
    field("orders to serve", { value: question.demand, placeholder: "such as 180/h", says: "of the scenario where it is empty" }, (value) => (question.demand = value || "")),
    field("sizes of fleets", { value: question.robots, placeholder: "4..what fits" }, (value) => (question.robots = value || "")),
  ));
  parts.push(make("div", { className: "row" }, button("How many robots?", ask, { className: shared.answer ? "" : "main", disabled: isRunning() })));
  if (shared.job?.what === "capacity" && shared.job.state !== "done") parts.push(jobState(shared.job));
  if (shared.points.length) parts.push(chart(shared.points));
  if (shared.answer) {
    parts.push(make("p", { id: "answer", className: "next" }, make("b", { textContent: shared.answer.sentence })), ...(shared.answer.notes || []).map((text) => muted(text)));
    parts.push(make("div", { className: "row" }, button("The whole answer", () => actions.frame(`page?path=${encodeURIComponent(`${shared.study}/capacity.html`)}`)), button("Back to the drawing", () => actions.frame(""))));
  }
  const studies = of("study").slice(0, 10);
  if (studies.length) parts.push(make("h3", { textContent: "Studies" }), chooser(studies, shared.study, openStudy));
  return parts;
}

const chooser = (paths, chosen, open) => make("ul", { className: "list" }, ...paths.map((path) => make("li", {}, make("button", { type: "button", "aria-pressed": String(path === chosen), onclick: () => open(path) }, path))));

/* What if? */

follows.batch = {
  async during(job) { shared.pairs = await get("paired", { out: job.out }).catch(() => shared.pairs); },
};

function compare(first, second) {
  shared.pairs = null;
  return start({ what: "variants", scenario: shared.scenario, maps: [first, second], seeds: two.seeds });
}

/* The drawing kept as a variant beside its file, compared with that file on the same orders; undo brings the change back. */
async function whatIf() {
  const base = site.path, word = (site.change || "change").replace(/[^\w-]+/g, "_");
  try {
    let path = "";
    for (let n = 1; !path || (await get("digest", { path })).digest; n++) path = `${folderOf(base)}${stemOf(base)}_${word}${n > 1 ? `_${n}` : ""}.building.yaml`;
    await post("save", { path, document: site.document, digest: "", like: base });
    replaced(site.saved, []);
    await refresh();
    note(`${path} is kept, and compared with ${base}, which is shown again.`);
    actions.show("ask");
    await compare(base, path);
  } catch (error) { banner(error.message); }
}

export function whatIfPart() {
  const parts = [make("h2", { textContent: "What if?" })], isChanged = site.digest && site.saved && isDirty();
  if (!isChanged) return [...parts, muted("Change the drawing, and compare it with what is saved: double or turn a lane, drag a charger or a station onto another place. The change is kept as a file of its own.")];
  parts.push(fields(
    field("variant", { value: site.change || "change", says: "part of its file's name" }, (value) => { site.change = value || ""; }),
    field("draws of the orders", { type: "integer", value: two.seeds, least: 2, most: 100 }, (value) => (two.seeds = value || 5)),
  ));
  parts.push(make("div", { className: "row" }, button("Compare with what is saved", whatIf, { disabled: !shared.scenario || isRunning() || site.refused })));
  if (!shared.scenario) parts.push(muted("This needs orders: propose or choose them on the Orders step."));
  return parts;
}

async function openComparison(out) {
  try {
    shared.pairs = await get("paired", { out });
  } catch (error) { banner(error.message); }
  changed("panel");
}

/* A variant's drawing in place of the one that is open, not saved yet. */
async function takeOver(name) {
  try {
    const path = of("map").find((one) => one === `${folderOf(site.path)}${name}`) ?? name;
    replaced((await get("open", { path })).document, []);
    note(`This is the drawing of ${path}. Save it, and it is ${site.path}; undo, and it is as it was.`);
    actions.show("draw");
  } catch (error) { banner(error.message); }
}

function comparisonsPart() {
  const parts = [], all = of("comparison").slice(0, 20);
  if (shared.job?.what === "batch" && shared.job.state !== "done") parts.push(jobState(shared.job));
  if (shared.pairs?.rows.length) parts.push(...pairsTable(shared.pairs));
  if (all.length) parts.push(make("h3", { textContent: "Compared" }), chooser(all, shared.pairs?.out, openComparison));
  return parts;
}

function pairsTable({ maps, rows }) {
  const number = (value) => (value === null ? "–" : String(Number(value.toPrecision(4))));
  const row = ({ measure, first, second, difference: [value, low, high], more_is_better, pairs }) => {
    const isSure = low !== null && low * high > 0, isGood = value > 0 === more_is_better;
    return make("tr", {}, make("td", { textContent: measure }), make("td", { textContent: number(first) }), make("td", { textContent: number(second) }),
      make("td", { className: isSure ? (isGood ? "good" : "bad") : "", textContent: `${number(value)} (${number(low)} to ${number(high)})`, title: `95 % limits of ${pairs} pairs` }));
  };
  const [first, second] = maps.map(stemOf), head = ["measure", first, second.startsWith(`${first}_`) ? second.slice(first.length + 1) : second, "difference"].map((text) => make("th", { textContent: text.replaceAll("_", "_\u200b"), scope: "col" }));  // a name may end a line after a `_`
  return [
    make("table", { id: "pairs" }, make("thead", {}, make("tr", {}, ...head)), make("tbody", {}, ...rows.map(row))),
    muted(`Second less first, with 95 % limits of ${rows[0].pairs} pairs on the same orders; coloured where the limits leave out 0.`),
    make("div", { className: "row" }, button(`Take over ${second}`, () => takeOver(maps[1]), { disabled: !site.document || isDirty() })),
  ];
}

function anyTwoPart() {
  const maps = of("map").filter((path) => path.endsWith(".building.yaml"));
  if (maps.length < 2) return [];
  if (!maps.includes(two.first) || !maps.includes(two.second)) [two.second, two.first] = maps;
  return [make("details", {}, make("summary", { textContent: "Compare any two layouts" }), fields(
    field("this layout", { choices: maps, value: two.first }, (value) => (two.first = value)),
    field("against", { choices: maps, value: two.second }, (value) => (two.second = value)),
  ), make("div", { className: "row" }, button("Compare", () => compare(two.first, two.second), { disabled: isRunning() })))];
}

/* Orders done an hour by size of fleet: a dot a run, a line through the means. */
function chart(points) {
  const space = "http://www.w3.org/2000/svg", [w, h, left, bottom] = [340, 200, 40, 30];
  const most = Math.max(...points.map((p) => p.per_h), 1) * 1.1, widest = Math.max(...points.map((p) => p.robots), 1) * 1.05;
  const at = (robots, per_h) => [left + (robots / widest) * (w - left - 8), h - bottom - (per_h / most) * (h - bottom - 22)];
  const svg = document.createElementNS(space, "svg");
  const draw = (tag, attributes, text = "") => { const e = document.createElementNS(space, tag); for (const [k, v] of Object.entries(attributes)) e.setAttribute(k, v); e.textContent = text; svg.append(e); };
  svg.setAttribute("viewBox", `0 0 ${w} ${h}`);
  svg.setAttribute("class", "chart");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `Orders done an hour by robots, ${points.length} runs so far`);
  for (let k = 0; k <= 4; k++) {
    const value = (most * k) / 4, [, y] = at(0, value);
    draw("line", { x1: left, x2: w - 8, y1: y, y2: y, stroke: "var(--line)" });
    draw("text", { x: left - 6, y: y + 4, "text-anchor": "end" }, Math.round(value));
  }
  const sizes = [...new Set(points.map((p) => p.robots))].sort((a, b) => a - b);
  for (const size of sizes) draw("text", { x: at(size, 0)[0], y: h - 12, "text-anchor": "middle" }, size);
  draw("text", { x: w - 8, y: h - 1, "text-anchor": "end" }, "robots");
  draw("text", { x: 2, y: 9 }, "orders done an hour");
  const means = sizes.map((size) => { const all = points.filter((p) => p.robots === size); return at(size, all.reduce((sum, p) => sum + p.per_h, 0) / all.length); });
  draw("polyline", { points: means.map((p) => p.join(",")).join(" "), fill: "none", stroke: "var(--accent)", "stroke-width": 2 });
  for (const p of points) { const [x, y] = at(p.robots, p.per_h); draw("circle", { cx: x, cy: y, r: 3.5, fill: "var(--moving)", "fill-opacity": 0.55 }); }
  return svg;
}
