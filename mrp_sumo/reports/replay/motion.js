/* Where every robot is, and where the plan has it, at any time. Lengths in metres from the lower left corner of the map. */
import { ABSENT, BLOCKED, NEVER, WAITING } from "./constants.js";

export class Motion {
  constructor(run) {
    const c = run.columns;
    this.numRobots = run.robots.length;
    this.owner = run.owner || []; // robots of what is drawn below them: rows of trailers and loads come after those of robots
    this.numBodies = this.numRobots + this.owner.length;
    this.numSamples = run.num_samples;
    this.period = run.period_s;
    this.unit = run.unit_m;
    this.stride = this.numSamples; // samples that there is room for
    this.x = c.x; // robot by robot, [R * stride]
    this.y = c.y;
    this.yaw = c.yaw; // 256 to a full turn
    this.state = c.state;
    this.first = c.plan_first || new Uint32Array(this.numRobots + 1);
    this.visit = { vertex: c.plan_vertex, arrive: c.plan_arrive, depart: c.plan_depart, arrived: c.plan_arrived }; // ms
    this.backward = c.plan_backward || null; // visits to which robots come backward
    this.hasPlan = this.first[this.numRobots] > 0;
    this.isPlanOnly = run.plan_only;
    this.vertexX = c.vertex_x && Float32Array.from(c.vertex_x, (v) => v * run.vertex_unit_m);
    this.vertexY = c.vertex_y && Float32Array.from(c.vertex_y, (v) => v * run.vertex_unit_m);
    this.bends = run.bends || {}; // by the vertices at the ends of lanes: share of the lane, x, y, course
    this.pose = new Float32Array(3 * this.numBodies); // x, y, yaw of everybody at the time last asked for
    this.states = new Uint8Array(this.numBodies); // and the states
    this.now = this.states.subarray(0, this.numRobots);
    this.ghost = new Float32Array(3 * this.numRobots);
    this.people = run.people && { ...run.people, x: c.people_x, y: c.people_y, since: c.people_since, count: c.people_count, at: [] };
    this.waits = run.live ? new Int16Array(this.numBodies * this.stride).fill(-1) : null; // robot waited for, or a reason (live.js)
    this.received = 0;
  }

  get end() {
    return Math.max(0, this.numSamples - 1) * this.period;
  }

  /* ---- of a run under way ---- */

  /* Take samples: of each robot, trailer and load x, y (2 bytes each), yaw, state (1 byte each), whom it waits for (2 bytes). */
  append(bytes) {
    const R = this.numBodies, count = bytes.length / (8 * R), words = new Uint16Array(bytes.buffer), signed = new Int16Array(bytes.buffer);
    while (this.received + count > this.stride) this.grow();
    for (let n = 0, p = 0; n < count; n++, this.received++) {
      for (let r = 0, i = this.received; r < R; r++, i += this.stride, p += 8) {
        this.x[i] = words[p / 2];
        this.y[i] = words[p / 2 + 1];
        this.yaw[i] = bytes[p + 4];
        this.state[i] = bytes[p + 5];
        this.waits[i] = signed[p / 2 + 3];
      }
    }
    this.numSamples = Math.max(this.numSamples, this.received);
  }

  grow() {
    const old = this.stride, R = this.numBodies;
    this.stride = Math.max(600, 2 * old);
    for (const name of ["x", "y", "yaw", "state", "waits"]) {
      const from = this[name], to = new from.constructor(R * this.stride);
      for (let r = 0; r < R; r++) to.set(from.subarray(r * old, (r + 1) * old), r * this.stride);
      this[name] = to;
    }
  }

  waitsAt(robot, t) {
    const state = this.state[robot * this.stride + this.sampleAt(t)];
    return state === WAITING || state === BLOCKED ? this.waits[robot * this.stride + this.sampleAt(t)] : -1;
  }

  sampleAt(t) {
    return Math.max(0, Math.min(this.numSamples - 1, Math.floor(t / this.period + 1e-6)));
  }

  /* Fill `pose` and `states`. */
  seek(t) {
    const k = this.sampleAt(t), T = this.stride;
    const last = k >= this.numSamples - 1;
    const u = last ? 0 : Math.max(0, Math.min(1, t / this.period - k));
    const { x, y, yaw, state, pose, states, unit } = this;
    for (let r = 0, i = k, p = 0; r < this.numBodies; r++, i += T, p += 3) {
      states[r] = state[i];
      const j = last || state[i + 1] === ABSENT ? i : i + 1;
      pose[p] = (x[i] + u * (x[j] - x[i])) * unit;
      pose[p + 1] = (y[i] + u * (y[j] - y[i])) * unit;
      const turn = ((yaw[j] - yaw[i] + 384) & 255) - 128;
      pose[p + 2] = (yaw[i] + u * turn) * (Math.PI / 128);
    }
  }

  /* Fill `people.at` with x and y of everybody who is there. */
  seekPeople(t) {
    const { x, y, since, count, every, at } = this.people, { unit } = this;
    const exact = Math.max(0, t / this.period / every), k = Math.floor(exact + 1e-6), u = Math.max(0, Math.min(1, exact - k));
    at.length = 0;
    for (let p = 0, begin = 0; p < since.length; begin += count[p++]) {
      const i = begin + k - since[p];
      if (k < since[p] || i >= begin + count[p]) continue;
      const j = i + 1 < begin + count[p] ? i + 1 : i;
      at.push((x[i] + u * (x[j] - x[i])) * unit, (y[i] + u * (y[j] - y[i])) * unit);
    }
  }

  /* The visit a robot is at, or has left for the next one, by plan. */
  visitAt(robot, t) {
    const ms = t * 1000 + 0.5, arrive = this.visit.arrive;
    let low = this.first[robot], high = this.first[robot + 1] - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (arrive[middle] <= ms) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /* Places [x, y] along the lane from a vertex to another, both ends included. */
  lane(a, b) {
    const bend = this.bends[`${a},${b}`];
    return bend ? bend.map(([, x, y]) => [x, y]) : [[this.vertexX[a], this.vertexY[a]], [this.vertexX[b], this.vertexY[b]]];
  }

  /* Fill `ghost` with where the plan has everybody. */
  seekPlan(t) {
    const { vertex, arrive, depart } = this.visit;
    const { vertexX, vertexY, ghost, first } = this;
    const ms = t * 1000;
    for (let r = 0, p = 0; r < this.numRobots; r++, p += 3) {
      const k = this.visitAt(r, t), more = k + 1 < first[r + 1];
      let a = k, b = more ? k + 1 : k, u = 0;
      if (more && ms > depart[k]) u = Math.min(1, (ms - depart[k]) / Math.max(1, arrive[k + 1] - depart[k]));
      const ax = vertexX[vertex[a]], ay = vertexY[vertex[a]], bx = vertexX[vertex[b]], by = vertexY[vertex[b]];
      ghost[p] = ax + u * (bx - ax);
      ghost[p + 1] = ay + u * (by - ay);
      if (u === 0 && k > first[r]) a = k - 1, b = k; // standing: the way it came
      const bend = this.bends[`${vertex[a]},${vertex[b]}`], back = this.backward && this.backward[b] ? Math.PI : 0;
      if (bend) {
        const share = b === k ? 1 : u, j = Math.max(1, bend.findIndex((node) => node[0] >= share));
        const [from, to] = [bend[j - 1], bend[j]], w = (share - from[0]) / (to[0] - from[0] || 1);
        for (let n = 0; n < 3; n++) ghost[p + n] = from[n + 1] + w * (to[n + 1] - from[n + 1]) + (n === 2 ? back : 0);
        continue;
      }
      const dx = vertexX[vertex[b]] - vertexX[vertex[a]], dy = vertexY[vertex[b]] - vertexY[vertex[a]];
      ghost[p + 2] = Math.atan2(dy, dx) + back;
    }
  }

  speedAt(robot, t) {
    const around = Math.round(0.5 / this.period), k = this.sampleAt(t); // positions are rounded: a single step says too little
    const first = Math.max(0, k - around), last = Math.min(this.numSamples - 1, k + 1 + around);
    let way = 0;
    for (let i = robot * this.stride + first; i < robot * this.stride + last; i++) way += Math.hypot(this.x[i + 1] - this.x[i], this.y[i + 1] - this.y[i]);
    return last > first ? (way * this.unit) / ((last - first) * this.period) : 0;
  }

  /* Seconds behind the plan at the latest visit reached, null before any. */
  latenessAt(robot, t) {
    const { arrive, arrived } = this.visit;
    let late = null;
    for (let k = this.first[robot]; k < this.first[robot + 1] && arrived[k] <= t * 1000; k++) late = (arrived[k] - arrive[k]) / 1000;
    return late;
  }

  /* [T][4] how many robots are in each state at each sample. */
  census() {
    const T = this.numSamples, count = new Uint32Array(T * 5);
    for (let r = 0; r < this.numRobots; r++) for (let k = 0, i = r * this.stride; k < T; k++, i++) count[5 * k + this.state[i]]++;
    return count;
  }

  /* Seconds a robot spends in each state, [R * 5]. */
  totals() {
    const T = this.numSamples, total = new Float64Array(this.numRobots * 5);
    for (let r = 0; r < this.numRobots; r++) for (let k = 0, i = r * this.stride; k < T; k++, i++) total[5 * r + this.state[i]] += this.period;
    return total;
  }
}

/* The events, by time, and by robot. */
export class Events {
  constructor(run) {
    const c = run.columns;
    this.count = c.event_t ? c.event_t.length : 0;
    this.t = c.event_t; // ms
    this.duration = c.event_duration; // ms
    this.kind = c.event_kind; // index into kinds
    this.robot = c.event_robot; // NEVER: none
    this.other = c.event_other;
    this.vertex = c.event_vertex;
    this.kinds = run.event_kinds;
    this.text = run.event_text; // {index: text}
    this.live = null; // where a run under way says whom robots wait for
    this.listed = [];
    this.index();
  }

  index() {
    this.perKind = new Uint32Array(this.kinds.length);
    this.ofRobot = new Map();
    this.disturbed = new Map(); // robot: events that say so
    for (let i = 0; i < this.count; i++) {
      this.perKind[this.kind[i]]++;
      for (const robot of [this.robot[i], this.other[i]]) {
        if (robot === NEVER || (robot === this.robot[i] && robot === this.other[i])) continue;
        if (!this.ofRobot.has(robot)) this.ofRobot.set(robot, []);
        this.ofRobot.get(robot).push(i);
        if (this.kinds[this.kind[i]] === "disturbed") this.disturbed.set(robot, [...(this.disturbed.get(robot) || []), i]);
      }
    }
  }

  /* Take events of a run under way: time and duration in ms, kind, robot, other robot and vertex (-1: none), text. */
  append(events) {
    this.listed = [...this.listed, ...events].sort((a, b) => a[0] - b[0]);
    this.kinds = [...new Set([...this.kinds, ...events.map((e) => e[1])])];
    const column = (k) => Uint32Array.from(this.listed, (e) => (e[k] < 0 ? NEVER : e[k]));
    [this.t, this.robot, this.other, this.vertex] = [0, 2, 3, 4].map(column);
    this.duration = Uint32Array.from(this.listed, (e) => (e[5] === null ? NEVER - 1 : e[5]));
    this.kind = Uint8Array.from(this.listed, (e) => this.kinds.indexOf(e[1]));
    this.text = Object.fromEntries(this.listed.map((e, i) => [i, e[6]]).filter(([, text]) => text));
    this.count = this.listed.length;
    this.index();
  }

  seconds(i) {
    return this.t[i] / 1000;
  }

  /* What a robot suffers from at a time, such as 'breaks down', '' for nothing. */
  disturbance(robot, t) {
    const ms = t * 1000 + 0.5, i = (this.disturbed.get(robot) || []).find((k) => this.t[k] <= ms && ms <= this.t[k] + this.duration[k]);
    return i === undefined ? "" : this.text[i] || "";
  }

  /* Whom a robot waits for at a time, NEVER for nobody: of the events that last, the latest begun. */
  waitsFor(robot, t) {
    if (this.live) return this.live.otherAt(robot, t);
    const ms = t * 1000 + 0.5, own = this.ofRobot.get(robot) || [];
    let other = NEVER;
    for (const i of own) {
      if (this.t[i] > ms) break;
      if (this.robot[i] === robot && this.other[i] !== NEVER && this.duration[i] > 0 && this.t[i] + this.duration[i] >= ms) other = this.other[i];
    }
    return other;
  }

  /* The first event after a time, -1 for none; or with step -1 the last before. */
  nextAfter(t, step, wanted) {
    const ms = Math.round(t * 1000);
    if (step > 0) {
      for (let i = 0; i < this.count; i++) if (this.t[i] > ms && wanted(i)) return i;
    } else {
      for (let i = this.count - 1; i >= 0; i--) if (this.t[i] < ms - 1 && wanted(i)) return i;
    }
    return -1;
  }
}
