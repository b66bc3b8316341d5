/* Levels and lifts: how levels lie over each other, where a cabin is on each, and edits of both. Places are in units of the file. */
import { isPixels, level, measured, option, replaced, rounded, site, without } from "./site.js";

const STOREY_M = 4, BESIDE_M = 0.05, DOOR_M = 1.2;  // `BESIDE_M` outside a cabin is taken for inside, as Open-RMF does
const SIDES = { front: -1, back: 1 };  // of a cabin's y
const levels = () => site.document?.levels || {};
export const lifts = () => site.document?.lifts || {};
export const isCabin = (lift) => ["x", "y", "yaw", "width", "depth"].every((key) => Number.isFinite(lift?.[key]));  // others are kept as they are
export const cabins = () => Object.entries(lifts()).filter(([, lift]) => isCabin(lift));
export const doorsOn = (lift, name) => [lift.level_doors?.[name] ?? []].flat();
const elevation = (name) => Number(levels()[name]?.elevation) || 0;
export const ordered = () => Object.keys(levels()).sort((a, b) => elevation(a) - elevation(b));
const reference = () => site.document?.reference_level_name ?? Object.keys(levels())[0];
const sign = () => (isPixels() ? -1 : 1);
const times = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c];
const over = (z, [a, b]) => times(z, [a / (a * a + b * b), -b / (a * a + b * b)]);
const turnOf = ([a, b]) => Math.atan2(b, a);

/* A level on the reference level, z -> a z + b of complex numbers, y up, by the fiducials that they share (placement.py); null without two. */
function placement(name) {
  if (!isPixels() || name === reference()) return { a: [1, 0], b: [0, 0] };
  const marks = (of) => (levels()[of]?.fiducials || []).filter(Array.isArray).map(([x, y, word]) => [x, -y, word]);
  const pairs = marks(reference()).flatMap((f) => marks(name).filter((g) => g[2] === f[2]).map((g) => [f, g]));
  const steps = pairs.flatMap(([f, g], i) => pairs.slice(i + 1).map(([f2, g2]) => [[f2[0] - f[0], f2[1] - f[1]], [g2[0] - g[0], g2[1] - g[1]]])).filter((step) => step.every((one) => Math.hypot(...one) > 0));
  if (!steps.length) return null;
  const sum = (values) => values.reduce((total, value) => total + value, 0), turns = steps.map(([f, g]) => turnOf(f) - turnOf(g));
  const turn = Math.atan2(sum(turns.map(Math.sin)), sum(turns.map(Math.cos))), ratio = sum(steps.map(([f, g]) => Math.hypot(...g) / Math.hypot(...f))) / steps.length;
  const a = [Math.cos(turn) / ratio, Math.sin(turn) / ratio];
  return { a, b: [0, 1].map((k) => sum(pairs.map(([f, g]) => f[k] - times(a, g)[k])) / pairs.length) };
}

/* Metres a unit of the level that is shown, or of another: of the reference level by its measurements, of others by how they lie on it. */
export function unit(name = site.level) {
  if (!isPixels()) return 1;
  const whole = measured(reference()), lies = name === reference() ? null : placement(name);
  return whole && lies ? whole * Math.hypot(...lies.a) : measured(name) ?? whole;
}

/* A place, or with `isStep` a distance, of a level on another. */
export function between(from, to, [x, y], isStep = false) {
  const [p, q] = [placement(from), placement(to)];
  if (from === to || !p || !q) return [x, y];
  const [u, v] = times(p.a, [x, sign() * y]), shift = isStep ? [0, 0] : [p.b[0] - q.b[0], p.b[1] - q.b[1]];
  const [s, t] = over([u + shift[0], v + shift[1]], q.a);
  return [s, sign() * t];
}

/* Fiducials of the level that is shown, which another can share. */
function marks() {
  const has = level().fiducials || [];
  if (!isPixels() || has.length > 1) return has;
  const xs = (level().vertices || []).map(([x]) => x), ys = (level().vertices || []).map(([, y]) => y), words = has.map(([, , word]) => word);
  const [left, top] = [Math.min(...xs, 0), Math.min(...ys, 0)], [right, bottom] = [Math.max(...xs, left + 100), Math.max(...ys, top + 100)];
  return [...has, ...[[left, bottom, "southwest"], [right, top, "northeast"]].filter(([, , word]) => !words.includes(word))];
}

export function addLevel() {
  let n = Object.keys(levels()).length + 1;
  while (levels()[`L${n}`]) n++;
  const fiducials = marks(), [ruler] = level().measurements || [], top = Math.max(...Object.keys(levels()).map(elevation));
  const measure = ruler ? { measurements: [[0, 1, ruler[2]]], vertices: [ruler[0], ruler[1]].map((v) => [...level().vertices[v].slice(0, 2), 0, ""]) } : { measurements: [], vertices: [] };
  const added = { elevation: rounded(top + STOREY_M), ...(fiducials.length ? { fiducials } : {}), lanes: [], ...measure, walls: [] };
  const own = fiducials.length ? { ...level(), fiducials } : level();
  enter(`L${n}`, { ...site.document, reference_level_name: reference(), levels: { ...levels(), [site.level]: own, [`L${n}`]: added } });
}

const enter = (name, document) => replaced(document, [], false, name);

export const setLevel = (values) => replaced({ ...site.document, levels: { ...levels(), [site.level]: { ...level(), ...values } } });

/* A level under another name, wherever the file names it. */
export function renameLevel(name) {
  const was = site.level, own = (word) => (word === was ? name : word), renamed = (object) => Object.fromEntries(Object.entries(object).map(([key, value]) => [own(key), value]));
  if (!name || levels()[name]) return;
  const document = { ...site.document, levels: renamed(levels()) };
  if (Object.keys(levels()).length > 1 || document.reference_level_name) document.reference_level_name = own(reference());
  if (document.lifts) document.lifts = Object.fromEntries(Object.entries(lifts()).map(([word, lift]) => {
    if (!isCabin(lift)) return [word, lift];
    const floors = ["reference_floor_name", "initial_floor_name", "lowest_floor", "highest_floor"].filter((key) => key in lift).map((key) => [key, own(lift[key])]);
    return [word, { ...lift, ...Object.fromEntries(floors), level_doors: renamed(lift.level_doors || {}) }];
  }));
  enter(name, document);
}

export const canRemoveLevel = () => site.level !== reference();
export function removeLevel() {
  const rest = { ...levels() }, gone = site.level, first = reference();
  delete rest[gone];
  const kept = Object.entries(lifts()).map(([word, lift]) => {
    if (!isCabin(lift)) return [word, lift];
    const [x, y] = lift.reference_floor_name === gone ? between(gone, first, [lift.x, lift.y]) : [lift.x, lift.y];
    const at = lift.reference_floor_name === gone ? { reference_floor_name: first, x: rounded(x), y: rounded(y) } : {};
    return [word, serving({ ...lift, ...at }, Object.fromEntries(Object.entries(lift.level_doors || {}).filter(([name]) => name !== gone)))];
  });
  enter(first, { ...site.document, levels: rest, lifts: Object.fromEntries(kept) });
}

/* Lifts */

/* A lift that opens these doors on these levels; doors that are opened nowhere go. */
function serving(lift, doors) {
  const floors = ordered().filter((name) => name in doors), used = new Set(Object.values(doors).flat());
  const known = Object.fromEntries(Object.entries(lift.doors || {}).filter(([word]) => used.has(word)));
  for (const word of used) known[word] ??= { door_type: 2, motion_axis_orientation: 0, width: rounded(Math.min(DOOR_M, lift.width * 0.8)), x: 0, y: rounded((SIDES[word] ?? -1) * lift.depth / 2) };
  const ends = floors.length ? { lowest_floor: floors[0], highest_floor: floors.at(-1), initial_floor_name: floors.includes(lift.initial_floor_name) ? lift.initial_floor_name : floors[0] } : {};
  return { ...lift, ...ends, doors: known, level_doors: doors };
}

/* A cabin on a level: its middle, places of it in metres across and towards the back, and what is inside. */
export function cabin(lift, name) {
  const floor = lift.reference_floor_name || reference(), middle = between(floor, name, [lift.x, lift.y]);
  const angle = lift.yaw - turnOf(placement(name)?.a ?? [1, 0]), [c, s] = [Math.cos(angle), Math.sin(angle)], u = unit(name) || 1;
  return {
    middle,
    isServed: name in (lift.level_doors || {}),
    at: (x, y) => [middle[0] + (c * x - s * y) / u, middle[1] + (sign() * (s * x + c * y)) / u],
    holds([px, py]) {
      const [dx, dy] = [(px - middle[0]) * u, sign() * (py - middle[1]) * u];
      return Math.abs(c * dx + s * dy) <= lift.width / 2 + BESIDE_M && Math.abs(c * dy - s * dx) <= lift.depth / 2 + BESIDE_M;
    },
  };
}

export const liftAt = (xy) => cabins().find(([, lift]) => cabin(lift, site.level).holds(xy))?.[0];

/* A document with a vertex in the middle of a lift on each level that it serves, where none is inside. */
function withStops(document, lift) {
  const all = { ...document.levels };
  for (const name of Object.keys(lift.level_doors)) {
    const place = cabin(lift, name), vertices = all[name].vertices || [];
    if (!vertices.some((vertex) => place.holds(vertex))) all[name] = { ...all[name], vertices: [...vertices, [...place.middle.map(rounded), 0, ""]] };
  }
  return { ...document, levels: all };
}

export function newLift([x0, y0], [x1, y1]) {
  const u = unit() || 1, name = freeLift();
  const size = { width: rounded(Math.abs(x1 - x0) * u), depth: rounded(Math.abs(y1 - y0) * u) };
  if (!(size.width > 0.3 && size.depth > 0.3)) return;
  const about = { reference_floor_name: site.level, initial_floor_name: site.level, plugins: true, x: rounded((x0 + x1) / 2), y: rounded((y0 + y1) / 2), yaw: 0, ...size };
  const lift = serving(about, Object.fromEntries(ordered().map((floor) => [floor, ["front"]])));
  replaced(withStops({ ...site.document, lifts: { ...lifts(), [name]: lift } }, lift), [{ kind: "lifts", index: name }]);
}

function freeLift() {
  let n = 1;
  while (lifts()[`lift_${n}`]) n++;
  return `lift_${n}`;
}

export const doorChoices = (lift) => {
  const words = [...new Set([...Object.keys(SIDES), ...Object.keys(lift.doors || {})])];
  return [...words, words.join(" and ")];
};

/* Doors of a lift on a level, `front`, `front and back`; none where it passes by. */
export function setDoors(name, floor, text) {
  const doors = { ...lifts()[name].level_doors };
  if (text) doors[floor] = text.split(" and ");
  else delete doors[floor];
  const lift = serving(lifts()[name], doors);
  replaced(withStops({ ...site.document, lifts: { ...lifts(), [name]: lift } }, lift));
}

/* Other values of a lift; its doors keep to its walls. */
export function setLift(name, values) {
  const was = lifts()[name], lift = { ...was, ...values };
  lift.doors = Object.fromEntries(Object.entries(lift.doors || {}).map(([word, door]) => [word, door && { ...door, x: rounded(door.x * lift.width / was.width), y: rounded(door.y * lift.depth / was.depth) }]));
  replaced({ ...site.document, lifts: { ...lifts(), [name]: lift } });
}

export function renameLift(was, name) {
  if (!name || lifts()[name]) return;
  const cabins = (vertices) => vertices.map((vertex) => (option(vertex, "lift_cabin") === was ? [...vertex.slice(0, -1), { ...vertex.at(-1), lift_cabin: [1, name] }] : vertex));
  const all = Object.fromEntries(Object.entries(levels()).map(([floor, one]) => [floor, one.vertices ? { ...one, vertices: cabins(one.vertices) } : one]));
  replaced({ ...site.document, levels: all, lifts: Object.fromEntries(Object.entries(lifts()).map(([word, lift]) => [word === was ? name : word, lift])) }, [{ kind: "lifts", index: name }]);
}

/* A lift somewhere else, with the vertices inside it on all levels; `from` is the document before it was moved. */
export function moveLift(name, dx, dy, from = site.document, merge = false) {
  const lift = from.lifts[name], floor = lift.reference_floor_name || reference(), all = { ...from.levels };
  for (const one of Object.keys(all)) {
    const place = cabin(lift, one), [x, y] = between(site.level, one, [dx, dy], true);
    if (place.isServed) all[one] = { ...all[one], vertices: (all[one].vertices || []).map((v) => (place.holds(v) ? [rounded(v[0] + x), rounded(v[1] + y), ...v.slice(2)] : v)) };
  }
  const [x, y] = between(site.level, floor, [dx, dy], true);
  replaced({ ...from, levels: all, lifts: { ...from.lifts, [name]: { ...lift, x: rounded(lift.x + x), y: rounded(lift.y + y) } } }, site.selection, merge);
}

/* A document without lifts, nor the places inside them that no lane leads to. */
export function withoutLifts(names) {
  const rest = { ...lifts() }, all = { ...levels() };
  for (const name of names) {
    for (const floor of Object.keys(lifts()[name].level_doors || {}).filter((one) => all[one]?.vertices)) {
      const place = cabin(lifts()[name], floor), used = new Set(["lanes", "walls", "doors", "measurements"].flatMap((kind) => (all[floor][kind] || []).flatMap(([a, b]) => [a, b])));
      const loose = all[floor].vertices.flatMap((vertex, index) => (place.holds(vertex) && !used.has(index) && !vertex[3] ? [{ kind: "vertices", index }] : []));
      if (loose.length) all[floor] = { ...all[floor], ...without(loose, all[floor]) };
    }
    delete rest[name];
  }
  return { ...site.document, levels: all, lifts: rest };
}
