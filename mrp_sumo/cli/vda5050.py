"""Let the robots of a scenario be VDA 5050 vehicles at an MQTT broker, for a fleet manager to drive; or be the master of such vehicles.

As a fleet (the default), every robot stands at its start and takes orders and instant actions; what drives them is your fleet manager.
As a master, the scenario's planner and dispatcher drive the vehicles at the broker whose serial numbers are the robots' names, and a run
folder is written. This program calls the broker and listens nowhere. See docs/fleet_manager.md. Needs the extra `vda5050`.
"""

import argparse
import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from mrp_sumo.cli import scenario_choice
from mrp_sumo.cli.option_rules import only_for, require_least
from mrp_sumo.cli.printing import say, say_json, warn

if TYPE_CHECKING:
    from mrp_sumo.experiments.map_cache import MapCache
    from mrp_sumo.experiments.staging.set_up import SetUp
    from mrp_sumo.formats.vda.messages import Dialect
    from mrp_sumo.wire.fleet import InjectedFault
    from mrp_sumo.wire.link import Link
    from mrp_sumo.wire.mqtt import Broker, Connections


@dataclass(frozen=True)
class Session:
    """Set-up that both parts share."""

    options: argparse.Namespace
    setup: "SetUp"
    maps: "MapCache"
    connections: "Connections"
    dialect: "Dialect"
    log: TextIO | None

    def logged(self, link: "Link", now_s: Callable[[], float]) -> "Link":
        """The link, whose messages are written down where that is asked for, with simulated times."""
        from mrp_sumo.wire.pace import Logged

        return link if self.log is None else Logged(link, self.log, self.dialect, self.options.manufacturer, now_s)


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo vda5050`."""
    add = parser.add_argument
    add("scenario", help="scenario file, or the name of a bundled scenario such as office_9")
    add("--broker", required=True, metavar="HOST[:PORT]", help="MQTT broker")
    add("--as", dest="part", choices=("fleet", "master"), default="fleet", help="vehicles (the default), or what drives vehicles of others")
    add("--version", default="2.1", metavar="VERSION", help="of VDA 5050: 2.0, 2.1 (default) or 3.0")
    add("--manufacturer", default="mrp_sumo", metavar="NAME", help="in topics and headers (default: mrp_sumo)")
    add("--speed", type=float, default=1.0, metavar="N", help="simulated seconds a second (default: 1, real time)")
    add("--duration", type=float, metavar="S", help="end after S simulated seconds (default: with Ctrl+C)")
    add("--state-period", type=float, default=1.0, metavar="S", help="report every S seconds, besides what happens (default: 1)")
    add("--visualization-period", type=float, default=1.0, metavar="S", help="of the topic visualization (default: 1; 0: none)")
    add(
        "--fault",
        action="append",
        default=[],
        metavar="ROBOT:KIND@S[+S]",
        help="breakdown, emergencyStop, localizationLost or fieldViolation from a time on, for so long; may be repeated",
    )
    add("--out", type=Path, metavar="DIR", help="run folder of a master (default: runs/<scenario>)")
    add("--log", type=Path, metavar="FILE", help="write all messages, one a line; a file that is there is not replaced")
    add("--tls", action="store_true", help="connect by TLS")
    add("--ca", type=Path, metavar="FILE", help="certificates of the authorities to trust (default: the system's)")
    add("--cert", type=Path, metavar="FILE", help="a certificate of one's own, and")
    add("--key", type=Path, metavar="FILE", help="its key")
    add("--user", default="", metavar="NAME", help="user name at the broker, and")
    add("--password-file", type=Path, metavar="FILE", help="a file whose first line is the password")
    add("--json", action="store_true", help="print what came of it as a line of JSON")
    scenario_choice.arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Connect, simulate, say good-bye."""
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.formats.vda.messages import SERIAL, Dialect

    broker, dialect = _broker(options), Dialect(options.version)
    for option, least in (("speed", 0.001), ("duration", 0.001), ("state_period", 0.001), ("visualization_period", 0.0)):
        require_least(f"--{option.replace('_', '-')}", getattr(options, option), least)
    if not SERIAL.fullmatch(options.manufacturer):
        raise MrpSumoError(f"--manufacturer {options.manufacturer[:80]}: expected letters, digits and _ . : -")
    if options.part == "master":
        only_for("--as fleet", fault=options.fault, duration=options.duration)
    else:
        only_for("--as master", out=options.out)
    scenario = scenario_choice.chosen_scenario(options)
    from mrp_sumo.drive import warm  # with all that drives: after the options and the scenario are sound
    from mrp_sumo.experiments.map_cache import MapCache
    from mrp_sumo.experiments.staging.set_up import set_up
    from mrp_sumo.wire.mqtt import Connections

    warm.prepare()
    with ExitStack() as stack:
        maps = stack.enter_context(MapCache())
        setup = set_up(scenario, maps)
        log = None if options.log is None else stack.enter_context(_log(options.log))
        connections = Connections(broker, dialect, options.manufacturer, warn)
        session = Session(options, setup, maps, connections, dialect, log)
        return (_drive if options.part == "master" else _be_driven)(session, stack)


@contextmanager
def _log(path: Path) -> Iterator[TextIO]:
    """A file of messages, which goes where there were none."""
    with path.open("x", encoding="utf-8") as file:
        try:
            yield file
        finally:
            if not file.tell():
                path.unlink()


def _be_driven(session: Session, stack: ExitStack) -> int:
    from mrp_sumo.experiments.run import interrupts
    from mrp_sumo.wire.fleet import Reporting, VirtualFleet
    from mrp_sumo.wire.mqtt import VehicleLink, encoded
    from mrp_sumo.wire.pace import Logged, Pace

    options, setup, dialect, connections = session.options, session.setup, session.dialect, session.connections
    faults = [_fault(text, setup) for text in options.fault]
    reporting = Reporting(options.state_period, options.visualization_period, options.manufacturer, time.time())
    vehicles = VehicleLink(connections)
    fleet: VirtualFleet
    link = session.logged(vehicles, lambda: fleet.now_s)
    fleet = VirtualFleet(setup, session.maps.network(setup.problem.graph), link, dialect, reporting, faults)
    stack.callback(link.close)
    for vehicle in fleet.vehicles:
        online, will = encoded(fleet.connection(vehicle, "ONLINE")), encoded(fleet.last_will(vehicle))
        vehicles.join(vehicle.sender.serial, online, will)
        if isinstance(link, Logged):
            link.note(vehicle.sender.serial, "connection", online)
    where = f"{len(fleet.vehicles)} vehicles at {connections.broker}, {dialect.topic('+', '+', options.manufacturer)} (Ctrl+C ends)"
    say(where, to_stderr=options.json)
    stack.enter_context(fleet)
    interrupt = stack.enter_context(interrupts())
    until_s, pace = options.duration or math.inf, Pace(options.speed)
    cpu_s, begun_s = time.process_time(), time.monotonic()
    while fleet.now_s < until_s - 1e-9 and not interrupt.is_pressed:
        fleet.step(pace.wait(fleet.now_s, link.receive))
    fleet.leave()
    share = (time.process_time() - cpu_s) / max(time.monotonic() - begun_s, 1e-9)
    if options.json:
        said = {
            "vehicles": len(fleet.vehicles),
            "sim_time_s": fleet.now_s,
            "sent": fleet.sent,
            "lost": connections.lost,
            "share_of_a_core": share,
            "behind_s": pace.behind_s,
        }
        say_json(said)
    else:
        say(f"{fleet.now_s:.1f} s simulated, {fleet.sent} messages sent, {connections.lost} lost, {share:.0%} of a core")
    if pace.behind_s > 0.5:
        warn(f"up to {pace.behind_s:.1f} s behind the clock")
    return 0


def _drive(session: Session, stack: ExitStack) -> int:
    from mrp_sumo.cli.run import print_run, progress_bar
    from mrp_sumo.experiments.run import RunOptions, finish
    from mrp_sumo.experiments.solve import solve
    from mrp_sumo.formats.vda.messages import serials_of
    from mrp_sumo.io.run_folder import check_replaceable
    from mrp_sumo.wire.fleet import GraphSite
    from mrp_sumo.wire.master import driven_vehicles
    from mrp_sumo.wire.mqtt import MasterLink

    options, setup, dialect = session.options, session.setup, session.dialect
    out = options.out or Path("runs") / setup.scenario.name
    check_replaceable(out)
    settings = replace(setup.settings, on_deadlock="report")  # no order can say that a vehicle turns round on a lane
    setup = replace(setup, settings=settings)
    master = MasterLink(session.connections, frozenset(serials_of(setup.problem.fleet.robot_name)))
    begun_s = time.monotonic()
    link = session.logged(master, lambda: (time.monotonic() - begun_s) * options.speed)
    master.join()
    stack.callback(link.close)
    site = GraphSite(setup.problem.graph, setup.map.level_shift_m)
    how = {"speed": options.speed, "manufacturer": options.manufacturer}
    engine = driven_vehicles(setup.problem, site, link, dialect, settings.step_length_s, **how)
    with progress_bar() as progress:
        run_options = RunOptions(progress=progress, keeps_interrupted=True, engine=engine)
        result = finish(setup, solve(setup, progress=progress), session.maps, run_options)
    result.write(out, session.maps)
    print_run(result, out, as_json=options.json)
    return 0 if result.status == "completed" else 1


def _broker(options: argparse.Namespace) -> "Broker":
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.wire.mqtt import broker_at, password_of

    if not options.tls:
        only_for("--tls", ca=options.ca, cert=options.cert, key=options.key)
    if (options.cert is None) != (options.key is None):
        raise MrpSumoError("--cert and --key belong together")
    if not options.user:
        only_for("--user", password_file=options.password_file)
    files = {"ca": options.ca, "certificate": options.cert, "key": options.key}
    return broker_at(options.broker, tls=options.tls, user=options.user, password=password_of(options.password_file), **files)


def _fault(text: str, setup: "SetUp") -> "InjectedFault":
    """A fault that `ROBOT:KIND@S[+S]` asks for."""
    from mrp_sumo.errors import MrpSumoError, nearest
    from mrp_sumo.formats.vda.abilities import FAULTS
    from mrp_sumo.wire.fleet import InjectedFault

    names = setup.problem.fleet.robot_name
    robot, _, rest = text.rpartition("@")[0].rpartition(":")
    when = text.rpartition("@")[2].split("+")
    try:
        begin_s, lasts_s = float(when[0]), float(when[1]) if len(when) == 2 else math.inf
    except ValueError:
        begin_s = lasts_s = math.nan
    if not robot or len(when) > 2 or not 0 <= begin_s < math.inf or not lasts_s > 0:
        raise MrpSumoError(f"--fault {text[:80]}: expected ROBOT:KIND@SECONDS or ROBOT:KIND@SECONDS+SECONDS")
    if robot not in names:
        raise MrpSumoError(f"--fault {text[:80]}: '{robot[:40]}' is not a robot{nearest(robot, names)}")
    if rest not in FAULTS:
        raise MrpSumoError(f"--fault {text[:80]}: '{rest[:40]}' is no fault{nearest(rest, FAULTS)}")
    return InjectedFault(names.index(robot), rest, begin_s, begin_s + lasts_s)
