/* Draws the map and the robots. What is drawn is decided by `view`, the state that the user changes. */
import { ABSENT, AT_GOAL, BLOCKED, MOVING, NEVER, STATE_COLORS, THEMES, WAITING } from "./constants.js";
import { SIDES, chooseSides } from "./labels.js";
import { packed } from "./shaders.js";

const TRAIL_S = 20;
const MAX_TASK_PIECES = 800; // of the way of one task
const MAX_TRAIL_PIECES = 48000;
const MAX_LABELS = 260;
const CROSSINGS_FROM = 45; // pixels a metre, from which on crossings have their names
const FAMILY = "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
const STATION_FONT = `500 10.5px ${FAMILY}`;

export class Scene {
  constructor(run, motion, events) {
    Object.assign(this, { run, motion, events });
    this.map = run.map;
    this.inset = 0; // pixels at the bottom that something covers
    this.camera = { scale: 1, x: 0, y: 0 }; // screen = (x * scale + camera.x, -y * scale + camera.y)
    this.theme = themeOf("light");
    this.heat = null;
  }

  /* `painter` draws with WebGL (gl.js) or without (canvas.js). */
  async start(painter, canvas, overlay, holder) {
    Object.assign(this, { painter, canvas, overlay, holder });
    await painter.start(canvas, overlay, holder.clientWidth, holder.clientHeight);
    this.lanes = painter.strokes(true); // from the ground up
    this.walls = painter.strokes(true);
    this.spots = painter.robots(true);
    this.trails = painter.strokes();
    this.ties = painter.strokes();
    this.ghosts = painter.robots();
    this.people = painter.robots();
    this.robots = painter.robots();
    this.resize();
    this.fit();
  }

  setTheme(name) {
    this.theme = themeOf(name);
    this.isDark = name === "dark";
    this.painter.setPaper(this.theme.paper);
    this.colors = this.theme.states.map((c) => packed(c));
    this.drawMap();
    if (this.heat) this.drawHeat();
  }

  resize() {
    this.width = Math.max(1, this.holder.clientWidth);
    this.height = Math.max(1, this.holder.clientHeight);
    this.painter.resize(this.width, this.height);
  }

  /* The whole map, or one of its levels, with room for the counts above it and the buttons at its right. */
  fit(level) {
    const [w, h] = level ? [level.width, level.height] : this.map.size_m;
    const narrow = this.width < 600 || this.height < 420;
    const left = narrow ? 14 : 36, right = this.width < 420 ? 14 : narrow ? 64 : 76, top = (narrow ? 58 : 64) + (this.map.levels.length ? 58 : 0), bottom = Math.max(narrow ? 64 : 40, this.inset + 10);
    let scale = Math.min((this.width - left - right) / w, (this.height - top - bottom) / h);
    if (level) {
      scale = Math.min(scale, this.maxScale);
    } else {
      this.minScale = scale / 4;
      this.maxScale = Math.max(600, 4 * scale);
    }
    this.camera.scale = scale;
    this.camera.x = left + (this.width - left - right) / 2 - (level ? level.x + w / 2 : w / 2) * scale;
    this.camera.y = top + (this.height - top - bottom) / 2 + (level ? level.y - h / 2 : h / 2) * scale;
  }

  zoomAt(px, py, factor) {
    const c = this.camera, scale = Math.max(this.minScale, Math.min(this.maxScale, c.scale * factor)), f = scale / c.scale;
    c.x = px + (c.x - px) * f;
    c.y = py + (c.y - py) * f;
    c.scale = scale;
  }

  centreOn(x, y, scale = this.camera.scale) {
    const c = this.camera;
    c.scale = Math.max(this.minScale, Math.min(this.maxScale, scale));
    c.x = this.width / 2 - x * c.scale;
    c.y = (this.height - this.inset) / 2 + y * c.scale;
  }

  /* Robots are to scale from this many pixels on; below, they are drawn as large as their neighbours leave room for. */
  get least() {
    const [least, most] = this.motion.numRobots <= 60 ? [9, 12] : this.motion.numRobots <= 400 ? [6, 9] : [5, 7];
    return Math.min(most, Math.max(least, 0.75 * this.run.spacing_m * this.camera.scale));
  }

  toScreen(x, y) {
    const c = this.camera;
    return [x * c.scale + c.x, -y * c.scale + c.y];
  }

  /* The robot under a point of the screen, -1 for none. */
  pick(px, py, slack) {
    const c = this.camera, pose = this.motion.pose, { length, width } = this.run;
    let best = -1, nearest = Infinity;
    for (let r = 0; r < this.motion.numRobots; r++) {
      if (this.motion.now[r] === ABSENT) continue;
      const dx = pose[3 * r] * c.scale + c.x - px, dy = -pose[3 * r + 1] * c.scale + c.y - py;
      const d = Math.hypot(dx, dy), reach = Math.max(0.5 * Math.max(length[r], width[r]) * c.scale, slack);
      if (d <= reach && d < nearest) (nearest = d), (best = r);
    }
    return best;
  }

  /* ---- the map, drawn once a theme ---- */

  drawMap() {
    const { map, theme } = this, filled = (polygons, color, alpha = 1) => polygons.map((points) => [points, color, alpha]);
    const polygons = [...filled(map.floors, theme.floor), ...filled(map.holes, theme.hole), ...filled(map.furniture, theme.furniture), ...filled(map.lifts, theme.special, 0.18)];
    this.painter.drawFloor(polygons, map.cells.map((box) => [box, theme.floor]));
    const both = packed(theme.lane, 0.95);
    this.lanes.begin((3 * map.lanes.length) / 5);
    for (let i = 0; i < map.lanes.length; i += 5) {
      const [ax, ay, bx, by, oneWay] = map.lanes.slice(i, i + 5);
      this.lanes.add(ax, ay, bx, by, 0.05, 1.25, true, both);
      if (oneWay) this.drawDirection(ax, ay, bx, by, both);
    }
    this.lanes.end();
    const wall = packed(theme.wall), door = packed(theme.door);
    const fine = packed(theme.fine);
    this.walls.begin((map.walls.length + map.inner.length) / 4 + map.doors.length);
    for (let i = 0; i < map.inner.length; i += 4) this.walls.add(map.inner[i], map.inner[i + 1], map.inner[i + 2], map.inner[i + 3], 0.03, 1, true, fine);
    for (const ends of map.doors) this.walls.add(...ends, 0.06, 1.5, false, door);
    for (let i = 0; i < map.walls.length; i += 4) this.walls.add(map.walls[i], map.walls[i + 1], map.walls[i + 2], map.walls[i + 3], 0.1, 1.2, true, wall);
    this.walls.end();
    const spot = map.stations.length <= 60 ? 5 : 3.2;
    this.spots.begin(map.stations.length + map.junctions.length / 2);
    const station = packed(theme.station), special = packed(theme.special), floor = packed(theme.lane);
    for (let i = 0; i < map.junctions.length; i += 2) this.spots.add(map.junctions[i], map.junctions[i + 1], 0, 0.12, 0.12, 2, 3, 0, 1, floor);
    for (const s of map.stations) this.spots.add(s.x, s.y, 0, 0.18, 0.18, spot, 3, 0, 1, s.kind ? special : station);
    this.spots.end();
    this.labelOrder = map.stations.map((_, i) => i).sort((a, b) => (map.stations[b].kind ? 1 : 0) - (map.stations[a].kind ? 1 : 0));
  }

  drawDirection(ax, ay, bx, by, color) {
    const length = Math.hypot(bx - ax, by - ay), ux = (bx - ax) / length, uy = (by - ay) / length;
    const s = Math.min(0.2, length / 4), x = (ax + bx) / 2 + ux * s, y = (ay + by) / 2 + uy * s;
    for (const side of [-1, 1]) this.lanes.add(x, y, x - 1.6 * ux * s - side * uy * s, y - 1.6 * uy * s + side * ux * s, 0.05, 1.5, true, color);
  }

  /* ---- heat maps ---- */

  /* Seconds that robots waited, or drove, in each cell over the whole run, smoothed. */
  timeByCell(what) {
    const [w, h] = this.map.size_m, m = this.motion;
    const cell = Math.max(0.2, Math.sqrt((w * h) / 160000)), columns = Math.ceil(w / cell) + 1, rows = Math.ceil(h / cell) + 1;
    let sum = new Float32Array(columns * rows);
    for (let r = 0; r < m.numRobots; r++) for (let i = r * m.stride, end = i + m.numSamples; i < end; i++) {
      const s = m.state[i];
      if (what === "density" ? s === MOVING : s === WAITING || s === BLOCKED) sum[Math.min(rows - 1, ((m.y[i] * m.unit) / cell) | 0) * columns + Math.min(columns - 1, ((m.x[i] * m.unit) / cell) | 0)] += m.period;
    }
    const raw = sum.reduce((a, b) => Math.max(a, b), 0);
    for (let pass = 0; pass < 2; pass++) { // binomial blur, along x then y
      for (const [step, limit] of [[1, columns], [columns, rows]]) {
        const next = new Float32Array(sum.length);
        for (let i = 0; i < sum.length; i++) {
          const k = step === 1 ? i % columns : (i / columns) | 0;
          next[i] = 0.5 * sum[i] + (k > 0 ? 0.25 * sum[i - step] : 0) + (k < limit - 1 ? 0.25 * sum[i + step] : 0);
        }
        sum = next;
      }
    }
    return { sum, columns, rows, cell, raw };
  }

  /* `what`: "waiting", "density" (of robots that drive), or "" for none. */
  showHeat(what) {
    if (!what) return this.painter.setHeat((this.heat = null));
    this.heat = this.timeByCell(what);
    this.drawHeat();
  }

  drawHeat() {
    const { sum, columns, rows, cell } = this.heat;
    const sorted = sum.filter((v) => v > 0).sort();
    const top = Math.max(sorted[Math.floor(sorted.length * 0.998)] || 0, 1e-6);
    this.heat.top = top;
    const picture = document.createElement("canvas");
    picture.width = columns;
    picture.height = rows;
    const context = picture.getContext("2d"), image = context.createImageData(columns, rows);
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const v = Math.min(1, sum[row * columns + column] / top) ** 0.7, i = 4 * ((rows - 1 - row) * columns + column);
        const [r, g, b] = heatColor(v);
        image.data[i] = r; image.data[i + 1] = g; image.data[i + 2] = b;
        image.data[i + 3] = 255 * Math.min(0.85, 1.5 * v);
      }
    }
    context.putImageData(image, 0, 0);
    this.painter.setHeat(picture, columns * cell, rows * cell);
  }

  /* ---- every frame ---- */

  draw(view, clock) {
    const { motion: m } = this;
    m.seek(view.t);
    if (m.hasPlan && (view.ghosts || view.selected >= 0)) m.seekPlan(view.t);
    this.drawTrails(view);
    this.drawTies(view);
    this.drawGhosts(view);
    if (m.people) this.drawPeople(view);
    this.drawRobots(view);
    this.drawLabels(view, this.painter.render(this.camera, this.width, this.height, this.isDark, view.still ? 0.35 : (clock / 1400) % 1));
  }

  drawRobots(view) {
    const { motion: m, run, robots, colors, least } = this, { pose, now } = m;
    const dimmed = view.only >= 0;
    robots.begin(m.numBodies + view.apart.length + 2 + (run.forks ? 2 * m.numRobots : 0));
    m.owner.forEach((owner, n) => {
      const b = m.numRobots + n, state = m.states[b];
      if (state !== ABSENT) robots.add(pose[3 * b], pose[3 * b + 1], pose[3 * b + 2], run.length[b], run.width[b], 0, 4, 0, dimmed && state !== view.only ? 0.18 : 1, colors[state]);
    });
    for (let r = 0; r < m.numRobots; r++) {
      const state = now[r];
      if (state === ABSENT) continue;
      const opacity = dimmed && state !== view.only ? 0.18 : 1;
      robots.add(pose[3 * r], pose[3 * r + 1], pose[3 * r + 2], run.length[r], run.width[r], least, 0, state === BLOCKED ? 0.9 * opacity : 0, opacity, colors[state]);
      if (run.forks && run.forks[r] && run.width[r] * this.camera.scale > 7) this.addForks(r, opacity);
    }
    for (const r of view.apart) robots.add(pose[3 * r], pose[3 * r + 1], pose[3 * r + 2], run.length[r], run.width[r], least, 2, 0, 1, packed(this.theme.special));
    for (const [robot, color] of [[view.hovered, this.theme.muted], [view.selected, this.theme.accent]]) {
      if (robot < 0 || now[robot] === ABSENT || (robot === view.selected && color === this.theme.muted)) continue;
      robots.add(pose[3 * robot], pose[3 * robot + 1], pose[3 * robot + 2], run.length[robot], run.width[robot], least, 2, 0, 1, packed(color));
    }
    robots.end();
  }

  /* The third of a truck that its forks take. */
  addForks(r, opacity) {
    const { motion: m, run, robots, theme } = this, x = m.pose[3 * r], y = m.pose[3 * r + 1], yaw = m.pose[3 * r + 2];
    const c = Math.cos(yaw), s = Math.sin(yaw), along = 0.335 * run.length[r] * run.forks[r];
    for (const aside of [0.28 * run.width[r], -0.28 * run.width[r]]) {
      robots.add(x + c * along - s * aside, y + s * along + c * aside, yaw, 0.33 * run.length[r], 0.12 * run.width[r], 0, 4, 0, 0.8 * opacity, packed(theme.ink));
    }
  }

  /* Discs with a rim, which no robot has. */
  drawPeople(view) {
    const { motion: m, people, theme } = this, { at, size_m: size } = m.people;
    m.seekPeople(view.t);
    const rim = packed(theme.halo), color = packed(theme.person), least = Math.min(this.least, 7);
    people.begin(at.length);
    for (let i = 0; i < at.length; i += 2) {
      people.add(at[i], at[i + 1], 0, size, size, least + 2.5, 3, 0, 1, rim);
      people.add(at[i], at[i + 1], 0, 0.8 * size, 0.8 * size, least, 3, 0, 0.95, color);
    }
    people.end();
  }

  drawGhosts(view) {
    const { motion: m, run, ghosts, least } = this, g = m.ghost;
    const one = view.selected, all = view.ghosts;
    ghosts.begin(m.numRobots + 1);
    if (m.hasPlan && !m.isPlanOnly) {
      const color = packed(this.theme.muted), chosen = packed(this.theme.accent);
      for (let r = 0; r < m.numRobots; r++) {
        if (!(all || r === one)) continue;
        ghosts.add(g[3 * r], g[3 * r + 1], g[3 * r + 2], run.length[r], run.width[r], least, 1, 0, r === one ? 1 : 0.8, r === one ? chosen : color);
      }
    }
    ghosts.end();
  }

  /* Ghost to robot, waiting robot to the one waited for, and the plan of the selected robot. */
  drawTies(view) {
    const { motion: m, ties, theme } = this, { pose, ghost: g } = m, one = view.selected;
    const visits = one >= 0 && m.hasPlan ? m.first[one + 1] - m.first[one] : 0;
    const path = Array.from({ length: Math.max(0, visits - 1) }, (_, n) => m.lane(m.visit.vertex[m.first[one] + n], m.visit.vertex[m.first[one] + n + 1]));
    ties.begin(2 * m.numBodies + path.reduce((sum, line) => sum + line.length, 0) + 16);
    this.drawBars(packed(theme.muted));
    if (view.aisle && view.showsAisle) ties.add(view.aisle.ax, view.aisle.ay, view.aisle.bx, view.aisle.by, 0.3, 9, true, packed(theme.accent, 0.3));
    if (visits) {
      const at = m.visitAt(one, view.t) - m.first[one], past = packed(theme.accent, 0.28), future = packed(theme.accent, 0.8);
      path.forEach((line, k) => line.slice(1).forEach((to, n) => ties.add(...line[n], ...to, 0.05, 2.5, true, k < at ? past : future)));
    }
    if (m.hasPlan && !m.isPlanOnly) {
      const from = packed(theme.muted, 0.7), chosen = packed(theme.accent, 0.7);
      for (let r = 0; r < m.numRobots; r++) {
        if (!(view.ghosts || r === one) || m.now[r] === ABSENT) continue;
        ties.add(g[3 * r], g[3 * r + 1], pose[3 * r], pose[3 * r + 1], 0.012, 1.2, false, r === one ? chosen : from);
      }
    }
    for (const r of m.numRobots <= 400 ? m.now.keys() : one >= 0 ? [one] : []) {
      const state = m.now[r];
      if (state !== BLOCKED && r !== one) continue;
      const other = this.events.waitsFor(r, view.t);
      if (other === NEVER || m.now[other] === ABSENT) continue;
      const color = theme.states[state === BLOCKED ? BLOCKED : WAITING];
      ties.add(pose[3 * r], pose[3 * r + 1], pose[3 * other], pose[3 * other + 1], 0.03, 2.5, true, packed(color, 0.2), packed(color, 0.95));
    }
    ties.end();
  }

  /* From the middle of each trailer to its hitch, and to the middle of what is in front of it. */
  drawBars(color) {
    const { motion: m, run, ties } = this, { pose } = m;
    m.owner.forEach((owner, n) => {
      const b = m.numRobots + n, p = 3 * b, bar = run.bar[n], front = 3 * (n && m.owner[n - 1] === owner ? b - 1 : owner);
      if (!bar || m.states[b] === ABSENT) return;
      const x = pose[p] + bar * Math.cos(pose[p + 2]), y = pose[p + 1] + bar * Math.sin(pose[p + 2]);
      ties.add(pose[p], pose[p + 1], x, y, 0.08, 1.5, true, color);
      ties.add(x, y, pose[front], pose[front + 1], 0.08, 1.5, true, color);
    });
  }

  /* The way of the last seconds, fading. Pieces in one line are drawn as one: most of the way is straight. */
  drawTrails(view) {
    const { motion: m, trails, theme } = this, T = m.stride;
    if (!view.trails && view.selected < 0) {
      trails.begin(0);
      return trails.end();
    }
    const each = Math.max(8, Math.min(48, Math.floor(MAX_TRAIL_PIECES / m.numRobots)));
    const step = Math.max(1, Math.round(TRAIL_S / m.period / each)); // samples a piece; pieces end at multiples, so that they stand still
    const k = m.sampleAt(view.t), newest = k - (k % step);
    const rgb = theme.states.map((c) => packed(c, 0));
    trails.begin(m.numRobots * (each + 1) + MAX_TASK_PIECES);
    const fade = new Uint32Array(each + 2);
    for (let j = 0; j < fade.length; j++) fade[j] = Math.round(150 * Math.max(0, 1 - j / (each + 1))) << 24;
    for (let r = 0; r < m.numRobots; r++) {
      if (m.now[r] === ABSENT || (!view.trails && r !== view.selected)) continue;
      const base = r * T, color = rgb[m.now[r] === AT_GOAL ? AT_GOAL : MOVING];
      let ax = m.pose[3 * r], ay = m.pose[3 * r + 1], ja = 0, bx = ax, by = ay, jb = 0;
      for (let j = 0, s = newest; j <= each && s >= 0; j++, s -= step) {
        if (m.state[base + s] === ABSENT) break;
        const x = m.x[base + s] * m.unit, y = m.y[base + s] * m.unit;
        if (x === bx && y === by) continue;
        const dx = x - ax, dy = y - ay, ux = bx - ax, uy = by - ay;
        if (Math.abs(ux * dy - uy * dx) > 0.012 * (Math.abs(dx) + Math.abs(dy)) || ux * dx + uy * dy < 0) {
          trails.add(ax, ay, bx, by, 0.07, 2, false, color | fade[ja], color | fade[jb]);
          ax = bx; ay = by; ja = jb;
        }
        bx = x; by = y; jb = j + 1;
      }
      if (jb) trails.add(ax, ay, bx, by, 0.07, 2, false, color | fade[ja], color | fade[jb]);
    }
    if (view.task >= 0) this.drawTask(view.task, (150 << 24) | rgb[AT_GOAL]);
    trails.end();
  }

  /* The way that a robot drove for a task, from when it had it until it was done. */
  drawTask(k, color) {
    const { motion: m, trails } = this, { tasks } = this.run, [, from, , to] = tasks.times[k], base = tasks.robot[k] * m.stride;
    const a = m.sampleAt(from), b = m.sampleAt(to === null ? m.end : to), step = Math.max(1, Math.ceil((b - a) / MAX_TASK_PIECES));
    for (let s = a; s < b; s += step) {
      const e = Math.min(b, s + step), x = m.x[base + s] * m.unit, y = m.y[base + s] * m.unit, u = m.x[base + e] * m.unit, v = m.y[base + e] * m.unit;
      if (x !== u || y !== v) trails.add(x, y, u, v, 0.1, 3, false, color, color);
    }
  }

  /* Names, on a canvas: sharp at any zoom, and text can be nothing else than text there. */
  drawLabels(view, context) {
    const { theme, motion: m, run, camera: c } = this;
    context.textBaseline = "middle";
    context.lineJoin = "round";
    const taken = new Set();
    let drawn = 0;
    const airy = c.scale < 12 ? 10 : 0; // names on a map seen from afar want more room
    const write = (text, x, y, color, font, must) => {
      if (x < -80 || y < -20 || x > this.width + 80 || y > this.height + 20 || (drawn >= MAX_LABELS && !must)) return false;
      context.font = font;
      const half = context.measureText(text).width / 2, w = 2 * half + 6 + 2 * airy, h = 7 + airy, cells = [];
      if (!must && (x < half || x > this.width - half)) return false; // half a name is none
      for (let gx = Math.floor((x - w / 2) / 8); gx <= Math.floor((x + w / 2) / 8); gx++) {
        for (let gy = Math.floor((y - h) / 8); gy <= Math.floor((y + h) / 8); gy++) cells.push(gx * 65536 + gy);
      }
      if (!must && cells.some((cell) => taken.has(cell))) return false;
      for (const cell of cells) taken.add(cell);
      drawn++;
      context.textAlign = "center";
      context.strokeStyle = theme.halo;
      context.lineWidth = 3.5;
      context.globalAlpha = 0.85;
      context.strokeText(text, x, y);
      context.globalAlpha = 1;
      context.fillStyle = color;
      context.fillText(text, x, y);
      return true;
    };
    for (const level of run.map.levels) {
      const [x, y] = this.toScreen(level.x, level.y);
      write(level.name, x + 0.5 * context.measureText(level.name).width, y - 10, theme.ink, `700 13px ${FAMILY}`, true);
    }
    const above = (r) => Math.max(0.5 * Math.hypot(run.length[r], run.width[r]) * c.scale, 0.6 * this.least) + 10;
    const label = (r, must) => {
      const [x, y] = this.toScreen(m.pose[3 * r], m.pose[3 * r + 1]);
      const why = this.events.disturbance(r, view.t);
      write(why ? `${run.robots[r]} ${why}` : run.robots[r], x, y - above(r), must ? theme.accent : theme.ink, `${must ? 700 : 600} 11.5px ${FAMILY}`, must);
    };
    for (const r of new Set([view.selected, view.hovered])) if (r >= 0 && m.now[r] !== ABSENT) label(r, true);
    if (view.labels) {
      const typical = run.length[0] * c.scale;
      if (m.numRobots <= 60 || typical > 9) for (let r = 0; r < m.numRobots; r++) if (m.now[r] !== ABSENT && r !== view.selected) label(r, false);
      for (const { station, width, side } of this.namesOfStations(context)) {
        if (drawn >= MAX_LABELS) break;
        const [x, y] = this.toScreen(station.x, station.y);
        for (const other of [SIDES[side], ...SIDES]) { // where a robot's name is in the way, another side
          const [dx, dy] = other(width, 10, this.stationRadius);
          if (write(station.name, x + dx, y + dy, theme.muted, STATION_FONT, false)) break;
        }
      }
    }
    if (view.found) { // a station that the search led to
      const [x, y] = this.toScreen(view.found.x, view.found.y);
      context.strokeStyle = theme.accent;
      context.lineWidth = 2.5;
      context.beginPath();
      context.arc(x, y, 12, 0, 2 * Math.PI);
      context.stroke();
      write(view.found.name, x, y + 22, theme.accent, `700 12px ${FAMILY}`, true);
    }
    this.drawGoal(context, view);
    this.drawScale(context);
  }

  get stationRadius() {
    return Math.max(0.13 * this.camera.scale, 3);
  }

  /* Names of stations with the side on which each stands; decided again when the zoom has changed by a tenth. */
  namesOfStations(context) {
    const step = Math.round(Math.log(this.camera.scale) / Math.log(1.1));
    if (this.names && this.names.step === step) return this.names.list;
    const { map } = this, k = this.camera.scale;
    context.font = STATION_FONT;
    const list = this.labelOrder.map((i) => map.stations[i]).filter((s) => s.name && (!s.crossing || k >= CROSSINGS_FROM)).map((station) => ({ station, width: context.measureText(station.name).width }));
    const lines = [...map.walls, ...map.doors.flat()].map((v, i) => (i % 2 ? -v : v) * k);
    const sides = list.length <= MAX_LABELS ? chooseSides(list.map(({ station, width }) => ({ x: station.x * k, y: -station.y * k, width })), lines, 14, this.stationRadius) : [];
    list.forEach((name, i) => (name.side = sides[i] ?? 0));
    this.names = { step, list };
    return list;
  }

  drawGoal(context, view) {
    const r = view.selected, v = r >= 0 && this.run.target.length ? this.run.target[r] : -1;
    if (v < 0 || !this.motion.vertexX || this.motion.now[r] === AT_GOAL) return;
    const [x, y] = this.toScreen(this.motion.vertexX[v], this.motion.vertexY[v]);
    context.strokeStyle = this.theme.accent;
    for (const radius of [4, 9]) {
      context.lineWidth = 2;
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  drawScale(context) {
    const wanted = 110 / this.camera.scale, power = 10 ** Math.floor(Math.log10(wanted));
    const metres = [5, 2, 1].map((f) => f * power).find((v) => v <= wanted), w = metres * this.camera.scale;
    const x = 16, y = this.height - 16;
    context.strokeStyle = this.theme.muted;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x, y - 4);
    context.lineTo(x, y);
    context.lineTo(x + w, y);
    context.lineTo(x + w, y - 4);
    context.stroke();
    context.font = `500 11px ${FAMILY}`;
    context.textAlign = "left";
    context.fillStyle = this.theme.muted;
    context.fillText(metres >= 1 ? `${metres} m` : `${Math.round(metres * 100)} cm`, x + w + 7, y - 3);
  }
}

/* The colours of a theme, and those of the states as a list. */
function themeOf(name) {
  return { ...THEMES[name], states: STATE_COLORS.map((state) => THEMES[name][state]) };
}

/* Yellow to deep red, as the waiting grows. */
function heatColor(v) {
  const stops = [[255, 221, 89], [253, 170, 50], [240, 93, 60], [190, 20, 70], [110, 0, 80]];
  const at = Math.min(0.9999, v) * (stops.length - 1), i = Math.floor(at), u = at - i;
  return stops[i].map((a, k) => Math.round(a + u * (stops[i + 1][k] - a)));
}
