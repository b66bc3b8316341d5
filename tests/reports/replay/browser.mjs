/* node browser.mjs CHROMIUM PAGE NASTY_PAGE TWO_RUNS TRAINS FOLDER: uses a replay page as people do, and prints what came of it as lines of JSON
   {"claim", "holds", "found"}. Screenshots go to FOLDER. Needs playwright-core. */
import { createRequire } from "node:module";

const [, , executablePath, page, nasty, beside, trains, folder] = process.argv;
const { chromium } = createRequire(import.meta.url)("playwright-core");
const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});
const say = (claim, holds, found = null) => console.log(JSON.stringify({ claim, holds: Boolean(holds), found }));

async function opened(file, options = {}, hash = "") {
  const context = await browser.newContext({ viewport: { width: 960, height: 640 }, ...options });
  const tab = await context.newPage();
  tab.problems = [];
  tab.requests = [];
  tab.on("console", (message) => ["error", "warning"].includes(message.type()) && tab.problems.push(message.text()));
  tab.on("pageerror", (error) => tab.problems.push(error.message));
  tab.on("dialog", (dialog) => (tab.problems.push(`dialog ${dialog.message()}`), dialog.dismiss()));
  tab.on("request", (request) => /^https?:/.test(request.url()) && tab.requests.push(request.url()));
  await tab.goto(`file://${file}${hash}`);
  await tab.waitForFunction(() => document.documentElement.dataset.ready, null, { timeout: 60000 });
  await tab.waitForTimeout(100);
  return tab;
}
const time = (tab) => tab.evaluate(() => window.replay.view.t);
const drawn = (tab) => tab.waitForFunction(() => !window.replay.dirty);

/* How much of the floor has another colour than its corner, read right after drawing. */
const painted = (tab) => tab.evaluate(() => {
  const { scene, view } = window.replay, copy = document.createElement("canvas").getContext("2d");
  const { width: w, height: h } = Object.assign(copy.canvas, { width: scene.canvas.width, height: scene.canvas.height });
  scene.draw(view, 0);
  copy.drawImage(scene.canvas, 0, 0);
  const { data } = copy.getImageData(0, 0, w, h);
  let other = 0;
  for (let i = 0; i < data.length; i += 4) if (Math.abs(data[i] - data[0]) + Math.abs(data[i + 1] - data[1]) + Math.abs(data[i + 2] - data[2]) > 12) other++;
  return other / (w * h);
});
const place = (tab, robot) => tab.evaluate((r) => {
  const { scene, motion } = window.replay, box = document.getElementById("floor").getBoundingClientRect();
  const [x, y] = scene.toScreen(motion.pose[3 * r], motion.pose[3 * r + 1]);
  return [x + box.left, y + box.top];
}, robot);

try {
  const tab = await opened(page);
  say("opens", (await tab.evaluate(() => document.documentElement.dataset.ready)) === "yes");
  let share = await painted(tab);
  for (let tries = 0; share <= 0.2 && tries < 50; tries++) {  // a busy machine may not have shown the page yet
    await tab.waitForTimeout(100);
    share = await painted(tab);
  }
  say("paints", share > 0.2, share);
  const card = await opened(page, {}, "#draw=gl&t=6"), none = await opened(page, {}, "#draw=canvas&t=6");
  const shares = [await painted(card), await painted(none)];
  say("paints the same with and without WebGL", Math.abs(shares[0] - shares[1]) < 0.02 && (await card.evaluate(() => Boolean(window.replay.scene.painter.renderer))), shares);
  for (const other of [card, none]) await other.context().close();

  const clock = await tab.textContent("#clock");
  await tab.click("#play");
  await tab.waitForFunction(() => window.replay.view.t > 1);
  await tab.click("#play");
  const stopped = await time(tab);
  await tab.waitForTimeout(200);
  say("plays", (await tab.textContent("#clock")) !== clock);
  say("pauses", (await time(tab)) === stopped);
  await tab.keyboard.press("Escape");
  await tab.locator("#floor").focus();
  await tab.keyboard.press("Space");
  say("space plays", await tab.evaluate(() => window.replay.view.playing));
  await tab.keyboard.press("Space");

  const track = await tab.locator("#track-canvas").boundingBox();
  const gutter = await tab.evaluate(() => window.replay.timeline.gutter);
  const end = await tab.evaluate(() => window.replay.motion.end);
  await tab.mouse.click(track.x + gutter + (track.width - gutter) / 2, track.y + 10);
  say("seeks by a click on the track", Math.abs((await time(tab)) - end / 2) < end / 100, await time(tab));
  await tab.mouse.move(track.x + gutter + 20, track.y + 10);
  await tab.mouse.down();
  await tab.mouse.move(track.x + gutter + (track.width - gutter) / 4, track.y + 10, { steps: 4 });
  await tab.mouse.up();
  say("seeks by dragging", Math.abs((await time(tab)) - end / 4) < end / 100, await time(tab));
  await tab.keyboard.press("Home");
  await tab.keyboard.press("Shift+ArrowRight");
  say("seeks by keys", Math.abs((await time(tab)) - Math.min(10, end)) < 0.01, await time(tab));

  const busy = await tab.evaluate(() => { // the robot with the longest plan
    const { first } = window.replay.motion, lengths = Array.from(first.slice(1), (end, r) => end - first[r]);
    return lengths.indexOf(Math.max(...lengths));
  });
  await tab.mouse.click(...(await place(tab, busy)));
  const name = await tab.evaluate((r) => window.replay.run.robots[r], busy);
  say("picks a robot", (await tab.textContent(".robot-head h2")) === name);
  say("shows its plan", (await tab.locator(".rows .row").count()) > 1 && (await tab.locator(".row.now").count()) === 1);
  say("address tells robot and time", await tab.waitForFunction(() => location.hash.includes("robot=")).then(() => true));
  await drawn(tab);
  await tab.screenshot({ path: `${folder}/picked.png` });
  await tab.keyboard.press("Escape");
  say("lets go", (await tab.evaluate(() => window.replay.view.selected)) === -1);

  await tab.click('[data-tab="events"]');
  const row = tab.locator(".rows .row").last();
  const when = await row.locator(".time").textContent();
  await row.click();
  const jumped = await tab.waitForFunction((t) => document.getElementById("clock").textContent.startsWith(t), when, { timeout: 5000 }).then(() => true, () => false);
  say("an event leads to its time", jumped, [when, await tab.textContent("#clock")]);

  await tab.keyboard.press("/");
  await tab.keyboard.type("robot_3");
  await tab.keyboard.press("Enter");
  say("finds a robot", (await tab.evaluate(() => window.replay.run.robots[window.replay.view.selected])) === "robot_3");
  await tab.keyboard.press("Escape");
  await tab.keyboard.press("/");
  await tab.keyboard.type("lobby");
  await tab.keyboard.press("Enter");
  say("finds a station", (await tab.evaluate(() => window.replay.view.found?.name)) === "lobby");

  const scale = await tab.evaluate(() => window.replay.scene.camera.scale);
  await tab.mouse.move(300, 300);
  await tab.mouse.wheel(0, -300);
  await tab.waitForFunction((s) => window.replay.scene.camera.scale > s, scale);
  say("wheel zooms", true);
  await tab.locator("#floor").focus();
  await tab.keyboard.press("f");
  for (const key of ["t", "g", "l"]) {
    const before = await tab.evaluate(() => JSON.stringify(window.replay.view));
    await tab.keyboard.press(key);
    say(`key ${key} switches`, before !== (await tab.evaluate(() => JSON.stringify(window.replay.view))));
    await tab.keyboard.press(key);
  }
  await tab.keyboard.press("a");
  const diagram = await tab.locator(".spacetime").boundingBox(), first = await tab.textContent(".aisle + .switch + div + section p");
  await tab.locator(".spacetime").click({ position: { x: diagram.width - 20, y: diagram.height / 2 } });
  say("an aisle's diagram leads to its time", Math.abs((await time(tab)) - end / 2) < end / 50, await time(tab));
  const lane = await tab.evaluate(() => { // the middle of the shortest aisle: a click there takes it
    const { scene, aisles } = window.replay, { ax, ay, bx, by } = aisles.at(-1), box = document.getElementById("floor").getBoundingClientRect(), [x, y] = scene.toScreen((ax + bx) / 2, (ay + by) / 2);
    return [x + box.left, y + box.top];
  });
  await tab.evaluate(() => window.replay.seek(0));
  await drawn(tab);
  await tab.mouse.click(...lane);
  const second = await tab.textContent(".aisle + .switch + div + section p");
  say("a click on a lane shows its aisle", /robots? (is|are) there/.test(first) && first !== second, [first, second]);
  await tab.screenshot({ path: `${folder}/aisle.png` });
  await tab.locator("#floor").focus();
  await tab.keyboard.press("h");
  await drawn(tab);
  say("heat map shows", await tab.locator("#heat-key").isVisible());
  await tab.keyboard.press("d");
  await drawn(tab);
  say("dark mode", (await tab.evaluate(() => document.documentElement.dataset.theme)) === "dark");
  await tab.screenshot({ path: `${folder}/dark.png` });
  say("asks no network", tab.requests.length === 0, tab.requests);
  say("no console error", tab.problems.length === 0, tab.problems);
  await tab.context().close();

  const phone = await opened(page, { viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true, colorScheme: "dark" }, "#t=6");
  say("follows the system's dark", (await phone.evaluate(() => document.documentElement.dataset.theme)) === "dark");
  await phone.touchscreen.tap(...(await place(phone, 1)));
  await phone.waitForFunction(() => document.getElementById("side").classList.contains("open"));
  say("a tap picks", (await phone.evaluate(() => window.replay.view.selected)) >= 0);
  say("a phone needs no sideways scrolling", await phone.evaluate(() => document.documentElement.scrollWidth <= window.innerWidth));
  await phone.waitForTimeout(300);
  await phone.screenshot({ path: `${folder}/phone.png` });
  const before = await phone.evaluate(() => window.replay.scene.camera.scale);
  const touch = await phone.context().newCDPSession(phone);
  const fingers = (gap) => [{ x: 195 - gap, y: 300, id: 1 }, { x: 195 + gap, y: 300, id: 2 }];
  await touch.send("Input.dispatchTouchEvent", { type: "touchStart", touchPoints: fingers(40) });
  for (const gap of [60, 80, 100]) await touch.send("Input.dispatchTouchEvent", { type: "touchMove", touchPoints: fingers(gap) });
  await touch.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] });
  say("a pinch zooms", (await phone.evaluate(() => window.replay.scene.camera.scale)) > 1.5 * before);
  say("no console error on a phone", phone.problems.length === 0, phone.problems);
  await phone.context().close();

  const chosen = [];
  for (const width of [390, 1200]) {
    const floors = await opened(`${folder}/levels.html`, { viewport: { width, height: 844 } });
    chosen.push(await floors.textContent('#levels [aria-pressed="true"]'));
    await floors.context().close();
  }
  say("a phone begins with the level of most robots, a wide screen with all", String(chosen) === "L2,all levels", chosen);

  const odd = await opened(nasty);
  await odd.click('[data-tab="robots"]');
  const shown = await odd.locator(".rows .row .what").first().textContent();
  await odd.locator(".rows .row").first().click();
  say("names are text", shown.includes("<img src=x") && (await odd.locator("img").count()) === 0 && odd.problems.length === 0, [shown, odd.problems]);
  await odd.context().close();

  const pair = await (await browser.newContext({ viewport: { width: 1400, height: 800 } })).newPage();
  await pair.goto(`file://${beside}#t=8&robot=1`);
  const marked = await pair.waitForFunction(() => {
    const apps = [...document.querySelectorAll("iframe")].map((frame) => frame.contentWindow.replay), [one, two] = apps;
    return apps.every((app) => app?.view?.selected === 1 && app.view.t === 8) && one.view.apart.length > 0 && [one.view.apart, two.view.apart, document.getElementById("apart").textContent];
  }, null, { timeout: 20000 }).then((found) => found.jsonValue(), () => null);
  say("two runs open at a moment, and what differs is marked", marked && String(marked[0]) === String(marked[1]) && marked[2].startsWith(`${marked[0].length} of 5 robots`), marked);
  await pair.screenshot({ path: `${folder}/pair.png` });
  await pair.context().close();

  const towed = [];
  for (const painter of ["gl", "canvas"]) {
    const train = await opened(trains, {}, `#draw=${painter}&t=8`);
    towed.push(...(await train.evaluate(() => { // colours at the middles of the last robot's trailers, and that of its state
      const { scene, view, motion: m } = window.replay, copy = document.createElement("canvas").getContext("2d", { willReadFrequently: true }), ratio = scene.painter.ratio;
      Object.assign(copy.canvas, { width: scene.canvas.width, height: scene.canvas.height });
      scene.draw(view, 0);
      copy.drawImage(scene.canvas, 0, 0);
      const wanted = parseInt(scene.theme.states[m.now[m.numRobots - 1]].slice(1), 16);
      return [m.numBodies - 2, m.numBodies - 1].map((b) => {
        const [x, y] = scene.toScreen(m.pose[3 * b], m.pose[3 * b + 1]).map((v) => Math.round(v * ratio)), { data } = copy.getImageData(x, y, 1, 1);
        return Math.max(...[16, 8, 0].map((shift, k) => Math.abs(((wanted >> shift) & 255) - data[k])));
      });
    })));
    towed.push(...train.problems);
    await train.screenshot({ path: `${folder}/trains_${painter}.png` });
    await train.context().close();
  }
  say("draws trailers with and without WebGL", towed.length === 4 && towed.every((off) => off < 8), towed);

  const blind = await browser.newContext();
  const dull = await blind.newPage();
  await dull.addInitScript(() => {
    HTMLCanvasElement.prototype.getContext = () => null;
  });
  await dull.goto(`file://${page}`);
  await dull.waitForFunction(() => document.documentElement.dataset.ready === "failed");
  say("says that it needs WebGL", (await dull.textContent("#cover")).includes("WebGL"));
} finally {
  await browser.close();
}
