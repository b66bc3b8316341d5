"""Damaged files of every format, through every command that reads them, and arguments nobody gives.

Expected: exit code 0, 1 or 2; a refusal in lines that begin with `mrp-sumo:` and leaves nothing behind; no traceback; nothing printed that
a terminal obeys, and no forged line; the trial's limits of time and memory hold. Commands run in the campaign's process, by
`mrp_sumo.cli.main.main`, thousands one after the other; those that take long are drawn less often.
"""

import contextlib
import io
import json
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Any

from campaigns.deep_damage import damage_any, damage_results, damage_run, damage_trace
from campaigns.driver import Trial
from lif_worlds import LIF
from map_worlds import CSV, LINK, MODEL, ROUTE, SITE
from step_wise_worlds import ROUND, write_problem

from mrp_sumo.cli.main import COMMANDS, main

LIMIT_S, COMPILING_S = 30, 600  # CPU time of a command, and where its kernels may have to be compiled
FORGED = "\x1b[2J\r\x9b1m\u202e\nforged line"
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]|^forged", re.MULTILINE)
PROJECT = Path(__file__).resolve().parents[2]
WORD = re.compile(rb"[^\s,\[\]{}:()\"'>-]+")
JUNK = (
    b"", b"null", b"-1", b"0", b"1e308", b"1e400", b"-1e-320", b"nan", b"inf", b".nan", b".inf", b"99999999999999999999",
    b"9223372036854775807",
    b"-9223372036854775809", b"[]", b"{}", b'"', b"'", b"[", b"{", b"]", b"}", b": ", b"- ", b"&a", b"*a", b"true", b"~", b"a", b"..",
    b"/", b"\x00",
    b"\x1b[31m", b"\r", b"\x0b", b"\x85", b"\xff\xfe", "²".encode(), "٣".encode(), "\u2028".encode(), b"2020-01-01", b"0x1F", b"1_000",
    FORGED.encode(), json.dumps(f"a{FORGED}").encode(),
    b"1.5", b"!!python/object:os.system",
    b"<<: *a", b"L1", b"\t", b"#", b"|", b"%", b"@", b"Agent 0:", b"1:2:3", b"[" * 500, b"{a: " * 200, b"[" * 100_000, b"9" * 5000,
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**400, 1e308, -1e308, 1e-320, 0.5, float("nan"), float("inf"),
    "", "a", "\x00", "..", "x" * 5000, f"a{FORGED}",
    [], {}, [[]], [None], {"": None}, {"a": {"b": []}}, "2020-01-01", "\ud800",
)  # fmt: skip

MAP = "type octile\nheight 4\nwidth 5\nmap\n.....\n.@.@.\n.....\n.....\n"
SCEN = "version 1\n0\tsmall.map\t5\t4\t0\t0\t4\t3\t7\n0\tsmall.map\t5\t4\t4\t0\t0\t3\t7\n"
ROBOT = "length_m: 0.3\nwidth_m: 0.2\nmax_speed_mps: 0.5\naccel_mps2: 0.5\n"
ROBOT += "decel_mps2: 0.5\nturn_rate_rad_s: 1.0\ngap_m: 0.05\nsource: a data sheet\n"
SCENARIO = """\
name: trial
seed: 3
map: {file: small.building.yaml, level: L1, graph: 0, snap_m: 0.01, split_crossings: true}
discretisation: {kind: grid, cell_m: 0.5}
robots: {count: 2, type: cart.yaml, draw: uniform}
assignment: {mode: optimal, solver: linear_sum_assignment, cost: path}
planner: {name: cbs, time_limit_s: 2.0, parameters: {heuristic: true}}
execution:
  policy: adg
  step_length_s: 0.1
  time_limit_s: 30.0
  on_deadlock: resolve
  recovery: {give_way: true, patience_s: 5.0, replanner: lacam}
  mutex_groups: {middle: [crossing_2_2, crossing_3_2]}
  disturbances:
    speed_noise: 0.05
    breakdowns: [{robot: 1, begin_s: 2.0, duration_s: 3.0}]
    obstacles: [{x_m: 4.0, y_m: 2.0, begin_s: 1.0, duration_s: 4.0, radius_m: 0.2}]
    closures: [{between: [crossing_2_1, crossing_4_1], begin_s: 1.0, duration_s: 5.0}]
record: {period_s: 0.2, bag: true, storage: mcap, rmf_messages: jazzy, robots: [robot_0], poses: true}
"""
SUITE = """\
name: study
description: A trial.
base: {map: small.building.yaml, robots: 2, planner: {name: cbs, time_limit_s: 2.0}}
grid_search: {seed: 0..1, planner: [astar, cbs]}
exclude: [{planner: astar, seed: 1}]
repeat: 1
until: plan
limits: {wall_s: 600, memory_mb: 2000}
views: {cost: 'select planner, avg(soc_steps) from results group by planner'}
"""
LIFELONG = """\
map: small.building.yaml
discretisation: {cell_m: 0.5}
robots: {count: 2, type: cart.yaml}
planner: {name: lacam, budget: 2000}
tasks:
  stations: {shelf: {places: [crossing_1_1], queue: [crossing_1_2]}}
  groups: {corner: [crossing_3_3, crossing_1_3]}
  streams:
    - name: order
      arrivals: {rate_per_h: 300, profile: [1, 0.5]}
      stops: [shelf, corner]
      zipf: 0.6
      service: [{constant_s: 2}, {triangular_s: [1, 2, 4]}]
    - {name: more, arrivals: {open: 1}, stops: [corner], due_after_s: 60, priority: 1}
  parking: [corner]
execution:
  dispatcher: hungarian
  engine: kinematic
  time_limit_s: 40
  planning: {budget_s: 1, window_s: 10}
  one_way: [[crossing_2_1, crossing_3_1]]
"""
FROM_FILE = (
    "map: small.building.yaml\ndiscretisation: {cell_m: 0.5}\nrobots: {count: 2, type: cart.yaml}\nplanner: pibt\ntasks: orders.csv\n"
)
FROM_FILE += "execution: {engine: kinematic, time_limit_s: 40}\n"
ORDERS = "release_s,stops,name,priority\n1,crossing_1_1 crossing_3_3,one,2\n3,crossing_1_3,,\n"
REQUESTS = """[{"unix_millis_earliest_start_time": 2000, "category": "delivery", "description":
  {"pickup": {"place": "crossing_1_1"}, "dropoff": {"place": "crossing_3_3"}}, "priority": {"value": 1}},
 {"unix_millis_earliest_start_time": 0, "category": "patrol", "description": {"places": ["crossing_1_3"], "rounds": 1}}]
"""
MANY = "--map small.map --scen small.scen --robots 2\n--map small.map --scen small.scen --robots 1 --planner cbs\n"
CONFIG = "robots:\n  robot_0: {start: [1.0, 1.0], goal: [3.0, 3.0]}\n  robot_1: {start: [3.0, 1.0], goal: [1.0, 3.0]}\n"
CONFIG += "config: {cellSize: 0.35, locationTolerance: 0.7, windowSize: 10, recordingTimeout: 600}\n"
SHEET = "image: room.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"


@dataclass(frozen=True)
class Reading:
    """A file that is damaged, or any of a folder, and a command that reads it."""

    file: str
    command: tuple[str, ...]
    needs: tuple[str, ...] = ()  # more files
    damage: Callable[[Path, random.Random], None] | None = None  # of a folder, below its checksums; None: of bytes

    @property
    def kind(self) -> str:
        """The row of the table."""
        return f"{self.file}{', ' + self.damage.__name__ if self.damage else ''}: {self.command[0]}"

    @property
    def weight(self) -> float:
        """How often it is drawn, among the others."""
        return min(0.01 / CPU_S.get(word, 0.01) for word in self.command)

    def lay_out(self, material: Path, folder: Path) -> None:
        """Copy what the command reads."""
        for name in {self.file.split("/")[0], *self.needs}:
            source = material / name
            shutil.copytree(source, folder / name) if source.is_dir() else shutil.copy(source, folder)


STUDY = ("lifelong.yaml", "--quick", "--robots", "1..2", "--horizon", "1min", "--workers", "1", "--out", "study", "--budget")
CPU_S = {  # of commands by a word of theirs; those that take more than a hundredth are drawn the less often
    **{"report": 0.6, "run": 0.25, "reproduce": 0.2, "init": 0.6, "capacity": 0.6, "--vda5050": 0.5},
    **{"query": 0.2, "import": 0.2, "render": 0.12, "compare": 0.1, "replay": 0.07, "export": 0.06, "analyze": 0.05, "batch": 0.05},
    **{"--command": 0.03, "--workers": 0.3, "status": 0.04, "work/plan.json": 0.08, "run/plan.json": 0.03},
}


PLANS = ("plan.json", "plan.yaml", "plan.txt", "plan.lacam", "plan.smart")
MAPS = ("small.lif.json", "small.xml", "small.site.json", "route.geojson", "small.geojson", "small.net.xml", "lanes.csv", "link.json")
MAPS += ("small.nav.yaml", "hall.dxf", "lifts.building.yaml")
ON_MAP = ("--map", "small.map", "--scen", "small.scen")
READINGS = (
    Reading("scenario.yaml", ("plan", "scenario.yaml"), ("small.building.yaml", "cart.yaml")),
    Reading("scenario.yaml", ("run", "scenario.yaml", "--out", "out"), ("small.building.yaml", "cart.yaml")),
    Reading("cart.yaml", ("plan", "scenario.yaml"), ("small.building.yaml", "scenario.yaml")),
    Reading("suite.yaml", ("batch", "suite.yaml", "--dry-run"), ("small.building.yaml",)),
    Reading("small.building.yaml", ("import", "small.building.yaml", "--out", "out")),
    Reading("small.building.yaml", ("convert", "small.building.yaml", "out.map")),
    Reading("small.map", ("plan", *ON_MAP), ("small.scen",)),
    Reading("small.map", ("import", "small.map", "--out", "out")),
    Reading("small.scen", ("plan", *ON_MAP), ("small.map",)),
    Reading("small.scen", ("import", "small.scen", "--out", "out"), ("small.map",)),
    Reading("sheet.yaml", ("import", "sheet.yaml", "--out", "out"), ("room.pgm",)),
    Reading("room.pgm", ("import", "sheet.yaml", "--out", "out"), ("sheet.yaml",)),
    Reading("instance.yaml", ("plan", "--map", "instance.yaml")),
    *(Reading(name, ("import", name, "--out", "out")) for name in MAPS),
    *(Reading(name, ("convert", name, "out.xml" if name != "small.xml" else "out.lif.json")) for name in MAPS),
    *(Reading(name, ("init", name, "--out", "out")) for name in ("small.building.yaml", "small.nav.yaml", "small.lif.json", "small.xml")),
    Reading("hall.png", ("convert", "hall.png", "out.map", "--meters-per-pixel", "0.1", "--cell", "0.5")),
    Reading("work.yaml", ("run", "work.yaml", "--set", "execution.time_limit_s=2", "--out", "out")),
    Reading("work.yaml", ("capacity", "work.yaml", "--quick", "--dry-run")),
    Reading("lifelong.yaml", ("run", "lifelong.yaml", "--out", "out"), ("small.building.yaml", "cart.yaml")),
    Reading("lifelong.yaml", ("capacity", "lifelong.yaml", "--quick", "--dry-run"), ("small.building.yaml", "cart.yaml")),
    *(Reading(name, ("run", "orders.yaml", "--set", f"tasks.file={name}", "--out", "out"),
              ("small.building.yaml", "cart.yaml", "orders.yaml"))
      for name in ("orders.csv", "requests.json")),
    Reading("many.txt", ("plan", "--many", "many.txt"), ("small.map", "small.scen")),
    *(Reading(name, ("plan", "x.json", "--steps", "5", "--planner", "epibt"), tuple({"x.json", "x.map", "x.agents", "x.tasks"} - {name}))
      for name in ("x.json", "x.map", "x.agents", "x.tasks")),
    Reading("solution.json", ("validate", "solution.json", "--problem", "x.json"), ("x.json", "x.map", "x.agents", "x.tasks")),
    Reading("messages.jsonl", ("validate", "--vda5050", "messages.jsonl")),
    Reading("messages.jsonl", ("import", "messages.jsonl", "--map", "small.building.yaml", "--out", "out"), ("small.building.yaml",)),
    Reading("roadmap.yaml", ("plan", "--map", "roadmap.yaml")),
    *(Reading(plan, ("validate", plan, *ON_MAP), ("small.map", "small.scen")) for plan in PLANS),
    *(Reading(plan, ("convert", plan, "out.yaml", "--map", "small.map"), ("small.map",)) for plan in PLANS),
    Reading("plan.txt", ("plan", *ON_MAP, "--command", "cp plan.txt {out}"), ("small.map", "small.scen")),
    Reading("plan.txt", ("run", *ON_MAP, "--plan", "plan.txt", "--set", "execution.engine=kinematic", "--out", "out"),
            ("small.map", "small.scen")),
    *(Reading("run", command, ("small.building.yaml", "cart.yaml")) for command in (
        ("replay", "run"), ("render", "run", "--at", "2", "--out", "out.png"), ("export", "run", "--csv"),
        ("export", "run", "--bag", "--out", "again"),
        ("export", "run", "--vda5050", "--out", "vda"), ("replay", "run", "run", "--out", "two.html"), ("reproduce", "run"),
        ("export", "run", "--geojson"), ("export", "run", "--fcd"), ("report", "run", "--out", "page.html"), ("analyze", "run"),
    )),
    *(Reading("run/bag", ("analyze", "run/bag")) for _ in range(3)),
    Reading("bag3", ("analyze", "bag3")),
    Reading("ros1.bag", ("analyze", "ros1.bag")),
    Reading("config.yaml", ("analyze", "run/bag", "--config", "config.yaml"), ("run",)),
    *(Reading("batch", command, ("suite.yaml", "small.building.yaml")) for command in (
        ("status", "batch"), ("query", "batch", "select count(*) from results"), ("query", "batch", "cost"),
        ("report", "batch", "--out", "page.html"),
        ("compare", "batch", "batch"), ("batch", "suite.yaml", "--out", "batch", "--dry-run"),
        ("batch", "suite.yaml", "--out", "batch", "--workers", "1"),
        ("analyze", "batch", "--metric", "soc_steps"),
    )),
)  # fmt: skip
BESIDE = ("lifelong.yaml", "small.building.yaml", "cart.yaml", "scenario.yaml", "work.yaml")
DEEP = tuple(Reading(folder, command, BESIDE, damage) for folder, damage, command in (
    *(("work", damage_run, command) for command in (
        ("replay", "work"), ("render", "work", "--at", "20", "--out", "out.png"), ("export", "work", "--csv"),
        ("export", "work", "--bag", "--out", "again"), ("export", "work", "--vda5050", "--out", "vda"), ("export", "work", "--geojson"),
        ("export", "work", "--fcd"), ("export", "work", "--rmf-plans"), ("report", "work", "--out", "page.html"),
        ("export", "work", "--viewers"), ("export", "work", "--ros1", "--out", "again.bag"), ("analyze", "work", "--audit"),
        ("render", "work", "--video", "out.gif", "--from", "1", "--to", "2", "--speed", "4", "--size", "240x240"),
        ("analyze", "work", "--metric", "min_clearance_m"), ("analyze", "work", "--metric", "protective_stops_per_robot_h"),
        ("replay", "work", "work", "--out", "two.html"), ("validate", "work/plan.json", "--scenario", "work.yaml"),
    )),
    *(("run", damage_run, command) for command in (
        ("replay", "run"), ("export", "run", "--csv"), ("export", "run", "--bag", "--out", "again"), ("reproduce", "run"),
        ("analyze", "run", "--metric", "min_clearance_m"), ("render", "run", "--at", "2", "--out", "out.png"),
        ("validate", "run/plan.json", "--scenario", "scenario.yaml"),
        ("run", "scenario.yaml", "--plan", "run/plan.json", "--out", "out"),
    )),
    *(("batch", damage_trace, ("analyze", "batch", "--metric", metric)) for metric in ("soc_steps", "min_clearance_m")),
    *(("batch", damage_results, command) for command in (
        ("query", "batch", "select * from results"), ("query", "batch", "cost"), ("report", "batch", "--out", "page.html"),
        ("compare", "batch", "batch"), ("status", "batch"),
    )),
    *(("study", damage_any, command) for command in (
        ("capacity", *STUDY, "5s"), ("status", "study"), ("report", "study", "--out", "page.html"), ("compare", "study", "study"),
        ("query", "study", "select * from results"),
    )),
    *(("study", damage_results, command) for command in (
        ("compare", "study", "study"), ("report", "study", "--out", "page.html"), ("query", "study", "select * from results"),
    )),
    *(("batch", damage_any, command) for command in (
        ("status", "batch"), ("report", "batch", "--out", "page.html"), ("compare", "batch", "batch"),
        ("reproduce", "batch", "--runs", "1"),
    )),
))  # fmt: skip
WORDS = (
    "--out",
    "--seed",
    "--map",
    "--scen",
    "--robots",
    "--set",
    "--planner",
    "--time-limit",
    "--json",
    "--format",
    "--limit",
    "--csv",
    "--metric",
    "--at",
)
WORDS += (
    "-1",
    "0",
    "1e400",
    "nan",
    "",
    ".",
    "..",
    "/",
    "/dev/null",
    "x" * 300,
    "\x00",
    "seed=-1",
    "planner=",
    "=",
    "a=b=c",
    "robots.count=[",
    "scenario.yaml",
    "run",
)
WORDS += (
    "small.map",
    "small.scen",
    "batch",
    "suite.yaml",
    "plan.json",
    "ünï",
    "\udcff",
    "--",
    "-v",
    "cbs",
    "execution={}",
    "map.graph=all",
)
UNSAFE = (
    "warmup",
    "batch",
    "list",
    "schema",
    "generate",
    "report",
    "paper",
    "demo",
    "capacity",
    "vda5050",
)  # take long, or write where they are told to; a report of / is long


def _be_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _be_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _link_to(target: str) -> Callable[[Path], None]:
    def be_link(path: Path) -> None:
        path.unlink()
        path.symlink_to(target.format(path.name))

    return be_link


REPLACEMENTS = (  # of a file
    *(_be_folder, _be_pipe, lambda path: path.write_bytes(b""), lambda path: path.unlink()),
    *map(_link_to, ("{}", "nowhere", "/dev/zero", "/dev/null", "/dev/full", "/proc/self/mem", ".")),
)


class _TooLong(BaseException):
    pass


class Fuzz:
    """Nine trials in ten damage a file, or a folder below its checksums; the others make up arguments."""

    size = None

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._kept = tempfile.TemporaryDirectory(prefix="fuzz-")
        self._material = Path(self._kept.name)
        os.environ["MPLBACKEND"] = "Agg"
        os.environ["XDG_CONFIG_HOME"] = str(self._material / "configuration")  # `mrp-sumo trust` writes there
        maker = os.fork()  # the campaign's process itself starts no thread
        if maker == 0:
            code = 1
            try:
                make_material(self._material)
                _require_read(self._material)
                code = 0
            except BaseException:
                traceback.print_exc()
                sys.stderr.flush()
            finally:
                os._exit(code)
        if os.waitpid(maker, 0)[1]:
            raise SystemExit("fuzz: the material cannot be made")

    def trial(self, number: int, folder: Path) -> Trial:
        chance = random.Random(f"{self._seed} {number}")
        if chance.random() < 0.1:
            for name in ("scenario.yaml", "small.building.yaml", "cart.yaml", "small.map", "small.scen", "plan.json", "suite.yaml"):
                shutil.copy(self._material / name, folder)
            if chance.random() < 0.5:
                return attempt(["plan", "scenario.yaml", *_settings(chance)], folder, "settings")
            command = [chance.choice([name for name in COMMANDS if name not in UNSAFE]), *chance.choices(WORDS, k=chance.randint(0, 5))]
            return attempt(command, folder, "arguments")
        readings = chance.choice((READINGS, DEEP))
        (reading,) = chance.choices(readings, [each.weight for each in readings])
        reading.lay_out(self._material, folder)
        target = folder / reading.file
        if reading.damage is not None:
            for _ in range(chance.choice((1, 1, 1, 2, 4))):
                reading.damage(target, chance)
        else:
            if target.is_dir():
                target = chance.choice(sorted(path for path in target.rglob("*") if path.is_file() and path.name != "batch.lock"))
            if chance.random() < 0.03:
                chance.choice(REPLACEMENTS)(target)
            else:
                target.write_bytes(damaged(target.read_bytes(), chance))
        return attempt(list(reading.command), folder, reading.kind)


def _require_read(material: Path) -> None:
    """Refuse a reading that is refused without any damage: it would try nothing."""
    for reading in (*READINGS, *DEEP):
        with tempfile.TemporaryDirectory() as folder:
            reading.lay_out(material, Path(folder))
            trial = attempt(list(reading.command), Path(folder), reading.kind, COMPILING_S)
        if trial.faults or trial.ended == "exit code 2":
            raise RuntimeError(f"{reading.command} does not work without damage: {trial}")


def damaged(data: bytes, chance: random.Random) -> bytes:
    """The data with one to four faults."""
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        data = chance.choice(_DAMAGES)(data, chance)
    return data


def attempt(command: list[str], folder: Path, kind: str, limit_s: float = LIMIT_S) -> Trial:
    """Run a command in a folder and look at how it ends."""
    shown = "mrp-sumo " + " ".join(_quoted(word) for word in command)
    (folder / "command.sh").write_text(shown + "\n", errors="surrogateescape")
    scratch = folder.parent / f"{folder.name}.tmp"
    scratch.mkdir(exist_ok=True)
    before = _files(folder)
    out, err = io.StringIO(), io.StringIO()
    code: Any = None
    faults: list[str] = []
    previous, home = tempfile.tempdir, Path.cwd()
    signal.signal(signal.SIGPROF, _alarm)
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    tempfile.tempdir = str(scratch)
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(command)
    except SystemExit as error:
        code = error.code or 0
    except _TooLong:
        faults.append(f"takes more than {limit_s:g} CPU-s")
    except BaseException as error:
        places = [f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__) if "mrp_sumo" in f.filename]
        faults += [
            traceback.format_exc(),
            f"{type(error).__name__} at {places[-1] if places else '?'}: {' '.join(str(error).split())[:120]}",
        ]
        faults.reverse()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        tempfile.tempdir = previous
        os.chdir(home)
    if not faults:
        if obeyed := OBEYED.search(out.getvalue() + err.getvalue()):
            faults.append(f"printed for a terminal to obey: {obeyed[0]!r}")
        faults += _faults_of(code, err.getvalue(), sorted(_files(folder) - before))
        faults += [f"left in the temporary folder: {path.name}" for path in scratch.iterdir()]
    shutil.rmtree(scratch, ignore_errors=True)
    return Trial(kind, f"exit code {code}" if code is not None else "fault", tuple(faults), shown)


def _faults_of(code: Any, errors: str, new: list[str]) -> Iterator[str]:
    if code not in (0, 1, 2):
        yield f"exit code {code!r}"
    if "out of memory" in errors:
        yield errors
    if "Traceback (most recent call last)" in errors:
        yield f"a traceback is printed: {errors[-2000:]}"
    if code == 2:
        lines = errors.splitlines()
        if not lines:
            yield "exit code 2 without a word"
        if odd := [line for line in lines if not line.startswith("mrp-sumo: ")]:
            yield f"a refusal of more than its line: {odd[0][:200]!r}"
        if new:
            yield f"refused, but {new[0]} is left"


def _files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")} - {"command.sh"}


def _alarm(number: int, frame: FrameType | None) -> None:
    raise _TooLong


def _quoted(word: str) -> str:
    return "'" + word.replace("'", "'\\''") + "'" if not re.fullmatch(r"[\w./=-]+", word) else word


def _settings(chance: random.Random) -> Iterator[str]:
    """Options that set keys of the scenario, or new ones beside them, to any value."""
    import yaml

    keys = [".".join(map(str, place)) for place in _paths_in(yaml.safe_load(SCENARIO))]
    for _ in range(chance.choice((1, 1, 2))):
        value = json.dumps(chance.choice(VALUES)) if chance.random() < 0.5 else chance.choice(JUNK).decode("utf-8", "surrogateescape")
        yield from ("--set", f"{chance.choice(keys)}{chance.choice(('', '', '', '.a', '.0'))}={value}")


def _paths_in(value: Any) -> Iterator[tuple[Any, ...]]:
    """Places of all mappings and values in a document, as keys from its top."""
    for key, inner in value.items() if isinstance(value, dict) else ():
        yield (key,)
        for path in _paths_in(inner):
            yield (key, *path)


def _encoded(data: bytes, chance: random.Random) -> bytes:
    """The same text as other systems write it, or packed."""
    import gzip

    text = data.decode("utf-8", "replace")
    match chance.randrange(6):
        case 0:
            return text.encode("utf-8-sig")
        case 1:
            return text.encode("utf-16")
        case 2:
            return text.replace("\n", "\r\n").encode()
        case 3:
            return text.replace("\n", "\r").encode()
        case 4:
            return text.replace("a", "é").encode("latin-1", "replace")
        case _:
            return gzip.compress(data, mtime=0)


def _word(data: bytes, chance: random.Random) -> bytes:
    words = list(WORD.finditer(data[:200_000]))
    if not words:
        return chance.choice(JUNK)
    result = chance.choice(words)
    return data[: result.start()] + chance.choice(JUNK) + data[result.end() :]


def _line(data: bytes, chance: random.Random) -> bytes:
    lines = data.split(b"\n")
    at = chance.randrange(len(lines))
    match chance.randrange(4):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, lines[at])
        case 2:
            lines.insert(at, lines.pop(chance.randrange(len(lines))))
        case _:
            lines[at] = b" " * chance.randint(1, 3) + lines[at]
    return b"\n".join(lines)


def _cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data) + 1)]


def _bytes(data: bytes, chance: random.Random) -> bytes:
    changed = bytearray(data or b"\0")
    for _ in range(chance.choice((1, 3, 30))):
        changed[chance.randrange(len(changed))] = chance.randrange(256)
    return bytes(changed)


def _inserted(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.choice(JUNK) + data[at:]


def _value(data: bytes, chance: random.Random) -> bytes:
    """Another value, or none, at a place of a JSON document; a record of a batch gets its checksum again."""
    import zlib

    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return _word(data, chance)
    places = list(places_in(document))
    if not places:
        return json.dumps(chance.choice(VALUES)).encode()
    parent, key = chance.choice(places)
    match chance.randrange(4):
        case 0:
            del parent[key]
        case 1:
            parent[key] = [parent[key]]
        case _:
            parent[key] = chance.choice(VALUES)
    if isinstance(document, dict) and "crc32" in document and "record" in document:
        body = json.dumps(document["record"], separators=(",", ":")).encode()
        return b'{"crc32":"%08x","record":' % zlib.crc32(body) + body + b"}\n"
    return json.dumps(document).encode()


def places_in(value: Any) -> Iterator[tuple[Any, Any]]:
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield value, key
        yield from places_in(inner)


def _is_deep(data: bytes) -> bool:
    """Whether PyYAML's loader in C might end the process: it calls itself for each bracket."""
    return data.count(b"[") + data.count(b"{") > 5000


def _yaml_value(data: bytes, chance: random.Random) -> bytes:
    """Another value, or none, at a place of a YAML document."""
    import yaml

    try:
        document = yaml.load(data, yaml.CSafeLoader) if len(data) < 100_000 and not _is_deep(data) else None
        places = list(islice(places_in(document), 10_000))  # aliases may stand for any number
    except (yaml.YAMLError, ValueError, RecursionError):
        return _word(data, chance)
    if not places:
        return _word(data, chance)
    parent, key = chance.choice(places)
    match chance.randrange(5):
        case 0:
            del parent[key]
        case 1:
            parent[key] = [parent[key]]
        case 2:  # a value of elsewhere
            other, which = chance.choice(places)
            parent[key] = other[which]
        case _:
            parent[key] = chance.choice(VALUES)
    try:
        return yaml.dump(document, Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True).encode(errors="surrogatepass")
    except (yaml.YAMLError, ValueError, RecursionError):
        return _word(data, chance)


_DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    *(_word, _word, _line, _cut, _bytes, _inserted, _encoded, _value, _value, _value, _yaml_value, _yaml_value),
)


def make_material(folder: Path) -> None:
    """A small file of each format, made by the commands themselves."""
    import ezdxf
    from PIL import Image

    from mrp_sumo.maps.generate import GENERATORS

    GENERATORS["grid"](9).write(folder / "small.building.yaml")
    texts = {
        "small.map": MAP,
        "small.scen": SCEN,
        "cart.yaml": ROBOT,
        "scenario.yaml": SCENARIO,
        "suite.yaml": SUITE,
        "config.yaml": CONFIG,
        "sheet.yaml": SHEET,
        "lifelong.yaml": LIFELONG,
        "orders.yaml": FROM_FILE,
        "orders.csv": ORDERS,
        "requests.json": REQUESTS,
        "many.txt": MANY,
        "small.lif.json": json.dumps(LIF),
        "small.xml": MODEL,
        "small.site.json": json.dumps(SITE),
        "route.geojson": json.dumps(ROUTE),
        "lanes.csv": CSV,
        "link.json": json.dumps(LINK),
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    work = (PROJECT / "scenarios" / "hospital_people.yaml").read_text()
    (folder / "work.yaml").write_text(
        work.partition("execution:")[0] + "execution: {engine: kinematic, doors: automatic, time_limit_s: 60}\n"
    )
    shutil.copy(PROJECT / "networks" / "hospital_levels" / "hospital_levels.building.yaml", folder / "lifts.building.yaml")
    Image.new("L", (60, 40), 255).save(folder / "hall.png")
    drawing = ezdxf.new()
    drawing.modelspace().add_lwpolyline([(0, 0), (6, 0), (6, 4), (0, 4)], close=True)
    drawing.saveas(folder / "hall.dxf")
    (folder / "room.pgm").write_bytes(b"P5\n16 16\n255\n" + bytes([254] * 256))
    (folder / "instance.yaml").write_text(
        "map:\n  dimensions: [4, 3]\n  obstacles:\n  - [1, 1]\nagents:\n"
        "- name: agent0\n  start: [0, 0]\n  goal: [3, 2]\n- name: agent1\n  start: [3, 0]\n  goal: [0, 2]\n"
    )
    (folder / "roadmap.yaml").write_text(
        "roadmap:\n  undirected: true\n  vertices:\n    a: [0, 0]\n    b: [1, 0]\n    c: [1, 1]\n  edges:\n  - [a, b]\n  - [b, c]\n"
        "agents:\n- name: agent0\n  start: a\n  goal: c\n"
    )
    write_problem(folder, ROUND, [0, 8], [[2], [6, 0], [7]])
    home = Path.cwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            for command in (
                *(["convert", "small.building.yaml", name] for name in ("small.geojson", "small.net.xml", "small.nav.yaml")),
                ["plan", "x.json", "--steps", "8", "--planner", "epibt", "--out", "solution.json"],
                *(
                    ["plan", *ON_MAP, "--out", plan, "--format", kind]
                    for plan, kind in zip(PLANS, ("json", "yaml", "paths", "lacam", "smart"))
                ),
                ["run", "scenario.yaml", "--out", "run"],
                ["export", "run", "--bag", "--storage", "sqlite3", "--out", "bag3"],
                ["export", "run", "--vda5050", "--out", "vda"],
                ["export", "run", "--ros1", "--out", "ros1.bag"],
                ["batch", "suite.yaml", "--out", "batch", "--workers", "1"],
                ["run", "work.yaml", "--out", "work"],
                ["capacity", *STUDY, "20min"],
            ):
                if main(command) == 2:
                    raise RuntimeError(f"the material cannot be made: {command}")
            shutil.move("vda/messages.jsonl", "messages.jsonl")
    finally:
        os.chdir(home)
