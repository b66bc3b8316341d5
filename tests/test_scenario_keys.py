"""Every key of scenario files gets a run to the written folder: a small share here, all with `python tools/campaign.py keys`."""

import json
import random

import pytest
from campaigns import keys as campaign

from mrp_sumo.io.scenario.model import ScenarioModel

EVERYTHING = campaign.Keys(seed=0)
LATELY_MENDED = [  # each ended in a traceback once
    {"execution.disturbances.breakdowns.robot": 1, "execution.disturbances.breakdowns.begin_s": 1.0},
    {"execution.disturbances.obstacles.x_m": 1.0, "execution.disturbances.obstacles.y_m": 1.0},
    {"execution.disturbances.closures.between": ["crossing_1_1", "crossing_4_1"], "execution.disturbances.closures.begin_s": 1.0},
    {"execution.disturbances.obstacles.duration_s": 3.0, "execution.disturbances.closures.duration_s": 3.0},
]


def test_every_key_has_sample_values():
    keys = campaign.keys()
    assert all(keys.values())
    sections = {key.split(".")[0] for key in keys}
    assert sections == set(ScenarioModel.model_fields)


def test_new_key_without_sample_values_is_noticed(monkeypatch):
    monkeypatch.delitem(campaign.NAMED, "map.level")
    with pytest.raises(LookupError, match=r"map.level: give it sample values in .*NAMED"):
        campaign.keys()


@pytest.mark.parametrize("case", LATELY_MENDED, ids=json.dumps)
def test_what_lasts_for_good_and_equal_disturbances_are_driven_to_the_written_folder(tmp_path, case):
    trial = campaign.try_case(case, tmp_path, "mended")
    assert not trial.faults
    assert trial.ended in ("completed", "time_limit")


@pytest.mark.parametrize("number", random.Random(12).sample(range(EVERYTHING.size), 12))
def test_key_gets_a_run_to_the_written_folder(tmp_path, number):
    assert not EVERYTHING.trial(number, tmp_path).faults
