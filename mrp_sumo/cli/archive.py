"""Fleet log archives on the command line: `import --log`, `export --archive` and `validate ARCHIVE`."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import say_either
from mrp_sumo.errors import MrpSumoError, count

if TYPE_CHECKING:
    from mrp_sumo.calibration.archive import ArchiveHead
    from mrp_sumo.calibration.log import MotionLog

LIMITS = ("length_m", "width_m", "max_speed_mps", "accel_mps2", "decel_mps2", "turn_rate_rad_s")
UNSTATED = "not stated: ask whoever recorded it"
UNIX_S = 1e8  # later times are dates


def import_logs(options: argparse.Namespace) -> int:
    """Make an archive of logs."""
    from mrp_sumo.calibration.archive import LISTED, MANIFEST, ArchiveHead, faults_of, merged, safe_name, write_archive
    from mrp_sumo.calibration.log import require_here
    from mrp_sumo.calibration.reading import read_fleet
    from mrp_sumo.maps.catalogue import find_map
    from mrp_sumo.maps.load import load_map

    if options.file is not None:
        raise MrpSumoError(f"--log: is there beside FILE '{options.file}', expected one of them; a map goes with --map")
    if options.check:
        raise MrpSumoError("--check is for maps; an archive is judged by `mrp-sumo validate ARCHIVE`")
    if options.out is None:
        raise MrpSumoError("say where to write with --out DIR")
    log = merged([read_fleet(path) for path in options.log])
    about = ArchiveHead(safe_name(options.log[0].stem), options.licence or UNSTATED, is_laid_out=log.is_laid_out, time_base=_base(log))
    drawn = None
    if options.map is not None:
        drawn = find_map(options.map, Path())
        map_ = load_map(drawn)
        require_here(log, map_)
        about = replace(about, levels=map_.nav.level_names, **_named(options.map, drawn))
        drawn = drawn if about.map_file else None
    made = write_archive(log, about, options.out, drawn)
    faults = [fault for fault in faults_of(made) if not fault.startswith(MANIFEST)]  # of the logs, not of what is not stated
    return _written(made, log, options, tuple(faults[:LISTED]))


def _base(log: "MotionLog") -> str:
    first_s = min((row[0] for rows in log.poses.values() for row in rows[:1]), default=0.0)
    return "seconds since 1970" if first_s > UNIX_S else "of the log"


def _named(name: str, path: Path) -> dict[str, Any]:
    """The map as a manifest names it: by its name where it comes with the program, else as a file of the archive."""
    from mrp_sumo.maps.catalogue import bundled_maps

    return {"map_name": name} if bundled_maps().get(name) == path else {"map_file": path.name}


def export_archive(options: argparse.Namespace) -> int:
    """Make an archive of a run or another log."""
    from mrp_sumo.calibration.archive import REMAINS, anonymised, write_archive
    from mrp_sumo.calibration.reading import read_fleet

    if not options.anonymise:
        only_for("--anonymise", move=options.move)
    if options.out is not None:
        raise MrpSumoError("--out: --archive says where the archive goes")
    path = Path(options.run)
    log = read_fleet(path)
    about, drawn = _about(path, log, options)
    notes: tuple[str, ...] = ()
    if options.anonymise:
        log, about, drawn = *anonymised(log, about, moved=options.move), None
        notes = ("names of vehicles, orders, stations, levels and types are others, times begin at 0, the map stays behind", REMAINS)
    return _written(write_archive(log, about, options.archive, drawn), log, options, notes)


def _about(path: Path, log: "MotionLog", options: argparse.Namespace) -> tuple["ArchiveHead", Path | None]:
    """What is known of a log beside its tables, and its map where it is a file."""
    from mrp_sumo.calibration.archive import ArchiveHead, is_archive, manifest_in, safe_name
    from mrp_sumo.files.folders import RESULT
    from mrp_sumo.maps.catalogue import bundled_maps

    about = ArchiveHead(safe_name(path.stem), options.licence or UNSTATED, is_laid_out=log.is_laid_out, time_base=_base(log))
    if is_archive(path):
        of: dict[str, Any] = manifest_in(path)
        levels = tuple(map(str, of["map"].get("levels") or ()))
        types = {name: figures for name, figures in of["robot_types"].items() if isinstance(figures, dict)}
        stated = {"licence": options.licence or of["licence"], "map_name": str(of["map"].get("bundled") or "")}
        return replace(about, **stated, levels=levels, types=types, truth=of.get("truth") or {}), None
    if not (path / RESULT).is_file():
        return about, None
    from mrp_sumo.io.run_reader import load_run

    run = load_run(path)
    types = {}
    for model in run.fleet.types:
        types[model.name] = {name: value for name in LIMITS if (value := getattr(model, name)) is not None}
    named = str(run.result["scenario"].get("map", {}).get("file", ""))
    about = replace(about, levels=run.graph.level_names, types=types)
    if named in bundled_maps():
        return replace(about, map_name=named), None
    drawn = Path(named)
    return (replace(about, map_file=drawn.name), drawn) if drawn.is_file() else (about, None)


def _written(path: Path, log: "MotionLog", options: argparse.Namespace, notes: tuple[str, ...]) -> int:
    size = sum(each.stat().st_size for each in (path.iterdir() if path.is_dir() else [path]))
    num_poses = sum(map(len, log.poses.values()))
    counts = {"vehicles": len(log.poses), "poses": num_poses, "orders": len(log.orders), "bytes": size}
    said = f"{path}: {count(len(log.poses), 'vehicle')}, {num_poses} poses, {count(len(log.orders), 'order')}, {size / 1e3:.0f} kB"
    all_notes = [*log.notes, *notes]
    say_either(options.json, {"file": str(path), **counts, "notes": all_notes}, *(f"note: {note}" for note in all_notes), said)
    return 0


def validate_archive(options: argparse.Namespace) -> int:
    """Judge an archive, print."""
    from mrp_sumo.calibration.archive import faults_of
    from mrp_sumo.files.reading import shortened

    if options.map is not None or options.scenario is not None or options.problem is not None:
        raise MrpSumoError("an archive stands by itself: no --map, --scenario or --problem")
    only_for("plans", scen=options.scen, robots=options.robots, seed=options.seed, following=options.following)
    faults = faults_of(options.plan)
    shown = faults[: options.limit]
    said = f"{shortened(options.plan)}: " + (count(len(faults), "fault") if faults else "a valid fleet log archive")
    document = {"valid": not faults, "faults": len(faults), "first": shown}
    say_either(options.json, document, *(f"{options.plan.name}: {fault}" for fault in shown), said)
    return int(bool(faults))
