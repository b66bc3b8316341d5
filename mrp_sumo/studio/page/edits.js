/* Edits of the level that is shown: what is near a place, lanes led across others, and what can be done with what is chosen. */
import { between, unit, withoutLifts } from "./levels.js";
import { corners, edited, isPixels, isZone, level, list, newLane, option, replaced, rounded, site, split, without, withoutLoose, withOptions } from "./site.js";
import { toFloor, toScreen } from "./view.js";

const NEAR_PX = 10;
export const ANGLE = Math.PI / 12;
let clipboard = null;

/* The vertex nearest to a place, null where none is near: of those that robots use, or with `isOnWalls` also of corners. */
export const near = (xy, isOnWalls = false) => {
  const at = toScreen(xy), skipped = isOnWalls ? new Set() : corners();
  let best = null, least = NEAR_PX;
  list("vertices").forEach((vertex, v) => {
    if (skipped.has(v)) return;
    const p = toScreen(vertex), d = Math.hypot(p[0] - at[0], p[1] - at[1]);
    if (d < least) [best, least] = [v, d];
  });
  return best;
};

/* The item of a list nearest to a place: [index, place on it], or null. */
export function nearLine(name, xy, counts = () => true) {
  const at = toScreen(xy), vertices = list("vertices");
  let best = null, least = NEAR_PX;
  list(name).forEach((item, i) => {
    const [a, b] = item;
    if (!vertices[a] || !vertices[b] || !counts(item)) return;
    const p = toScreen(vertices[a]), q = toScreen(vertices[b]), [dx, dy] = [q[0] - p[0], q[1] - p[1]];
    const t = Math.min(1, Math.max(0, ((at[0] - p[0]) * dx + (at[1] - p[1]) * dy) / Math.max(dx * dx + dy * dy, 1e-9)));
    const on = [p[0] + t * dx, p[1] + t * dy], d = Math.hypot(on[0] - at[0], on[1] - at[1]);
    if (d < least) [best, least] = [[i, toFloor(on), t], d];
  });
  return best;
}

export const same = (a, b) => (x) => (x[0] === a && x[1] === b) || (x[0] === b && x[1] === a);


/* Lists with a lane led from vertex to vertex: through vertices that lie on it, and with a new vertex where it crosses a lane. */
export function led(a, b, options, vertices, lanes) {
  const [p, q] = [vertices[a], vertices[b]], [dx, dy] = [q[0] - p[0], q[1] - p[1]], long = Math.hypot(dx, dy), near_ = Math.min(0.05 / (unit() || 1), long / 10);
  const stops = [], on = new Set(lanes.flatMap(([i, j]) => [i, j]));
  vertices = vertices.slice();
  vertices.forEach(([x, y], v) => {
    const t = ((x - p[0]) * dx + (y - p[1]) * dy) / (long * long);
    if (v !== a && v !== b && on.has(v) && t > 0 && t < 1 && Math.abs((x - p[0]) * dy - (y - p[1]) * dx) / long < near_) stops.push([t, v]);
  });
  const through = new Set(stops.map(([, v]) => v)), result = [];
  for (const lane of lanes) {
    const [i, j, ...rest] = lane, r = vertices[i], s = vertices[j], det = dx * (s[1] - r[1]) - dy * (s[0] - r[0]);
    const t = ((r[0] - p[0]) * (s[1] - r[1]) - (r[1] - p[1]) * (s[0] - r[0])) / det, u = ((r[0] - p[0]) * dy - (r[1] - p[1]) * dx) / det;
    if (!det || t <= 0 || t >= 1 || u <= 0 || u >= 1 || [a, b].includes(i) || [a, b].includes(j) || through.has(i) || through.has(j)) { result.push(lane); continue; }
    const v = vertices.length;
    vertices.push([rounded(p[0] + t * dx), rounded(p[1] + t * dy), 0, ""]);
    stops.push([t, v]);
    result.push([i, v, ...rest], [v, j, ...rest]);
  }
  const chain = [a, ...stops.sort((x, y) => x[0] - y[0]).map(([, v]) => v), b];
  for (let k = 0; k + 1 < chain.length; k++) if (!result.some(same(chain[k], chain[k + 1]))) result.push(newLane(chain[k], chain[k + 1], options));
  return { vertices, lanes: result };
}

/* Names of vertices, or of doors, on all levels: each is there once. */
const names = (of = "vertices") => new Set(Object.values(site.document.levels).flatMap((one) => (one[of] || []).map((item) => (of === "vertices" ? item[3] : option(item, "name")))));

export function freeName(word, of = "vertices") {
  const taken = names(of);
  let n = 1;
  while (taken.has(`${word}_${n}`)) n++;
  return `${word}_${n}`;
}

export function contained([x0, y0], [x1, y1]) {
  const [l, r, t, b] = [Math.min(x0, x1), Math.max(x0, x1), Math.min(y0, y1), Math.max(y0, y1)];
  return list("vertices").flatMap(([x, y], v) => (x >= l && x <= r && y >= t && y <= b ? [v] : []));
}

/* Liang-Barsky: a segment has a part in a rectangle. */
export function crosses(p, q, a, b) {
  let [from, to] = [0, 1];
  for (const k of [0, 1]) {
    const d = q[k] - p[k], low = Math.min(a[k], b[k]), high = Math.max(a[k], b[k]);
    if (Math.abs(d) < 1e-9) { if (p[k] < low || p[k] > high) return false; continue; }
    const [t0, t1] = [(low - p[k]) / d, (high - p[k]) / d];
    [from, to] = [Math.max(from, Math.min(t0, t1)), Math.min(to, Math.max(t0, t1))];
  }
  return from < to;
}

export function removeChosen() {
  if (!site.selection.length) return;
  const gone = site.selection.filter((s) => s.kind === "lifts").map((s) => s.index);
  edited(withoutLoose(without(site.selection), level()), []);
  if (gone.length) replaced(withoutLifts(gone), [], true);
}

/* Vertices that a selection stands for: its own, and the ends of its lines. */
const endsOf = (item) => item?.vertices ?? (item || []).slice(0, 2);
export const chosenVertices = () => [...new Set(site.selection.flatMap((s) => (s.kind === "vertices" ? [s.index] : endsOf(list(s.kind)[s.index]))))];

/* True for a place within an outline. */
export function holds(one, [x, y]) {
  const at = one.vertices.map((v) => list("vertices")[v]);
  return at.filter(([ax, ay], k) => { const [bx, by] = at[(k + 1) % at.length]; return ay > y !== by > y && x < ax + ((bx - ax) * (y - ay)) / (by - ay); }).length % 2 === 1;
}

export function moved(vertices, dx, dy, from = list("vertices"), merge = false) {
  const chosen = new Set(vertices);
  edited({ vertices: list("vertices").map((item, v) => (chosen.has(v) ? [rounded(from[v][0] + dx), rounded(from[v][1] + dy), ...item.slice(2)] : item)) }, site.selection, merge);
}

export function aligned(axis) {
  const vertices = chosenVertices(), middle = vertices.reduce((sum, v) => sum + list("vertices")[v][axis], 0) / vertices.length, chosen = new Set(vertices);
  edited({ vertices: list("vertices").map((item, v) => (chosen.has(v) ? item.map((value, k) => (k === axis ? rounded(middle) : value)) : item)) });
}

export function mirrored(axis) {
  const vertices = chosenVertices(), values = vertices.map((v) => list("vertices")[v][axis]), sum = Math.min(...values) + Math.max(...values), chosen = new Set(vertices);
  edited({ vertices: list("vertices").map((item, v) => (chosen.has(v) ? item.map((value, k) => (k === axis ? rounded(sum - value) : value)) : item)) });
}

/* The chosen part by itself: its vertices, and lines between them by number among these. */
function copied() {
  const vertices = chosenVertices(), number = new Map(vertices.map((v, k) => [v, k])), part = { vertices: vertices.map((v) => list("vertices")[v]) };
  for (const name of ["lanes", "walls", "doors"]) part[name] = list(name).filter(([a, b]) => number.has(a) && number.has(b)).map(([a, b, ...rest]) => [number.get(a), number.get(b), ...rest]);
  part.floors = list("floors").filter((one) => isZone(one) && one.vertices.every((v) => number.has(v))).map((one) => ({ ...one, vertices: one.vertices.map((v) => number.get(v)) }));
  return part;
}

/* Lists with a part added somewhere else; vertices at places where there is one already are that one. */
function added(part, dx, dy, lists) {
  const vertices = lists.vertices.slice(), taken = new Set([...names(), ...vertices.map((v) => v[3])]), index = new Map(vertices.map(([x, y], v) => [`${rounded(x)} ${rounded(y)}`, v]));
  const at = part.vertices.map(([x, y, z, name, ...rest]) => {
    const place = [rounded(x + dx), rounded(y + dy)], key = place.join(" ");
    if (!index.has(key)) {
      index.set(key, vertices.length);
      let free = name;
      for (let n = 2; free && taken.has(free); n++) free = `${String(name).replace(/_\d+$/, "")}_${n}`;
      taken.add(free);
      vertices.push([...place, z ?? 0, free, ...rest]);
    }
    return index.get(key);
  });
  const result = { ...lists, vertices };
  for (const name of ["lanes", "walls", "doors"]) {
    const items = (lists[name] || []).slice();
    for (const [a, b, ...rest] of part[name]) if (at[a] !== at[b] && !items.some(same(at[a], at[b]))) items.push([at[a], at[b], ...rest]);
    if (items.length) result[name] = items;
  }
  if (part.floors.length) result.floors = [...(lists.floors || []), ...part.floors.map((one) => ({ ...one, vertices: one.vertices.map((v) => at[v]) }))];
  const ends = new Set(part.lanes.flatMap(([a, b]) => [at[a], at[b]]).filter((v) => v >= lists.vertices.length));
  if (ends.size) result.lanes = throughEnds(vertices, result.lanes, ends);
  return result;
}

/* Lanes led through those vertices that lie on them. */
function throughEnds(vertices, lanes, ends) {
  const near_ = 0.05 / (unit() || 1);
  return lanes.flatMap((lane) => {
    const [a, b, ...rest] = lane, [p, q] = [vertices[a], vertices[b]], [dx, dy] = [q[0] - p[0], q[1] - p[1]], long = Math.hypot(dx, dy);
    const stops = [...ends].filter((v) => v !== a && v !== b).map((v) => [((vertices[v][0] - p[0]) * dx + (vertices[v][1] - p[1]) * dy) / (long * long), v])
      .filter(([t, v]) => t > 0 && t < 1 && Math.abs((vertices[v][0] - p[0]) * dy - (vertices[v][1] - p[1]) * dx) / long < near_).sort((x, y) => x[0] - y[0]);
    const chain = [a, ...stops.map(([, v]) => v), b];
    return chain.slice(1).map((v, k) => [chain[k], v, ...rest]);
  });
}

const lists = () => Object.fromEntries(["vertices", "lanes", "walls", "doors", "floors"].filter((name) => level()[name] || name === "vertices").map((name) => [name, list(name)]));

export function repeated(times, dx_m, dy_m) {
  const part = copied(), u = unit() || 1, y = isPixels() ? -1 : 1;
  if (!part.vertices.length) return;
  let all = lists();
  for (let n = 1; n <= times; n++) all = added(part, (n * dx_m) / u, (y * n * dy_m) / u, all);
  edited(all);
}

export function copy() { clipboard = { ...copied(), of: site.level }; }

/* What was copied, beside where it was; on another level at the same place. */
export function paste(step_m) {
  if (!clipboard?.vertices.length) return;
  const shift = clipboard.of === site.level ? (unit() ? (5 * step_m) / unit() : 10) : 0;
  clipboard = { ...clipboard, of: site.level, vertices: clipboard.vertices.map((v) => [...between(clipboard.of, site.level, v).map(rounded), ...v.slice(2)]) };
  const before = list("vertices").length, all = added(clipboard, shift, shift, lists());
  edited(all, all.vertices.slice(before).map((_, k) => ({ kind: "vertices", index: before + k })));
}

/* A lane as an arc that stands off its chord by so many metres, to the left where that is above 0. */
export function bent(index, off_m) {
  const [a, b, ...rest] = list("lanes")[index], [p, q] = [list("vertices")[a], list("vertices")[b]], off = off_m / (unit() || 1);
  const chord = Math.hypot(q[0] - p[0], q[1] - p[1]);
  if (!off || !chord) return;
  const half = 2 * Math.atan((2 * Math.abs(off)) / chord), pieces = Math.max(2, Math.ceil((2 * half) / ANGLE)), radius = chord / (2 * Math.sin(half));
  const [ux, uy] = [(q[0] - p[0]) / chord, (q[1] - p[1]) / chord], side = Math.sign(off) * (isPixels() ? 1 : -1);
  const vertices = list("vertices").slice(), chain = [a];
  for (let k = 1; k < pieces; k++) {
    const angle = -half + (2 * half * k) / pieces, along = chord / 2 + radius * Math.sin(angle), across = side * (radius * Math.cos(angle) - radius * Math.cos(half));
    chain.push(vertices.length);
    vertices.push([rounded(p[0] + along * ux + across * uy), rounded(p[1] + along * uy - across * ux), 0, ""]);
  }
  chain.push(b);
  const lanes = list("lanes").filter((_, i) => i !== index);
  for (let k = 0; k + 1 < chain.length; k++) lanes.push([chain[k], chain[k + 1], ...rest]);
  edited({ vertices, lanes }, []);
}

/* Chosen lanes with others beside them, joined at each end: one for each direction of those that go both ways, where there is more room. */
export function doubled(apart_m) {
  const chosen = site.selection.filter((s) => s.kind === "lanes").map((s) => list("lanes")[s.index]).filter(Boolean);
  const far = apart_m / (unit() || 1), before = list("vertices"), sides = new Map();
  for (const [a, b] of chosen) {
    const [dx, dy] = [before[b][0] - before[a][0], before[b][1] - before[a][1]], long = Math.hypot(dx, dy) || 1;
    for (const v of [a, b]) {
      const [x, y] = [-dy / long, dx / long], [first] = sides.values(), turn = first && first[0][0] * x + first[0][1] * y < 0 ? -1 : 1;
      sides.set(v, [...(sides.get(v) || []), [turn * x, turn * y]]);
    }
  }
  const offsets = [1, -1].map((side) => new Map([...sides].map(([v, normals]) => {
    const sum = [0, 1].map((k) => normals.reduce((total, n) => total + n[k], 0)), share = (side * far * normals.length) / Math.max(sum[0] ** 2 + sum[1] ** 2, 0.1);
    return [v, [rounded(before[v][0] + sum[0] * share), rounded(before[v][1] + sum[1] * share)]];
  })));
  const places = roomOf([...offsets[0].values()]) < roomOf([...offsets[1].values()]) ? offsets[1] : offsets[0];
  let lists = { vertices: before.slice(), lanes: list("lanes") };
  const twin = new Map();
  for (const [v, [x, y]] of places) {
    const there = lists.vertices.findIndex((p) => Math.hypot(p[0] - x, p[1] - y) < far / 20);
    twin.set(v, there < 0 ? lists.vertices.push([x, y, 0, ""]) - 1 : there);
  }
  lists.lanes = throughEnds(lists.vertices, lists.lanes, new Set(twin.values()));
  for (const [v, other] of twin) if (!lists.lanes.some(same(v, other))) lists = led(v, other, {}, lists.vertices, lists.lanes);
  for (const [a, b, options = {}] of chosen) {
    const [x, y] = places.get(a), [dx, dy] = [before[b][0] - before[a][0], before[b][1] - before[a][1]], turn = isPixels() ? 1 : -1;
    const isBoth = options.bidirectional?.[1], isLeft = turn * (dy * (x - before[a][0]) - dx * (y - before[a][1])) > 0, { mutex, ...rest } = options;
    const [from, to] = isBoth && isLeft ? [b, a] : [a, b];  // traffic keeps to the right
    lists = led(twin.get(from), twin.get(to), { ...rest, bidirectional: [4, false] }, lists.vertices, lists.lanes);
    if (isBoth) lists.lanes = lists.lanes.map((lane) => (lane[0] === a && lane[1] === b ? withOptions([to, from, ...lane.slice(2)], { bidirectional: false }) : lane));
  }
  site.change = `double_lane_${site.selection.find((s) => s.kind === "lanes").index}`;
  edited(lists, []);
}

/* How far places are from the nearest wall; Infinity without any. */
const roomOf = (places) => Math.min(...list("walls").flatMap(([a, b]) => places.map(([x, y]) => {
  const [p, q] = [list("vertices")[a], list("vertices")[b]], [dx, dy] = [q[0] - p[0], q[1] - p[1]];
  const t = Math.min(1, Math.max(0, ((x - p[0]) * dx + (y - p[1]) * dy) / Math.max(dx * dx + dy * dy, 1e-9)));
  return Math.hypot(p[0] + t * dx - x, p[1] + t * dy - y);
})), Infinity);

/* A vertex that was dropped on another, or on a lane that is not its own: its name and purpose go there, or, without any, its lanes. True if so. */
export function dropped({ hit: { index }, document }, xy) {
  const moved_ = site.document, vertex = list("vertices")[index], isStation = vertex[3] || vertex.length > 4;
  site.document = document;  // as it was before
  const own = (lane) => lane[0] === index || lane[1] === index, lane = nearLine("lanes", xy, (one) => !own(one));
  let to = near(xy), lists = { vertices: list("vertices"), lanes: list("lanes") };
  if (to === null && lane) {
    lists = split(lane[0], lane[1]);
    to = lists.vertices.length - 1;
  }
  const there = lists.vertices[to];
  if (to === null || to === index || there[3] || there.length > 4) {
    site.document = moved_;
    return false;
  }
  const was = lists.vertices[index], joins = !isStation || !lists.lanes.some(own);
  lists.vertices = lists.vertices.map((one, v) => (v === to && isStation ? [...one.slice(0, 3), ...was.slice(3)] : v === index ? [...one.slice(0, 3), ""] : one));
  if (joins) {
    const joined_ = lists.lanes.map((one) => [...one.slice(0, 2).map((v) => (v === index ? to : v)), ...one.slice(2)]).filter(([a, b]) => a !== b);
    lists.lanes = joined_.filter((one, i) => joined_.findIndex(same(one[0], one[1])) === i);
  }
  const isLoose = !["lanes", "walls", "doors", "measurements"].some((name) => (lists[name] || list(name)).some(own));
  if (isLoose) lists = without([{ kind: "vertices", index }], { ...level(), ...lists });
  if (isStation) site.change = `move_${was[3] || index}`;
  edited(lists, [{ kind: "vertices", index: isLoose && to > index ? to - 1 : to }], true);
  return true;
}

/* Set options of all chosen items of a list. */
export function setOptions(kind, values) {
  const chosen = new Set(site.selection.filter((s) => s.kind === kind).map((s) => s.index));
  edited({ [kind]: list(kind).map((item, i) => (chosen.has(i) ? withOptions(kind === "vertices" && item.length < 4 ? [...item, ""] : item, values) : item)) });
}

export function renamed(index, name) {
  edited({ vertices: list("vertices").map((item, v) => (v === index ? [...item.slice(0, 3), name, ...item.slice(4)] : item)) });
}

export function turned() {
  const chosen = new Set(site.selection.filter((s) => s.kind === "lanes").map((s) => s.index));
  site.change = `turn_lane_${[...chosen][0]}`;
  edited({ lanes: list("lanes").map((item, i) => (chosen.has(i) ? [item[1], item[0], ...item.slice(2)] : item)) });
}
