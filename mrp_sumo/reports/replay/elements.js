/* Elements, colours and spans of time as the page writes them. Text is set as text: a name can never become HTML. */
import { STATE_COLORS } from "./constants.js";

const KIND_COLORS = { deadlock: "--deadlock", blocked: "--blocked", disturbance: "--disturbance", yielded: "--yielded", waited: "--waiting", goal: "--goal" };
export const STATE_VARIABLES = STATE_COLORS.map((name) => `--${name}`);

export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key === "style") for (const [name, v] of Object.entries(value)) element.style.setProperty(name, v);
    else if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key.includes("-") || key === "role") element.setAttribute(key, value);
    else element[key] = value;
  }
  element.append(...children.filter((c) => c !== null && c !== undefined));
  return element;
}

export function clockText(t, digits = 1) {
  const tenths = Math.max(0, Math.round(t * 10 ** digits)) / 10 ** digits;
  const minutes = Math.floor(tenths / 60), hours = Math.floor(minutes / 60);
  const seconds = (tenths - 60 * minutes).toFixed(digits).padStart(digits ? 3 + digits : 2, "0");
  return hours ? `${hours}:${String(minutes % 60).padStart(2, "0")}:${seconds}` : `${minutes}:${seconds}`;
}

export function spanText(seconds) {
  return seconds >= 600 ? clockText(seconds, 0) + " min" : seconds >= 100 ? `${Math.round(seconds)} s` : `${seconds.toFixed(1)} s`;
}

export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), use = document.createElementNS("http://www.w3.org/2000/svg", "use");
  svg.setAttribute("class", "icon");
  use.setAttribute("href", `#${name}`);
  svg.append(use);
  return svg;
}

export function kindColor(kind) {
  return KIND_COLORS[kind] || "--other";
}

export function cssColor(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
