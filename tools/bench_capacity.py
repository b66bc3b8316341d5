"""How far the answers of capacity studies can be trusted, and what they cost.

    python tools/bench_capacity.py [coverage] [saving] [kills] [--studies 1000] [--kills 20] [--json]

`coverage`: of how many studies of a queue (M/M/2 at 70 %, ten replications of 12,000 customers, the warm-up left out by MSER-5) the 95 %
limits hold Erlang's truth. `saving`: runs of the search beside a grid of every third size with as many seeds, on made-up fleets whose peak
is known. `kills`: a small study is killed again and again at random moments, and its answer compared, byte for byte, with that of one that
was left alone; also the CPU time of the search beside that of the runs. --json prints an object a line.
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
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path.insert(0, str(TESTS))
STUDY = ("warehouse_lifelong", "--quick", "--robots", "1..4", "--horizon", "3min", "--budget", "8s", "--json")


def coverage(studies: int) -> dict[str, float]:
    """Share of studies whose limits hold the truth."""
    from queues import coverage as share

    began = time.process_time()
    return {"studies": studies, "covered": share(17, studies, 10, 12_000), "cpu_s": time.process_time() - began}


def saving() -> dict[str, float]:
    """Runs of the search, and of a full grid with the seeds of its most sampled size."""
    from fleets import Fleets, question, rises_and_falls

    from mrp_sumo.sizing.search import Desk, coarse, limits

    desk = Desk(question(), Fleets(rises_and_falls))
    began = time.process_time()
    found = limits(coarse(desk))
    least, most = desk.question.sizes
    full = len(range(least, most + 1, 3)) * max(len(point.records) for point in found.curve.points.values())
    return {
        "runs": len(desk.asked),
        "full_grid": full,
        "saving": full / len(desk.asked),
        "peak": found.peak.estimate or 0,
        "cpu_s": time.process_time() - began,
    }


def kills(count: int) -> dict[str, float | bool]:
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


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", help="coverage, saving, kills (default: all)")
    parser.add_argument("--studies", type=int, default=1000)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    measures = {"coverage": lambda: coverage(options.studies), "saving": saving, "kills": lambda: kills(options.kills)}
    for name in options.what or measures:
        row = {"what": name, **measures[name]()}
        shown = {key: f"{value:.4g}" if isinstance(value, float) else value for key, value in row.items() if key != "what"}
        figures = "  ".join(f"{key} {value}" for key, value in shown.items())
        print(json.dumps(row) if options.json else f"{name:<10} {figures}", flush=True)


if __name__ == "__main__":
    main()
