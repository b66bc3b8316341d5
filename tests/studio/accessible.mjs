/* Each step by axe-core, light and dark, and by the keyboard alone. */
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import { goes, person, problems, say } from "./person.mjs";

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const STEPS = ["1 Floor", "2 Draw", "3 Orders", "4 Run", "5 Ask", "6 Leave"];
const CONTROLS = "button, input, select, textarea, summary, canvas[tabindex]";
const windows = [await person({ colorScheme: "light" }), await person({ colorScheme: "dark" })];

/* What can be used and is not reached by Tab, once around. */
async function unreached(tab) {
  await tab.evaluate((controls) => {
    window.toReach = new Set([...document.querySelectorAll(controls)].filter((one) => !one.disabled && one.checkVisibility()));
    document.activeElement.blur();
  }, CONTROLS);
  for (let k = await tab.evaluate(() => window.toReach.size) + 5; k > 0; k--) {
    await tab.keyboard.press("Tab");
    await tab.evaluate(() => window.toReach.delete(document.activeElement));
  }
  return tab.evaluate(() => [...window.toReach].map((one) => one.outerHTML.slice(0, 100)));
}

await goes(async () => {
  for (const [k, { tab, until, step }] of windows.entries()) {
    await tab.click('#side button:has-text("office.building.yaml")');
    await until("site.size");
    await tab.evaluate(() => window.studio.openScenario("day.yaml"));
    await tab.evaluate(axe);
    for (const name of STEPS) {
      await step(name);
      await tab.evaluate((isDraw) => {
        const { site, show } = window.studio;
        if (isDraw) { site.selection = [{ kind: "vertices", index: Object.values(site.document.levels)[0].vertices.findIndex((v) => v[3]) }]; show("draw"); }
      }, name === "2 Draw");
      const found = await tab.evaluate(() => window.axe.run(document, { iframes: false }).then((said) => said.violations.map((one) => [one.id, one.nodes[0].html.slice(0, 120)])));
      say(`${name}, ${["light", "dark"][k]}: no violation`, !found.length, found);
      if (k) continue;
      const left = await unreached(tab);
      say(`${name}: all of it by Tab`, !left.length, left);
    }
  }
  say("no console error", !problems.length, problems);
}, windows[0].tab);
