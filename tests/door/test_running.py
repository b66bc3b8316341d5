"""Runs from the front door: driven, looked at, kept."""

import json

import pandas as pd
import pytest

import mrp_sumo as ms


@pytest.fixture(scope="module")
def problem():
    return ms.problem(ms.Scenario(map="office", robots=3, planner="cbs", seed=1, record={"bag": False}))


@pytest.fixture(scope="module")
def plan(problem):
    return ms.plan(problem, "cbs")


@pytest.fixture(scope="module")
def run(problem, plan):
    return ms.simulate(problem, plan, policy="adg")


def refusal(call):
    with pytest.raises(ms.MrpSumoError) as caught:
        call()
    return str(caught.value)


def test_run_has_metrics_and_says_how_it_ended(run):
    assert run.status == "completed" and run.executed and run.folder is None
    assert run.metrics["goals_reached"] == 3 and run.metrics["execution_time_s"] > 0
    assert repr(run) == f"<Run office_3: completed, 3 robots, cbs, adg, {run.metrics['execution_time_s']:.1f} s>"
    assert "3 of 3, policy adg" in str(run) and "<table>" in run._repr_html_()


def test_run_in_memory_is_the_run_in_its_folder(run, tmp_path):
    folder = run.save(tmp_path / "run")
    again = ms.load_run(folder)
    for name in ("trajectory", "visits", "events"):
        pd.testing.assert_frame_equal(getattr(run, name), getattr(again, name))
    assert run.metrics == again.metrics and run.audit == again.audit
    assert {k: v for k, v in again.result.items() if k != "files"} == json.loads(json.dumps(run.result))
    assert again.folder == folder and repr(again) == repr(run)
    assert run.replay().page == again.replay().page
    assert (run.samples.x_m == again.samples.x_m).all() and run.samples.robot_name == again.samples.robot_name
    assert run.plot(5.0)._repr_png_() == again.plot(5.0)._repr_png_()
    assert refusal(lambda: again.save(tmp_path / "other")) == f"{folder}: is a run folder already; copy it"


def test_plan_is_driven_by_the_problem_it_is_given_for(problem, plan, run):
    slow = ms.Scenario(
        map="office",
        robots={"count": 3, "factor": {"max_speed_mps": 0.5}},
        planner="cbs",
        seed=1,
        record={"bag": False},
        execution={"engine": "kinematic", "time_limit_s": 900},
    )
    driven = ms.simulate(ms.problem(slow), plan)
    assert driven.trajectory.speed_mps.max() == pytest.approx(0.5 * run.trajectory.speed_mps.max())
    assert driven.result["scenario"]["execution"]["engine"] == "kinematic"
    assert driven.result["scenario"]["planner"]["name"] == "cbs"


def test_one_call_runs_as_the_steps_do(problem, plan, run):
    whole = ms.run(problem.scenario)
    pd.testing.assert_frame_equal(whole.trajectory, run.trajectory)
    assert whole.result["scenario"] == run.result["scenario"]


def test_command_line_writes_the_same_run(run, tmp_path):
    from mrp_sumo.cli.main import main

    (tmp_path / "office_3.yaml").write_text("map: office\nrobots: 3\nplanner: cbs\nseed: 1\nrecord: {bag: false}\n")
    assert main(["run", str(tmp_path / "office_3.yaml"), "--out", str(tmp_path / "cli")]) == 0
    run.save(tmp_path / "door")
    for name in ("plan.json", "trajectory.parquet", "visits.parquet", "events.jsonl", "floor.json"):
        assert (tmp_path / "door" / name).read_bytes() == (tmp_path / "cli" / name).read_bytes(), name


def test_keys_of_execution_are_arguments(problem, plan):
    run = ms.simulate(problem, plan, "timed", time_limit_s=3, disturbances={"start_delay_s": 1.0})
    chosen = run.result["scenario"]["execution"]
    assert (run.status, chosen["policy"], chosen["time_limit_s"], chosen["disturbances"]["start_delay_s"]) == ("time_limit", "timed", 3, 1)
    assert chosen["invalid_plan"] == problem.setup.scenario.execution.invalid_plan


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"policy": "adgg"}, "simulate: policy: unknown execution policy 'adgg' (did you mean 'adg'?)"),
        ({"time_limt_s": 3}, "simulate: time_limt_s: unknown key (did you mean 'time_limit_s'?)"),
        ({"step_length_s": 0.2}, "simulate: step_length_s decides what there is to plan; give it to the scenario"),
    ],
)
def test_unknown_keys_are_refused_with_the_nearest(problem, plan, more, line):
    assert refusal(lambda: ms.simulate(problem, plan, **more)) == line


def test_invalid_plan_of_ones_own_is_not_driven(problem):
    stay = ms.plan_of_paths([[v] for v in problem.start], problem.step_s)
    fixed = ms.problem(problem.scenario.replace(assignment={"mode": "fixed"}))
    run = ms.simulate(fixed, stay)
    assert run.status == "refused" and not run.executed and run.result["scenario"]["planner"]["name"] == "given"
    assert "ends at" in run.note and "refused" in repr(run)
    assert refusal(lambda: run.trajectory) == "office_3: the run was not executed (refused), so it has no trajectory"
    assert run.events.empty


def test_run_without_a_plan_is_a_result():
    lane = ms.Scenario(map="office", robots=3, planner={"name": "cbs", "time_limit_s": 1e-9}, seed=1)
    run = ms.run(lane)
    assert run.status == "planning_timed_out" and run.plan is None
    assert "nothing to replay" in refusal(run.replay) and "nothing to replay" in refusal(run.plot)


def test_replay_is_shown_and_written(run, tmp_path):
    replay = run.replay()
    assert repr(replay).startswith("<Replay office_3: ")
    assert replay._repr_html_().startswith('<iframe srcdoc="&lt;!doctype html&gt;')
    assert replay.write(tmp_path / "page.html").read_text(encoding="utf-8") == replay.page
    assert "is a folder" in refusal(lambda: replay.write(tmp_path))


def test_plot_is_halfway_by_default_and_within_the_run(run):
    assert run.plot()._repr_png_() == run.plot(round(float(run.samples.t_s[-1]) / 2, 1))._repr_png_()
    assert "is outside the run" in refusal(lambda: run.plot(-1))


def test_progress_is_told_and_quiet_by_default(problem, plan, capsys):
    stages = []
    ms.simulate(problem, plan, progress=lambda stage, done, of: stages.append(stage))
    assert {"building the SUMO network", "measuring"} <= set(stages) and any(stage.startswith("driving") for stage in stages)
    assert capsys.readouterr() == ("", "")
