"""SUMO as the loop sees it: robots by number, lanes by their names. The only importer of libsumo and traci.

A vehicle's front is the robot's centre, and length = minGap = its radius and half the gap, so that followers and
oncoming robots stop a separation apart. Refuses a second simulation in one process: libsumo would silently
replace the first. Everything SUMO complains of comes out as an ExecutionError.
"""

import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from io import StringIO
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray
from mrp_sumo.engines.sumo.network import backdrop_of
from mrp_sumo.errors import ExecutionError

OPTIONS = (
    *("--time-to-teleport", "-1", "--insertion-checks", "none"),
    *("--collision.action", "warn", "--collision.stoptime", "100000", "--collision.mingap-factor", "0.5"),
    *("--step-method.ballistic", "false"),  # SUMO would choose it where vehicles do not plan in every step
    *("--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true", "--xml-validation", "never"),
)
VIEW = (  # of sumo-gui; the delay is milliseconds a simulated second: ten times real time
    *("--start", "true", "--quit-on-end", "true", "--delay", "100", "--window-size", "1400,900"),
    *("--gui-settings-file", str(Path(__file__).parents[2] / "data" / "sumo_view.xml")),
)

WITHOUT_SAFE_SPEED = 0b11110  # all of SUMO's checks of commanded speeds but that for others, stops and limits ahead

DISC_CORNERS, PERSON_COLOUR, PERSON_LAYER = 12, (157, 63, 143, 255), 100  # above lanes

_running = False


class Sumo:
    """A running simulation. Made by `running_sumo`."""

    def __init__(self, api: Any, num_robots: int, plan_every_s: float | None) -> None:
        self._api = api
        self._vehicle = api.vehicle
        self._name = [f"robot_{r}" for r in range(num_robots)]
        self._base = np.zeros(num_robots)
        self._num_people = 0  # that are drawn
        self._turned: list[tuple[int, float]] = []  # robots that turned back since the last step, and what their odometers show
        self._plan_every_s = plan_every_s  # None: every step
        self._kind = [""] * num_robots
        self.out: dict[int, tuple[str, float, tuple[float, float]]] = {}  # robots that are out: edge, place on it, position
        self._num_back = 0  # how often robots were put back
        self.set_speed = api.vehicle.setSpeed  # by name: called more often than anything else

    @property
    def names(self) -> list[str]:
        """[R] vehicles, in the order of robots."""
        return self._name

    def lane_length_m(self, edge: str) -> float:
        """As SUMO keeps it. Raises ExecutionError when the network has no such edge."""
        try:
            return float(self._api.lane.getLength(edge + "_0"))
        except self._api.TraCIException as error:
            raise ExecutionError(f"the network has no edge '{edge}': it was not made of this graph") from error

    def raise_limit(self, edge: str, speed_mps: float) -> None:
        """Let robots drive faster on a lane that has no limit of its own."""
        self._api.edge.setMaxSpeed(edge, speed_mps)

    def insert(self, robot: int, kind: int, edges: list[str], at_end: bool, stops: bool) -> None:
        """Put a robot on the first edge, at its end or its beginning. `stops`: the route ends where the robot stays."""
        name, self._kind[robot] = self._name[robot], f"type_{kind}"
        self._api.route.add(name, edges)
        position = str(self._api.lane.getLength(edges[0] + "_0")) if at_end else "0"
        self._vehicle.add(name, name, self._kind[robot], departPos=position, departSpeed="0")
        if stops:
            self._stop_at_end(name, edges[-1])

    def change(self, robot: int, kind: int) -> None:
        """A robot that stands is of another type from now on."""
        self._kind[robot] = f"type_{kind}"
        if robot not in self.out:
            self._vehicle.setType(self._name[robot], self._kind[robot])

    def begin(self) -> None:
        """The step in which all robots appear. That they keep apart is left to who commands them."""
        self._api.simulationStep()
        count = self._vehicle.getIDCount()
        if count != len(self._name):
            raise ExecutionError(f"SUMO inserted {count} of {len(self._name)} robots")
        for name in self._name:
            self._take_command(name)
        self._base = np.fromiter(map(self._vehicle.getDistance, self._name), np.float64, len(self._name))

    def step(self) -> None:
        self._api.simulationStep()
        for robot, driven_m in self._turned:  # one that faces the way back already has set out in this step
            set_out_m = self._vehicle.getSpeed(self._name[robot]) * self._api.simulation.getDeltaT()
            self._base[robot] = self._vehicle.getDistance(self._name[robot]) - driven_m - set_out_m
        self._turned.clear()

    def read_driven(self, driven_m: FloatArray, moving: BoolArray) -> None:
        """Bring odometers [R] up to date, since `begin`; those not `moving` are left as they are."""
        if moving.all():
            driven_m[:] = np.fromiter(map(self._vehicle.getDistance, self._name), np.float64, len(self._name))
            driven_m -= self._base
        elif moving.any():
            names = compress(self._name, moving.tolist())
            driven_m[moving] = np.fromiter(map(self._vehicle.getDistance, names), np.float64) - self._base[moving]

    def edge(self, robot: int) -> str:
        return self.out[robot][0] if robot in self.out else str(self._vehicle.getRoadID(self._name[robot]))

    def take_out(self, robot: int) -> None:
        """A robot that stands costs no more time, until it is sent on."""
        name = self._name[robot]
        self.out[robot] = self._vehicle.getRoadID(name), self._vehicle.getLanePosition(name), self._vehicle.getPosition(name)
        self._vehicle.remove(name)

    def set_route(self, robot: int, edges: list[str], stops: bool, driven_m: float) -> None:
        """Replace what lies ahead; the first edge is where the robot is. One that is out is put back, with `driven_m` on its odometer."""
        name = self._name[robot]
        if robot in self.out:
            self._put_back(robot, edges, driven_m)
        else:
            self._vehicle.setRoute(name, edges)
        if stops:
            self._stop_at_end(name, edges[-1])
        self._plan_now(name)

    def turn_back(self, robot: int, edge: str, onward: list[str], stops: bool, driven_m: float) -> None:
        """Put a standing robot at the same place of the opposite edge, with `driven_m` on its odometer."""
        name = self._name[robot]
        here, length = self._vehicle.getRoadID(name), self._api.lane.getLength(edge + "_0")
        along = self._vehicle.getLanePosition(name)
        self._vehicle.setRoute(name, [here, edge, *onward])
        self._vehicle.moveTo(name, edge + "_0", length - along)
        if stops:
            self._stop_at_end(name, ([edge, *onward])[-1])
        self._plan_now(name)
        self._turned.append((robot, driven_m))

    def collisions(self) -> list[tuple[str, str, str]]:
        """Collisions that SUMO reports of the last step: collider, victim, kind."""
        return [(c.collider, c.victim, c.type) for c in self._api.simulation.getCollisions()]

    def positions(self) -> FloatArray:
        """[R, 2] m, SUMO's own."""
        places = (self.out[r][2] if r in self.out else self._vehicle.getPosition(name) for r, name in enumerate(self._name))
        return np.array(list(places)).reshape(-1, 2)

    def _take_command(self, name: str) -> None:
        self._vehicle.setSpeed(name, 0.0)
        self._vehicle.setSpeedMode(name, WITHOUT_SAFE_SPEED)

    def _plan_now(self, name: str) -> None:
        """Look ahead in the next step, where another edge may follow now."""
        if self._plan_every_s is not None:
            self._vehicle.setActionStepLength(name, self._plan_every_s, True)

    def _put_back(self, robot: int, edges: list[str], driven_m: float) -> None:
        name, (edge, along_m, _) = self._name[robot], self.out.pop(robot)
        self._num_back += 1
        route = f"{name}.{self._num_back}"
        self._api.route.add(route, edges)
        self._vehicle.add(name, route, self._kind[robot], departPos="0", departSpeed="0")
        self._vehicle.moveTo(name, edge + "_0", along_m)
        self._take_command(name)
        self._base[robot] = self._vehicle.getDistance(name) - driven_m

    def show_people(self, xy: FloatArray, radius_m: float) -> None:
        """Draw people as discs at these places [N, 2], in place of those that were drawn before."""
        shown = self._api.polygon
        turn = np.arange(DISC_CORNERS) * (2 * np.pi / DISC_CORNERS)
        discs = xy[:, None] + radius_m * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        for k, disc in enumerate(discs.tolist()):
            if k < self._num_people:
                shown.setShape(f"person_{k}", disc)
            else:
                shown.add(f"person_{k}", disc, PERSON_COLOUR, fill=True, layer=PERSON_LAYER)
        for k in range(len(xy), self._num_people):
            shown.remove(f"person_{k}")
        self._num_people = len(xy)

    def _stop_at_end(self, name: str, edge: str) -> None:
        self._vehicle.setStop(name, edge, pos=self._api.lane.getLength(edge + "_0"), duration=1e7)


@contextmanager
def running_sumo(
    network: Path,
    fleet: Fleet,
    step_length_s: float,
    seed: int,
    gui: bool = False,
    *,
    shorten: Callable[[str], str] | None = None,
    plan_every_s: float | None = None,
) -> Iterator[Sumo]:
    """Start SUMO (sumo-gui with `gui`) on a network, and close it whatever happens.

    Robots' types are numbered by `type_of`. SUMO loads what `shorten`, if given, leaves of the network's text. With `plan_every_s` vehicles
    look ahead so often only, and in between do what they are commanded; by default in every step. Raises ExecutionError for a network that
    SUMO does not load, and for every error of SUMO inside the block.
    """
    global _running
    if _running:
        raise ExecutionError("a simulation is already running in this process, and SUMO can only do one")
    _check_whole(Path(network))
    api, program = _api(gui)
    with tempfile.TemporaryDirectory() as folder:
        types = Path(folder) / "types.add.xml"
        types.write_text(_types(fleet, step_length_s, plan_every_s or step_length_s))
        loaded = Path(network)
        if shorten is not None:
            loaded = Path(folder) / "excerpt.net.xml"
            loaded.write_text(shorten(Path(network).read_text(encoding="utf-8")), encoding="utf-8")
        _running = True
        try:
            files = ("-n", str(loaded), "-a", _additional(Path(network), types, gui))
            _start(
                api, [program, *files, *OPTIONS, "--step-length", f"{step_length_s:g}", "--seed", str(seed % 2**31), *(VIEW if gui else ())]
            )
            yield Sumo(api, fleet.num_robots, plan_every_s)
        except (api.TraCIException, api.FatalTraCIError, struct.error, ConnectionError) as error:
            if gui and not isinstance(error, api.TraCIException):
                raise ExecutionError("sumo-gui was closed before the end of the run") from error
            raise ExecutionError(f"SUMO gave up: {str(error).strip() or 'it said nothing'}") from error
        finally:
            _running = False
            with suppress(*((api.FatalTraCIError, struct.error, ConnectionError) if gui else ())):  # gone already
                api.close()


def type_of(fleet: Fleet) -> list[int]:
    """[R] the vehicle type of each robot as it is now: robots with equal limits share one."""
    kinds: list[int] = (rows_of(fleet)[:, None] == types_of(fleet)).all(-1).argmax(1).tolist()
    return kinds


def rows_of(fleet: Fleet) -> FloatArray:
    """[R, 5] what decides the vehicle type of a robot."""
    return np.stack([fleet.accel_mps2, fleet.decel_mps2, fleet.max_speed_mps, fleet.width_m, fleet.radius_m], 1)


def types_of(fleet: Fleet) -> FloatArray:
    """[K, 5] the limits and sizes of all types, also of robots with loads."""
    return np.unique(np.concatenate([rows_of(each) for each in (fleet, *([fleet.loaded] if fleet.loaded else []))]), axis=0)


def _check_whole(network: Path) -> None:
    """libsumo may crash on half a file."""
    if not network.is_file():
        raise ExecutionError(f"{network}: no such network")
    with network.open("rb") as file:
        file.seek(max(0, network.stat().st_size - 64))
        if not file.read().rstrip().endswith(b"</net>"):
            raise ExecutionError(f"{network}: not a whole SUMO network, expected '</net>' at its end")


def _api(gui: bool) -> tuple[Any, str]:
    if not gui:
        import libsumo

        return libsumo, "sumo"
    import sumo
    import traci

    return traci, str(Path(sumo.SUMO_HOME) / "bin" / "sumo-gui")


def _start(api: Any, command: list[str]) -> None:
    """Start SUMO; sumo-gui once only, in silence, since traci's own `start` tries sixty times where there is no display."""
    if api.isLibsumo():
        api.start(command)
        return
    from sumolib.miscutils import getFreeSocketPort

    if sys.platform != "win32" and not os.environ.get("DISPLAY"):
        raise ExecutionError("sumo-gui needs a display, and there is none (DISPLAY is not set); --live shows the run in a browser")
    port = getFreeSocketPort()
    process = subprocess.Popen([*command, "--remote-port", str(port)], stderr=subprocess.DEVNULL)
    try:
        with redirect_stdout(StringIO()):  # where traci counts its attempts
            api.init(port, proc=process)
    except api.TraCIException as error:
        process.kill()
        raise ExecutionError(
            f"sumo-gui ended as it started, DISPLAY is '{os.environ.get('DISPLAY', '')}'; --live shows the run in a browser"
        ) from error


def _additional(network: Path, types: Path, gui: bool) -> str:
    backdrop = backdrop_of(network)
    return f"{types},{backdrop}" if gui and backdrop.is_file() else str(types)


def _types(fleet: Fleet, step_length_s: float, plan_every_s: float) -> str:
    lines = ["<additional>"]
    for k, (accel, decel, speed, width_m, radius_m) in enumerate(types_of(fleet).tolist()):
        half_m = float(2 * radius_m + fleet.gap_m.max()) / 2  # of the separation of two of them, with the largest gap
        lines.append(
            f'<vType id="type_{k}" length="{half_m:.6f}" minGap="{half_m:.6f}" width="{width_m:.6f}" '
            f'accel="{accel:.6f}" decel="{decel:.6f}" apparentDecel="{decel:.6f}" '
            # with less SUMO lets some head-on robots collide
            f'emergencyDecel="{2 * decel:.6f}" maxSpeed="{speed:.6f}" speedFactor="1" speedDev="0" '
            f'sigma="0" tau="{step_length_s:g}" actionStepLength="{plan_every_s:g}"/>'
        )
    return "\n".join([*lines, "</additional>\n"])
