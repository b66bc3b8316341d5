"""Make a robot type and a set of disturbances of a fleet's log: how fast vehicles drive, how that scatters, what stops them.

LOG is a recorded stream of VDA 5050 messages (FILE.jsonl), a bag with /fleet_states, /tf, odometry, stamped poses or cmd_vel, a CSV of
poses (t_s, x_m, y_m, and robot, yaw_rad, action, station, battery), a run folder, or a fleet log archive. Each figure has a 90 % interval;
what the log does not tell stays as in --robot, and is said. --out TYPE.yaml gets the type, TYPE.disturbances.yaml beside it what disturbs
it, and TYPE.png fit and data; --against TYPE.yaml says what of an earlier one no longer fits. A scenario names both:
`robots: {type: ./TYPE.yaml}`, `execution: {disturbances: ./TYPE.disturbances.yaml}`.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli.printing import plain_table, print_table, say, say_json
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.writing import writing_to

if TYPE_CHECKING:
    from mrp_sumo.calibration.estimates import Calibration

DEFAULT_ROBOT = "amr_600"


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("log", metavar="LOG", type=Path, help="messages of VDA 5050, a bag, a CSV of poses, a run folder, or an archive")
    parser.add_argument("--map", metavar="MAP", help="a map file or the name of a bundled map: a log of another site is refused")
    parser.add_argument(
        "--robot",
        metavar="TYPE",
        default=DEFAULT_ROBOT,
        help="type of robots/ or YAML file for what the log does not tell (default: amr_600)",
    )
    parser.add_argument(
        "--out", metavar="TYPE.yaml", type=Path, help="file of the robot type to write, with a picture and the disturbances"
    )
    parser.add_argument(
        "--against",
        metavar="TYPE.yaml",
        type=Path,
        help="a type that an earlier calibration wrote: exit code 1 where the log no longer fits it",
    )
    parser.add_argument("--json", action="store_true", help="print the figures as a line of JSON")


def run(options: argparse.Namespace) -> int:
    """Calibrate, write, print."""
    from mrp_sumo.calibration.estimates import calibrated
    from mrp_sumo.calibration.files import document_of, drift, of_calibration, require_free, write_files
    from mrp_sumo.calibration.log import require_here
    from mrp_sumo.calibration.reading import read_fleet
    from mrp_sumo.io.scenario.robots import robot_type
    from mrp_sumo.maps.catalogue import bundled_folder, find_map
    from mrp_sumo.maps.load import load_map

    if options.out is not None and options.out.suffix not in (".yaml", ".yml"):
        raise MrpSumoError(f"--out: found '{options.out.name}', expected a name that ends in .yaml")
    if options.out is not None:
        require_free(options.out)
    base = robot_type(options.robot, bundled_folder("robots"), Path())
    log = read_fleet(options.log)
    if options.map is not None:
        require_here(log, load_map(find_map(options.map, Path())))
    result = calibrated(log)
    changed = {} if options.against is None else drift(result, options.against)
    written: list[Path] = []
    if options.out is not None:
        from mrp_sumo.core.robot_type import RobotShape
        from mrp_sumo.reports.pictures.calibration import picture_of

        shape = RobotShape(**{name: value for name, value in vars(base).items() if name != "name"})
        try:
            with writing_to(options.out):
                written += write_files(result, shape, options.out)
                written.append(picture_of(result).write(options.out.with_suffix(".png")))
        except BaseException:
            for each in of_calibration(options.out):  # which were not there: all of them, or none
                each.unlink(missing_ok=True)
            raise
    if options.json:
        say_json(document_of(result) | ({} if options.against is None else {"drift": changed}) | {"files": [str(path) for path in written]})
    else:
        _print(result, options, written)
        for name, both in changed.items():
            say(f"drift: {name}: {both}")
        if options.against is not None and not changed:
            say(f"no drift: every figure fits {options.against}")
    return int(bool(changed))


def _print(result: "Calibration", options: argparse.Namespace, written: list[Path]) -> None:
    from mrp_sumo.calibration.estimates import counted
    from mrp_sumo.calibration.files import disturbances_of

    say(f"{result.log.source}: {result.log.kind}, {counted(len(result.vehicles), 'vehicles')}, {result.span_s / 3600:.2f} h in all")
    for note in result.log.notes:
        say(f"note: {note}")
    table = plain_table("figure", "value", "90 % interval", "unit", "from", right=(1,))
    for each in result.quantities.values():
        table.add_row(each.name, f"{each.value:.4g}", f"{each.low:.4g} to {each.high:.4g}", each.symbol, each.basis)
    print_table(table, 120)
    usual = vars(disturbances_of(result))
    for name, why in result.unknown.items():
        stays = "" if name == "stopping_m" else f"; taken as {usual[name]:g}" if name in usual else f"; as in {options.robot}"
        say(f"{name}: not told by the log ({why}){stays}")
    for path in written:
        say(f"written: {path}")
