"""Trust in the answers of capacity studies, and their cost.

    python tools/bench_capacity.py [coverage] [driven] [agreement] [saving] [kills] [--studies 200] [--pairs 7] [--kills 20] [--seeds 80]
                                   [--pool DIR] [--json]

`coverage`: of how many studies, with the search in them, limits hold the truth, on six closed networks whose throughput is known exactly
(`tests/closed_networks.py`): of every size, of the size with the most, of peak, knee and collapse; and how many invent a collapse where
there is none; nothing in the search was tuned on them. `driven`: the same on three small floors that are driven for real
(`tests/driven_floors.py`), --seeds runs of every size, whose mean is the truth and from which studies draw theirs; --pool keeps them.
`agreement`: of how many pairs a study with --quick and a long one agree within their limits. `saving`: runs of the search beside a grid
of every third size with as many seeds, on made-up fleets whose peak is known. `kills`: a small study is killed again and again at random
moments, and its answer compared, byte for byte, with that of one that was left alone; also the CPU time of the search beside that of the
runs. --json prints an object a line.
"""

import argparse
import json
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import bench

Row = bench.Row
STUDY = ("warehouse_lifelong", "--quick", "--robots", "1..4", "--horizon", "3min", "--budget", "8s", "--json")


def coverage(studies: int) -> Iterator[Row]:
    """Of studies of closed networks, in per cent, a row a network: how many limits hold the truth, and how many collapses are invented."""
    from closed_networks import NETWORKS, Studied

    from mrp_sumo.sizing.question import FULL

    for network in NETWORKS:
        yield {"system": network.name, **_counted((Studied(network, study, FULL) for study in range(studies)), network.per_h)}


def driven(studies: int, seeds: int, folder: Path) -> Iterator[Row]:
    """The same of studies of floors that are driven, and of how many limits hold what is known by hand."""
    from driven_floors import FLOORS, Drawn, pool

    for floor in FLOORS:
        of = pool(floor, folder / floor.name.replace(" ", "_"), seeds, workers=2)
        known = {f"true_per_h_{n}": round(per_h, 1) for n, per_h in of.per_h.items()}
        yield {"system": floor.name, **_counted((Drawn(of, study) for study in range(studies)), of.per_h, floor.known_per_h), **known}


def _counted(studies: Iterable[Any], per_h: Mapping[int, float], known_per_h: Mapping[int, float] | None = None) -> Row:
    """Shares of limits that hold the truth, of studies of one system."""
    from closed_networks import by_hand, held

    from mrp_sumo.sizing.search import Desk, coarse, limits

    began, shares, runs, count = time.process_time(), defaultdict[str, list[bool]](list), 0, 0
    for studied in studies:
        desk = Desk(studied.question, studied)
        answer = limits(coarse(desk))
        count, runs = count + 1, runs + len(desk.trials)
        for name, holds in {**held(answer, per_h), "by_hand": by_hand(answer, known_per_h or {})}.items():
            shares[name] += holds
    result = {name: 100 * sum(of) / len(of) for name, of in sorted(shares.items()) if of}
    return {"studies": count, **result, "runs": runs / count, "cpu_s": time.process_time() - began}


def agreement(pairs: int) -> Iterator[Row]:
    """Of pairs of a quick study and a long one, a row a network: how many agree within their limits in all of throughput, peak and knee."""
    from closed_networks import NETWORKS, Studied, agree

    from mrp_sumo.sizing.question import FULL, QUICK
    from mrp_sumo.sizing.search import Desk, coarse, limits

    for network in NETWORKS:
        agreed = 0
        for study in range(pairs):
            both = [Studied(network, 2 * study + k, effort) for k, effort in enumerate((QUICK, FULL))]
            agreed += agree(*(limits(coarse(Desk(studied.question, studied))) for studied in both))
        yield {"system": network.name, "pairs": pairs, "agree": agreed}


def saving() -> Row:
    """Runs of the search, and of a full grid with the seeds of its most sampled size."""
    from fleets import Fleets, question, rises_and_falls

    from mrp_sumo.sizing.search import Desk, coarse, limits

    desk = Desk(question(), Fleets(rises_and_falls))
    began = time.process_time()
    result = limits(coarse(desk))
    least, most = desk.question.sizes
    full = len(range(least, most + 1, 3)) * max(len(point.records) for point in result.curve.points.values())
    return {
        "runs": len(desk.trials),
        "full_grid": full,
        "saving": full / len(desk.trials),
        "peak": result.peak.estimate or 0,
        "cpu_s": time.process_time() - began,
    }


def kills(count: int) -> Row:
    """The same study left alone, and killed so many times."""
    chance = random.Random(0)
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        alone = subprocess.run(_command(Path(folder, "alone")), capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        runs = 0.0
        for path in Path(folder, "alone", "runs").rglob("*.json"):
            runs += json.loads(path.read_text())["record"]["run_cpu_s"] or 0.0
        killed = 0
        while killed < count:
            study = subprocess.Popen(_command(Path(folder, "killed")), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
            try:
                study.wait(chance.uniform(2.0, 12.0))
                if killed >= count // 2:  # it has ended: the rest would kill nothing
                    break
                Path(folder, "killed", "answer.json").unlink()
                for path in sorted(Path(folder, "killed", "runs").rglob("*.json"))[:: chance.randint(2, 5)]:
                    path.unlink()
            except subprocess.TimeoutExpired:
                study.send_signal(signal.SIGKILL)
                study.wait()
                killed += 1
        again = subprocess.run(_command(Path(folder, "killed")), capture_output=True, check=True)
        pages = {Path(folder, name, "capacity.html").read_bytes() for name in ("alone", "killed")}
        return {"kills": killed, "same": alone.stdout == again.stdout and len(pages) == 1, "runs_cpu_s": runs, "study_cpu_s": spent}


def _command(out: Path) -> list[str]:
    return [sys.executable, "-m", "mrp_sumo", "capacity", *STUDY, "--out", str(out)]


MEASURES = {
    "coverage": lambda options: coverage(options.studies),
    "driven": lambda options: driven(options.studies, options.seeds, options.pool),
    "agreement": lambda options: agreement(options.pairs),
    "saving": lambda options: iter([saving()]),
    "kills": lambda options: iter([kills(options.kills)]),
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Measures, and how many studies they take."""
    parser.add_argument("what", nargs="*", help=f"{', '.join(MEASURES)} (default: all)")
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--pairs", type=int, default=7)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=80)
    parser.add_argument("--pool", type=Path, default=Path("runs/driven_floors"))


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """Those of each measure."""
    for name in options.what or MEASURES:
        for row in MEASURES[name](options):
            yield {"what": name, **row}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
