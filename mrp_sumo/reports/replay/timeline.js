/* The scrubber: how many robots were in which state, and under it a row of events a kind. */
import { AT_GOAL, BLOCKED, MOVING, WAITING } from "./constants.js";
import { STATE_VARIABLES, cssColor, kindColor } from "./elements.js";

const KIND_ORDER = ["deadlock", "blocked", "disturbance", "yielded", "waited", "goal"];
const ROW = 11;
const MAX_ROWS = 5;
const MANY = 400;

export class Timeline {
  constructor(element, canvas, motion, events) {
    Object.assign(this, { element, canvas, motion, events });
    this.refresh();
  }

  /* Count again what there is. */
  refresh() {
    const { motion, events } = this;
    this.census = motion.census();
    const rank = (kind) => (KIND_ORDER.indexOf(kind) + KIND_ORDER.length + 1) % (KIND_ORDER.length + 1);
    this.rows = events.kinds
      .map((kind, index) => ({ kind, index }))
      .filter(({ kind, index }) => kind !== "started" && events.perKind[index])
      .sort((a, b) => rank(a.kind) - rank(b.kind))
      .slice(0, MAX_ROWS);
  }

  draw() {
    const { canvas, motion, census, rows, events } = this;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const width = Math.max(50, this.element.clientWidth);
    this.gutter = width > 620 && rows.length ? 74 : 0;
    this.area = 32;
    const height = this.area + (rows.length ? 7 + rows.length * ROW : 0);
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    canvas.style.height = `${height}px`;
    this.width = width - this.gutter;
    const c = canvas.getContext("2d");
    c.scale(ratio, ratio);
    c.translate(this.gutter, 0);
    const colors = STATE_VARIABLES.map(cssColor), T = motion.numSamples, R = Math.max(1, motion.numRobots);
    c.save();
    c.beginPath();
    c.roundRect(0, 0, this.width, this.area, 5);
    c.clip();
    c.fillStyle = cssColor("--soft");
    c.fillRect(0, 0, this.width, this.area);
    const below = new Float64Array(Math.ceil(this.width));
    for (const [state, alpha] of [[MOVING, 0.75], [WAITING, 0.9], [BLOCKED, 1], [AT_GOAL, 0.4]]) {
      c.fillStyle = colors[state];
      c.globalAlpha = alpha;
      for (let px = 0; px < below.length; px++) {
        const k0 = Math.floor((px / this.width) * (T - 1)), k1 = Math.max(k0 + 1, Math.floor(((px + 1) / this.width) * (T - 1)));
        let sum = 0;
        for (let k = k0; k < k1; k++) sum += census[5 * Math.min(T - 1, k) + state];
        const h = (sum / (k1 - k0) / R) * this.area;
        if (h > 0) c.fillRect(px, this.area - below[px] - h, 1.02, h);
        below[px] += h;
      }
    }
    c.restore();
    c.globalAlpha = 1;
    rows.forEach((row, i) => {
      const y = this.area + 6 + i * ROW, color = cssColor(kindColor(row.kind));
      c.fillStyle = cssColor("--line");
      c.fillRect(0, y + ROW / 2 - 0.5, this.width, 1);
      c.fillStyle = color;
      if (events.perKind[row.index] > MANY) this.drawDensity(c, row, y);
      else this.drawMarks(c, row, y);
      c.globalAlpha = 1;
    });
    if (this.gutter) {
      c.font = "500 10.5px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
      c.textAlign = "right";
      c.textBaseline = "middle";
      rows.forEach((row, i) => {
        c.fillStyle = cssColor(kindColor(row.kind));
        c.fillText(row.kind.slice(0, 12), -9, this.area + 6 + i * ROW + ROW / 2, this.gutter - 12);
      });
      c.fillStyle = cssColor("--faint");
      c.fillText("robots", -9, this.area / 2, this.gutter - 12);
    }
  }

  /* Each event: a mark where it begins and a bar as long as it lasts. */
  drawMarks(c, row, y) {
    const { events, motion } = this;
    for (let e = 0; e < events.count; e++) {
      if (events.kind[e] !== row.index) continue;
      const x = this.toX(events.seconds(e)), w = (events.duration[e] / 1000 / (motion.end || 1)) * this.width;
      if (w >= 2) {
        c.globalAlpha = 0.5;
        c.beginPath();
        c.roundRect(x, y + 3, w, ROW - 6, 2);
        c.fill();
      }
      c.globalAlpha = 1;
      c.beginPath();
      c.roundRect(x - 1.1, y + 1.5, 2.2, ROW - 3, 1);
      c.fill();
    }
  }

  /* Too many to tell apart: the stronger the colour, the more begin there. */
  drawDensity(c, row, y) {
    const { events } = this, bins = new Uint32Array(Math.ceil(this.width / 2) + 1);
    for (let e = 0; e < events.count; e++) if (events.kind[e] === row.index) bins[Math.floor(this.toX(events.seconds(e)) / 2)]++;
    const most = Math.max(...bins);
    bins.forEach((n, i) => {
      if (!n) return;
      c.globalAlpha = 0.12 + 0.88 * (n / most);
      c.fillRect(2 * i, y + 2, 2, ROW - 4);
    });
  }

  toX(t) {
    return this.motion.end > 0 ? (t / this.motion.end) * this.width : 0;
  }

  timeAt(x) {
    return Math.max(0, Math.min(1, (x - this.gutter) / this.width)) * this.motion.end;
  }

  /* The event drawn at a point of the track, -1 for none. */
  eventAt(x, y) {
    const row = this.rows[Math.floor((y - this.area - 6) / ROW)];
    if (!row || y < this.area + 3) return -1;
    const { events } = this, t = this.timeAt(x) * 1000, slack = (5 / this.width) * this.motion.end * 1000;
    let best = -1, nearest = slack;
    for (let e = 0; e < events.count; e++) {
      if (events.kind[e] !== row.index) continue;
      const d = Math.max(0, events.t[e] - t, Math.min(t - events.t[e] - events.duration[e], Math.abs(t - events.t[e])));
      if (d < nearest || (d === 0 && nearest === 0 && events.t[e] > events.t[best])) (nearest = d), (best = e);
    }
    return best;
  }

  showTime(head, t) {
    head.style.transform = `translateX(${this.gutter + this.toX(t)}px)`;
  }
}
