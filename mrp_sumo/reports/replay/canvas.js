/* Draws without a graphics card, where WebGL would be worked out by the processor, or is not there at all: with the canvas's own
   strokes and copies. Layers take the same calls as those of shaders.js. What stands still is drawn once a view and copied. */

const ANGLES = 64; // pictures of a robot a full turn
const LARGEST = 20; // pixels of half a robot up to which it is copied from a picture
const FADE = 40; // of 255: a stroke that fades by more is drawn in pieces
const MAX_PICTURES = 2000; // of a colour

export class CanvasPainter {
  async start(canvas, overlay) {
    Object.assign(this, { canvas, overlay });
    overlay.style.display = "none"; // names go on the floor itself
    this.ratio = Math.min(2, window.devicePixelRatio || 1);
    this.context = canvas.getContext("2d", { alpha: false, willReadFrequently: true });
    if (!this.context) throw new Error("This browser draws neither with WebGL 2 nor on a canvas.");
    this.still = document.createElement("canvas");
    this.layers = [];
    this.polygons = this.boxes = [];
    this.pictures = new Map(); // of a colour, by size, style and angle
  }

  strokes(isStill = false) {
    return this.layer(new StrokeLayer(this, isStill));
  }

  robots(isStill = false) {
    return this.layer(new RobotLayer(this, isStill));
  }

  layer(layer) {
    this.layers.push(layer);
    return layer;
  }

  resize(width, height) {
    for (const canvas of [this.canvas, this.still, this.overlay]) {
      canvas.width = Math.round(width * this.ratio);
      canvas.height = Math.round(height * this.ratio);
    }
    this.canvas.style.width = `${width}px`;
    this.canvas.style.height = `${height}px`;
    this.drawn = "";
  }

  setPaper(color) {
    this.paper = color;
    this.pictures.clear();
    this.color = null;
    this.drawn = "";
  }

  drawFloor(polygons, boxes) {
    Object.assign(this, { polygons, boxes });
    this.drawn = "";
  }

  setHeat(picture, width, height) {
    this.heat = picture && { picture, width, height };
    this.drawn = "";
  }

  render(camera, width, height, isDark, beat) {
    const { context, ratio } = this, view = { ...camera, width, height, isDark, beat, ratio };
    const wanted = `${camera.scale} ${camera.x} ${camera.y}`;
    if (wanted !== this.drawn) this.drawStill(view), (this.drawn = wanted);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.globalAlpha = 1;
    context.drawImage(this.still, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    for (const layer of this.layers) if (!layer.isStill) layer.paint(context, view);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.globalAlpha = 1;
    return context;
  }

  drawStill(view) {
    const c = this.still.getContext("2d", { alpha: false, willReadFrequently: true });
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.globalAlpha = 1;
    c.fillStyle = this.paper;
    c.fillRect(0, 0, this.still.width, this.still.height);
    const s = view.scale * view.ratio;
    c.setTransform(s, 0, 0, -s, view.x * view.ratio, view.y * view.ratio);
    for (const [points, color, alpha = 1] of this.polygons) {
      c.fillStyle = color;
      c.globalAlpha = alpha;
      c.beginPath();
      for (let i = 0; i < points.length; i += 2) c.lineTo(points[i], points[i + 1]);
      c.fill();
    }
    c.globalAlpha = 1;
    c.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
    for (const [[x, y, w, h], color] of this.boxes) { // to whole pixels: neighbours leave no seam
      const left = Math.round(x * view.scale + view.x), top = Math.round(view.y - (y + h) * view.scale);
      c.fillStyle = color;
      c.fillRect(left, top, Math.round((x + w) * view.scale + view.x) - left, Math.round(view.y - y * view.scale) - top);
    }
    if (this.heat) {
      const { picture, width, height } = this.heat;
      c.drawImage(picture, view.x, view.y - height * view.scale, width * view.scale, height * view.scale);
    }
    for (const layer of this.layers) if (layer.isStill) layer.paint(c, view);
  }

  /* A robot as it looks at an angle; sizes in quarters of a pixel. */
  picture(length, width, style, color, angle, view) {
    if (color !== this.color) this.ofColor = this.pictures.get(color) || this.pictures.set(color, new Map()).get(color);
    this.color = color;
    const key = ((length * 128 + width) * 8 + style) * ANGLES + angle;
    let found = this.ofColor.get(key);
    if (!found) {
      if (this.ofColor.size > MAX_PICTURES) this.ofColor.clear();
      const hx = length / 4, hy = width / 4, side = 2 * Math.ceil((Math.hypot(hx, hy) + 2) * view.ratio);
      found = document.createElement("canvas");
      found.width = found.height = side;
      const c = found.getContext("2d", { willReadFrequently: true });
      c.setTransform(view.ratio, 0, 0, view.ratio, side / 2, side / 2);
      c.rotate((-angle * 2 * Math.PI) / ANGLES);
      drawRobot(c, hx, hy, style, color, view.isDark);
      this.ofColor.set(key, found);
    }
    return found;
  }
}

class StrokeLayer {
  constructor(painter, isStill) {
    Object.assign(this, { painter, isStill, strokes: [], count: 0 });
    this.groups = new Map(); // of colour, width and ends: coordinates of one path
  }

  begin() {
    this.strokes.length = 0;
  }

  add(ax, ay, bx, by, width, pixels, round, from, to = from) {
    this.strokes.push(ax, ay, bx, by, width, pixels, round ? 1 : 0, from, to);
  }

  end() {
    if (this.isStill) this.painter.drawn = "";
  }

  paint(c, view) {
    const { strokes: s, groups } = this, { scale: k, x, y, width: w, height: h } = view;
    for (const path of groups.values()) path.length = 0;
    for (let i = 0; i < s.length; i += 9) {
      const ax = s[i] * k + x, ay = y - s[i + 1] * k, bx = s[i + 2] * k + x, by = y - s[i + 3] * k, thick = Math.max(s[i + 4] * k, s[i + 5]);
      if ((ax < -thick && bx < -thick) || (ay < -thick && by < -thick) || (ax > w + thick && bx > w + thick) || (ay > h + thick && by > h + thick)) continue;
      const from = s[i + 7] >>> 24, to = s[i + 8] >>> 24, pieces = Math.ceil((Math.abs(to - from) + 1) / FADE);
      for (let p = 0; p < pieces; p++) {
        const a = p / pieces, b = (p + 1) / pieces, opacity = (from + (to - from) * 0.5 * (a + b)) & 0xf8;
        const key = (((s[i + 7] & 0xffffff) * 32 + (opacity >> 3)) * 64 + Math.min(63, Math.round(2 * thick))) * 2 + s[i + 6];
        let path = groups.get(key);
        if (!path) groups.set(key, (path = []));
        path.push(ax + (bx - ax) * a, ay + (by - ay) * a, ax + (bx - ax) * b, ay + (by - ay) * b);
      }
    }
    for (const [key, path] of groups) {
      if (!path.length) {
        groups.delete(key);
        continue;
      }
      const look = Math.floor(key / 2), rest = Math.floor(look / 64), word = Math.floor(rest / 32);
      c.strokeStyle = c.fillStyle = cssOf(word);
      c.globalAlpha = Math.min(1, ((rest % 32) * 8 + 4) / 252);
      c.lineWidth = (look % 64) / 2;
      c.lineCap = key % 2 ? "round" : "butt";
      const thick = c.lineWidth, half = 0.5 * thick;
      let slanted = 0;
      for (let i = 0; i < path.length; i += 4) {
        const ax = path[i], ay = path[i + 1], dx = path[i + 2] - ax, dy = path[i + 3] - ay;
        if (key % 2 === 0 && dy > -0.3 && dy < 0.3) c.fillRect(dx < 0 ? ax + dx : ax, ay - half, Math.abs(dx), thick); // much faster than a stroke
        else if (key % 2 === 0 && dx > -0.3 && dx < 0.3) c.fillRect(ax - half, dy < 0 ? ay + dy : ay, thick, Math.abs(dy));
        else {
          if (slanted++ === 0) c.beginPath();
          c.moveTo(ax, ay);
          c.lineTo(ax + dx, ay + dy);
        }
      }
      if (slanted) c.stroke();
    }
    c.globalAlpha = 1;
  }
}

class RobotLayer {
  constructor(painter, isStill) {
    Object.assign(this, { painter, isStill, robots: [] });
  }

  begin() {
    this.robots.length = 0;
  }

  add(x, y, yaw, length, width, pixels, style, pulse, opacity, color) {
    this.robots.push(x, y, yaw, length, width, pixels, style, pulse, opacity, color);
  }

  end() {
    if (this.isStill) this.painter.drawn = "";
  }

  paint(c, view) {
    const { robots: r, painter } = this, { scale: k, ratio } = view;
    for (let i = 0; i < r.length; i += 10) {
      const x = r[i] * k + view.x, y = view.y - r[i + 1] * k, grow = Math.max(1, r[i + 5] / Math.max(r[i + 3] * k, 0.001));
      let hx = 0.5 * r[i + 3] * k * grow, hy = 0.5 * r[i + 4] * k * grow;
      if (hy < 0.55 * hx && grow > 1) hy = 0.55 * hx;
      const reach = hx + hy + 14, style = r[i + 6], color = r[i + 9], yaw = r[i + 2];
      if (x < -reach || y < -reach || x > view.width + reach || y > view.height + reach) continue;
      c.globalAlpha = r[i + 8];
      if (r[i + 7] > 0) drawPulse(c, x, y, hx, hy, yaw, r[i + 7], color, view);
      if (style === 3) {
        c.fillStyle = cssOf(color);
        c.beginPath();
        c.arc(x, y, Math.min(hx, hy), 0, 2 * Math.PI);
        c.fill();
      } else if (style === 2 || hx > LARGEST) {
        c.save();
        c.translate(x, y);
        c.rotate(-yaw);
        drawRobot(c, hx, hy, style, color, view.isDark);
        c.restore();
      } else {
        const angle = ((Math.round((yaw * ANGLES) / (2 * Math.PI)) % ANGLES) + ANGLES) % ANGLES;
        const picture = painter.picture(Math.round(4 * hx), Math.round(4 * hy), style, color, angle, view), half = picture.width / 2;
        c.drawImage(picture, Math.round(x * ratio - half) / ratio, Math.round(y * ratio - half) / ratio, picture.width / ratio, picture.width / ratio); // on whole pixels
      }
    }
    c.globalAlpha = 1;
  }
}

/* Half a robot's length and width in pixels; styles: 0 a robot, 1 where the plan has it, 2 a ring around it, 4 what it tows or carries. It heads to the right. */
function drawRobot(c, hx, hy, style, color, isDark) {
  const small = Math.min(hx, hy), css = cssOf(color);
  const box = (more, radius) => {
    c.beginPath();
    c.roundRect(-hx - more, -hy - more, 2 * (hx + more), 2 * (hy + more), Math.max(0, radius));
  };
  if (style === 2) {
    c.strokeStyle = css;
    c.globalAlpha *= 0.25;
    c.lineWidth = 7;
    box(5, 0.35 * small + 5);
    c.stroke();
    c.globalAlpha *= 4;
    c.lineWidth = 2.5;
    c.stroke();
    return;
  }
  const arrow = () => {
    c.beginPath();
    c.moveTo(0.62 * hx, 0);
    c.lineTo(-0.5 * hx, 0.56 * hy);
    c.lineTo(-0.24 * hx, 0);
    c.lineTo(-0.5 * hx, -0.56 * hy);
    c.closePath();
  };
  if (style === 1) {
    c.strokeStyle = c.fillStyle = css;
    c.lineWidth = 1.4;
    box(-0.6, 0.3 * small);
    c.stroke();
    c.globalAlpha *= 0.14;
    c.fill();
    c.globalAlpha /= 0.14;
    if (small <= 5) return;
    c.globalAlpha *= 0.75;
    arrow();
    c.lineWidth = 1;
    c.stroke();
    return;
  }
  c.fillStyle = mixed(color, isDark ? 255 : 0, 0.32);
  box(0, 0.34 * small);
  c.fill();
  c.fillStyle = css;
  const rim = Math.min(1.6, 0.12 * small);
  box(-rim, 0.34 * small - rim);
  c.fill();
  if (small <= 3.2 || style === 4) return;
  c.fillStyle = "rgba(255,255,255,0.95)";
  arrow();
  c.fill();
}

function drawPulse(c, x, y, hx, hy, yaw, strength, color, { beat }) {
  const opacity = c.globalAlpha, ring = 2 + 8 * beat;
  c.save();
  c.translate(x, y);
  c.rotate(-yaw);
  c.strokeStyle = cssOf(color);
  for (const [gap, width, alpha] of [[2.5, 5, 0.2], [ring, 2.4, 1 - beat]]) {
    c.globalAlpha = Math.min(1, opacity * strength * alpha);
    c.lineWidth = width;
    c.beginPath();
    c.roundRect(-hx - gap, -hy - gap, 2 * (hx + gap), 2 * (hy + gap), 0.35 * Math.min(hx, hy) + gap);
    c.stroke();
  }
  c.restore();
}

/* The colour of a word of shaders.js, without its opacity. */
function cssOf(word) {
  return `rgb(${word & 255},${(word >>> 8) & 255},${(word >>> 16) & 255})`;
}

function mixed(word, with_, share) {
  const [r, g, b] = [word & 255, (word >>> 8) & 255, (word >>> 16) & 255].map((v) => Math.round(v + share * (with_ - v)));
  return `rgb(${r},${g},${b})`;
}
