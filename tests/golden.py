"""Where the golden cases are; see data/README.md."""

from pathlib import Path

DATA = Path(__file__).parent / "data"
MAPS = DATA / "maps"
MRP_BENCH = MAPS / "boschresearch+mrp_bench"
INSTANCES = DATA / "instances"
METRICS = DATA / "mrp_bench_metrics"
BAG_CHECKERS = DATA / "bag_checkers"
