/* Tools: what a click, a drag and a key on the floor do. A tool gets places in units of the drawing, already snapped. */
import { ANGLE, chosenVertices, contained, copy, crosses, dropped, freeName, holds, led, moved, near, nearLine, paste, removeChosen, same } from "./edits.js";
import { liftAt, moveLift, newLift, unit } from "./levels.js";
import { changed, edited, isPixels, isZone, list, newWall, redo, rounded, site, split, undo, without } from "./site.js";
import { camera, fit, overlay, redraw, toFloor, toScreen, zoom } from "./view.js";

const canvas = document.getElementById("floor");
export const TOOLS = [
  ["select", "v", "Select", "Click or drag what is to be changed; drag the floor to move it; Shift-drag chooses a rectangle. Delete removes."],
  ["lane", "l", "Lanes", "Click from place to place; near a lane it joins it. Esc or a double click ends. Shift keeps angles."],
  ["oneway", "o", "One-way lanes", "As lanes, in the direction that is drawn."],
  ["station", "s", "Station", "Click on a lane, or on a vertex; then say its name and what it is for."],
  ["wall", "w", "Walls", "Click from corner to corner. Esc or a double click ends."],
  ["rack", "r", "Rack", "Drag a rectangle: four walls."],
  ["zone", "z", "No robots", "Drag a rectangle: a zone that no robot is planned through."],
  ["door", "d", "Door", "Click both ends of a door; along a wall it opens it."],
  ["lift", "e", "Lift", "Drag a rectangle: the cabin, on all levels. Then lead a lane to the place in its middle on each."],
  ["clear", "x", "Clear", "Drag a rectangle: no lanes within."],
  ["scale", "m", "Scale", "Click two places whose distance you know."],
];
export const tool = { name: "select", chain: [], drag: null, step_m: 0.1, snaps: true, ask: null };

export function choose(name) {
  Object.assign(tool, { name, chain: [], drag: null });
  changed("tool");
  redraw();
}

export function pick(xy) {
  const v = near(xy) ?? near(xy, true);
  if (v !== null) return { kind: "vertices", index: v };
  for (const name of ["lanes", "doors", "walls", "measurements"]) {
    const hit = nearLine(name, xy);
    if (hit) return { kind: name, index: hit[0] };
  }
  const zone = list("floors").findIndex((one) => isZone(one) && holds(one, xy)), lift = liftAt(xy);
  if (zone >= 0) return { kind: "floors", index: zone };
  return lift ? { kind: "lifts", index: lift } : null;
}

/* A place on the grid of the step; with Shift at an angle of 15 degrees to the place before. */
export function snapped(xy, shift = false) {
  const last = tool.chain.at(-1);
  const from = typeof last === "number" ? list("vertices")[last] : last;
  if (shift && from) {
    const [dx, dy] = [xy[0] - from[0], xy[1] - from[1]], angle = Math.round(Math.atan2(dy, dx) / ANGLE) * ANGLE, far = Math.hypot(dx, dy);
    return [rounded(from[0] + far * Math.cos(angle)), rounded(from[1] + far * Math.sin(angle))];
  }
  const step = tool.snaps && unit() ? tool.step_m / unit() : 0;
  return step ? xy.map((value) => rounded(Math.round(value / step) * step)) : xy.map(rounded);
}

/* A vertex at a place: one that is there, one on a lane, which it splits, or a new one; of walls only a corner. */
function vertexAt(xy, shift, onLanes = true) {
  const there = near(xy, !onLanes);
  if (there !== null) return [there, {}];
  const lane = onLanes ? nearLine("lanes", xy) : null;
  if (lane) {
    const lists = split(lane[0], lane[1]);
    return [lists.vertices.length - 1, lists];
  }
  const vertices = [...list("vertices"), [...snapped(xy, shift), 0, ""]];
  return [vertices.length - 1, { vertices }];
}

function joined(name, xy, shift) {
  const [v, lists] = vertexAt(xy, shift, name === "lanes");
  const before = tool.chain.at(-1), items = lists[name] || list(name);
  if (before !== undefined && before !== v && !items.some(same(before, v))) {
    if (name === "walls") lists.walls = [...items, newWall(before, v)];
    else Object.assign(lists, led(before, v, tool.name === "oneway" ? { bidirectional: [4, false] } : {}, lists.vertices || list("vertices"), items));
  }
  if (Object.keys(lists).length) edited(lists, [{ kind: "vertices", index: v }]);
  tool.chain = [...tool.chain.filter((x) => typeof x === "number"), v];
}

const CLICKS = {
  select(xy, event) {
    const hit = pick(xy);
    if (!hit) site.selection = event.shiftKey ? site.selection : [];
    else if (event.shiftKey) site.selection = [...site.selection, hit];
    else if (!site.selection.some((s) => s.kind === hit.kind && s.index === hit.index)) site.selection = [hit];
    changed("selection");
  },
  lane: (xy, event) => joined("lanes", xy, event.shiftKey),
  oneway: (xy, event) => joined("lanes", xy, event.shiftKey),
  wall: (xy, event) => joined("walls", xy, event.shiftKey),
  station(xy, event) {
    const [v, lists] = vertexAt(xy, event.shiftKey);
    const vertices = (lists.vertices || list("vertices")).slice();
    if (vertices[v][3] === "" || vertices[v][3] === null) vertices[v] = [...vertices[v].slice(0, 3), freeName("station"), ...vertices[v].slice(4)];
    edited({ ...lists, vertices }, [{ kind: "vertices", index: v }]);
    changed("named");
  },
  door(xy, event) {
    const place = snapped(xy, event.shiftKey);
    if (!tool.chain.length) { tool.chain = [place]; return; }
    const n = list("vertices").length;
    const options = { motion_axis: [1, "start"], motion_degrees: [3, 90], motion_direction: [2, 1], name: [1, freeName("door", "doors")], plugin: [1, "normal"], right_left_ratio: [3, 1], type: [1, "hinged"] };
    edited({ vertices: [...list("vertices"), [...tool.chain[0], 0, ""], [...place, 0, ""]], doors: [...list("doors"), [n, n + 1, options]] }, [{ kind: "doors", index: list("doors").length }]);
    tool.chain = [];
  },
  async scale(xy) {
    if (!tool.chain.length) { tool.chain = [xy.map(rounded)]; return; }
    const [p, q] = [tool.chain[0], xy.map(rounded)];
    tool.chain = [];
    if (Math.hypot(p[0] - q[0], p[1] - q[1]) < 1e-6) return;
    const metres = await tool.ask("How far apart are the two places?", "metres", "");
    if (!(metres > 0)) return;
    const n = list("vertices").length;
    edited({ vertices: [...list("vertices"), [...p, 0, ""], [...q, 0, ""]], measurements: [...list("measurements"), [n, n + 1, { distance: [3, metres] }]] }, []);
    changed("scaled");
  },
};

const RECTANGLES = {
  rack([x0, y0], [x1, y1]) {
    const n = list("vertices").length, corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    const walls = corners.map((_, k) => newWall(n + k, n + ((k + 1) % 4)));
    const first = list("walls").length;
    edited({ vertices: [...list("vertices"), ...corners.map((c) => [...c, 0, ""])], walls: [...list("walls"), ...walls] }, walls.map((_, k) => ({ kind: "walls", index: first + k })));
  },
  zone([x0, y0], [x1, y1]) {
    const n = list("vertices").length, corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    const zone = { parameters: { no_robots: [4, true] }, vertices: corners.map((_, k) => n + k) };
    edited({ vertices: [...list("vertices"), ...corners.map((c) => [...c, 0, ""])], floors: [...list("floors"), zone] }, [{ kind: "floors", index: list("floors").length }]);
  },
  lift: newLift,
  clear(a, b) {
    const inside = contained(a, b), lanes = [];
    const on = new Set(list("lanes").flatMap(([p, q]) => [p, q])), gone = inside.filter((v) => on.has(v));
    list("lanes").forEach(([p, q], index) => crosses(list("vertices")[p], list("vertices")[q], a, b) && lanes.push({ kind: "lanes", index }));
    edited(without([...gone.map((index) => ({ kind: "vertices", index })), ...lanes]), []);
  },
  select(a, b) {
    const inside = new Set(contained(a, b)), chosen = [...inside].map((index) => ({ kind: "vertices", index }));
    for (const name of ["lanes", "walls", "doors"]) list(name).forEach(([p, q], index) => inside.has(p) && inside.has(q) && chosen.push({ kind: name, index }));
    list("floors").forEach((one, index) => isZone(one) && one.vertices.every((v) => inside.has(v)) && chosen.push({ kind: "floors", index }));
    site.selection = chosen;
    changed("selection");
  },
};

/* Pointer and keys */

const place = (event) => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };

canvas.addEventListener("pointerdown", (event) => {
  if (!site.document) return;
  canvas.focus();
  canvas.setPointerCapture(event.pointerId);
  const at = place(event), xy = toFloor(at), hit = tool.name === "select" && event.button === 0 ? pick(xy) : null;
  const rectangle = event.button === 0 && tool.name in RECTANGLES && (tool.name !== "select" || event.shiftKey);
  overlay.cross = null;
  tool.drag = { at, xy, from: [camera.x, camera.y], isMove: false, rectangle, vertices: null, was: list("vertices"), document: site.document };
  if (rectangle) return;
  if (hit?.kind === "vertices") {
    const isChosen = site.selection.some((s) => s.kind === "vertices" && s.index === hit.index);
    tool.drag.vertices = isChosen ? chosenVertices() : [hit.index];
    tool.drag.hit = hit;
  } else if (hit?.kind === "lifts") Object.assign(tool.drag, { hit, lift: hit.index });
  else if (hit && site.selection.some((s) => s.kind === hit.kind && s.index === hit.index)) tool.drag.vertices = chosenVertices();
});

canvas.addEventListener("pointermove", (event) => {
  if (!site.document) return;
  const at = place(event), xy = toFloor(at), drag = tool.drag;
  document.dispatchEvent(new CustomEvent("pointer", { detail: xy }));
  if (!drag) {
    if (tool.chain.length) { tool.preview = snapped(xy, event.shiftKey); redraw(); }
    return;
  }
  if (!drag.isMove && Math.hypot(at[0] - drag.at[0], at[1] - drag.at[1]) < 4) return;
  const first = !drag.isMove;
  drag.isMove = true;
  if (drag.rectangle) drag.to = xy;
  else if (drag.lift) {
    site.selection = [drag.hit];
    moveLift(drag.lift, ...snapped([xy[0] - drag.xy[0], xy[1] - drag.xy[1]]), drag.document, !first);
  }
  else if (drag.vertices) {
    if (first && drag.hit && !site.selection.some((s) => s.kind === "vertices" && s.index === drag.hit.index)) site.selection = [drag.hit];
    const main = drag.was[drag.hit?.index ?? drag.vertices[0]], target = snapped([main[0] + xy[0] - drag.xy[0], main[1] + xy[1] - drag.xy[1]]);
    moved(drag.vertices, target[0] - main[0], target[1] - main[1], drag.was, !first);
  } else {
    const moved_ = [drag.at[0] - at[0], drag.at[1] - at[1]], origin = toFloor([0, 0]), shift = toFloor(moved_);
    camera.isTouched = true;
    camera.x = drag.from[0] + shift[0] - origin[0];
    camera.y = drag.from[1] + shift[1] - origin[1];
  }
  redraw();
});

canvas.addEventListener("pointerup", (event) => {
  const drag = tool.drag;
  tool.drag = null;
  if (!drag) return;
  if (!drag.isMove) { if (event.button === 0) click(drag.xy, event); }
  else if (drag.rectangle && drag.to) RECTANGLES[tool.name](snapped(drag.xy), snapped(drag.to));
  else if (drag.vertices || drag.lift) {
    const name = drag.vertices && list("vertices")[drag.vertices[0]][3];
    if (!(drag.hit?.kind === "vertices" && drag.vertices.length === 1 && dropped(drag, toFloor(place(event)))) && name) site.change = `move_${name}`;
    changed("dragged");
  }
  redraw();
});
canvas.addEventListener("dblclick", () => { tool.chain = []; tool.preview = null; redraw(); });
canvas.addEventListener("contextmenu", (event) => { event.preventDefault(); tool.chain = []; redraw(); });
canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(-event.deltaY / 400), place(event)); }, { passive: false });

function click(xy, event) {
  CLICKS[tool.name]?.(xy, event);
  redraw();
}

overlay.draw = (pen, at) => {
  const drag = tool.drag;
  if (drag?.rectangle && drag.to) {
    const [a, b] = [toScreen(drag.xy), toScreen(drag.to)];
    pen.setLineDash([5, 4]);
    pen.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue("--accent");
    pen.lineWidth = 1.5;
    pen.strokeRect(a[0], a[1], b[0] - a[0], b[1] - a[1]);
    pen.setLineDash([]);
  }
  const last = tool.chain.at(-1), from = typeof last === "number" ? at[last] : last && toScreen(last);
  if (from && tool.preview) {
    pen.setLineDash([4, 4]);
    pen.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue("--accent");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(...from);
    pen.lineTo(...toScreen(tool.preview));
    pen.stroke();
    pen.setLineDash([]);
  }
};

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export function key(event) {
  if (!site.document || document.querySelector("dialog[open]")) return false;
  const typing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName), meta = event.ctrlKey || event.metaKey;
  if (typing && !(meta && event.key === "s")) return false;
  if (meta && event.key === "z") event.shiftKey ? redo() : undo();
  else if (meta && event.key === "y") redo();
  else if (meta && event.key === "c") copy();
  else if (meta && event.key === "v") paste(tool.step_m);
  else if (meta && event.key === "a") { site.selection = list("vertices").map((_, index) => ({ kind: "vertices", index })); changed("selection"); }
  else if (meta) return false;
  else if (event.key === "Delete" || event.key === "Backspace") removeChosen();
  else if (event.key === "Escape") { if (tool.chain.length) tool.chain = []; else if (tool.name !== "select") choose("select"); else { site.selection = []; changed("selection"); } overlay.cross = null; }
  else if (event.key === "+" || event.key === "=") zoom(1.25);
  else if (event.key === "-") zoom(0.8);
  else if (event.key === "f") fit();
  else if (event.key in ARROWS && event.target === canvas) arrow(ARROWS[event.key], event);
  else if (event.key === "Enter" && event.target === canvas && overlay.cross) enter(event);
  else if (event.key === "n" && event.target === canvas) { overlay.cross = snapped([camera.x, camera.y]); }
  else {
    const one = TOOLS.find(([, letter]) => letter === event.key);
    if (!one) return false;
    choose(one[0]);
  }
  redraw();
  return true;
}

function arrow([x, y], event) {
  const step = ((event.shiftKey ? 10 : 1) * tool.step_m) / (unit() || tool.step_m), down = isPixels() ? 1 : -1;
  if (tool.name === "select" && site.selection.length && !overlay.cross) {
    const [one] = site.selection;
    if (one.kind === "lifts") moveLift(one.index, x * step, y * down * step);
    else moved(chosenVertices(), x * step, y * down * step);
    return;
  }
  const from = overlay.cross || snapped([camera.x, camera.y]);
  overlay.cross = [rounded(from[0] + x * step), rounded(from[1] + y * down * step)];
  tool.preview = tool.chain.length ? overlay.cross : null;
  document.dispatchEvent(new CustomEvent("pointer", { detail: overlay.cross }));
}

function enter(event) {
  if (tool.name in RECTANGLES && tool.name !== "select") {
    if (!tool.corner) { tool.corner = overlay.cross; return; }
    RECTANGLES[tool.name](tool.corner, overlay.cross);
    tool.corner = null;
    return;
  }
  click(overlay.cross, event);
}
