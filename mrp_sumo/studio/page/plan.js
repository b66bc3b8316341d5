/* Layers and the unit of a plan in DXF or SVG, or the page of a PDF, chosen in a dialog that shows what is chosen. */
import { make } from "./elements.js";
import { get } from "./api.js";
import { ask, check, field, fields, muted } from "./parts.js";

export const hasChoice = (path) => /\.(dxf|svg|pdf)$/i.test(path);
const SPACE = "http://www.w3.org/2000/svg";

/* {layers, unit, scale, page} as `open` takes them, where there is something to choose; null where it was given up. */
export async function choosePlan(path) {
  const plan = await get("layers", { path });
  if (plan.pages) return plan.pages === 1 ? {} : pageOf(path, plan.pages);
  const units = Object.keys(plan.units), isDxf = units.length > 0;
  if (plan.layers.length === 1 && plan.unit) return {};
  const chosen = new Set(plan.layers.filter((layer) => layer.shown).map((layer) => layer.name)), values = isDxf ? { unit: plan.unit } : { scale: null };
  const metres = () => (isDxf ? plan.units[values.unit] : values.scale);
  const preview = document.createElementNS(SPACE, "svg"), size = muted(""), open = make("button", { className: "main", textContent: "Open", value: "ok" });
  const [wide, high] = plan.size.map((side) => (1000 * side) / Math.max(...plan.size));
  preview.setAttribute("viewBox", `-10 -10 ${wide + 20} ${high + 20}`);
  preview.setAttribute("class", "preview");
  preview.setAttribute("role", "img");
  preview.setAttribute("aria-label", "The chosen layers");
  const show = () => {
    const lines = document.createElementNS(SPACE, "path");
    lines.setAttribute("d", plan.layers.filter((layer) => chosen.has(layer.name)).flatMap((layer) => layer.lines.map(([a, b, c, d]) => `M${a} ${b}L${c} ${d}`)).join(""));
    preview.replaceChildren(lines);
    size.textContent = metres() ? `The drawing is ${plan.size.map((side) => Number((side * metres()).toPrecision(3))).join(" x ")} m.` : isDxf ? "It says no unit: choose one." : "It has no scale: say how long a unit is.";
    open.disabled = !chosen.size || !metres();
  };
  const boxes = plan.layers.map((layer) => check(`${layer.name || "(no layer)"} – ${layer.strokes} line${layer.strokes === 1 ? "" : "s"}`, chosen.has(layer.name), (isOn) => { chosen[isOn ? "add" : "delete"](layer.name); show(); }));
  const unit = isDxf
    ? field("unit", { choices: units, value: plan.unit }, (value) => { values.unit = value || ""; show(); })
    : field("a unit is", { type: "number", unit: "m", value: "", placeholder: "0.01" }, (value) => { values.scale = value > 0 ? value : null; show(); });
  const dialog = document.getElementById("dialog");
  dialog.replaceChildren(make("form", { method: "dialog", className: "plan" }, make("h2", { textContent: `What of ${path} is wall?` }), preview,
    make("div", { className: "boxes", role: "group", "aria-label": "Layers" }, ...boxes), fields(unit), size,
    make("div", { className: "row" }, open, make("button", { textContent: "Cancel", value: "", formNoValidate: true }))));
  show();
  dialog.returnValue = "";
  dialog.showModal();
  await new Promise((resolve) => (dialog.onclose = resolve));
  if (dialog.returnValue !== "ok") return null;
  const all = chosen.size === plan.layers.length;
  return { ...(all || (plan.layers.length === 1 && !plan.layers[0].name) ? {} : { layers: JSON.stringify([...chosen]) }), ...(isDxf ? { unit: values.unit } : { scale: values.scale }) };
}

async function pageOf(path, pages) {
  const page = await ask(`Which page of ${path}?`, `of ${pages}`, 1);
  return page && { page };
}
