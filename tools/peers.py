#!/usr/bin/env python3
"""Our planners beside the programs of others, which whoever runs this has built; writes docs/peers.md.

    tools/peers.py INSTANCES [--lacam3 FILE] [--libmrp DIR] [--eecbs FILE] [--cbsh2-rtc FILE] [--mapf-lns2 FILE] [--peer 'NAME=COMMAND'] ...

Nothing is downloaded; a program that is not given is left out. INSTANCES holds MovingAI files as for `tools/bench_planners.py`, whose
measurement this is: same instances, same machine, same run, every planner asked an instance before the next one, CPU time of the whole
process, every plan read from the program's file and judged by our referee. Of docs/peers.md the part between `<!-- measured -->` and
`<!-- end -->` is written anew.

Programs with other formats (pibt2, EPIBT, CCBS) can take part by a small program of yours that translates: --peer
'pibt2=./translate.py {map} {scen} {agents} {out}', places as in `mrp_sumo.planning.external`.
"""

import argparse
import sys
from datetime import date
from pathlib import Path

from bench import Row, line
from bench_planners import BENCHMARK, PAPER, made, measure

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.planning.registry import planner

PAGE = Path(__file__).resolve().parents[1] / "docs" / "peers.md"
LISTED = "-m {map} -a {scen} -k {agents} -t {time_limit} -o {out}.csv --outputPaths={out}"  # EECBS, CBSH2-RTC and MAPF-LNS2
LIBMRP = {  # program of its build folder -> (name, command)
    "cbs": ("CBS, libMultiRobotPlanning", "-i {yaml} -o {out}"),
    "ecbs": ("ECBS 1.2, libMultiRobotPlanning", "-i {yaml} -o {out} -w 1.2"),
    "cbs_ta": ("CBS-TA, libMultiRobotPlanning", "-i {yaml_free} -o {out}"),
    "ecbs_ta": ("ECBS-TA 1.2, libMultiRobotPlanning", "-i {yaml_free} -o {out} -w 1.2"),
}
PROGRAMS = {  # option -> (name, command)
    "lacam3": ("lacam3", "-m {map} -i {scen} -N {agents} -t {time_limit} -s {seed} -o {out} --no-star --no-multi-thread"),  # first solution
    "eecbs": ("EECBS 1.2", f"{LISTED} --suboptimality=1.2"),
    "cbsh2_rtc": ("CBSH2-RTC", LISTED),
    "mapf_lns2": ("MAPF-LNS2", LISTED),
}
OURS = ("cbs", "ecbs", "eecbs", "lacam", "lns2")


def main() -> int:
    """Measure, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("instances", type=Path)
    for option in PROGRAMS:
        parser.add_argument(f"--{option.replace('_', '-')}", type=Path, metavar="FILE", help="its program")
    parser.add_argument("--libmrp", type=Path, metavar="DIR", help="build folder of libMultiRobotPlanning")
    parser.add_argument("--peer", action="append", default=[], metavar="NAME=COMMAND", help="any other program; may be repeated")
    only = "only maps and sizes, written like 'warehouse_0.4 9', that contain this text; may be repeated"
    parser.add_argument("--only", action="append", default=[], metavar="TEXT", help=only)
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="S")
    parser.add_argument("--count", type=int, default=1000, metavar="N", help="instances a row at most")
    parser.add_argument("--print", action="store_true", help="print the tables, leave the page as it is")
    options = parser.parse_args()
    try:
        planners = {name: made(name) for name in OURS} | peers(options)
        sizes = [(name, robots) for name, of in (PAPER | BENCHMARK).items() for robots in of]
        text = table(
            {
                f"{name}, {robots} robots": measure(planners, options.instances, name, robots, options.time_limit, options.count)
                for name, robots in sizes
                if not options.only or any(text in f"{name} {robots}" for text in options.only)
            }
        )
    except MrpSumoError as error:
        print(error, file=sys.stderr)
        return 2
    there = ", ".join(name for name in planners if name not in OURS) or "none was given"
    head = f"Measured on {date.today().isoformat()}, limit {options.time_limit:g} s. Programs of others: {there}.\n"
    if options.print:
        print(head + text)
    else:
        write(head + text)
    return 0


def peers(options: argparse.Namespace) -> dict[str, Planner]:
    """The programs that were given, by name.

    Raises
    ------
    MrpSumoError
        For a file that is not there.
    """
    commands = {}
    for option, (name, arguments) in PROGRAMS.items():
        if (path := getattr(options, option)) is not None:
            commands[name] = f"{_program(path)} {arguments}"
    for program, (name, arguments) in LIBMRP.items() if options.libmrp else ():
        if (options.libmrp / program).is_file():
            commands[name] = f"{_program(options.libmrp / program)} {arguments}"
    for text in options.peer:
        name, equals, command = text.partition("=")
        if not equals:
            raise MrpSumoError(f"--peer {text}: expected NAME=COMMAND")
        commands[name] = command
    return {name: planner("external", {"command": command}) for name, command in commands.items()}


def _program(path: Path) -> Path:
    if not path.is_file():
        raise MrpSumoError(f"{path}: no such program")
    return path.resolve()


def table(sizes: dict[str, list[Row]]) -> str:
    """A column for each map and number of robots: CPU time in ms, median and longest, and cost; nothing without instances."""
    sizes = {size: rows for size, rows in sizes.items() if rows}
    if not sizes:
        return ""
    lines = [line(["planner", *sizes]), line(["---"] * (1 + len(sizes)))]
    for k, row in enumerate(next(iter(sizes.values()))):
        name = row["planner"]
        lines.append(line([f"`{name}`" if name in OURS else name, *(_cell(rows[k]) for rows in sizes.values())]))
    return "\n" + "\n".join(lines) + "\n"


def _cell(row: Row) -> str:
    tried = row["instances"] - row["refused"]
    missing = "" if row["solved"] == tried else f" ({row['solved']} of {tried})"
    ms = [None if row[key] is None else 1e3 * row[key] for key in ("cpu_median_s", "cpu_max_s")]
    return f"{_number(ms[0])} / {_number(ms[1])}, {_number(row['cost'])}{missing}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f}" if value >= 1000 else f"{value:.1f}"


def write(text: str) -> None:
    """Put the tables into the page."""
    begin, middle, rest = PAGE.read_text(encoding="utf-8").partition("<!-- measured -->\n")
    PAGE.write_text(f"{begin}{middle}\n{text}\n<!-- end -->{rest.partition('<!-- end -->')[2]}", encoding="utf-8")


if __name__ == "__main__":
    raise SystemExit(main())
