/* Parts of panels: fields with labels and units, lists, questions, and the state of a command. */
import { make } from "./elements.js";
import { post } from "./api.js";

let ids = 0;

/* A labelled field, in three cells: label, input, unit. `change` is called with its value; null where it is empty. */
export function field(label, { type = "text", value = "", unit = "", choices = null, least, most, says = "", step = "any", placeholder = "" }, change) {
  const id = `field-${ids++}`;
  let input;
  if (type === "boolean") {
    input = make("input", { id, type: "checkbox", checked: Boolean(value), title: says });
    input.addEventListener("change", () => change(input.checked));
  } else if (choices?.length) {
    const all = value === "" || value === null || choices.includes(value) ? choices : [value, ...choices];
    input = make("select", { id, title: says }, ...["", ...all].map((choice) => make("option", { value: String(choice), textContent: choice === "" ? `– ${placeholder && `(${placeholder})`}` : String(choice), selected: choice === (value ?? "") })));
    input.addEventListener("change", () => change(input.value === "" ? null : all.find((choice) => String(choice) === input.value)));
  } else {
    const isNumber = type === "number" || type === "integer";
    input = make("input", { id, type: isNumber ? "number" : "text", value: value ?? "", title: says, placeholder: String(placeholder ?? "") });
    if (isNumber) Object.assign(input, { step: type === "integer" ? 1 : step, ...(least !== null && least !== undefined ? { min: least } : {}), ...(most !== null && most !== undefined && most < 1e8 ? { max: most } : {}) });
    committed(input, () => change(input.value === "" ? null : isNumber ? Number(input.value) : input.value));
  }
  return [make("label", { htmlFor: id, title: says, textContent: label }), input, make("span", { className: "unit", textContent: unit })];
}

/* Call back with what was typed, once; a panel that is made anew meanwhile carries it along (`typed`). */
export function committed(input, change) {
  const commit = () => {
    if (!input.dataset.typed) return;
    delete input.dataset.typed;
    change();
  };
  input.addEventListener("input", () => (input.dataset.typed = "yes"));
  input.addEventListener("change", commit);
  input.addEventListener("blur", commit);
}

export function check(label, isOn, change) {
  const input = make("input", { type: "checkbox", checked: Boolean(isOn) });
  input.addEventListener("change", () => change(input.checked));
  return make("label", {}, input, label);
}

export const fields = (...all) => make("div", { className: "fields" }, ...all.flat());
export const button = (text, onclick, properties = {}) => make("button", { type: "button", textContent: text, onclick, ...properties });
export const next = (...text) => make("p", { className: "next" }, ...text);
export const muted = (text) => make("p", { className: "muted", textContent: text });

/* A question in a dialog; resolves to the number or text, null where it was given up. */
export function ask(title, unit, value, type = "number") {
  const dialog = document.getElementById("dialog"), input = make("input", { type, step: "any", value, required: true, "aria-label": title });
  return new Promise((resolve) => {
    const form = make("form", { method: "dialog" }, make("h2", { textContent: title }), make("div", { className: "row" }, input, make("span", { textContent: unit })),
      make("div", { className: "row" }, make("button", { className: "main", textContent: "OK", value: "ok" }), make("button", { textContent: "Cancel", value: "", formNoValidate: true })));
    dialog.replaceChildren(form);
    dialog.onclose = () => resolve(dialog.returnValue === "ok" ? (type === "number" ? Number(input.value) : input.value.trim()) : null);
    dialog.returnValue = "";
    dialog.showModal();
    input.focus();
    input.select?.();
  });
}

export function banner(text, ...buttons) {
  const place = document.getElementById("banner");
  place.hidden = !text;
  place.classList.remove("note");
  place.replaceChildren(make("span", { textContent: text }), ...buttons, ...(text ? [button("Close", () => banner(""))] : []));
}

/* Words that nothing has to be done about. */
export function note(text) {
  banner(text);
  document.getElementById("banner").classList.toggle("note", Boolean(text));
}

/* The state of a command as an element. */
export function jobState(job) {
  if (!job) return null;
  const words = { running: "under way …", done: "done", failed: "failed", stopped: "stopped" }[job.state];
  const last = job.state === "failed" ? job.reported.join("\n") || job.printed.join("\n") : job.reported.at(-1) || "";
  const [compiled, needed] = job.compiled;
  const time = `${job.seconds < 100 ? `${Math.round(job.seconds)} s` : `${Math.round(job.seconds / 60)} min`}`;
  const kernels = job.state === "running" ? `compiling, once on this machine, which takes minutes: ${compiled} new of ${needed} kernels at most; the next command begins at once` : `${compiled} kernels were compiled for it, once on this machine`;
  return make("div", { role: "status", className: "job" },
    make("p", {}, make("b", { className: job.state === "failed" ? "bad" : job.state === "done" ? "good" : "", textContent: words }), ` ${time}`),
    make("p", {}, make("code", { className: "muted", textContent: job.command })),
    compiled ? muted(kernels) : null,
    last ? make("pre", { textContent: last }) : null,
    job.state === "running" ? button("Stop", () => post("stop", { number: String(job.number) }), { className: "danger" }) : null);
}
