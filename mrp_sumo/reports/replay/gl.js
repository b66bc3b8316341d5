/* global PIXI */
/* Draws with WebGL 2 on a graphics card: a few draw calls a frame, however many robots there are. */
import { Robots, Strokes } from "./shaders.js";

export class GlPainter {
  async start(canvas, overlay, width, height) {
    Object.assign(this, { canvas, overlay });
    this.renderer = await PIXI.autoDetectRenderer({
      canvas, preference: "webgl", antialias: false, resolution: Math.min(2, window.devicePixelRatio || 1), autoDensity: true, backgroundAlpha: 1,
      width, height, preserveDrawingBuffer: false, powerPreference: "high-performance",
      eventMode: "none", eventFeatures: { move: false, globalMove: false, click: false, wheel: false },
    });
    this.uniforms = new PIXI.UniformGroup({
      uView: { value: new Float32Array(4), type: "vec4<f32>" },
      uScreen: { value: new Float32Array(4), type: "vec4<f32>" },
    });
    this.ratio = this.renderer.resolution;
    this.stage = new PIXI.Container();
    this.ground = new PIXI.Container(); // in metres, y up
    this.floors = new PIXI.Graphics();
    this.ground.addChild(this.floors);
    this.stage.addChild(this.ground);
  }

  strokes() {
    return this.layer(new Strokes(this.uniforms));
  }

  robots() {
    return this.layer(new Robots(this.uniforms));
  }

  layer(instances) {
    this.stage.addChild(instances.mesh);
    return instances;
  }

  resize(width, height) {
    this.renderer.resize(width, height);
    this.overlay.width = Math.round(width * this.ratio);
    this.overlay.height = Math.round(height * this.ratio);
  }

  setPaper(color) {
    this.renderer.background.color = color;
  }

  /* `polygons` as [points, colour, opacity], `boxes` as [[x, y, width, height], colour]. */
  drawFloor(polygons, boxes) {
    this.floors.clear();
    for (const [points, color, alpha] of polygons) this.floors.poly(points).fill({ color, alpha });
    for (const [box, color] of boxes) this.floors.rect(...box).fill(color);
  }

  /* A picture that lies on the floor, its lower left corner at the origin; null for none. */
  setHeat(picture, width, height) {
    this.sprite?.destroy({ texture: true, textureSource: true });
    this.sprite = picture && new PIXI.Sprite(PIXI.Texture.from(picture));
    if (!picture) return;
    this.sprite.texture.source.scaleMode = "linear";
    this.sprite.scale.set(width / picture.width, -height / picture.height);
    this.sprite.position.set(0, height);
    this.ground.addChild(this.sprite);
  }

  /* A frame; what is written above it goes to the context that is returned, which is empty. */
  render(camera, width, height, isDark, beat) {
    const { uniforms: u, ground, ratio } = this;
    u.uniforms.uView.set([camera.scale, camera.x, camera.y, beat]);
    u.uniforms.uScreen.set([width, height, isDark ? 1 : 0, 0]);
    u.update();
    ground.position.set(camera.x, camera.y);
    ground.scale.set(camera.scale, -camera.scale);
    this.renderer.render({ container: this.stage });
    const context = this.overlay.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return context;
  }
}
