"""A report begins with who is ahead, by how much and how surely, and does not decide what the runs do not."""

import pandas as pd
import pytest

from mrp_sumo.reports.answer import answer
from mrp_sumo.reports.study import read_study


def study_of(tmp_path, second, num_seeds=20, fails=0):
    """Two planners on the same seeds: the second's flowtime in terms of the first's, and how often the first fails."""
    rows = []
    for seed in range(num_seeds):
        for planner, flowtime in (("cbs", 100.0 + seed), ("lacam", (100.0 + seed) * second(seed))):
            good = planner == "lacam" or seed >= fails
            rows.append(
                {
                    "key": f"{planner}{seed}",
                    "status": "completed" if good else "time_limit",
                    "success": good,
                    "plan_success": True,
                    "plan_valid": True,
                    "planner": planner,
                    "map": "office",
                    "seed": seed,
                    "robots.count": 9,
                    "sim_time_s": 60.0,
                    "driven_flowtime_s": flowtime,
                }
            )
    pd.DataFrame(rows).to_parquet(tmp_path / "results.parquet")
    return read_study(tmp_path / "results.parquet")


@pytest.mark.parametrize(
    ("second", "num_seeds", "fails", "said"),
    [
        (
            lambda seed: 1.05,
            20,
            0,
            ("CBS and LaCAM succeed equally often, in 100 % of 20 instances (office)", "that of LaCAM, the nearest, is 5.0 %"),
        ),
        (
            lambda seed: 1.05,
            20,
            10,
            ("LaCAM succeeds most often, in 100 % of 20 instances (office): 50 points", "CBS has the lower flowtime as driven, by 4.8 %"),
        ),
        (lambda seed: 1.05, 4, 0, ("it is undecided who has the lower flowtime as driven",)),
        (lambda seed: 1.05 if seed % 2 else 0.95, 20, 0, ("it is undecided",)),
        (lambda seed: 1.0, 20, 1, ("which decides nothing yet", "it is undecided")),
    ],
)
def test_answer_says_who_is_ahead_and_how_surely(tmp_path, second, num_seeds, fails, said):
    result = answer(study_of(tmp_path, second, num_seeds, fails))
    assert all(part in result for part in said), result
    assert result.count(". ") == 1
