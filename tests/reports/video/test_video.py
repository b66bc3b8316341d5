"""Videos: as many frames as the time asks for, the plan ahead as it is in force, names that stay; bad input is one line."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from mrp_sumo.cli.main import main
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.reports.video.film import STATES, Film, Timing, clock
from mrp_sumo.reports.video.scene import PlannedRoute, scene_of


def test_mp4_has_a_frame_for_every_thirtieth_of_a_second_and_a_poster(folder, tmp_path, capsys):
    import av
    from PIL import Image

    video = tmp_path / "out.mp4"
    assert main(["render", str(folder), "--video", str(video), "--to", "2", "--speed", "4", "--size", "480x270"]) == 0
    assert "480 x 270" in capsys.readouterr().out
    with av.open(str(video)) as file:
        stream = file.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(stream)]
        assert (stream.width, stream.height, stream.average_rate) == (480, 270, 30)
    assert len(frames) == 16 + 30  # half a second, and a second on the last frame
    assert (np.abs(frames[0].astype(int) - frames[15]) > 60).any()
    assert not (np.abs(frames[15].astype(int) - frames[-1]) > 60).any()
    with Image.open(video.with_suffix(".png")) as poster:
        assert poster.size == (480, 270)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.mp4", "out.png"]


@pytest.mark.parametrize("name", ["out.gif", "out.webp", "frames/"])
def test_other_kinds_need_no_encoder(folder, tmp_path, monkeypatch, name):
    from PIL import Image

    monkeypatch.setattr("mrp_sumo.reports.video.encode.find_spec", lambda name: None)
    request = ["render", str(folder), str(folder), "--to", "1", "--speed", "10", "--size", "320x240", "--titles", "one", "another"]
    assert main([*request, "--video", str(tmp_path / name) + "/" * name.endswith("/")]) == 0
    if name == "frames/":
        assert len(list((tmp_path / name).glob("0*.png"))) == 34
    else:
        with Image.open(tmp_path / name) as image:
            assert image.size == (320, 240) and image.n_frames > 1


def test_runs_are_beside_each_other_at_one_scale_of_time(folder):
    scenes = [scene_of(load_run(folder)) for _ in range(2)]
    film = Film(scenes, Timing(0.0, 1.0, 1.0, 30), (640, 360))
    left, right = film.panes
    assert left.left + left.width < right.left or left.bottom > right.bottom + right.height
    assert len(film.timing.t_s) == 31 + 30
    assert film.timing.t_s[-1] == 1.0


def test_trailers_have_the_colour_of_their_tugger(trains):
    scene = scene_of(load_run(trains))
    film = Film([scene], Timing(0.0, 20.0, 1.0, 30), (1200, 900))
    differs = scene.record.execution.t_s[np.flatnonzero(scene.state[:, 0] != scene.state[:, 1])[-5:-4]]
    time_s = scene.moments(differs)[0]
    picture = film.draw([time_s])
    column, row = film.panes[0].pixels(time_s.parts_xy).round().astype(int).T
    assert scene.parts.owner.tolist() == [0, 0, 1, 1] and time_s.state[0] != time_s.state[1]
    for k, robot in enumerate(scene.parts.owner.tolist()):
        colour = np.array(to_rgba(STATES[time_s.state[robot]])[:3]) * 255
        assert np.abs(picture[picture.shape[0] - 1 - row[k], column[k], :3] - colour).max() <= 1


@pytest.mark.parametrize("end", [1, -1])
def test_forks_are_drawn_at_the_end_where_a_truck_has_them(trains, end):
    scene = scene_of(load_run(trains))
    time_s = scene.moments(np.array([14.5]))[0]
    films = [Film([one], Timing(0.0, 20.0, 1.0, 30), (1200, 900)) for one in (scene, replace(scene, forks=np.array([end, 0])))]
    plain, forked = (film.draw([time_s]) for film in films)
    row, column = np.nonzero((plain != forked).any(axis=2))
    assert len(row)
    off = np.stack([column, plain.shape[0] - 1 - row], 1) - films[0].panes[0].pixels(time_s.xy[0])
    along = off @ (np.cos(time_s.yaw_rad[0]), np.sin(time_s.yaw_rad[0])) * end / films[0].panes[0].scale
    length_m = scene.record.fleet.length_m[0]
    assert 0.1 * length_m < along.min() and along.max() < 0.6 * length_m


def test_plan_ahead_is_what_is_in_force():
    first = PlannedRoute(0.0, np.arange(3), np.array([0.0, 1, 2]), np.array([0.0, 1.5, np.inf]))
    assert first.ahead(0.5) == range(1, 3)
    assert first.ahead(1.6) == range(2, 3)
    far = PlannedRoute(0.0, np.arange(30), np.arange(30.0), np.arange(30.0))
    assert len(far.ahead(2.5)) == 11
    assert len(far.ahead(40)) == 0


def test_plan_ahead_follows_curves_from_where_the_robot_is(trains):
    """A quarter of a circle about (0, 2) from (0, 0) to (2, 2), then straight on; seen after 30 degrees of it, and on the lane after it."""
    scene = scene_of(load_run(trains))
    angle = np.radians(np.arange(0, 91, 15))
    arc = np.column_stack([2 * angle, 2 * np.sin(angle), 2 - 2 * np.cos(angle), angle])
    graph = SimpleNamespace(xy=np.array([(0.0, 0.0), (2.0, 2.0), (2.0, 4.0)]), curves={(0, 1): arc})
    route = PlannedRoute(0.0, np.arange(3), np.array([0.0, 4, 8]), np.array([0.0, 4, np.inf]))
    scene = replace(scene, record=SimpleNamespace(graph=graph), ways=((route,),))
    now = SimpleNamespace(t_s=1.0, xy=arc[2:3, 1:3])
    assert np.allclose(scene.ahead(0, now), [*arc[2:, 1:3], (2, 4)])
    assert np.allclose(scene.ahead(0, SimpleNamespace(t_s=5.0, xy=np.array([(2.0, 3.0)]))), [(2, 4)])


def test_clock_counts_hours_only_where_there_are_any():
    assert [clock(t) for t in (0, 59.96, 3599.9, 3600)] == ["0:00.0", "1:00.0", "59:59.9", "1:00:00.0"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--video", "out.avi"], "ends in .mp4, .gif or .webp"),
        (["--video", "none/out.gif"], "cannot be written"),
        (["--video", "out.gif", "--from", "1e6"], "--from 1e+06: is outside the run"),
        (["--video", "out.gif", "--from", "9", "--to", "3"], "--to 3: expected a time after 9 s"),
        (["--video", "out.gif", "--speed", "0"], "--speed 0: expected 0.01 to 10000"),
        (["--video", "out.gif", "--size", "101x90"], "--size 101x90: expected even numbers"),
        (["--video", "out.gif", "--robots", "robot_7"], "--robots robot_7: "),
        (["--video", "out.gif", "--level", "L9"], "--level L9: "),
        (["--video", "out.gif", "--titles", "a", "b"], "--titles: found 2, expected one for each of 1 runs"),
        (["--video", "out.gif", "--at", "3"], "--at and --out are for a picture"),
        ([], "expected --at T and --out FILE for a picture, or --video FILE"),
    ],
)
def test_video_that_cannot_be_made_is_one_line(folder, tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    assert main(["render", str(folder), *options]) == 2
    said = capsys.readouterr().err
    assert message in said and len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_mp4_without_an_encoder_names_the_extra(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("mrp_sumo.reports.video.encode.find_spec", lambda name: None)
    assert main(["render", str(folder), "--video", str(tmp_path / "out.mp4")]) == 2
    assert "pip install 'mrp-sumo[video]'" in capsys.readouterr().err
