/* Somebody at a workbench in a real browser, who moves, clicks and looks, and says what holds as lines of JSON {"claim", "holds", "found"}.
   node SCRIPT CHROMIUM ADDRESS [FOLDER]; needs playwright-core. */
import { createRequire } from "node:module";

const [, , executablePath, address] = process.argv;
const { chromium } = createRequire(import.meta.url)("playwright-core");
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-gpu"] });
export const PATIENCE = { timeout: 300000 };
export const problems = [], outside = [];
export const folder = process.argv[4];
export const say = (claim, holds, found = null) => console.log(JSON.stringify({ claim, holds: Boolean(holds), found }));

/* A window with the workbench; places on its floor are in units of which `scale` make one of the drawing's. */
export async function person({ scale = 1, ...options } = {}) {
  const tab = await (await browser.newContext({ viewport: { width: 1280, height: 800 }, ...options })).newPage();
  tab.on("console", (message) => ["error", "warning"].includes(message.type()) && problems.push(message.text()));
  tab.on("pageerror", (error) => problems.push(error.message));
  tab.on("request", (request) => !request.url().startsWith(address) && /^https?:/.test(request.url()) && outside.push(request.url()));
  await tab.goto(address);
  await tab.waitForFunction(() => document.documentElement.dataset.ready, null, PATIENCE);
  const look = (text) => new Function("site", "shared", "l", `return ${text}`)(window.studio.site, window.studio.shared, window.studio.site.document?.levels[window.studio.site.level] || {});
  const looked = `(${look})`;
  const screen = async (x, y) => {
    const box = await tab.locator("#floor").boundingBox(), [sx, sy] = await tab.evaluate((p) => window.studio.toScreen(p), [x * scale, y * scale]);
    return [box.x + sx, box.y + sy];
  };
  const drag = async (a, b) => {
    await tab.mouse.move(...(await screen(...a)));
    await tab.mouse.down();
    await tab.mouse.move(...(await screen(...b)), { steps: 3 });
    await tab.mouse.up();
  };
  return {
    tab, screen, drag,
    /* The value of an expression of `site`, `shared`, and `l`, the level that is shown. */
    site: (text) => tab.evaluate(`${looked}(${JSON.stringify(text)})`),
    until: (text) => tab.waitForFunction(`${looked}(${JSON.stringify(text)})`, null, PATIENCE),
    click: async (x, y, how) => tab.mouse.click(...(await screen(x, y)), how),
    shiftDrag: async (a, b) => { await tab.keyboard.down("Shift"); await drag(a, b); await tab.keyboard.up("Shift"); },
    step: (name) => tab.click(`#steps button:has-text("${name}")`),
    press: (text) => tab.click(`#side button:text-is("${text}")`),
    type: async (label, value) => { const field = tab.getByLabel(label, { exact: true }); await field.fill(String(value)); await field.press("Tab"); },
    key: async (name) => { await tab.locator("#floor").focus(); await tab.keyboard.press(name); },
    answer: async (text) => { await tab.fill("dialog input", text); await tab.click('dialog button:text-is("OK")'); },
  };
}

/* Do it, say so where it does not come to its end, and go. */
export async function goes(through, tab) {
  try {
    await through();
  } catch (error) {
    say("goes through to the end", false, String(error).slice(0, 800));
    if (folder) await tab.screenshot({ path: `${folder}/fault.png` });
  }
  await browser.close();
}
