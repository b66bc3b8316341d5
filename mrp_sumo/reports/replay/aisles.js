/* Straight aisles of a map: lanes, or cells of a grid, in one line without a gap. */

const OFFSET_M = 0.12; // lanes that lie this far apart are in one line
const ANGLES = 180; // directions that are told apart
const GAP_M = 0.05;
const MOST = 3000;

/* [{ax, ay, bx, by, length}], the longest first. */
export function aislesOf(map) {
  const pieces = map.lanes.length ? lanePieces(map.lanes) : cellPieces(map.cells), lines = new Map();
  for (const [ax, ay, bx, by] of pieces) {
    const turn = ((Math.round((Math.atan2(by - ay, bx - ax) * ANGLES) / Math.PI) % ANGLES) + ANGLES) % ANGLES, angle = (turn * Math.PI) / ANGLES;
    const ux = Math.cos(angle), uy = Math.sin(angle), across = -uy * (ax + bx) / 2 + ux * (ay + by) / 2, key = turn * 1e6 + Math.round(across / OFFSET_M);
    const a = ux * ax + uy * ay, b = ux * bx + uy * by;
    if (!lines.has(key)) lines.set(key, { ux, uy, across, spans: [] });
    lines.get(key).spans.push([Math.min(a, b), Math.max(a, b)]);
  }
  const aisles = [];
  for (const { ux, uy, across, spans } of lines.values()) {
    spans.sort((p, q) => p[0] - q[0]);
    let [begin, end] = spans[0];
    const close = () => aisles.push({ ax: ux * begin - uy * across, ay: uy * begin + ux * across, bx: ux * end - uy * across, by: uy * end + ux * across, length: end - begin });
    for (const [a, b] of spans) {
      if (a > end + GAP_M) close(), ([begin, end] = [a, b]);
      else end = Math.max(end, b);
    }
    close();
  }
  return aisles.sort((p, q) => q.length - p.length).slice(0, MOST);
}

function lanePieces(lanes) {
  const pieces = [];
  for (let i = 0; i < lanes.length; i += 5) pieces.push(lanes.slice(i, i + 4));
  return pieces;
}

/* Rows of free cells as they are given, and the columns that they make. */
function cellPieces(rows) {
  const pieces = [];
  for (const [x, y, w, h] of rows) {
    pieces.push([x + h / 2, y + h / 2, x + w - h / 2, y + h / 2]);
    for (let k = 0; k < Math.round(w / h); k++) pieces.push([x + (k + 0.5) * h, y, x + (k + 0.5) * h, y + h]);
  }
  return pieces.filter(([ax, ay, bx, by]) => ax !== bx || ay !== by);
}

/* The aisle under a point, null for none within a distance; of two that cross there the longer. */
export function aisleAt(aisles, x, y, within) {
  let best = null, nearest = within;
  for (const aisle of aisles) {
    const { ax, ay, bx, by, length } = aisle, ux = (bx - ax) / length, uy = (by - ay) / length;
    const along = Math.max(0, Math.min(length, (x - ax) * ux + (y - ay) * uy)), d = Math.hypot(ax + along * ux - x, ay + along * uy - y);
    if (d < nearest - 1e-3) (nearest = d), (best = aisle);
  }
  return best;
}
