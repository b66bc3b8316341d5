/* The panel of the drawing: what is chosen, the level, what can be changed about them, and findings. */
import { make } from "./elements.js";
import { whatIfPart } from "./ask.js";
import { canRemoveLevel, doorChoices, doorsOn, isCabin, lifts, ordered, removeLevel, renameLevel, renameLift, setDoors, setLevel, setLift, unit } from "./levels.js";
import { button, check, field, fields, muted, next } from "./parts.js";
import { actions, shared } from "./shared.js";
import { changed, edited, isDirty, level, list, option, rounded, site } from "./site.js";
import { aligned, bent, chosenVertices, doubled, mirrored, removeChosen, renamed, repeated, setOptions, turned } from "./edits.js";
import { choose, tool } from "./tools.js";
import { camera, KINDS, up } from "./view.js";

const LANE_KINDS = ["forward", "backward"];

export function drawPanel() {
  if (!site.document) return [next("Open or begin a floor first."), button("Floor", () => actions.show("floor"), { className: "main" })];
  const parts = [], lanes = list("lanes").length, stations = list("vertices").filter((v) => v[3]).length;
  if (!unit()) parts.push(next("This level has no scale yet."), button("Scale (m)", () => choose("scale"), { className: "main" }));
  else if (!lanes) parts.push(next("Press ", make("kbd", { textContent: "l" }), " and click along the aisles: lanes join where they meet. On the Floor step, lanes can be laid all over a picture."));
  else if (stations < 2) parts.push(next("Press ", make("kbd", { textContent: "s" }), " and click where loads are picked up and set down; name the places and say what they are for."));
  else if (site.refused) parts.push(next("Mend what is found below: click a line to go there."));
  else parts.push(next(site.findings.some((f) => f.kind === "narrow_lanes") ? `Robots of type ${shared.robot} have no room where it is ringed, and are not planned there: move these lanes, or choose another robot below. Else save it, and go to Orders.` : "It can be driven on. Save it, and go to Orders."), make("div", { className: "row" }, button("Orders", () => actions.show("orders"), { className: "main" })));
  parts.push(...properties(), ...(site.saved && isDirty() && shared.scenario ? whatIfPart() : []), ...findings());
  return parts;
}

function properties() {
  const parts = [], chosen = site.selection;
  const one = chosen.length === 1 ? chosen[0] : null, kinds = new Set(chosen.map((s) => s.kind));
  if (one?.kind === "vertices") parts.push(...vertexPart(one.index));
  else if (kinds.size === 1 && kinds.has("lanes")) parts.push(...lanePart());
  else if (one?.kind === "doors") parts.push(...doorPart(one.index));
  else if (one?.kind === "measurements") parts.push(...rulerPart(one.index));
  else if (one?.kind === "floors") parts.push(make("h2", { textContent: "Zone without robots" }), muted("No robot is planned through it, nor near enough to reach into it. Drag its corners."));
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

const beside = { apart_m: 1 };
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
      field("width", { type: "number", value: option(first, "width") || "", unit: "m", least: 0, placeholder: "what walls leave", says: "robots that are wider are not planned over it" }, (value) => setOptions("lanes", { width: value })),
      field("driven", { choices: LANE_KINDS, value: option(first, "orientation") || "" }, (value) => setOptions("lanes", { orientation: value ?? null })),
      field("group", { value: option(first, "mutex") ?? "", says: "of lanes and vertices for one robot at a time" }, (value) => setOptions("lanes", { mutex: value })),
    ),
    fields(field("a second lane", { type: "number", value: beside.apart_m, unit: "m apart", least: 0.1 }, (value) => (beside.apart_m = value || 1))),
    make("div", { className: "row" }, button("Double", () => doubled(beside.apart_m), { title: "a lane for each direction, beside each other, where there is more room" }), button("Turn round", turned, { title: "the other direction; of one-way lanes", disabled: chosen.every((lane) => option(lane, "bidirectional")) })),
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
  if (!isCabin(lift)) return [];
  const choices = doorChoices(lift), size = (key) => field(key, { type: "number", value: lift[key], unit: "m", least: 0.3 }, (value) => value > 0 && setLift(name, { [key]: value }));
  return [make("h2", { textContent: `Lift ${name}` }), fields(
    field("name", { value: name }, (value) => renameLift(name, value)),
    size("width"), size("depth"),
    field("turned by", { type: "number", value: rounded((lift.yaw * 180) / Math.PI), unit: "°", says: "counter-clockwise; at 0 the front is below" }, (value) => setLift(name, { yaw: Number((((value ?? 0) * Math.PI) / 180).toFixed(6)) })),
  ), make("h3", { textContent: "Doors" }), fields(...ordered().map((floor) => field(`on ${floor}`, { choices, value: doorsOn(lift, floor).join(" and ") || null, says: "none: it passes by" }, (value) => setDoors(name, floor, value)))),
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

const visits = new Map();  // text of a finding -> how often somebody went there
function findings() {
  const parts = [make("h3", { textContent: site.findings.length ? `Found (${site.findings.length})` : "Nothing to report" })];
  if (site.size?.vertices) parts.push(muted(`${site.size.vertices} vertices and ${site.size.lanes} directed lanes to drive on`));
  parts.push(make("ul", { className: "list" }, ...site.findings.slice(0, 100).map((finding) => make("li", {}, make("button", {
    type: "button", className: `finding ${finding.severity}`, title: finding.places.length > 1 ? "go there; again: to the next" : finding.places.length ? "go there" : "",
    onclick: () => {
      const visit = visits.get(finding.text) ?? 0, [name, x, y] = finding.places[visit % finding.places.length] || [];
      if (!name) return;
      visits.set(finding.text, visit + 1);
      site.level = name;
      Object.assign(camera, { x, y, scale: Math.max(camera.scale, 15 / ((1 / (unit() || 0.05)) * 1)) });
      changed("view");
    },
  }, make("span", { textContent: finding.text }), finding.cure ? make("small", { textContent: ` – ${finding.cure}` }) : null)))));
  return parts;
}

