/* global PIXI */
/* Two shaders for PixiJS meshes, both instanced, so that thousands of strokes or robots are one draw each.
   Coordinates are metres; uView is (pixels per metre, x and y of the origin in pixels, time), uScreen (width, height, ., .). */

const STROKE_VERTEX = `#version 300 es
in vec2 aPosition; in vec4 aEnds; in vec3 aPen; in vec4 aFrom; in vec4 aTo;
uniform vec4 uView; uniform vec4 uScreen;
out vec2 vAt; out float vLength; out float vHalf; out float vRound; out vec4 vColor;
void main() {
  vec2 a = vec2(aEnds.x, -aEnds.y) * uView.x + uView.yz, b = vec2(aEnds.z, -aEnds.w) * uView.x + uView.yz;
  vec2 step = b - a;
  vLength = length(step);
  vec2 along = vLength > 0.001 ? step / vLength : vec2(1.0, 0.0), across = vec2(-along.y, along.x);
  vHalf = 0.5 * max(aPen.x * uView.x, aPen.y);
  vRound = aPen.z;
  float reach = vHalf + 1.0, cap = vRound > 0.5 ? reach : 0.0;
  vAt = vec2(mix(-cap, vLength + cap, aPosition.x), aPosition.y * reach);
  vColor = mix(aFrom, aTo, aPosition.x);
  vec2 p = a + along * vAt.x + across * vAt.y;
  gl_Position = vec4(p.x / uScreen.x * 2.0 - 1.0, 1.0 - p.y / uScreen.y * 2.0, 0.0, 1.0);
}`;

const STROKE_FRAGMENT = `#version 300 es
precision highp float;
in vec2 vAt; in float vLength; in float vHalf; in float vRound; in vec4 vColor;
out vec4 color;
void main() {
  float beyond = vRound > 0.5 ? max(0.0, max(-vAt.x, vAt.x - vLength)) : 0.0;
  float alpha = clamp(vHalf + 0.5 - length(vec2(beyond, vAt.y)), 0.0, 1.0) * vColor.a;
  color = vec4(vColor.rgb * alpha, alpha);
}`;

/* aLook: x smallest size in pixels, y style (0 robot, 1 ghost, 2 ring around a robot, 3 plain disc, 4 what it tows or carries), z strength of the pulse, w opacity. */
const ROBOT_VERTEX = `#version 300 es
in vec2 aPosition; in vec3 aPose; in vec2 aSize; in vec4 aLook; in vec4 aColor;
uniform vec4 uView; uniform vec4 uScreen;
out vec2 vAt; out vec2 vHalf; out vec4 vLook; out vec4 vColor;
void main() {
  float grow = max(1.0, aLook.x / max(aSize.x * uView.x, 0.001));
  vHalf = 0.5 * aSize * uView.x * grow;
  if (vHalf.y < 0.55 * vHalf.x && grow > 1.0) vHalf.y = 0.55 * vHalf.x;
  float margin = 4.0 + (aLook.y > 1.5 || aLook.z > 0.0 ? 12.0 : 0.0);
  vAt = aPosition * (vHalf + margin);
  vLook = aLook; vColor = aColor;
  float c = cos(aPose.z), s = sin(aPose.z);
  vec2 p = vec2(aPose.x, -aPose.y) * uView.x + uView.yz + vec2(c * vAt.x - s * vAt.y, -s * vAt.x - c * vAt.y);
  gl_Position = vec4(p.x / uScreen.x * 2.0 - 1.0, 1.0 - p.y / uScreen.y * 2.0, 0.0, 1.0);
}`;

const ROBOT_FRAGMENT = `#version 300 es
precision highp float;
in vec2 vAt; in vec2 vHalf; in vec4 vLook; in vec4 vColor;
uniform vec4 uView; uniform vec4 uScreen;
out vec4 color;
vec4 over(vec4 top, vec4 below) { return top + below * (1.0 - top.a); }
vec4 ink(vec3 rgb, float alpha) { return vec4(rgb * alpha, alpha); }
float box(vec2 p, vec2 half_, float r) { vec2 q = abs(p) - half_ + r; return length(max(q, 0.0)) + min(max(q.x, q.y), 0.0) - r; }
float arrow(vec2 p, vec2 h) { // a navigation arrow that points to +x
  vec2 tip = vec2(0.62 * h.x, 0.0), wing = vec2(-0.5 * h.x, 0.56 * h.y), notch = vec2(-0.24 * h.x, 0.0);
  vec2 q = vec2(p.x, abs(p.y));
  return max(dot(q - tip, normalize(vec2(wing.y, tip.x - wing.x))), dot(q - notch, normalize(vec2(-wing.y, wing.x - notch.x))));
}
void main() {
  float small = min(vHalf.x, vHalf.y), style = vLook.y;
  color = vec4(0.0);
  if (style > 2.5 && style < 3.5) {
    color = ink(vColor.rgb, clamp(0.5 + small - length(vAt), 0.0, 1.0) * vColor.a * vLook.w);
    return;
  }
  if (style > 1.5 && style < 2.5) {
    float d = abs(box(vAt, vHalf + 5.0, small * 0.35 + 5.0)) - 1.25;
    color = over(ink(vColor.rgb, clamp(0.5 - d, 0.0, 1.0)), ink(vColor.rgb, 0.28 * clamp(1.0 - d / 5.0, 0.0, 1.0)));
    return;
  }
  float d = box(vAt, vHalf, 0.34 * small);
  if (style > 0.5 && style < 1.5) {
    float line = clamp(1.2 - abs(d + 0.6), 0.0, 1.0);
    color = over(ink(vColor.rgb, line), ink(vColor.rgb, 0.14 * clamp(0.5 - d, 0.0, 1.0)));
    if (small > 5.0) color = over(ink(vColor.rgb, 0.75 * clamp(1.0 - abs(arrow(vAt, vHalf)), 0.0, 1.0)), color);
    color *= vLook.w;
    return;
  }
  if (vLook.z > 0.0) {
    float beat = fract(uView.w), ring = 2.0 + 8.0 * beat;
    color = ink(vColor.rgb, vLook.z * (1.0 - beat) * clamp(1.8 - abs(d - ring), 0.0, 1.0));
    color = over(ink(vColor.rgb, 0.22 * vLook.z * clamp(1.0 - d / 7.0, 0.0, 1.0)), color);
  }
  float shadow = small > 4.0 ? 0.22 * clamp(1.0 - d / 3.5, 0.0, 1.0) : 0.0;
  color = over(vec4(0.0, 0.0, 0.0, shadow), color);
  vec3 edge = mix(vColor.rgb, uScreen.z > 0.5 ? vec3(1.0) : vec3(0.0), 0.32);
  color = over(ink(edge, clamp(0.5 - d, 0.0, 1.0)), color);
  float rim = clamp(small * 0.12, 0.0, 1.6);
  vec3 body = vColor.rgb * (1.0 + 0.10 * vAt.x / max(vHalf.x, 1.0));
  color = over(ink(body, clamp(0.5 - d - rim, 0.0, 1.0)), color);
  if (small > 3.2 && style < 0.5) color = over(ink(vec3(1.0), 0.95 * clamp(0.5 - arrow(vAt, vHalf), 0.0, 1.0)), color);
  color *= vLook.w;
}`;

/* A mesh of instances of one quad. `layout` names the instance attributes: [name, format, bytes]. */
class Instances {
  constructor(vertex, fragment, quad, layout, uniforms) {
    this.stride = layout.reduce((sum, [, , bytes]) => sum + bytes, 0);
    this.buffer = new PIXI.Buffer({ data: new Float32Array(this.stride / 4), usage: PIXI.BufferUsage.VERTEX | PIXI.BufferUsage.COPY_DST, shrinkToFit: false });
    const attributes = { aPosition: { buffer: new Float32Array(quad), format: "float32x2" } };
    let offset = 0;
    for (const [name, format, bytes] of layout) {
      attributes[name] = { buffer: this.buffer, format, stride: this.stride, offset, instance: true };
      offset += bytes;
    }
    this.geometry = new PIXI.Geometry({ attributes, indexBuffer: new Uint16Array([0, 1, 2, 1, 3, 2]), instanceCount: 0 });
    const shader = new PIXI.Shader({ glProgram: PIXI.GlProgram.from({ vertex, fragment }), resources: { view: uniforms } });
    this.mesh = new PIXI.Mesh({ geometry: this.geometry, shader });
    this.mesh.visible = false;
    this.capacity = 1;
    this.count = 0;
    this.floats = this.buffer.data;
    this.words = new Uint32Array(this.floats.buffer);
  }

  /* Room for so many instances; what was written before is lost. */
  begin(capacity) {
    if (capacity > this.capacity) {
      this.capacity = Math.ceil(capacity * 1.25);
      this.floats = new Float32Array((this.capacity * this.stride) / 4);
      this.words = new Uint32Array(this.floats.buffer);
      this.buffer.data = this.floats;
    }
    this.count = 0;
  }

  end() {
    this.geometry.instanceCount = this.count;
    this.mesh.visible = this.count > 0;
    if (this.count) this.buffer.update(this.count * this.stride);
  }
}

export class Strokes extends Instances {
  constructor(uniforms) {
    super(STROKE_VERTEX, STROKE_FRAGMENT, [0, -1, 1, -1, 0, 1, 1, 1],
      [["aEnds", "float32x4", 16], ["aPen", "float32x3", 12], ["aFrom", "unorm8x4", 4], ["aTo", "unorm8x4", 4]], uniforms);
  }

  add(ax, ay, bx, by, width, pixels, round, from, to = from) {
    const f = this.floats, i = 9 * this.count++;
    f[i] = ax; f[i + 1] = ay; f[i + 2] = bx; f[i + 3] = by;
    f[i + 4] = width; f[i + 5] = pixels; f[i + 6] = round ? 1 : 0;
    this.words[i + 7] = from;
    this.words[i + 8] = to;
  }
}

export class Robots extends Instances {
  constructor(uniforms) {
    super(ROBOT_VERTEX, ROBOT_FRAGMENT, [-1, -1, 1, -1, -1, 1, 1, 1],
      [["aPose", "float32x3", 12], ["aSize", "float32x2", 8], ["aLook", "float32x4", 16], ["aColor", "unorm8x4", 4]], uniforms);
  }

  add(x, y, yaw, length, width, pixels, style, pulse, opacity, color) {
    const f = this.floats, i = 10 * this.count++;
    f[i] = x; f[i + 1] = y; f[i + 2] = yaw; f[i + 3] = length; f[i + 4] = width;
    f[i + 5] = pixels; f[i + 6] = style; f[i + 7] = pulse; f[i + 8] = opacity;
    this.words[i + 9] = color;
  }
}

/* "#rrggbb" and an opacity as the four bytes of a word. */
export function packed(hex, alpha = 1) {
  const rgb = parseInt(hex.slice(1), 16);
  return ((Math.round(alpha * 255) << 24) | ((rgb & 255) << 16) | (rgb & 0xff00) | (rgb >> 16)) >>> 0;
}
