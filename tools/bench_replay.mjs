/* node bench_replay.mjs CHROMIUM PAGE: load time and frame rate of a replay page, as one line of JSON: drawn by the processor, as in a
   browser without a graphics card, or with REPLAY_GPU set by the card. Needs playwright-core. */
import { createRequire } from "node:module";
import { performance } from "node:perf_hooks";

const [, , executablePath, page] = process.argv;
const { chromium } = createRequire(import.meta.url)("playwright-core");
const gpu = process.env.REPLAY_GPU ? [] : ["--disable-gpu"];
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", ...gpu] });
try {
  const tab = await browser.newPage({ viewport: { width: 1440, height: 900 } });
  const problems = [];
  tab.on("console", (message) => ["error", "warning"].includes(message.type()) && problems.push(message.text()));
  tab.on("pageerror", (error) => problems.push(error.message));
  const began = performance.now();
  await tab.goto(`file://${page}`);
  await tab.waitForFunction(() => document.documentElement.dataset.ready, null, { timeout: 120000 });
  const load_s = (performance.now() - began) / 1000;
  const told = await tab.evaluate(async () => {
    const app = window.replay;
    app.setSpeed(8);
    app.play(true);
    await new Promise((done) => setTimeout(done, 1000));
    const frames = app.frames, from = performance.now();
    await new Promise((done) => setTimeout(done, 4000));
    const fps = ((app.frames - frames) * 1000) / (performance.now() - from);
    app.play(false);
    let spent = 0; // by the page's scripts alone: what a frame costs before it goes to the graphics card
    for (let i = 0; i < 60; i++) {
      app.view.t = (app.motion.end * (i + 1)) / 61;
      const a = performance.now();
      app.motion.seek(app.view.t);
      for (const part of ["drawTrails", "drawTies", "drawGhosts", "drawRobots"]) app.scene[part](app.view);
      spent += performance.now() - a;
    }
    const gl = app.scene.painter.renderer?.gl, counted = { calls: 0, bytes: 0 }, own = {}; // what one frame asks of the graphics card
    const size = (data, length) => (length ? length * data.BYTES_PER_ELEMENT : data.byteLength) || 0;
    for (const name of gl ? ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced", "bufferData", "bufferSubData"] : []) {
      own[name] = gl[name];
      gl[name] = (...given) => {
        if (name.startsWith("draw")) counted.calls++;
        else if (name.startsWith("buffer")) counted.bytes += given.filter((value) => value?.byteLength).reduce((sum, value) => sum + size(value, given[4]), 0);
        return own[name].apply(gl, given);
      };
    }
    app.view.t = app.motion.end / 2;
    app.motion.seek(app.view.t);
    app.scene.draw(app.view, 0);
    for (const name in own) gl[name] = own[name];
    const drawn = []; // the frame as a whole, drawn and read back: waits for what draws
    for (let i = 0; i < 5; i++) {
      app.view.t = (app.motion.end * (i + 1)) / 6;
      const a = performance.now();
      app.motion.seek(app.view.t);
      app.scene.draw(app.view, 0);
      if (gl) gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      else app.scene.painter.context.getImageData(0, 0, 1, 1);
      drawn.push(performance.now() - a);
    }
    const seek = performance.now();
    app.scene.showHeat("waiting");
    return { fps, script_ms: spent / 60, calls: counted.calls, upload_kb: counted.bytes / 1000, frame_ms: drawn.sort((a, b) => a - b)[2], heat_ms: performance.now() - seek, painter: gl ? "WebGL" : "canvas", memory: performance.memory?.usedJSHeapSize / 1e6, ready: document.documentElement.dataset.ready };
  });
  const round = (value, digits) => Number(value.toFixed(digits));
  console.log(JSON.stringify({ browser: `Chromium ${browser.version()}${gpu.length ? ", no graphics card" : ""}`, painter: told.painter, load_time_s: round(load_s, 2), frames_per_s: round(told.fps, 1), script_ms_per_frame: round(told.script_ms, 2), draw_calls: told.calls, upload_kb_per_frame: round(told.upload_kb, 0), frame_ms: round(told.frame_ms, 0), heat_map_ms: round(told.heat_ms, 0), page_heap_mb: round(told.memory || 0, 0), ready: told.ready, console_problems: problems.length }));
  if (problems.length) console.error(problems.slice(0, 3).join("\n"));
} finally {
  await browser.close();
}
