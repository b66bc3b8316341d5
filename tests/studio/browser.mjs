/* From a picture of a hall to an answer, as people do it. Screenshots go to a second folder, where one is named. */
import { readFileSync, writeFileSync } from "node:fs";
import { folder, goes, outside, PATIENCE, person, problems, say } from "./person.mjs";

const shots = process.argv[5], begin = Date.now();
const { tab, site, until, click, step, press, type, answer } = await person();
const shot = async (name) => shots && tab.screenshot({ path: `${shots}/${name}.png` }).then(() => console.error(name, Math.round((Date.now() - begin) / 1000), "s"));
const lists = (name) => site(`(l.${name} || []).length`);

await goes(async () => {
  await tab.click('#side button:has-text("hall.png")');
  await until("site.document && site.path === 'hall.building.yaml'");
  await tab.waitForTimeout(300);
  await shot("1_floor");
  say("a picture without a scale asks for it", (await tab.textContent("#side")).includes("Say how large the plan is"));
  await click(20, 20);
  await click(620, 20);
  await answer("30");
  await until("l.measurements.length === 1");
  say("two places and their distance are the scale", (await tab.textContent("#side")).includes("32.0 x 22.0 m, 5.00 cm a pixel"));

  await press("Walls and lanes");
  await until("l.lanes.length > 20");
  await until("site.findings && !site.refused && site.size");
  await shot("2_lanes");
  say("lanes are laid over the free floor", (await lists("walls")) > 8, await lists("lanes"));
  const before = await lists("lanes");
  await tab.keyboard.press("Control+z");
  say("undo takes back", (await lists("lanes")) === 0);
  await tab.keyboard.press("Control+y");
  say("redo brings back", (await lists("lanes")) === before);

  await tab.keyboard.press("v");
  const places = await site("(() => { const v = l.vertices, on = [...new Set(l.lanes.flatMap(([a, b]) => [a, b]))]; const by = (f) => v[on.reduce((a, b) => (f(v[b]) < f(v[a]) ? b : a))]; return [by(([x, y]) => x + y), by(([x, y]) => -x - y), by(([x, y]) => x - y), by(([x, y]) => y - x)].map((p) => p.slice(0, 2)); })()");
  const names = [["goods_in", "pick-up"], ["goods_out", "drop-off"], ["charger_1", "charger"], ["home", "parking"]];
  for (const [k, [name, kind]] of names.entries()) {
    await tab.keyboard.press("s");
    await click(...places[k]);
    await tab.waitForTimeout(50);
    const field = tab.locator("#side .fields input").first();
    await field.fill(name);
    await field.press("Tab");
    await tab.getByLabel(kind, { exact: true }).check();
    await tab.locator("#floor").focus();
    await tab.keyboard.press("Escape");
  }
  const stations = await site("l.vertices.filter((v) => v[3]).map((v) => [v[3], v[4]])");
  say("stations have names and kinds", stations.length === 4 && stations.every((s) => s[1]), stations);
  await tab.waitForTimeout(400);
  await shot("3_stations");

  await tab.keyboard.press("Control+s");
  await until("site.digest && site.document === site.saved");
  say("Ctrl+S saves", readFileSync(`${folder}/hall.building.yaml`, "utf8").includes("goods_out"));

  await step("3 Orders");
  await press("Propose orders");
  await until("shared.scenario && shared.values");
  await tab.waitForTimeout(200);
  await shot("4_orders");
  say("orders are proposed and valid", (await site("shared.fault")) === "", await site("shared.scenario"));
  await type("robots", 3);
  await tab.waitForFunction(() => document.querySelector("textarea.yaml").value.includes("count: 3"), null, PATIENCE);
  say("a field changes the text and keeps its comments", /count: 3 +# guessed/.test(readFileSync(`${folder}/${await site("shared.scenario")}`, "utf8")));
  const text = tab.locator("textarea.yaml");
  await text.fill((await text.inputValue()).replace("count: 3", "count: -2"));
  await text.press("Tab");
  await until("shared.fault");
  say("the text's errors are those of the command", /scenario.yaml:\d+: robots.count: found -2, expected/.test(await site("shared.fault")), await site("shared.fault"));
  await text.fill((await text.inputValue()).replace("count: -2", "count: 2"));
  await text.press("Tab");
  await until("!shared.fault");
  await tab.waitForFunction(() => [...document.querySelectorAll("#side .fields input")][0].value === "2", null, PATIENCE);
  say("the text changes the fields", true);

  await step("4 Run");
  await press("Run hall/scenario.yaml");
  await tab.waitForFunction(() => document.getElementById("frame").src.includes("/live/"), null, PATIENCE);
  const live = tab.frameLocator("#frame");
  await live.locator("#floor").waitFor(PATIENCE);
  await tab.waitForTimeout(1500);
  await shot("5_live");
  say("a run is watched in place", (await live.locator("#status").textContent()).length > 0, await live.locator("#status").textContent());
  const speed = live.locator("select").first();
  if (await speed.count()) await speed.selectOption({ index: (await speed.locator("option").count()) - 1 });
  await until("shared.run");
  await live.locator("#floor").waitFor(PATIENCE);
  await tab.waitForTimeout(1500);
  await shot("6_replay");
  say("its replay follows", (await tab.getAttribute("#frame", "src")).startsWith("replay?run=runs"));
  await press("Waits over the plan");
  await until("site.heat");
  await tab.waitForTimeout(300);
  await shot("7_waits");
  say("waits are drawn over the plan", (await site("site.heat.length")) > 0 && (await site("site.heat.every(([name]) => name === site.level)")));

  await step("5 Ask");
  await type("at most", "1min");
  await tab.locator('#side .row button:text-is("How many robots?")').click();
  await until("shared.points.length > 1");
  await shot("8_filling");
  say("a study fills in while it runs", await tab.locator("svg.chart").count());
  await until("shared.answer");
  await tab.waitForTimeout(300);
  await shot("9_answer");
  say("it has an answer", /robot/.test(await tab.textContent("#answer")), await tab.textContent("#answer"));

  const mine = readFileSync(`${folder}/hall.building.yaml`, "utf8");
  writeFileSync(`${folder}/hall.building.yaml`, mine.replace("goods_in", "goods_here"));
  await until("l.vertices.some((v) => v[3] === 'goods_here')");
  say("another program's change is shown", (await tab.textContent("#banner")).includes("changed by another program"));
  await step("2 Draw");
  await tab.locator("#floor").focus();
  await tab.keyboard.press("Control+a");
  await tab.keyboard.press("ArrowRight");
  await until("site.document !== site.saved");
  writeFileSync(`${folder}/hall.building.yaml`, mine);
  await tab.waitForFunction(() => document.getElementById("banner").textContent.includes("and here, too"), null, PATIENCE);
  await tab.keyboard.press("Control+s");
  await tab.waitForFunction(() => document.getElementById("banner").textContent.includes("nothing was written"), null, PATIENCE);
  say("a conflict writes nothing and offers three ways", (await tab.locator("#banner button").count()) === 4 && readFileSync(`${folder}/hall.building.yaml`, "utf8") === mine);
  await tab.click('#banner button:has-text("Open theirs")');
  await until("l.vertices.some((v) => v[3] === 'goods_in')");

  await tab.locator("#floor").focus();
  await tab.keyboard.press("l");
  await tab.keyboard.press("n");
  const lanes = await lists("lanes");
  for (const key of ["Enter", "Shift+ArrowRight", "Shift+ArrowRight", "Enter", "Escape"]) await tab.keyboard.press(key);
  say("the keyboard alone draws", (await lists("lanes")) > lanes, (await lists("lanes")) - lanes);
  await step("6 Leave");
  await shot("10_leave");
  await press("LIF");
  await until("shared.job && shared.job.what === 'convert' && shared.job.state !== 'running'");
  say("it leaves as a LIF", (await site("shared.job.state")) === "done" && readFileSync(`${folder}/hall.lif.json`, "utf8").includes("lifVersion"));
  say("asks no other server", !outside.length, outside);
  say("no console error", !problems.filter((p) => !/409|400/.test(p)).length, problems);
}, tab);
