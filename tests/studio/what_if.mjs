/* A lane doubled, a charger moved: each a variant in the folder, compared on the same orders. */
import { readFileSync } from "node:fs";
import { folder, goes, PATIENCE, person, problems, say } from "./person.mjs";

const { tab, site, until, click, drag, press, type, key, answer, step } = await person({ scale: 20 });
const station = async (place, name, kind) => { await key("s"); await click(...place); await type("name", name); await tab.getByLabel(kind, { exact: true }).check(); await key("Escape"); await key("Escape"); };
const read = (name) => readFileSync(`${folder}/${name}.building.yaml`, "utf8");

await goes(async () => {
  await press("Empty floor");
  await answer("ring");
  await tab.waitForFunction(() => document.querySelector("dialog input")?.value === "40", null, PATIENCE);
  await answer("30");
  await until("site.path === 'ring.building.yaml'");
  await key("w");
  for (const place of [[2, 3], [28, 3]]) await click(...place);
  await key("Escape");
  await key("l");
  for (const place of [[4, 4], [26, 4], [26, 12], [4, 12], [4, 4]]) await click(...place);
  await key("Escape");
  await key("Escape");
  await station([4, 4], "goods_in", "pick-up");
  await station([26, 12], "goods_out", "drop-off");
  await station([15, 12], "charger_1", "charger");
  await tab.keyboard.press("Control+s");
  await until("site.digest && site.document === site.saved");
  await step("3 Orders");
  await press("Propose orders");
  await until("shared.scenario && shared.values");
  const before = read("ring");

  await step("2 Draw");
  await click(10, 4);
  await press("Double");
  const lanes = await site("l.lanes.map(([a, b, options]) => [...[a, b].map((v) => l.vertices[v].slice(0, 2).map((x) => x / 20)), options.bidirectional[1]])");
  const has = (a, b, isBoth) => lanes.some((lane) => JSON.stringify(lane) === JSON.stringify([a, b, isBoth]));
  say("a lane is doubled where there is room, traffic to the right", has([26, 4], [4, 4], false) && has([4, 5], [26, 5], false) && !lanes.some(([a, b, isBoth]) => isBoth && a[1] === b[1] && a[1] < 6), lanes);
  say("its twin joins the lanes that it meets", has([4, 12], [4, 5], true) && has([4, 5], [4, 4], true) && has([26, 4], [26, 5], true), lanes);
  await until("site.size && !site.refused");
  await press("Compare with what is saved");
  await until("shared.pairs?.rows.length && shared.pairs.rows[0].pairs === 5 && shared.job.state === 'done'");
  const [row] = await site("shared.pairs.rows");
  say("one click keeps it and compares it on the same orders", row.difference.every(Number.isFinite) && row.difference[1] <= row.difference[0], row);
  say("the first layout of the comparison is the one that was saved", (await site("shared.pairs.maps.join()")) === "ring.building.yaml,ring_double_lane_0.building.yaml", await site("shared.pairs.maps"));
  say("the layout is as it was", (await site("site.document === site.saved")) && read("ring") === before);
  const kept = new Set(before.split("\n"));
  say("the variant says the rest as the layout does", read("ring_double_lane_0").split("\n").filter((line) => !kept.has(line)).length < 12);

  await step("2 Draw");
  await drag([15, 12], [26, 8]);
  const place = await site("l.vertices.filter((v) => v[3] === 'charger_1').map(([x, y, , , options]) => [x, y, options.is_charger[1]])[0]");
  say("a charger is dragged onto another lane, and its lanes stay", JSON.stringify(place) === "[520,160,true]" && (await site("l.lanes.length")) === 6 && (await site("site.change")) === "move_charger_1", [place, await site("l.lanes")]);
  await tab.keyboard.press("Control+z");
  say("undo takes it back", await site("site.document === site.saved"));
  await step("5 Ask");
  await press("Take over ring_double_lane_0");
  await until("l.lanes.some((lane) => lane[2].bidirectional[1] === false)");
  say("a variant is taken over", (await site("l.lanes.some((lane) => lane[2].bidirectional[1] === false)")) && (await site("site.path")) === "ring.building.yaml" && read("ring") === before);
  say("no console error", !problems.length, problems);
}, tab);
