/* The drawing that is open, as a building.yaml says it, and how it came about: every edit makes a new document that shares what stays. */

export const site = {
  path: "", digest: "", from: "", document: null, level: "", saved: null, selection: [], findings: [], refused: true, size: null, heat: null, change: "", plan: null,
};
const past = [], future = [], listeners = [];
const LISTS = ["lanes", "walls", "doors", "measurements"], OUTLINES = ["floors", "holes"];
const TAGS = { string: 1, boolean: 4 };

export const onChange = (listener) => listeners.push(listener);
export const changed = (what = "view") => listeners.forEach((listener) => listener(what));
export const isDirty = () => site.document !== null && site.document !== site.saved;
export const canUndo = () => past.length > 0;
export const canRedo = () => future.length > 0;
export const level = () => site.document?.levels?.[site.level] || {};
export const list = (name) => level()[name] || [];
export const isPixels = () => (site.document?.coordinate_system || "reference_image") === "reference_image";

export function opened(drawing) {
  Object.assign(site, { path: drawing.path, digest: drawing.digest, from: drawing.from, document: drawing.document, selection: [], findings: [], refused: true, heat: null, change: "", plan: null });
  site.saved = drawing.digest ? drawing.document : null;
  const levels = Object.keys(drawing.document.levels || {});
  site.level = levels.includes(site.level) ? site.level : levels[0] || "";
  past.length = future.length = 0;
  changed("opened");
}

/* Replace the document; `merge` joins an edit with the one before, as while something is dragged. */
export function replaced(document, selection = site.selection, merge = false, shown = site.level) {
  if (!merge) past.push([site.document, site.selection, site.level]);
  future.length = 0;
  Object.assign(site, { document, selection, level: shown });
  changed("document");
}

/* Replace lists of the level that is shown. */
export function edited(lists, selection, merge) {
  const levels = { ...site.document.levels, [site.level]: { ...level(), ...lists } };
  replaced({ ...site.document, levels }, selection, merge);
}

export function undo(from = past, to = future) {
  if (!from.length) return;
  to.push([site.document, site.selection, site.level]);
  [site.document, site.selection, site.level] = from.pop();
  changed("document");
}
export const redo = () => undo(future, past);

/* Metres a unit by the measurements of a level; null without any. */
export function measured(name) {
  const one = site.document?.levels?.[name] || {};
  const scales = (one.measurements || []).map(([a, b, options]) => {
    const [p, q] = [one.vertices?.[a], one.vertices?.[b]];
    return p && q && options?.distance ? options.distance[1] / Math.hypot(p[0] - q[0], p[1] - q[1]) : NaN;
  }).filter((scale) => scale > 0 && Number.isFinite(scale));
  return scales.length ? scales.reduce((sum, scale) => sum + scale, 0) / scales.length : null;
}

export const option = (item, name) => (item?.at(-1)?.constructor === Object ? item.at(-1)[name]?.[1] : undefined);

/* An item with other options; those that are null, false or "" go. */
export function withOptions(item, values) {
  const has = item.at(-1)?.constructor === Object;
  const options = { ...(has ? item.at(-1) : {}) };
  for (const [name, value] of Object.entries(values)) {
    if (value === null || value === "" || (value === false && name !== "bidirectional")) delete options[name];
    else options[name] = [options[name]?.[0] ?? TAGS[typeof value] ?? (Number.isInteger(value) ? 2 : 3), value];
  }
  const rest = has ? item.slice(0, -1) : item.slice();
  return Object.keys(options).length || has ? [...rest, options] : rest;
}

export const newLane = (a, b, options = {}) => [a, b, { bidirectional: [4, true], graph_idx: [2, 0], orientation: [1, ""], ...options }];
export const newWall = (a, b) => [a, b, { alpha: [3, 1], texture_name: [1, "default"] }];
export const rounded = (value) => Math.round(value * 1000) / 1000;

/* The lists of a level without some vertices, all that they carry and some items of other lists. */
export function without(selection, of = level()) {
  const list = (name) => of[name] || [];
  const gone = new Set(selection.filter((s) => s.kind === "vertices").map((s) => s.index));
  const number = [];
  let next = 0;
  list("vertices").forEach((_, v) => number.push(gone.has(v) ? -1 : next++));
  const lists = { vertices: list("vertices").filter((_, v) => !gone.has(v)) };
  for (const name of LISTS) {
    if (!of[name]) continue;
    const these = new Set(selection.filter((s) => s.kind === name).map((s) => s.index));
    lists[name] = list(name).filter(([a, b], i) => !these.has(i) && !gone.has(a) && !gone.has(b)).map((item) => (gone.size ? [number[item[0]], number[item[1]], ...item.slice(2)] : item));
  }
  for (const name of OUTLINES) {
    const these = new Set(selection.filter((s) => s.kind === name).map((s) => s.index));
    if (!of[name] || !(gone.size || these.size)) continue;
    lists[name] = list(name).filter((_, i) => !these.has(i)).map((one) => ({ ...one, vertices: one.vertices.filter((v) => !gone.has(v)).map((v) => number[v]) })).filter((one) => one.vertices.length > 2);
  }
  return lists;
}

/* A floor that no robot may be on. */
export const isZone = (floor) => Boolean(floor.parameters?.no_robots?.[1]);
const isBare = (vertex) => !vertex[3] && vertex.length < 5;
const ends = (all, names) => names.flatMap((name) => (all[name] || []).flatMap(([a, b]) => [a, b]));
const used = (all) => new Set([...ends(all, LISTS), ...OUTLINES.flatMap((name) => (all[name] || []).flatMap((one) => one.vertices))]);

/* Vertices that are only corners of walls, ends of doors and rulers, and such: robots have no use for them. */
export function corners() {
  const all = used(level());
  for (const v of ends(level(), ["lanes"])) all.delete(v);
  return new Set([...all].filter((v) => list("vertices")[v] && isBare(list("vertices")[v])));
}

/* Corners of walls and ends of rulers that nothing uses any more go with what used them. */
export function withoutLoose(lists, before) {
  if (lists.vertices.length !== before.vertices.length) return lists;
  const was = used(before), is = used({ ...before, ...lists });
  const loose = [...was].filter((v) => !is.has(v) && isBare(before.vertices[v]));
  return loose.length ? without(loose.map((index) => ({ kind: "vertices", index })), { ...before, ...lists }) : lists;
}

/* [vertices, lanes] with a lane led over a new vertex; the vertex is the last. */
export function split(lane, xy) {
  const vertices = [...list("vertices"), [rounded(xy[0]), rounded(xy[1]), 0, ""]], v = vertices.length - 1;
  const [a, b, ...rest] = list("lanes")[lane];
  const lanes = list("lanes").slice();
  lanes[lane] = [a, v, ...rest];
  lanes.push([v, b, ...rest]);
  return { vertices, lanes };
}
