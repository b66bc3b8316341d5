"""Make other logs of a finished run: a ROS 2 or ROS 1 bag, CSV, GeoJSON, SUMO's FCD, messages of VDA 5050, a fleet log archive, or set-ups
for viewers.

The run's trajectory is the source of all of them. Files go into the run folder unless --out says otherwise;
what exists is not replaced.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.option_rules import only_for, require_within
from mrp_sumo.cli.printing import say_either
from mrp_sumo.cli.result_folder import result_folder, run_folder

FORMATS = {  # option -> (name of the file or folder, help)
    "bag": ("bag", "ROS 2 bag (folder)"),
    "ros1": ("run.bag", "ROS 1 bag"),
    "csv": ("trajectory.csv", "one line per robot and sample"),
    "geojson": ("run.geojson", "map, paths and events, in metres"),
    "fcd": ("fcd.xml", "floating car data, as SUMO writes them"),
    "rmf-plans": ("rmf_plans.json", "plan and releases as messages of Open-RMF's next generation, as JSON (experimental)"),
    "viewers": ("viewers", "set-ups for RViz 2, Foxglove, PlotJuggler and Rerun (folder)"),
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo export`."""
    parser.add_argument("run", metavar="RUN", type=result_folder, help="run folder; of --archive any log that `calibrate` reads")
    wanted = parser.add_mutually_exclusive_group(required=True)
    for name, (_, about) in FORMATS.items():
        wanted.add_argument(f"--{name}", dest="format", action="store_const", const=name, help=about)
    wanted.add_argument(
        "--vda5050",
        metavar="VERSION",
        nargs="?",
        const="3.0",
        help="messages of VDA 5050, 2.1 or 3.0 (the default), by vehicle and all in time order (folder)",
    )
    wanted.add_argument(
        "--archive", metavar="PATH", type=Path, help="a fleet log archive, a folder or a .zip, for `calibrate`, `predict` and others"
    )
    parser.add_argument("--out", metavar="PATH", type=Path, help="file or folder to make")
    parser.add_argument(
        "--anonymise",
        action="store_true",
        help="of --archive: other names of vehicles, orders and stations, and times from 0; says what remains",
    )
    parser.add_argument("--move", action="store_true", help="of --anonymise: move the origin, too; the map then stays behind")
    parser.add_argument("--licence", metavar="TEXT", help="of --archive: under which it may be used, such as CC-BY-4.0")
    parser.add_argument("--storage", metavar="NAME", help="of a ROS 2 bag: mcap (default) or sqlite3")
    parser.add_argument("--rmf", metavar="NAME", help="generation of rmf_fleet_msgs: galactic, jazzy (default) or kilted")
    parser.add_argument("--robots", metavar="A,B", help="robots that get topics of their own in a bag: odom and plan")
    parser.add_argument("--poses", action="store_true", help="put /robot_poses into a bag: what /tf says, as a PoseArray")
    parser.add_argument("--split", type=float, metavar="S", help="a file of a ROS 2 bag for each S seconds (default: one)")
    parser.add_argument(
        "--repeat-latched", type=float, metavar="S", help="say map and markers again every S seconds (for play --start-offset)"
    )
    parser.add_argument("--json", action="store_true", help="print the path as a line of JSON")


def run(options: argparse.Namespace) -> int:
    """Write the file and print its path."""
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.io.run_reader import load_run
    from mrp_sumo.reports import exports

    if options.archive is not None:
        from mrp_sumo.cli.archive import export_archive

        return export_archive(options)
    only_for("archives: --archive", anonymise=options.anonymise, licence=options.licence)
    only_for("--anonymise", move=options.move)
    run_folder(options.run)
    bag_alone = {name: getattr(options, name) for name in ("robots", "poses", "rmf", "repeat_latched")}
    if options.format not in ("bag", "ros1"):
        only_for("bags: --bag, --ros1", **bag_alone)
    if options.format != "bag":
        only_for("ROS 2 bags: --bag", storage=options.storage, split=options.split)
    for name, seconds in (("--repeat-latched", options.repeat_latched), ("--split", options.split)):
        require_within(name, seconds, 0, expected="seconds of 0 or more")
    loaded = load_run(options.run)
    out = options.out or Path(options.run) / ("vda5050" if options.vda5050 else FORMATS[options.format][0])
    if out.exists():
        raise MrpSumoError(f"{out}: exists already; choose another place with --out")
    record = loaded.record
    if not len(record.execution.t_s):
        raise MrpSumoError(f"{options.run}: the trajectory is empty")
    if options.vda5050:
        from mrp_sumo.reports.vda_log import write_vda

        write_vda(out, record, options.vda5050)
    elif options.format in ("bag", "ros1"):
        from mrp_sumo.bags.writer import BagOptions, write_bag

        robots = tuple(name.strip() for name in (options.robots or "").split(",") if name.strip())
        choice = BagOptions(
            storage=options.storage or "mcap",
            rmf=options.rmf or "jazzy",
            robots=robots,
            poses=options.poses,
            repeat_latched_s=options.repeat_latched or 0.0,
            split_s=options.split or 0.0,
        )
        if options.format == "ros1":
            exports.write_ros1(out, record, lambda folder: write_bag(folder, record, choice))
        else:
            exports.write_ros2(out, lambda folder: write_bag(folder, record, choice))
    elif options.format == "rmf-plans":
        from mrp_sumo.reports.rmf_plans import write_rmf_plans

        write_rmf_plans(out, record)
    else:
        write = {"csv": exports.write_csv, "geojson": exports.write_geojson, "fcd": exports.write_fcd, "viewers": exports.write_viewers}
        write[options.format](out, record)
    say_either(options.json, {"file": str(out)}, out)
    return 0
