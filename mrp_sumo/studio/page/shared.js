/* What the steps of the workbench share: the files of the folder, the scenario, and the command that is under way. */
import { get, post } from "./api.js";
import { banner } from "./parts.js";
import { changed } from "./site.js";

export const shared = { start: null, files: [], step: "floor", robot: "turtlebot3", scenario: null, text: "", textDigest: "", values: null, fault: "", job: null, run: "", study: "", points: [], answer: null, pairs: null };
export const actions = {};  // of main.js: save, open, show, frame
export const follows = {};  // what a command is -> { during, after }: what the page does with its results so far, and in the end
const LOOK_MS = 700;

export const of = (kind) => shared.files.filter((file) => file.kind === kind).map((file) => file.path);
export const folderOf = (path) => (path.includes("/") ? path.slice(0, path.lastIndexOf("/") + 1) : "");
export const stemOf = (path) => path.slice(folderOf(path).length).replace(/\.building\.yaml$/, "");
export const isRunning = () => shared.job?.state === "running";

export async function refresh() {
  shared.files = await get("files");
}

export async function start(values) {
  try {
    await follow(await post("start", values));
  } catch (error) { banner(error.message); }
  changed("panel");
}

/* Watch a command to its end; one that was under way when the page was opened, too. */
export async function follow(job) {
  const { during, after } = follows[job.what] || {};
  for (;;) {
    shared.job = job;
    await during?.(job);
    changed("panel");
    if (job.state !== "running") break;
    await new Promise((resolve) => setTimeout(resolve, LOOK_MS));
    try {
      job = (await get("commands")).find((one) => one.number === job.number);
    } catch (error) {
      shared.job = { ...job, state: "failed", reported: [error.message] };
      throw error;
    }
  }
  await refresh();
  if (job.state !== "stopped") await after?.(job);
  changed("panel");
}
