/* Beside which of its sides a station's name stands, so that names lie neither on walls nor on each other.
   Decided once for each zoom, not each frame: greedy, the stations with a purpose first. */

const GAP = 4; // pixels between a station and its name

/* Centre of a name of w by h pixels beside a point, by side: below, above, right, left. */
export const SIDES = [
  (w, h, r) => [0, r + GAP + h / 2],
  (w, h, r) => [0, -r - GAP - h / 2],
  (w, h, r) => [r + GAP + w / 2, 0],
  (w, h, r) => [-r - GAP - w / 2, 0],
];

/* For each name {x, y, width} (x and y in pixels, y down) the index of its side. `lines` holds walls as ax, ay, bx, by in pixels. */
export function chooseSides(names, lines, height, radius) {
  const placed = [];
  return names.map(({ x, y, width }) => {
    let best = 0, least = Infinity;
    SIDES.forEach((side, k) => {
      const [dx, dy] = side(width, height, radius);
      const box = [x + dx - width / 2, y + dy - height / 2, x + dx + width / 2, y + dy + height / 2];
      const neighbours = placed.filter((other) => box[0] < other[2] && box[2] > other[0] && box[1] < other[3] && box[3] > other[1]).length;
      const cost = 10 * neighbours + crossings(lines, box) + 0.1 * k;
      if (cost < least) (least = cost), (best = k);
    });
    const [dx, dy] = SIDES[best](width, height, radius);
    placed.push([x + dx - width / 2, y + dy - height / 2, x + dx + width / 2, y + dy + height / 2]);
    return best;
  });
}

/* How many lines enter a box. */
function crossings(lines, [left, top, right, bottom]) {
  let count = 0;
  for (let i = 0; i < lines.length; i += 4) {
    const ax = lines[i], ay = lines[i + 1], bx = lines[i + 2], by = lines[i + 3];
    if (Math.max(ax, bx) < left || Math.min(ax, bx) > right || Math.max(ay, by) < top || Math.min(ay, by) > bottom) continue;
    const side = (px, py) => Math.sign((bx - ax) * (py - ay) - (by - ay) * (px - ax)); // of the line on which a corner lies
    const sides = [side(left, top), side(right, top), side(left, bottom), side(right, bottom)];
    if (!sides.every((s) => s === sides[0] && s !== 0)) count++;
  }
  return count;
}
