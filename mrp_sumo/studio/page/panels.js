/* Panels beside the floor: a floor, orders, a run, what to take away. Each begins with what to do next. */
import { make } from "./elements.js";
import { get, post } from "./api.js";
import { ask, banner, button, committed, field, fields, jobState, muted, next, note } from "./parts.js";
import { unit } from "./levels.js";
import { actions, folderOf, follows, isRunning, of, refresh, shared, start } from "./shared.js";
import { isDirty, level, list, opened, edited, rounded, site, changed } from "./site.js";
import { camera, fit, picture, up } from "./view.js";
import { choose, tool } from "./tools.js";

/* Floor */

export function floorPanel() {
  const parts = [];
  const image = picture(), scale = unit();
  if (!site.document) parts.push(next("Open a plan of your floor or a map from the list, or begin with an empty floor. Drop a PNG, JPG, PDF, DXF or SVG onto this page, or choose one from elsewhere."));
  else if (!scale) parts.push(next("Say how large the plan is: click two places whose distance you know, such as both ends of a wall, then type the metres between them."), ...(tool.name === "scale" ? [] : [button("Scale (m)", () => choose("scale"), { className: "main" })]));
  else parts.push(next((image || site.plan) && !list("lanes").length ? "The floor has a scale. Have lanes laid over it below, or draw them yourself." : "The floor has a scale. Go to Draw."), button("Draw lanes", () => actions.show("draw"), { className: "main" }));
  if (site.document) {
    parts.push(make("h2", { textContent: site.path }));
    parts.push(muted(`${site.digest ? "saved" : "not saved yet"}${site.from && site.from !== site.path ? `, made of ${site.from}` : ""}${scale ? `, ${extent(image, scale)}` : ""}`));
    if (scale && (image || site.plan)) parts.push(...proposal(image));
  }
  parts.push(make("h3", { textContent: `In ${shared.start?.folder || "the folder"}` }));
  const shown = shared.files.filter((file) => file.kind === "plan" || file.kind === "map").slice(0, 40);
  parts.push(shown.length ? make("ul", { className: "list" }, ...shown.map((file) => make("li", {}, make("button", { type: "button", onclick: () => actions.open(file.path) }, file.path, " ", make("small", { textContent: file.kind === "plan" ? "plan" : "map" }))))) : muted("No plan and no map here yet."));
  parts.push(make("h3", { textContent: "Or" }), make("div", { className: "row" }, button("Choose a file …", chooseFile), button("Empty floor", emptyFloor), button("Look again", async () => { await refresh(); changed("panel"); })));
  const bundled = make("select", { "aria-label": "A map that comes with the program" }, make("option", { value: "", textContent: "a map that comes with the program" }), ...(shared.start?.bundled || []).map((name) => make("option", { value: name, textContent: name })));
  bundled.addEventListener("change", () => bundled.value && actions.open(`bundled:${bundled.value}`));
  parts.push(make("div", { className: "row" }, bundled));
  return parts;
}

const extent = (image, scale) => (image?.isThere ? `${(image.naturalWidth * scale).toPrecision(3)} x ${(image.naturalHeight * scale).toPrecision(3)} m, ` : "") + `${(100 * scale).toPrecision(3)} cm a ${image ? "pixel" : "unit"}`;

/* A file from elsewhere: a copy in the folder is opened. */
export async function addFile(file) {
  try {
    const response = await fetch(`add?path=${encodeURIComponent(file.name)}`, { method: "POST", body: file }), said = await response.json();
    if (!response.ok && response.status !== 409) throw new Error(said.error);
    await refresh();
    await actions.open(file.name);
    if (response.status === 409) note(`${file.name} was in the folder already; it is that one.`);
  } catch (error) { banner(error.message); }
}

function chooseFile() {
  const input = make("input", { type: "file" });
  input.addEventListener("change", () => input.files[0] && addFile(input.files[0]));
  input.click();
}

/* Lanes wherever there is room, over a picture. */
const proposed = { pitch_m: 2, radius_m: 0.5 };
function proposal(image) {
  return [
    make("h3", { textContent: "Lanes all over the free floor" }),
    muted(`${image ? "What is dark in the picture is wall. " : ""}Lanes go wherever a robot has room; then take away what you do not want.`),
    fields(
      field("between lanes", { type: "number", value: proposed.pitch_m, unit: "m", least: 0.3 }, (value) => (proposed.pitch_m = value || 2)),
      field("robot's radius", { type: "number", value: proposed.radius_m, unit: "m", least: 0.05 }, (value) => (proposed.radius_m = value || 0.5)),
    ),
    make("div", { className: "row" }, ...(image ? [button("Walls and lanes", () => propose(true)), button("Walls only", () => propose(false))] : [button("Lay lanes", () => propose(true))])),
  ];
}

async function propose(withLanes) {
  note("Looking for room …");
  try {
    const made = await post("propose", { ...(picture() ? { plan: folderOf(site.path) + level().drawing.filename, scale: unit() } : site.plan), ...proposed });
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

/* Orders */

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
  followRobot();
}

/* Room beside walls is that of the scenario's robots. */
function followRobot() {
  const type = valueAt("robots.type");
  if (!shared.start.robots.includes(type) || type === shared.robot) return;
  shared.robot = type;
  changed("robot");
}

async function setValue(key, value) {
  try {
    const said = await post("scenario", { path: shared.scenario, text: shared.text, key, value });
    Object.assign(shared, said);
    followRobot();
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

follows.init = {
  async after(job) {
    if (job.state !== "done") return;
    shared.job = null;
    await openScenario(job.out);
  },
};

async function proposeOrders() {
  if (await actions.save()) start({ what: "init", map: site.path, ...wishes });
}

const listed = (text) => (text || "").split(",").map((name) => name.trim()).filter(Boolean);

/* Groups of stations, and stations with several places and a queue: lists of names. */
function placesPart() {
  const { groups = {}, stations = {} } = shared.values?.tasks || {}, known = level().vertices?.map((v) => v[3]).filter(Boolean).join(", ") || "";
  const names = (label, key, value, says) => field(label, { value: (value || []).join(", "), says: `${says}, with commas; on this level: ${known}` }, (text) => setValue(key, text ? listed(text) : null));
  const rows = [
    ...Object.entries(groups).map(([name, value]) => names(`group ${name}`, `tasks.groups.${name}`, value, "names of stations or vertices")),
    ...Object.entries(stations).flatMap(([name, one]) => [names(`${name}: places`, `tasks.stations.${name}.places`, one?.places, "names of vertices, one robot at a time is served at each"), names(`${name}: queue`, `tasks.stations.${name}.queue`, one?.queue, "names of vertices where robots wait for a place")]),
  ];
  return [make("details", {}, make("summary", { textContent: "Groups, places and queues" }), muted("Each named vertex is a station with one place. A station with several places, and a queue, has a name of its own."), fields(...rows),
    make("div", { className: "row" }, button("Add a station with places …", addStation)))];
}

/* What `init` guessed, as it says beside each key. */
function guessesPart() {
  const guesses = [...shared.text.matchAll(/^[\s-]*(\w+):.*# guessed: (.*)$/gm)].map(([, key, why]) => make("li", {}, make("b", { textContent: { count: "robots", arrivals: "orders" }[key] || key }), `: ${why}`));
  return guesses.length ? [make("details", { open: true }, make("summary", { textContent: "What was guessed" }), make("ul", { className: "guesses" }, ...guesses))] : [];
}

/* Kinds of orders: how many of each, and between which stops. */
function streamsPart() {
  const streams = shared.values?.tasks?.streams;
  if (!Array.isArray(streams)) return [];
  const rows = streams.flatMap((stream, k) => {
    const key = `tasks.streams.${k}`, name = stream?.name ?? `stream_${k}`;
    return [
      field(`${name}: orders`, { type: "number", value: stream?.arrivals?.rate_per_h ?? "", unit: "an hour", least: 0 }, (value) => setValue(`${key}.arrivals.rate_per_h`, value)),
      field(`${name}: stops`, { value: (stream?.stops || []).join(", "), says: "groups, stations or vertices in their order, with commas" }, (text) => setValue(`${key}.stops`, listed(text))),
    ];
  });
  return [make("details", {}, make("summary", { textContent: "Kinds of orders" }), muted(`Stops are names of groups, of which one place is drawn, or of stations: ${Object.keys(shared.values.tasks.groups || {}).join(", ")}.`), fields(...rows),
    make("div", { className: "row" }, button("Add a kind of orders …", addStream), ...(streams.length > 1 ? [button("Remove the last", () => setValue(`tasks.streams.${streams.length - 1}`, null), { className: "danger" })] : [])))];
}

async function addStream() {
  const { streams } = shared.values.tasks, name = await ask("What is this kind of orders called?", "", `order_${streams.length + 1}`, "text");
  const stops = name && await ask("Where does each stop?", "names, with commas", (streams[0]?.stops || []).toReversed().join(", "), "text");
  const rate_per_h = stops && await ask("How many are there?", "an hour", 10);
  if (rate_per_h > 0) setValue(`tasks.streams.${streams.length}`, { ...streams[0], name: name.replace(/[^\w-]+/g, "_"), arrivals: { rate_per_h }, stops: listed(stops) });
}

async function addStation() {
  const chosen = site.selection.filter((s) => s.kind === "vertices").map((s) => list("vertices")[s.index]?.[3]).filter(Boolean).join(", ");
  const name = await ask("What is the station called?", "", "", "text");
  const places = name && await ask("Which vertices are its places?", "names, with commas", chosen, "text");
  if (places) setValue(`tasks.stations.${name.replace(/[^\w-]+/g, "_")}.places`, listed(places));
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
    parts.push(make("div", { className: "row" }, button("Propose orders", proposeOrders, { className: "main", disabled: isRunning() || !site.document })), jobState(shared.job));
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
  parts.push(fields(...shown), ...guessesPart());
  const listId = "all-options";
  const other = make("input", { placeholder: "another option …", "aria-label": "Another option" });
  other.setAttribute("list", listId);
  other.addEventListener("change", () => { if (declared.has(other.value)) { more = [...more, other.value]; changed("panel"); } });
  parts.push(make("div", { className: "row" }, other, make("datalist", { id: listId }, ...shared.start.fields.filter((one) => !MAIN.includes(one.key)).map((one) => make("option", { value: one.key, label: one.says })))));
  parts.push(...streamsPart(), ...placesPart());
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

/* Run */

let watched = 0;  // the run whose live view was shown
follows.run = {
  during(job) {
    if (!job.live || shared.step !== "run" || watched === job.number) return;
    watched = job.number;
    actions.frame(`live/${job.number}/`);
  },
  after(job) { if (of("run").includes(job.out)) openRun(job.out); },
};

function openRun(run) {
  shared.run = run;
  if (shared.step === "run") actions.frame(`replay?run=${encodeURIComponent(run)}`);
  changed("panel");
}

async function startRun() {
  if (site.document && isDirty() && !(await actions.save())) return;
  start({ what: "run", scenario: shared.scenario || site.path });
}

async function showWaits() {
  try {
    site.heat = site.heat ? null : (await get("waits", { run: shared.run, path: site.path })).places;
    actions.frame("");
  } catch (error) { banner(error.message); }
  changed("view");
}

export function runPanel() {
  const running = shared.job?.what === "run" && isRunning();
  const parts = [next(running ? "It drives. In the picture: space pauses, the list beside live sets the speed, up to fast; click a robot to break it down, a lane to close it, a station to add an order." : shared.run ? "Look at the replay, then see where robots waited on your plan, and ask how many robots are needed." : "Run the scenario and watch it while it drives.")];
  parts.push(make("div", { className: "row" }, button(shared.scenario ? `Run ${shared.scenario}` : "Run the map alone", startRun, { className: running ? "" : "main", disabled: running || (!shared.scenario && !site.document) }), button("How many robots?", () => actions.show("ask"))));
  if (shared.job?.what === "run") parts.push(jobState(shared.job));
  const runs = of("run");
  if (runs.length) {
    parts.push(make("h3", { textContent: "Runs" }));
    parts.push(make("ul", { className: "list" }, ...runs.slice(0, 20).map((run) => make("li", {}, make("button", { type: "button", "aria-pressed": String(run === shared.run), onclick: () => openRun(run) }, run)))));
  }
  if (site.heat) parts.push(muted(site.heat.length ? `Where robots stood and waited: the redder the longer, ${Math.round(Math.max(...site.heat.map((place) => place[3])))} s of all robots at the worst place.` : "No robot waited."));
  if (shared.run) parts.push(make("div", { className: "row" }, button(site.heat ? "Waits off the plan" : "Waits over the plan", showWaits, { disabled: !site.document })));
  parts.push(make("div", { className: "row" }, button("Back to the drawing", () => actions.frame(""))));
  return parts;
}

/* Leave */

follows.report = {
  after(job) { if (job.state === "done") actions.frame(`page?path=${encodeURIComponent(job.out)}`); },
};

export function leavePanel() {
  const run = shared.run, map = site.digest ? site.path : "";
  const each = (text, hint, values, disabled) => [make("div", { className: "row" }, button(text, () => start(values), { disabled: disabled || isRunning() }), make("span", { className: "muted", textContent: hint }))];
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
