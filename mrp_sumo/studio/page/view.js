/* The floor under the pen: camera and drawing on a canvas. A frame draws what is seen in a few paths, so that no scene graph is needed. */
import { cssColor } from "./elements.js";
import { cabin, cabins, doorsOn, unit } from "./levels.js";
import { isPixels, isZone, level, list, option, site } from "./site.js";

export const KINDS = [
  ["is_charger", "charger", "--goal"], ["is_parking_spot", "parking", "--accent"], ["pickup_dispenser", "pick-up", "--special"],
  ["dropoff_ingestor", "drop-off", "--special"], ["dock_name", "dock", "--special"], ["is_holding_point", "holding point", "--special"],
];
export const camera = { x: 0, y: 0, scale: 1, isTouched: false };  // the place in the middle, and pixels of the screen a unit
const canvas = document.getElementById("floor"), pen = canvas.getContext("2d", { alpha: false });
const pictures = new Map(), PALETTE_PX = 180;
export const overlay = { draw: null, cross: null };  // of tools
let asked = false;
export const frames = { count: 0, ms: 0 };

export const up = () => (isPixels() ? 1 : -1);  // screens count downwards, as pictures do
const MANY = 400, WALL_M = 0.1;  // vertices, of which not all are shown from afar
const perMetre = () => camera.scale / (unit() || 0.05);  // pixels of the screen, about
const width = () => canvas.clientWidth, height = () => canvas.clientHeight;
export const toScreen = ([x, y]) => [(x - camera.x) * camera.scale + width() / 2, (y - camera.y) * up() * camera.scale + height() / 2];
export const toFloor = ([x, y]) => [(x - width() / 2) / camera.scale + camera.x, ((y - height() / 2) / camera.scale) * up() + camera.y];
export const picture = () => {
  const name = level().drawing?.filename;
  if (!name || typeof name !== "string") return null;
  const folder = site.path.includes("/") ? site.path.slice(0, site.path.lastIndexOf("/") + 1) : "";
  const path = folder + name;
  if (!pictures.has(path)) {
    const image = new Image();
    image.onload = () => { image.isThere = true; redraw(); document.dispatchEvent(new Event("picture")); };
    image.src = `picture?path=${encodeURIComponent(path)}`;
    pictures.set(path, image);
  }
  return pictures.get(path);
};

export function fit() {
  const places = list("vertices").map(([x, y]) => [x, y]);
  const image = picture();
  if (image?.isThere && !list("lanes").length) places.push([0, 0], [image.naturalWidth, image.naturalHeight]);
  if (!places.length) places.push([0, 0], [800, 500]);
  const [xs, ys] = [0, 1].map((k) => places.map((p) => p[k]));
  const [left, right, top, bottom] = [xs.reduce((a, b) => Math.min(a, b)), xs.reduce((a, b) => Math.max(a, b)), ys.reduce((a, b) => Math.min(a, b)), ys.reduce((a, b) => Math.max(a, b))];
  camera.scale = Math.min((width() - PALETTE_PX - 40) / Math.max(right - left, 1), (height() - 60) / Math.max(bottom - top, 1), unit() ? 100 * unit() : 2);
  camera.x = (left + right) / 2 - PALETTE_PX / 2 / camera.scale;  // beside the palette
  camera.y = (top + bottom) / 2;
  camera.isTouched = false;
  redraw();
}

/* True where something of the level is seen. */
export function isInSight() {
  const seen = list("vertices").map(toScreen).filter(([x, y]) => x > 0 && y > 0 && x < width() && y < height());
  return seen.length > 1;
}

export function zoom(factor, at = [width() / 2, height() / 2]) {
  camera.isTouched = true;
  const before = toFloor(at);
  camera.scale = Math.min(Math.max(camera.scale * factor, 1e-4), 1e4);
  const after = toFloor(at);
  camera.x += before[0] - after[0];
  camera.y += before[1] - after[1];
  redraw();
}

export function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    const begin = performance.now();
    draw();
    frames.count++;
    frames.ms = performance.now() - begin;
  });
}

function draw() {
  const ratio = window.devicePixelRatio || 1, w = Math.round(width() * ratio), h = Math.round(height() * ratio);
  if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.fillStyle = cssColor("--paper");
  pen.fillRect(0, 0, width(), height());
  if (!site.document) return;
  const vertices = list("vertices"), at = vertices.map(toScreen);
  drawPicture();
  for (const [name, color] of [["floors", "--floor"], ["holes", "--hole"]]) {
    pen.fillStyle = cssColor(color);
    for (const one of list(name)) if (!isZone(one)) outline(one.vertices.map((v) => at[v]));
  }
  drawZones(at);
  stroke(list("walls"), at, "--wall", Math.min(Math.max(WALL_M * perMetre(), 1), 2.5));
  stroke(list("doors"), at, "--door", 4);
  drawLanes(at);
  if (site.heat) drawHeat();
  drawLifts();
  drawVertices(vertices, at);
  drawRulers(at);
  if (!site.heat) drawFindings();
  overlay.draw?.(pen, at);
  if (overlay.cross) drawCross(toScreen(overlay.cross));
}

function drawPicture() {
  const image = picture();
  if (!image?.isThere) return;
  const [x, y] = toScreen([0, 0]), [x2, y2] = toScreen([image.naturalWidth, image.naturalHeight]);
  const dark = document.documentElement.dataset.theme === "dark";
  pen.save();
  pen.globalAlpha = 0.75;
  if (dark) pen.filter = "invert(0.88)";
  pen.drawImage(image, x, y, x2 - x, y2 - y);
  pen.restore();
}

function outline(points) {
  if (points.some((p) => !p)) return;
  pen.beginPath();
  points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.fill();
}

function drawZones(at) {
  list("floors").forEach((one, index) => {
    if (!isZone(one)) return;
    const isChosen = site.selection.some((s) => s.kind === "floors" && s.index === index);
    pen.globalAlpha = 0.13;
    pen.fillStyle = pen.strokeStyle = cssColor("--blocked");
    outline(one.vertices.map((v) => at[v]));
    pen.globalAlpha = 1;
    pen.setLineDash([7, 5]);
    stroke(one.vertices.map((v, k) => [v, one.vertices[(k + 1) % one.vertices.length]]), at, isChosen ? "--waiting" : "--blocked", isChosen ? 4 : 1.5);
    pen.setLineDash([]);
  });
}

/* Bands as wide as lanes are drawn. */
function drawWidths(lanes, at) {
  pen.globalAlpha = 0.14;
  for (const width of new Set(lanes.map((lane) => option(lane, "width")).filter((value) => value > 0))) {
    stroke(lanes.filter((lane) => option(lane, "width") === width), at, "--accent", width * perMetre());
  }
  pen.globalAlpha = 1;
}

function stroke(items, at, color, size) {
  pen.strokeStyle = cssColor(color);
  pen.lineWidth = size;
  pen.beginPath();
  for (const [a, b] of items) {
    if (!at[a] || !at[b]) continue;
    pen.moveTo(...at[a]);
    pen.lineTo(...at[b]);
  }
  pen.stroke();
}

function drawLanes(at) {
  const lanes = list("lanes"), color = cssColor("--accent");
  const both = lanes.filter((lane) => option(lane, "bidirectional")), single = lanes.filter((lane) => !option(lane, "bidirectional"));
  drawWidths(lanes, at);
  pen.globalAlpha = 0.7;
  stroke(both, at, "--accent", 2);
  stroke(single, at, "--accent", 2);
  pen.globalAlpha = 1;
  pen.fillStyle = color;
  pen.beginPath();
  for (const [a, b] of single) {
    if (!at[a] || !at[b]) continue;
    const [x, y] = [(at[a][0] + at[b][0]) / 2, (at[a][1] + at[b][1]) / 2], angle = Math.atan2(at[b][1] - at[a][1], at[b][0] - at[a][0]);
    const size = Math.min(8, Math.hypot(at[b][0] - at[a][0], at[b][1] - at[a][1]) / 3), [c, s] = [Math.cos(angle) * size, Math.sin(angle) * size];
    pen.moveTo(x + c, y + s);
    pen.lineTo(x - c - s * 0.7, y - s + c * 0.7);
    pen.lineTo(x - c + s * 0.7, y - s - c * 0.7);
  }
  pen.fill();
  const chosen = site.selection.filter((s) => s.kind !== "vertices");
  for (const name of ["lanes", "walls", "doors"]) stroke(chosen.filter((s) => s.kind === name).map((s) => list(name)[s.index]).filter(Boolean), at, "--waiting", 5);
}

/* Cabins: dashed where a lift passes by, with its doors where it stops. */
function drawLifts() {
  pen.font = "12px system-ui, sans-serif";
  for (const [name, lift] of cabins()) {
    const place = cabin(lift, site.level), [w, d] = [lift.width / 2, lift.depth / 2], isChosen = site.selection.some((s) => s.kind === "lifts" && s.index === name);
    pen.strokeStyle = cssColor(isChosen ? "--waiting" : "--special");
    pen.lineWidth = isChosen ? 4 : 2;
    pen.setLineDash(place.isServed ? [] : [5, 4]);
    const corners = [[-w, -d], [w, -d], [w, d], [-w, d]].map((corner) => toScreen(place.at(...corner)));
    pen.beginPath();
    corners.forEach((corner, k) => (k ? pen.lineTo(...corner) : pen.moveTo(...corner)));
    pen.closePath();
    pen.stroke();
    pen.setLineDash([]);
    pen.strokeStyle = cssColor("--door");
    pen.lineWidth = 5;
    for (const word of doorsOn(lift, site.level)) {
      const door = lift.doors?.[word];
      if (!door) continue;
      const turned = Number(door.motion_axis_orientation) || 0, [x, y] = [(door.width / 2) * Math.cos(turned), (door.width / 2) * Math.sin(turned)];
      pen.beginPath();
      pen.moveTo(...toScreen(place.at(door.x - x, door.y - y)));
      pen.lineTo(...toScreen(place.at(door.x + x, door.y + y)));
      pen.stroke();
    }
    pen.fillStyle = cssColor("--ink");
    pen.textAlign = "center";
    pen.fillText(name, (corners[0][0] + corners[2][0]) / 2, Math.min(...corners.map(([, y]) => y)) - 8);
    pen.textAlign = "left";
  }
}

function drawVertices(vertices, at) {
  const onLane = new Set(list("lanes").flatMap(([a, b]) => [a, b]));
  const [w, h] = [width(), height()], seen = ([x, y]) => x > -50 && y > -20 && x < w + 50 && y < h + 20;
  const near = perMetre(), size = Math.min(Math.max(0.2 * near, 2), 5), hasCorners = vertices.length < MANY || near > 25;
  pen.fillStyle = cssColor("--muted");
  pen.beginPath();
  vertices.forEach((vertex, v) => {
    if (vertex[3] || vertex.length > 4 || !seen(at[v])) return;
    if (!onLane.has(v) && !hasCorners) return;
    const r = onLane.has(v) ? size : 1.5;
    pen.rect(at[v][0] - r, at[v][1] - r, 2 * r, 2 * r);
  });
  pen.fill();
  pen.font = "12px system-ui, sans-serif";
  pen.textBaseline = "middle";
  const isMany = vertices.filter((vertex) => vertex[3]).length >= MANY, labels = [];
  vertices.forEach((vertex, v) => {
    if (!(vertex[3] || vertex.length > 4) || !seen(at[v])) return;
    const kind = KINDS.find(([name]) => option(vertex, name));
    pen.fillStyle = cssColor(kind ? kind[2] : "--station");
    pen.beginPath();
    pen.arc(at[v][0], at[v][1], size + 2.5, 0, 7);
    pen.fill();
    if (vertex[3] !== "" && vertex[3] !== null && (near > 60 || !isMany)) labels.push([String(vertex[3]), at[v]]);
  });
  drawNames(labels);
  pen.strokeStyle = cssColor("--waiting");
  pen.lineWidth = 3;
  for (const { kind, index } of site.selection) {
    if (kind !== "vertices" || !at[index]) continue;
    pen.beginPath();
    pen.arc(at[index][0], at[index][1], size + 5, 0, 7);
    pen.stroke();
  }
}

/* Names beside their places, above or below, where no other name is yet. */
function drawNames(labels) {
  const taken = [];
  for (const [text, [x, y]] of labels) {
    const wide = pen.measureText(text).width, isFree = (dx, dy) => !taken.some(([l, t, w]) => x + dx < l + w && l < x + dx + wide && Math.abs(y + dy - t) < 13);
    const [dx, dy] = [[9, -9], [9, 13], [-wide - 9, -9], [-wide - 9, 13]].find((shift) => isFree(...shift)) || [9, -9];
    taken.push([x + dx, y + dy, wide]);
    named(text, x + dx, y + dy, "--ink");
  }
}

function named(text, x, y, color) {
  pen.strokeStyle = cssColor("--halo");
  pen.lineWidth = 3;
  pen.strokeText(text, x, y);
  pen.fillStyle = cssColor(color);
  pen.fillText(text, x, y);
}

function drawRulers(at) {
  pen.save();
  pen.setLineDash([6, 5]);
  stroke(list("measurements"), at, "--special", 1.5);
  pen.restore();
  for (const [a, b, options] of list("measurements")) {
    if (at[a] && at[b] && options?.distance) named(`${options.distance[1]} m`, (at[a][0] + at[b][0]) / 2 + 6, (at[a][1] + at[b][1]) / 2 + 12, "--special");
  }
}

function drawFindings() {
  pen.lineWidth = 2.5;
  for (const finding of site.findings) {
    pen.strokeStyle = cssColor(finding.severity === "refuse" ? "--blocked" : finding.severity === "warn" ? "--waiting" : "--muted");
    for (const [name, x, y] of finding.places.slice(0, 60)) {
      if (name !== site.level) continue;
      const [sx, sy] = toScreen([x, y]);
      pen.beginPath();
      pen.arc(sx, sy, 12, 0, 7);
      pen.stroke();
    }
  }
}

function drawHeat() {
  const most = Math.max(...site.heat.map((place) => place[3]), 1);
  const size = Math.max(0.4 * perMetre(), 7);
  for (const [name, x, y, seconds] of site.heat) {
    if (name !== site.level) continue;
    const [sx, sy] = toScreen([x, y]), share = Math.sqrt(seconds / most);
    pen.fillStyle = `hsla(${50 - 50 * share}, 95%, 50%, ${0.15 + 0.7 * share})`;
    pen.beginPath();
    pen.arc(sx, sy, size * (0.5 + 0.5 * share), 0, 7);
    pen.fill();
  }
}

function drawCross([x, y]) {
  pen.strokeStyle = cssColor("--accent");
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.moveTo(x - 10, y);
  pen.lineTo(x + 10, y);
  pen.moveTo(x, y - 10);
  pen.lineTo(x, y + 10);
  pen.stroke();
}
