/* The panel beside the floor, one for each step: a floor, lanes, orders, a run, a question, what to take away. Each begins with what to do next. */
import { make } from "./elements.js";
import { get, post } from "./api.js";
import { ask, banner, button, check, command, committed, field, fields, jobState, muted, next, note, watched } from "./parts.js";
import { canRemoveLevel, doorChoices, lifts, ordered, removeLevel, renameLevel, renameLift, setDoors, setLevel, setLift, unit } from "./levels.js";
import { isDirty, level, list, opened, option, replaced, edited, rounded, site, changed } from "./site.js";
import { camera, fit, KINDS, picture, redraw, up } from "./view.js";
import { aligned, bent, choose, chosenVertices, mirrored, removeChosen, renamed, repeated, setOptions, tool, turned } from "./tools.js";

export const shared = { start: null, files: [], robot: "turtlebot3", scenario: null, text: "", textDigest: "", values: null, fault: "", job: null, run: "", study: "", points: [], answer: null, variants: null, pairs: null };
export const actions = {};  // of main.js: save, open, show, frame
const LANE_KINDS = ["", "forward", "backward"];

const of = (kind) => shared.files.filter((file) => file.kind === kind).map((file) => file.path);
const folderOf = (path) => (path.includes("/") ? path.slice(0, path.lastIndexOf("/") + 1) : "");

export async function refresh() {
  shared.files = await get("files");
}

/* 1. Floor */

export function floorPanel() {
  const parts = [];
  const image = picture(), scale = unit();
  if (!site.document) parts.push(next("Open a plan of your floor or a map from the list, or begin with an empty floor. Files are those of the folder that you started in: copy a PNG, JPG or DXF there."));
  else if (!scale) parts.push(next("Say how large the plan is: press Scale, click two places whose distance you know, such as both ends of a wall, and type the metres between them."), button("Scale (m)", () => choose("scale"), { className: "main" }));
  else parts.push(next("The floor has a scale. Go to Draw.", " "), button("Draw lanes", () => actions.show("draw"), { className: "main" }));
  if (site.document) {
    parts.push(make("h2", { textContent: site.path }));
    parts.push(muted(`${site.digest ? "saved" : "not saved yet"}${site.from && site.from !== site.path ? `, made of ${site.from}` : ""}${scale ? `, ${(1 / scale).toPrecision(3)} units a metre` : ""}`));
    if (image && scale) parts.push(...proposal());
  }
  parts.push(make("h3", { textContent: `In ${shared.start?.folder || "the folder"}` }));
  const shown = shared.files.filter((file) => file.kind === "plan" || file.kind === "map").slice(0, 40);
  parts.push(shown.length ? make("ul", { className: "list" }, ...shown.map((file) => make("li", {}, make("button", { type: "button", onclick: () => actions.open(file.path) }, file.path, " ", make("small", { textContent: file.kind === "plan" ? "plan" : "map" }))))) : muted("No plan and no map here yet."));
  parts.push(make("h3", { textContent: "Or" }), make("div", { className: "row" }, button("Empty floor", emptyFloor), button("Look again", async () => { await refresh(); changed("panel"); })));
  const bundled = make("select", { "aria-label": "A map that comes with the program" }, make("option", { value: "", textContent: "a map that comes with the program" }), ...(shared.start?.bundled || []).map((name) => make("option", { value: name, textContent: name })));
  bundled.addEventListener("change", () => bundled.value && actions.open(`bundled:${bundled.value}`));
  parts.push(make("div", { className: "row" }, bundled));
  return parts;
}

/* Lanes wherever there is room, over a picture. */
const proposed = { pitch_m: 2, radius_m: 0.5 };
function proposal() {
  return [
    make("h3", { textContent: "Lanes all over the free floor" }),
    muted("What is dark in the picture is wall. Lanes go wherever a robot has room; then take away what you do not want."),
    fields(
      field("between lanes", { type: "number", value: proposed.pitch_m, unit: "m", least: 0.3 }, (value) => (proposed.pitch_m = value || 2)),
      field("robot's radius", { type: "number", value: proposed.radius_m, unit: "m", least: 0.05 }, (value) => (proposed.radius_m = value || 0.5)),
    ),
    make("div", { className: "row" }, button("Walls and lanes", () => propose(true)), button("Walls only", () => propose(false))),
  ];
}

async function propose(withLanes) {
  try {
    const made = await post("propose", { picture: folderOf(site.path) + level().drawing.filename, scale_m: unit(), ...proposed });
    const n = list("vertices").length, shifted = (items) => items.map(([a, b, ...rest]) => [a + n, b + n, ...rest]);
    const lists = { vertices: [...list("vertices"), ...made.vertices], walls: [...list("walls"), ...shifted(made.walls)] };
    if (withLanes) lists.lanes = [...list("lanes"), ...shifted(made.lanes)];
    else {  // only the corners of walls
      const corners = [...new Set(made.walls.flatMap(([a, b]) => [a, b]))], number = new Map(corners.map((v, k) => [v, k + n]));
      lists.vertices = [...list("vertices"), ...corners.map((v) => made.vertices[v])];
      lists.walls = [...list("walls"), ...made.walls.map(([a, b, ...rest]) => [number.get(a), number.get(b), ...rest])];
    }
    edited(lists, []);
    note(made.notes.join("; "));
    actions.show("draw");
  } catch (error) { banner(error.message); }
}

async function emptyFloor() {
  const name = await ask("What is it called?", "", "site", "text");
  if (!name) return;
  const metres = await ask("How wide is the floor?", "m", 40);
  if (!(metres > 0)) return;
  const width = rounded(metres / 0.05), level_ = { elevation: 0, lanes: [], measurements: [[0, 1, { distance: [3, metres] }]], vertices: [[0, 0, 0, ""], [width, 0, 0, ""]], walls: [] };
  opened({ path: `${name.replace(/[^\w-]+/g, "_")}.building.yaml`, digest: "", from: "", document: { coordinate_system: "reference_image", graphs: {}, levels: { L1: level_ }, lifts: {}, name } });
  fit();
  camera.scale = Math.min(camera.scale, 600 / width);
  camera.y = up() * width * 0.3;
  actions.show("draw");
}

/* 2. Draw */

export function drawPanel() {
  if (!site.document) return [next("Open or begin a floor first."), button("Floor", () => actions.show("floor"), { className: "main" })];
  const parts = [], lanes = list("lanes").length, stations = list("vertices").filter((v) => v[3]).length;
  if (!unit()) parts.push(next("This level has no scale yet."), button("Scale (m)", () => choose("scale"), { className: "main" }));
  else if (!lanes) parts.push(next("Press ", make("kbd", { textContent: "l" }), " and click along the aisles: lanes join where they meet. On the Floor step, lanes can be laid all over a picture."));
  else if (stations < 2) parts.push(next("Press ", make("kbd", { textContent: "s" }), " and click where loads are picked up and set down; name the places and say what they are for."));
  else if (site.refused) parts.push(next("Mend what is found below: click a line to go there."));
  else parts.push(next("It can be driven on. Save it, and go to Orders."), make("div", { className: "row" }, button("Orders", () => actions.show("orders"), { className: "main" })));
  parts.push(...properties(), ...findings());
  return parts;
}

function properties() {
  const parts = [], chosen = site.selection;
  const one = chosen.length === 1 ? chosen[0] : null, kinds = new Set(chosen.map((s) => s.kind));
  if (one?.kind === "vertices") parts.push(...vertexPart(one.index));
  else if (kinds.size === 1 && kinds.has("lanes")) parts.push(...lanePart());
  else if (one?.kind === "doors") parts.push(...doorPart(one.index));
  else if (one?.kind === "measurements") parts.push(...rulerPart(one.index));
  else if (one?.kind === "lifts") parts.push(...liftPart(one.index));
  else if (chosen.length) parts.push(make("h2", { textContent: `${chosen.length} chosen` }));
  if (chosenVertices().length > 1) parts.push(...arrangePart());
  if (chosen.length) parts.push(make("div", { className: "row" }, button("Delete", removeChosen, { className: "danger", title: "Delete" })));
  if (!chosen.length) {
    parts.push(make("h2", { textContent: `Level ${site.level}` }), ...levelPart(), fields(
      field("snap to", { type: "number", value: tool.step_m, unit: "m", least: 0.01 }, (value) => (tool.step_m = value || 0.1)),
      field("snap", { type: "boolean", value: tool.snaps }, (value) => (tool.snaps = value)),
      field("robot that needs room", { choices: shared.start.robots, value: shared.robot }, (value) => { shared.robot = value || "turtlebot3"; changed("robot"); }),
    ));
  }
  return parts;
}

const metres = (value) => rounded(value * (unit() || 1));

function vertexPart(v) {
  const vertex = list("vertices")[v];
  if (!vertex) return [];
  const place = (k, value) => edited({ vertices: list("vertices").map((item, i) => (i === v ? item.map((x, n) => (n === k ? rounded((k === 1 ? up() : 1) * value / (unit() || 1)) : x)) : item)) });
  const kinds = KINDS.map(([name, word]) => check(word, option(vertex, name), (isOn) => setOptions("vertices", { [name]: isOn ? (name.startsWith("is_") ? true : String(vertex[3] || `place_${v}`)) : null })));
  return [
    make("h2", { textContent: vertex[3] ? `Station ${vertex[3]}` : `Vertex ${v}` }),
    fields(
      field("name", { value: vertex[3] ?? "", says: "of a station, as scenarios use it" }, (value) => renamed(v, value || "")),
      make("span", { textContent: "for" }), make("div", { className: "kinds", role: "group", "aria-label": "What the place is for" }, ...kinds),
      field("x", { type: "number", value: metres(vertex[0]), unit: "m" }, (value) => place(0, value ?? 0)),
      field("y", { type: "number", value: metres(up() * vertex[1]), unit: "m", says: "downwards, as pictures count" }, (value) => place(1, value ?? 0)),
      field("only passed", { type: "boolean", value: option(vertex, "is_passthrough_point"), says: "robots neither start, end nor rest here" }, (value) => setOptions("vertices", { is_passthrough_point: value || null })),
      field("group", { value: option(vertex, "mutex") ?? "", says: "of vertices and lanes for one robot at a time" }, (value) => setOptions("vertices", { mutex: value })),
    ),
  ];
}

function lanePart() {
  const chosen = site.selection.map((s) => list("lanes")[s.index]).filter(Boolean), first = chosen[0];
  if (!first) return [];
  const long = chosen.reduce((sum, [a, b]) => sum + Math.hypot(...[0, 1].map((k) => list("vertices")[a][k] - list("vertices")[b][k])), 0);
  const parts = [
    make("h2", { textContent: chosen.length === 1 ? `Lane ${site.selection[0].index}` : `${chosen.length} lanes` }),
    muted(`${metres(long).toFixed(2)} m`),
    fields(
      field("both ways", { type: "boolean", value: option(first, "bidirectional") }, (value) => setOptions("lanes", { bidirectional: value })),
      field("speed limit", { type: "number", value: option(first, "speed_limit") || "", unit: "m/s", least: 0, placeholder: "the robot's" }, (value) => setOptions("lanes", { speed_limit: value })),
      field("driven", { choices: LANE_KINDS.slice(1), value: option(first, "orientation") || "" }, (value) => setOptions("lanes", { orientation: value ?? null })),
      field("group", { value: option(first, "mutex") ?? "", says: "of lanes and vertices for one robot at a time" }, (value) => setOptions("lanes", { mutex: value })),
    ),
    make("div", { className: "row" }, button("Turn round", turned, { title: "the other direction" })),
  ];
  if (chosen.length === 1) parts.push(fields(field("arc, off the line by", { type: "number", unit: "m", value: "" }, (value) => value && bent(site.selection[0].index, value))));
  return parts;
}

function doorPart(index) {
  const door = list("doors")[index];
  if (!door) return [];
  return [make("h2", { textContent: `Door ${option(door, "name") ?? ""}` }), fields(
    field("name", { value: option(door, "name") ?? "" }, (value) => setOptions("doors", { name: value || "door" })),
    field("kind", { choices: ["hinged", "double_hinged", "sliding", "double_sliding"], value: option(door, "type") }, (value) => setOptions("doors", { type: value || "hinged" })),
  )];
}

function rulerPart(index) {
  const ruler = list("measurements")[index];
  return ruler ? [make("h2", { textContent: "Scale" }), fields(field("distance", { type: "number", value: option(ruler, "distance"), unit: "m", least: 0 }, (value) => value > 0 && setOptions("measurements", { distance: value })))] : [];
}

function levelPart() {
  const parts = [fields(
    field("level", { value: site.level, says: "name of the level, as scenarios and lifts use it" }, (value) => renameLevel(value)),
    field("elevation", { type: "number", value: level().elevation ?? 0, unit: "m", says: "of the floor; lifts ride from lower to higher" }, (value) => setLevel({ elevation: value ?? 0 })),
  )];
  if (canRemoveLevel()) parts.push(make("div", { className: "row" }, button("Delete this level", removeLevel, { className: "danger" })));
  return parts;
}

function liftPart(name) {
  const lift = lifts()[name];
  if (!lift) return [];
  const choices = doorChoices(lift), size = (key) => field(key, { type: "number", value: lift[key], unit: "m", least: 0.3 }, (value) => value > 0 && setLift(name, { [key]: value }));
  return [make("h2", { textContent: `Lift ${name}` }), fields(
    field("name", { value: name }, (value) => renameLift(name, value)),
    size("width"), size("depth"),
    field("turned by", { type: "number", value: rounded((lift.yaw * 180) / Math.PI), unit: "°", says: "counter-clockwise; at 0 the front is below" }, (value) => setLift(name, { yaw: Number((((value ?? 0) * Math.PI) / 180).toFixed(6)) })),
  ), make("h3", { textContent: "Doors" }), fields(...ordered().map((floor) => field(`on ${floor}`, { choices, value: (lift.level_doors?.[floor] || []).join(" and ") || null, says: "none: it passes by" }, (value) => setDoors(name, floor, value)))),
    muted("Lead a lane through the door to the place inside, on each level where it stops.")];
}

const repeat = { times: 3, dx: 3, dy: 0 };
function arrangePart() {
  return [
    make("h3", { textContent: "Arrange" }),
    make("div", { className: "row" }, button("Align in a column", () => aligned(0)), button("Align in a row", () => aligned(1)), button("Mirror ↔", () => mirrored(0)), button("Mirror ↕", () => mirrored(1))),
    fields(
      field("repeat", { type: "integer", value: repeat.times, unit: "times", least: 1, most: 200 }, (value) => (repeat.times = value || 1)),
      field("to the right", { type: "number", value: repeat.dx, unit: "m" }, (value) => (repeat.dx = value || 0)),
      field("up", { type: "number", value: repeat.dy, unit: "m" }, (value) => (repeat.dy = value || 0)),
    ),
    make("div", { className: "row" }, button("Repeat", () => repeated(repeat.times, repeat.dx, repeat.dy))),
  ];
}

function findings() {
  const parts = [make("h3", { textContent: site.findings.length ? `Found (${site.findings.length})` : "Nothing to report" })];
  if (site.size?.vertices) parts.push(muted(`${site.size.vertices} vertices and ${site.size.lanes} directed lanes to drive on`));
  parts.push(make("ul", { className: "list" }, ...site.findings.slice(0, 100).map((finding) => make("li", {}, make("button", {
    type: "button", className: `finding ${finding.severity}`, title: finding.places.length ? "go there" : "",
    onclick: () => {
      const [name, x, y] = finding.places[0] || [];
      if (!name) return;
      site.level = name;
      Object.assign(camera, { x, y, scale: Math.max(camera.scale, 15 / ((1 / (unit() || 0.05)) * 1)) });
      changed("view");
    },
  }, make("span", { textContent: finding.text }), finding.cure ? make("small", { textContent: ` – ${finding.cure}` }) : null)))));
  return parts;
}

/* 3. Orders */

const MAIN = ["robots.count", "robots.type", "tasks.streams.0.arrivals.rate_per_h", "execution.time_limit_s", "seed", "planner.name", "execution.dispatcher.name", "execution.policy.name", "discretisation.cell_m", "robots.speed_mps"];
const WORDS = { "robots.count": "robots", "robots.type": "type of robot", "tasks.streams.0.arrivals.rate_per_h": "orders", "execution.time_limit_s": "time of a run", "planner.name": "planner", "execution.dispatcher.name": "dispatcher", "execution.policy.name": "policy", "discretisation.cell_m": "step of a plan" };
const wishes = { robot: "", robots: null, rate_per_h: null };
let more = [];

const valueAt = (key) => {
  let at = shared.values;
  for (const name of key.split(".")) {
    if (at === null || at === undefined) return undefined;
    at = typeof at === "object" ? at[name] : name === "name" || name === "count" || name === "file" || name === "kind" ? at : undefined;
  }
  return at;
};

export async function openScenario(path) {
  const said = await get("text", { path });
  Object.assign(shared, { scenario: path, text: said.text, textDigest: said.digest, fault: said.fault });
  shared.values = (await post("scenario", { path, text: said.text })).values;
}

async function setValue(key, value) {
  try {
    const said = await post("scenario", { path: shared.scenario, text: shared.text, key, value });
    Object.assign(shared, said);
    await saveScenario();
  } catch (error) { banner(error.message); }
  changed("panel");
}

async function saveScenario() {
  try {
    const said = await post("save_text", { path: shared.scenario, text: shared.text, digest: shared.textDigest });
    Object.assign(shared, { textDigest: said.digest, fault: said.fault });
  } catch (error) {
    if (error.status !== 409) { banner(error.message); return; }
    banner(error.message, button("Keep mine", async () => { shared.textDigest = (await get("digest", { path: shared.scenario })).digest; await saveScenario(); banner(""); }), button("Take theirs", async () => { await openScenario(shared.scenario); banner(""); changed("panel"); }));
  }
}

async function proposeOrders() {
  if (!(await actions.save())) return;
  try {
    const job = await command({ what: "init", map: site.path, ...wishes }, (state) => { shared.job = state; changed("panel"); });
    shared.job = job?.state === "done" ? null : job;
    if (job?.state === "done") { await refresh(); await openScenario(job.out); }
  } catch (error) { banner(error.message); }
  changed("panel");
}

export function ordersPanel() {
  const parts = [], known = of("scenario");
  if (!site.document && !known.length) return [next("Draw a floor first."), button("Floor", () => actions.show("floor"), { className: "main" })];
  if (!shared.scenario) {
    parts.push(next("Have a first scenario proposed: it reads stations, chargers and parking from the drawing, guesses the rest, says what it guessed, and tries it. Fields that are empty are guessed."));
    parts.push(fields(
      field("type of robot", { choices: shared.start.robots, value: wishes.robot }, (value) => (wishes.robot = value || "")),
      field("robots", { type: "integer", value: wishes.robots ?? "", least: 1 }, (value) => (wishes.robots = value)),
      field("orders", { type: "number", value: wishes.rate_per_h ?? "", unit: "an hour", least: 0 }, (value) => (wishes.rate_per_h = value)),
    ));
    parts.push(make("div", { className: "row" }, button("Propose orders", proposeOrders, { className: "main", disabled: shared.job?.state === "running" || !site.document })), jobState(shared.job));
  }
  const chooser = make("select", { "aria-label": "Scenario" }, make("option", { value: "", textContent: "a new scenario" }), ...known.map((path) => make("option", { value: path, textContent: path, selected: path === shared.scenario })));
  chooser.addEventListener("change", async () => { if (chooser.value) await openScenario(chooser.value); else shared.scenario = null; changed("panel"); });
  if (known.length) parts.push(make("div", { className: "row" }, chooser));
  if (!shared.scenario) return parts;
  parts.unshift(next(shared.fault ? "Mend the line below." : "Change what is guessed wrongly, here or in the text. It is saved as you go. Then run it."), ...(shared.fault ? [] : [make("div", { className: "row" }, button("Run it", () => actions.show("run"), { className: "main" }))]));
  const declared = new Map(shared.start.fields.map((one) => [one.key, one]));
  const shown = [...MAIN, ...more].map((key) => declared.get(key)).filter(Boolean).map((one) => {
    const value = valueAt(one.key), choices = one.key === "robots.type" ? shared.start.robots : one.choices;
    return field(WORDS[one.key] || one.key, { ...one, choices: choices.length ? choices : null, value: typeof value === "object" ? "" : value, placeholder: one.default ?? "" }, (v) => setValue(one.key, v));
  });
  parts.push(fields(...shown));
  const listId = "all-options";
  const other = make("input", { placeholder: "another option …", "aria-label": "Another option" });
  other.setAttribute("list", listId);
  other.addEventListener("change", () => { if (declared.has(other.value)) { more = [...more, other.value]; changed("panel"); } });
  parts.push(make("div", { className: "row" }, other, make("datalist", { id: listId }, ...shared.start.fields.filter((one) => !MAIN.includes(one.key)).map((one) => make("option", { value: one.key, label: one.says })))));
  const text = make("textarea", { className: "yaml", value: shared.text, spellcheck: false, "aria-label": `Text of ${shared.scenario}` });
  committed(text, async () => {
    shared.text = text.value;
    const said = await post("scenario", { path: shared.scenario, text: text.value });
    Object.assign(shared, { values: said.values ?? shared.values, fault: said.fault });
    await saveScenario();
    changed("panel");
  });
  parts.push(make("h3", { textContent: shared.scenario }), shared.fault ? make("p", { className: "bad", role: "alert", textContent: shared.fault }) : muted("valid"), text);
  return parts;
}

/* 4. Run */

async function startRun() {
  if (site.document && isDirty() && !(await actions.save())) return;
  try {
    let isShown = false;
    const job = await command({ what: "run", scenario: shared.scenario || site.path }, (state) => {
      shared.job = state;
      if (state.live && !isShown) { isShown = true; actions.frame(`live/${state.number}/`); }
      changed("panel");
    });
    await refresh();
    if (job && job.state !== "stopped" && of("run").includes(job.out)) {
      shared.run = job.out;
      actions.frame(`replay?run=${encodeURIComponent(job.out)}`);
    }
  } catch (error) { banner(error.message); }
  changed("panel");
}

async function showWaits() {
  try {
    site.heat = site.heat ? null : (await get("waits", { run: shared.run, path: site.path })).places;
    actions.frame("");
  } catch (error) { banner(error.message); }
  changed("view");
}

export function runPanel() {
  const running = shared.job?.what === "run" && shared.job.state === "running";
  const parts = [next(running ? "It drives. In the picture: space pauses, the slider sets the speed; click a robot to break it down, a lane to close it, a station to add an order." : shared.run ? "Look at the replay, then see where robots waited on your plan, and ask how many robots are needed." : "Run the scenario and watch it while it drives.")];
  parts.push(make("div", { className: "row" }, button(shared.scenario ? `Run ${shared.scenario}` : "Run the map alone", startRun, { className: running ? "" : "main", disabled: running || (!shared.scenario && !site.document) }), button("How many robots?", () => actions.show("ask"))));
  if (shared.job?.what === "run") parts.push(jobState(shared.job));
  const runs = of("run");
  if (runs.length) {
    parts.push(make("h3", { textContent: "Runs" }));
    parts.push(make("ul", { className: "list" }, ...runs.slice(0, 20).map((run) => make("li", {}, make("button", { type: "button", "aria-pressed": String(run === shared.run), onclick: () => { shared.run = run; actions.frame(`replay?run=${encodeURIComponent(run)}`); changed("panel"); } }, run)))));
  }
  if (shared.run) parts.push(make("div", { className: "row" }, button(site.heat ? "Waits off the plan" : "Waits over the plan", showWaits, { disabled: !site.document })));
  parts.push(make("div", { className: "row" }, button("Back to the drawing", () => actions.frame(""))));
  return parts;
}

/* 5. Ask */

const question = { quick: true, robots: "", demand: "", budget: "3min" };
const two = { first: "", second: "", seeds: 5 };

async function study() {
  try {
    Object.assign(shared, { answer: null, points: [] });
    const job = await command({ what: "capacity", scenario: shared.scenario, quick: question.quick, robots: question.robots, demand: question.demand, budget: question.budget }, async (state) => {
      shared.job = state;
      shared.study = state.out;
      shared.points = (await get("curve", { out: state.out }).catch(() => ({ points: shared.points }))).points;
      changed("panel");
    });
    shared.answer = job?.answer?.answer ?? null;
    await refresh();
  } catch (error) { banner(error.message); }
  changed("panel");
}

async function compareVariants() {
  try {
    shared.pairs = null;
    await command({ what: "variants", scenario: shared.scenario, maps: [two.first, two.second], seeds: two.seeds }, async (state) => {
      shared.job = state;
      shared.pairs = await get("paired", { out: state.out, first: two.first }).catch(() => shared.pairs);
      changed("panel");
    });
  } catch (error) { banner(error.message); }
  changed("panel");
}

export function askPanel() {
  if (!shared.scenario) return [next("A question needs a scenario with orders."), button("Orders", () => actions.show("orders"), { className: "main" })];
  const running = shared.job?.state === "running";
  const parts = [next(shared.answer ? "The answer is below, and its page for others is in the folder. Change the drawing and ask again, or save it under another name and compare the two." : "Ask how many robots the orders need: fleets of several sizes are driven on several draws of the orders.")];
  parts.push(fields(
    field("quick", { type: "boolean", value: question.quick, says: "3 seeds of 20 simulated minutes at first, wider limits" }, (value) => (question.quick = value)),
    field("at most", { value: question.budget, says: "what the study may take on two cores", placeholder: "20min" }, (value) => (question.budget = value || "")),
    field("orders to serve", { value: question.demand, placeholder: "the scenario's, such as 180/h" }, (value) => (question.demand = value || "")),
    field("sizes of fleets", { value: question.robots, placeholder: "4..what fits" }, (value) => (question.robots = value || "")),
  ));
  parts.push(make("div", { className: "row" }, button("How many robots?", study, { className: shared.answer ? "" : "main", disabled: running })));
  if (shared.job?.what === "capacity") parts.push(jobState(shared.job.state === "done" ? null : shared.job));
  if (shared.points.length) parts.push(chart(shared.points));
  if (shared.answer) {
    parts.push(make("p", { id: "answer", className: "next" }, make("b", { textContent: shared.answer.sentence })), ...(shared.answer.notes || []).map((note) => muted(note)));
    parts.push(make("div", { className: "row" }, button("The whole answer", () => actions.frame(`page?path=${encodeURIComponent(`${shared.study}/capacity.html`)}`)), button("Back to the drawing", () => actions.frame(""))));
  }
  const studies = of("study");
  if (studies.length) {
    parts.push(make("h3", { textContent: "Studies" }), make("ul", { className: "list" }, ...studies.slice(0, 10).map((path) => make("li", {}, make("button", { type: "button", "aria-pressed": String(path === shared.study), onclick: async () => { const said = await get("curve", { out: path }); Object.assign(shared, { study: path, points: said.points, answer: said.answer }); changed("panel"); } }, path)))));
  }
  parts.push(...variantsPart(running));
  return parts;
}

function variantsPart(running) {
  const maps = of("map").filter((path) => path.endsWith(".building.yaml"));
  const parts = [make("h2", { textContent: "Two layouts on the same orders" }), make("div", { className: "row" }, button("Save this drawing as a variant …", saveVariant, { disabled: !site.document }))];
  if (maps.length < 2) return [...parts, muted("Save the drawing under another name, change it, and compare the two.")];
  if (!two.first) [two.second, two.first] = [maps[0], maps[1]];
  parts.push(fields(
    field("this layout", { choices: maps, value: two.first }, (value) => (two.first = value)),
    field("against", { choices: maps, value: two.second }, (value) => (two.second = value)),
    field("draws of the orders", { type: "integer", value: two.seeds, least: 2, most: 100 }, (value) => (two.seeds = value || 5)),
  ));
  parts.push(make("div", { className: "row" }, button("Compare", compareVariants, { disabled: running })));
  if (shared.job?.what === "batch") parts.push(jobState(shared.job));
  if (shared.pairs?.rows.length) {
    const number = (value) => (value === null ? "–" : String(Number(value.toPrecision(4))));
    parts.push(make("table", { id: "pairs" }, make("thead", {}, make("tr", {}, ...["", ...shared.pairs.maps.map((name) => name.replace(".building.yaml", "")), "difference"].map((text) => make("th", { textContent: text, scope: "col" })))), make("tbody", {},
      ...shared.pairs.rows.map((row) => {
        const [value, low, high] = row.difference, sure = low !== null && low * high > 0, good = sure && value > 0 === row.more_is_better;
        return make("tr", {}, make("td", { textContent: row.measure }), make("td", { textContent: number(row.first) }), make("td", { textContent: number(row.second) }),
          make("td", { className: sure ? (good ? "good" : "bad") : "", textContent: `${number(value)} (${number(low)} to ${number(high)})`, title: `95 % limits of ${row.pairs} pairs` }));
      }))), muted(`Second less first, with 95 % limits of ${shared.pairs.rows[0].pairs} pairs on the same orders; coloured where the limits leave out 0.`));
  }
  return parts;
}

async function saveVariant() {
  const name = await ask("What is the variant called?", "", `${site.path.replace(/(.*\/)?(.*)\.building\.yaml$/, "$2")}_b`, "text");
  if (!name) return;
  site.path = `${folderOf(site.path)}${name.replace(/[^\w-]+/g, "_")}.building.yaml`;
  site.digest = "";
  site.saved = null;
  if (await actions.save()) { await refresh(); two.first = ""; }
  changed("panel");
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

/* 6. Leave */

async function take(values) {
  try {
    const job = await command(values, (state) => { shared.job = state; changed("panel"); });
    await refresh();
    if (job?.state === "done" && job.out.endsWith(".html") && values.what === "report") actions.frame(`page?path=${encodeURIComponent(job.out)}`);
  } catch (error) { banner(error.message); }
  changed("panel");
}

export function leavePanel() {
  const run = shared.run, map = site.digest ? site.path : "";
  const each = (text, hint, values, disabled) => [make("div", { className: "row" }, button(text, () => take(values), { disabled: disabled || shared.job?.state === "running" }), make("span", { className: "muted", textContent: hint }))];
  return [
    next("All of it is files in the folder, which the command line reads and git keeps."),
    make("h3", { textContent: run ? `Of ${run}` : "Of a run: choose one on the Run step" }),
    ...each("Report", "tables and charts, one page", { what: "report", run }, !run),
    ...each("Replay as a file", "for any browser", { what: "replay", run }, !run),
    ...each("Video", "GIF of the first minute", { what: "video", run }, !run),
    make("h3", { textContent: map ? `Of ${map}` : "Of the drawing: save it first" }),
    ...each("LIF", "for fleet managers (VDMA)", { what: "convert", map, format: "lif" }, !map),
    ...each("openTCS", "plant model", { what: "convert", map, format: "opentcs" }, !map),
    ...each("Nav graph", "for Open-RMF", { what: "convert", map, format: "nav" }, !map),
    ...(shared.study ? [make("h3", { textContent: "For the boss" }), make("div", { className: "row" }, button("The two pages", () => actions.frame(`page?path=${encodeURIComponent(`${shared.study}/capacity.html`)}`)), make("span", { className: "muted", textContent: `${shared.study}/capacity.html` }))] : []),
    jobState(shared.job),
    make("h3", { textContent: "On the command line" }),
    make("pre", { textContent: [site.digest ? `mrp-sumo import ${site.path} --check` : "", shared.scenario ? `mrp-sumo run ${shared.scenario}\nmrp-sumo capacity ${shared.scenario} --quick` : "", run ? `mrp-sumo replay ${run} --serve` : ""].filter(Boolean).join("\n") || "mrp-sumo studio ." }),
    make("div", { className: "row" }, button("Back to the drawing", () => actions.frame(""))),
  ];
}
