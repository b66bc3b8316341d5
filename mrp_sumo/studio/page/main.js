/* The workbench: steps, palette, saving, findings while drawing, and what other programs do to the files that are open. */
import { make } from "./elements.js";
import { get, post } from "./api.js";
import { ask, banner, button, note } from "./parts.js";
import { canRedo, canUndo, changed, isDirty, onChange, opened, redo, site, undo } from "./site.js";
import { addLevel, ordered, unit } from "./levels.js";
import { camera, fit, frames, isInSight, redraw, toFloor, toScreen, up } from "./view.js";
import { choose, key, tool, TOOLS } from "./tools.js";
import { choosePlan, hasChoice } from "./plan.js";
import { askPanel } from "./ask.js";
import { drawPanel } from "./draw.js";
import { addFile, floorPanel, leavePanel, openScenario, ordersPanel, runPanel } from "./panels.js";
import { actions, follow, of, refresh, shared, start, stemOf } from "./shared.js";

const element = (id) => document.getElementById(id);
const STEPS = [["floor", "1 Floor", floorPanel], ["draw", "2 Draw", drawPanel], ["orders", "3 Orders", ordersPanel], ["run", "4 Run", runPanel], ["ask", "5 Ask", askPanel], ["leave", "6 Leave", leavePanel]];
const KEYS = [["1–6 with Alt", "steps"], ...TOOLS.map(([, letter, word]) => [letter, word]), ["n, then arrows, Enter", "a cross that clicks, with the keyboard alone"], ["arrows", "move what is chosen, with Shift ten steps"], ["Delete", "remove"], ["Esc", "end a line, let go"], ["+ − f", "closer, farther, whole floor"], ["Ctrl+Z, Ctrl+Y", "undo, redo"], ["Ctrl+C, Ctrl+V", "copy, paste, also onto another level"], ["Ctrl+A", "choose all"], ["Ctrl+S, Ctrl+Shift+S", "save, save as"]];
let checking = 0, wanted = 0, polled = false;

/* Panels */

const labelOf = (input) => input.getAttribute("aria-label") || input.labels?.[0]?.textContent;

/* The panel of the step, made anew; who is typing in it goes on typing. */
function panel() {
  const side = element("side"), active = document.activeElement, label = side.contains(active) && labelOf(active), scroll = side.scrollTop;
  const typed = active.dataset.typed ? active.value : null, caret = [active.selectionStart, active.selectionEnd];
  const unfolded = new Map([...side.querySelectorAll("summary")].map((one) => [one.textContent, one.parentElement.open]));
  delete active.dataset.typed;
  const [, title, parts] = STEPS.find(([name]) => name === shared.step);
  side.replaceChildren(make("h2", { className: "hidden", textContent: title.slice(2) }), ...parts().filter(Boolean));
  for (const one of side.querySelectorAll("summary")) one.parentElement.open = unfolded.get(one.textContent) ?? one.parentElement.open;
  side.scrollTop = scroll;
  const again = label && [...side.querySelectorAll("input, select, textarea")].find((input) => labelOf(input) === label);
  if (!again) return;
  again.focus();
  if (typed !== null) {
    again.value = typed;
    again.dataset.typed = "yes";
  }
  if (Number.isInteger(caret[0])) again.setSelectionRange(...caret);
  else if (typed === null) again.select?.();  // fields of numbers do not tell what is selected in them
}

function show(name) {
  shared.step = name;
  for (const one of element("steps").children) one.setAttribute("aria-selected", String(one.dataset.step === name));
  element("palette").hidden = name !== "draw" && !(name === "floor" && site.document);
  if (name === "floor" || name === "draw" || name === "orders") frame("");
  if (name === "draw" && tool.name === "scale" && unit()) choose("select");
  panel();
  bars();
}

function frame(address) {
  const place = element("frame");
  place.hidden = !address;
  if (address && !place.src.endsWith(address)) place.src = address;
  if (!address) place.removeAttribute("src");
  redraw();
}

function bars() {
  element("title").textContent = site.path || `studio – ${shared.start?.folder ?? ""}`;
  document.title = `${isDirty() ? "• " : ""}${site.path || "studio"}`;
  element("dirty").hidden = !isDirty();
  element("undo").disabled = !canUndo();
  element("redo").disabled = !canRedo();
  element("save").disabled = !isDirty();
  element("saveas").disabled = !site.document;
  for (const one of element("palette").querySelectorAll("button")) one.setAttribute("aria-pressed", String(one.dataset.tool === tool.name));
  element("hint").textContent = !["floor", "draw"].includes(shared.step) ? "" : site.document ? TOOLS.find(([name]) => name === tool.name)[3] : "Open a plan or a map, or begin with an empty floor.";
  const names = ordered(), levels = element("levels");
  levels.hidden = !site.document || (names.length < 2 && shared.step !== "draw");
  levels.replaceChildren(...names.map((name) => button(name, () => showLevel(name), { "aria-pressed": String(name === site.level) })), ...(shared.step === "draw" ? [button("+", addLevel, { title: "Add a level above" })] : []));
}

function showLevel(name) {
  Object.assign(site, { level: name, selection: [] });
  if (!isInSight()) fit();
  changed("view");
}

/* Files */

async function open(path) {
  if (isDirty() && site.digest && !(await sure(`${site.path} has changes that are not saved.`))) return;
  try {
    const chosen = hasChoice(path) ? await choosePlan(path) : {};
    if (!chosen) return;
    const drawing = await get("open", { path, ...chosen }), isOther = drawing.path !== site.path;
    opened(drawing);
    site.plan = chosen.unit || chosen.scale || hasChoice(path) ? { plan: path, ...chosen } : null;
    if (isOther) await openOwnScenario();
    fit();
    note(drawing.from !== drawing.path ? drawing.notes.join("; ") : "");
    if (shared.step === "floor" && unit() && drawing.digest) show("draw");
    else { show(unit() ? shared.step : "floor"); if (!unit()) choose("scale"); }
    if (drawing.digest || (await get("digest", { path: drawing.path })).digest === "") return;
    banner(`${drawing.path} is there already; this is a new drawing of ${drawing.from}.`, button(`Open ${drawing.path}`, () => { banner(""); open(drawing.path); }), button("Save this under another name", () => { banner(""); saveAs(); }));
  } catch (error) {
    banner(error.message);
  }
}

/* The scenario that was proposed for the map, where there is one. */
async function openOwnScenario() {
  const own = `${stemOf(site.path).replaceAll(".", "_")}/scenario.yaml`;
  if (of("scenario").includes(own)) await openScenario(own);
  else shared.scenario = null;
}

async function sure(text) {
  return (await ask(`${text} Type "yes" to go on without them.`, "", "", "text")) === "yes";
}

async function save() {
  if (!site.document) return true;
  if (!isDirty()) return true;
  const document_ = site.document;
  try {
    const said = await post("save", { path: site.path, document: document_, digest: site.digest });
    Object.assign(site, { digest: said.digest, saved: document_, change: "" });
    changed("saved");
    return true;
  } catch (error) {
    if (error.status !== 409) { banner(error.message, button("Save again", () => { banner(""); save(); })); return false; }
    conflict(error.message);
    return false;
  }
}

function conflict(text) {
  banner(text,
    button("Save mine under another name", () => { banner(""); saveAs(); }),
    button("Open theirs", async () => { banner(""); site.saved = site.document; await open(site.path); }),
    button("Write mine over it", async () => { banner(""); site.digest = (await get("digest", { path: site.path })).digest; site.saved = null; save(); }, { className: "danger" }));
}

/* Under another name; LIF, openTCS models and nav graphs are written by `convert`, which says what they do not hold. */
async function saveAs() {
  const name = await ask("Save as", "or .lif.json, .xml (openTCS), .nav.yaml", site.path.replace(/\.building\.yaml$/, "_2.building.yaml"), "text");
  if (!name) return false;
  if (/\.(lif\.json|xml|nav\.yaml)$/.test(name)) {
    if (!(await save())) return false;
    show("leave");
    await start({ what: "convert", map: site.path, out: name });
    return true;
  }
  Object.assign(site, { path: `${name.replace(/\.building\.yaml$/, "")}.building.yaml`, digest: "", saved: null });
  changed("view");
  return save();
}

/* Other windows and programs change files, too. */
async function poll() {
  if (!site.digest || polled) return;
  try {
    const path = site.path, digest = site.digest, said = await get("digest", { path });
    if (path !== site.path || digest !== site.digest || said.digest === digest) return;
    if (!said.digest) { site.digest = ""; site.saved = null; banner(`${path} is not on disk any more: save it again to keep it.`); changed("view"); return; }
    if (isDirty()) { polled = true; conflict(`${path} was changed by another program, and here, too.`); setTimeout(() => (polled = false), 20000); return; }
    const drawing = await get("open", { path });
    if (isDirty() || path !== site.path) return;
    opened(drawing);
    banner(`${path} was changed by another program: this is the new state.`);
  } catch { /* the next look says it */ }
}

/* Findings, while drawing */

async function check() {
  wanted++;
  if (checking || !site.document) return;
  checking = 1;
  while (wanted) {
    wanted = 0;
    const document_ = site.document, begin = performance.now();
    try {
      const said = await post("check", { path: site.path, document: document_, robot: shared.robot });
      if (site.document === document_) Object.assign(site, { findings: said.findings, refused: said.refused, size: said.vertices ? { vertices: said.vertices, lanes: said.lanes } : null, checked_ms: performance.now() - begin });
    } catch (error) {
      site.findings = [{ severity: "refuse", text: error.message, places: [] }];
      site.refused = true;
    }
  }
  checking = 0;
  redraw();
  if (shared.step === "draw" && !tool.drag) panel();
}

onChange((what) => {
  if (["opened", "document", "dragged", "robot", "scaled"].includes(what) && !tool.drag) check();
  if (what === "scaled") { choose("select"); show("floor"); }
  if (what === "named") { panel(); element("side").querySelector("input")?.select(); }
  else if (!tool.drag && (["panel", "opened", "dragged", "saved"].includes(what) || ((what === "document" || what === "selection" || what === "view") && (shared.step === "draw" || shared.step === "floor" || shared.step === "run")))) panel();
  bars();
  redraw();
});

/* Beginning */

element("steps").append(...STEPS.map(([name, text]) => button(text, () => show(name), { role: "tab", "aria-selected": "false", "aria-controls": "side" })));
[...element("steps").children].forEach((one, k) => (one.dataset.step = STEPS[k][0]));
element("palette").append(...TOOLS.map(([name, letter, word]) => { const one = make("button", { type: "button", "aria-pressed": "false", onclick: () => choose(name) }, word, make("kbd", { textContent: letter })); one.dataset.tool = name; return one; }));
element("undo").onclick = () => undo();
element("redo").onclick = () => redo();
element("save").onclick = () => save();
element("saveas").onclick = () => saveAs();
element("theme").onclick = () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
element("help").onclick = help;
function help() {
  const dialog = element("dialog");
  dialog.onclose = null;
  dialog.replaceChildren(make("form", { method: "dialog" }, make("h2", { textContent: "Keys" }), make("div", { className: "keys" }, ...KEYS.flatMap(([keys, word]) => [make("kbd", { textContent: keys }), make("span", { textContent: word })])), make("div", { className: "row" }, make("button", { className: "main", textContent: "Close" }))));
  dialog.showModal();
}
function theme(name) {
  document.documentElement.dataset.theme = name;
  redraw();
}
const prefersDark = matchMedia("(prefers-color-scheme: dark)");
theme(prefersDark.matches ? "dark" : "light");
prefersDark.addEventListener("change", () => theme(prefersDark.matches ? "dark" : "light"));

addEventListener("keydown", (event) => {
  const meta = event.ctrlKey || event.metaKey;
  if (meta && event.key.toLowerCase() === "s") { event.preventDefault(); event.shiftKey ? saveAs() : save(); return; }
  if (event.altKey && event.key >= "1" && event.key <= "6") { event.preventDefault(); show(STEPS[Number(event.key) - 1][0]); return; }
  if (event.key === "?" && !/^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName)) { help(); return; }
  if (key(event)) event.preventDefault();
});
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => { event.preventDefault(); if (event.dataTransfer.files[0]) addFile(event.dataTransfer.files[0]); });
addEventListener("beforeunload", (event) => { if (isDirty() && canUndo()) event.preventDefault(); });
addEventListener("resize", redraw);
document.addEventListener("picture", () => camera.isTouched || fit());
document.addEventListener("pointer", ({ detail: [x, y] }) => {
  const u = unit();
  element("where").textContent = u ? `${(x * u).toFixed(2)}, ${(up() * y * u).toFixed(2)} m` : `${x.toFixed(0)}, ${y.toFixed(0)} pixels`;
});
tool.ask = ask;
Object.assign(actions, { save, open, show, frame });
window.studio = { site, shared, tool, camera, frames, toFloor, toScreen, show, open, save, openScenario };

shared.start = await get("start");
await refresh();
show("floor");
bars();
if (shared.start.opened) await open(shared.start.opened);
const underWay = (await get("commands")).find((job) => job.state === "running");
if (underWay) follow(underWay).catch((error) => banner(error.message));
setInterval(poll, 2000);
document.documentElement.dataset.ready = "yes";
