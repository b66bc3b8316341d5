/* Two windows on one folder, and the layers of a plan. */
import { readFileSync } from "node:fs";
import { folder, goes, PATIENCE, person, problems, say } from "./person.mjs";

const one = await person(), other = await person(), read = (name) => readFileSync(`${folder}/${name}.building.yaml`, "utf8");
const banner = ({ tab }) => tab.textContent("#banner");
const says = ({ tab }, text) => tab.waitForFunction((words) => document.getElementById("banner").textContent.includes(words), text, PATIENCE);
const named = (name) => `Object.values(site.document.levels)[0].vertices.some((v) => v[3] === '${name}')`;

/* Choose a vertex by its name, and give it another. */
async function rename({ tab, until, type }, was, name) {
  await tab.evaluate((word) => {
    const { site, show, tool } = window.studio, vertices = Object.values(site.document.levels)[0].vertices;
    site.selection = [{ kind: "vertices", index: vertices.findIndex((v) => v[3] === word) }];
    tool.name = "select";
    show("draw");
  }, was);
  await type("name", name);
  await until(named(name));
}

await goes(async () => {
  for (const { tab, until } of [one, other]) {
    await tab.click('#side button:has-text("office.building.yaml")');
    await until("site.path === 'office.building.yaml' && site.digest");
  }
  const name = await one.site("Object.values(site.document.levels)[0].vertices.find((v) => v[3])[3]");
  await rename(one, name, "reception");
  await one.tab.keyboard.press("Control+s");
  await other.until(named("reception"));
  await says(other, "this is the new state");
  say("what one window saves, the other shows", await other.site("site.document === site.saved"));

  await rename(other, "reception", "theirs");
  await rename(one, "reception", "mine");
  await one.tab.keyboard.press("Control+s");
  await one.until("site.document === site.saved");
  await says(other, "and here, too");
  say("a window with changes of its own keeps them, and asks", await other.site(named("theirs")), await banner(other));
  const saved = read("office");
  await other.tab.keyboard.press("Control+s");
  await says(other, "nothing was written");
  say("a save over another's is refused, and nothing is written", read("office") === saved && saved.includes("mine"));
  await other.tab.click('#banner button:text-is("Save mine under another name")');
  await other.answer("office_b");
  await other.until("site.path === 'office_b.building.yaml' && site.document === site.saved");
  say("one window's work is saved under another name", read("office_b").includes("theirs"));
  say("and the other's is as it was", read("office") === saved && (await one.site("site.path")) === "office.building.yaml");

  await other.step("1 Floor");
  await other.tab.click('#side button:has-text("hall.dxf")');
  await other.tab.locator("dialog .preview").waitFor(PATIENCE);
  const boxes = other.tab.locator("dialog .boxes label"), open = other.tab.locator('dialog button:text-is("Open")');
  await other.tab.screenshot({ path: `${folder}/layers.png` });
  say("layers of a plan are chosen with what they hold", (await boxes.allTextContents()).join("; ") === "WALLS – 4 lines; TABLES – 1 line", await boxes.allTextContents());
  say("a plan without a unit cannot be opened before one is chosen", await open.isDisabled());
  await other.tab.locator("dialog select").selectOption("m");
  await open.click();
  await other.until("site.path === 'hall.building.yaml'");
  say("the chosen layer alone is wall", (await other.site("l.walls.length")) === 4, await other.site("l.walls.length"));
  await other.step("1 Floor");
  await other.tab.evaluate(() => { const { site } = window.studio; site.saved = site.document; });
  await other.tab.click('#side button:has-text("odd.building.yaml")');
  await other.until("site.path === 'odd.building.yaml' && site.findings.length");
  await other.step("2 Draw");
  say("parts that are none are told, and nothing breaks", /fiducial 0 is '3'/.test(await other.tab.textContent("#side")), await other.site("site.findings"));
  say("no console error", !problems.filter((text) => !/409/.test(text)).length, problems);
}, other.tab);
