"""A run in Foxglove while it drives: its bag's messages over a WebSocket, and Foxglove's playback control.

Needs the extra `live`. Foxglove's own server lets everybody in, so it stands behind a gate.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace
from threading import Thread
from types import TracebackType
from typing import Any, Self

from mrp_sumo.bags.live_bag import LiveBag, Said
from mrp_sumo.bags.messages import EPOCH_NS
from mrp_sumo.drive.listeners import Listener, Moment
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.outset import record_at_outset
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.maps.costmap import costmap
from mrp_sumo.wire.gate import FOXGLOVE, Relay
from mrp_sumo.wire.playback import Playback, Position

PORT = 8765  # which Foxglove offers when it is asked to open a connection


class FoxgloveView:
    """Shows the runs of one command to Foxglove. To be used with `with`."""

    def __init__(self, port: int = PORT, speed: float = 1.0) -> None:
        """Find out whether there can be a server; `speed` is in simulated seconds a second.

        Raises MrpSumoError without the extra `live`, and where the port cannot be had.
        """
        try:
            import foxglove
            import foxglove.websocket
        except ImportError:
            raise MrpSumoError("--foxglove needs foxglove-sdk: pip install 'mrp-sumo[live]'") from None
        self._foxglove = foxglove
        logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # what a viewer gets wrong is the viewer's matter
        self._gate = Relay(port, FOXGLOVE)
        Thread(target=self._gate.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()
        self.speed = speed
        self._server: Any = None
        self._context: Any = None
        self._store: Any = None  # of message types
        self._channels: dict[str, Any] = {}  # by topic
        self._playback: Playback | None = None

    @property
    def address(self) -> str:
        return self._gate.address

    @property
    def app(self) -> str:
        """The address at which Foxglove opens it."""
        return f"https://app.foxglove.dev/?ds=foxglove-websocket&ds.url={self.address}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        try:
            if kind is None and self._playback is not None:
                self._playback.finish()
        finally:
            self._stop()
            self._gate.drain()
            self._gate.shutdown()
            self._gate.server_close()

    def watch(self, setup: SetUp, solution: Solution) -> Listener:
        """The listener of a run that is about to be driven; when it is, there is a server."""
        self._stop()
        record, building = record_at_outset(setup, solution), setup.map.building
        if building:
            record = replace(record, costmap=costmap(building, setup.map.nav.level_names[0]))
        bag = LiveBag(record, setup.scenario.record.rmf_messages)
        self._context, self._store = self._foxglove.Context(), bag.messages.typestore
        self._playback = playback = Playback(self._send, self._tick, self.speed)
        for topic, typename in bag.later:
            self.advertise(topic, typename)
        showing = Showing(self, bag, playback, record.name, setup.settings.time_limit_s)
        showing.say(bag.at_outset(), 0)
        return showing

    def start(self, name: str, until_s: float, playback: Playback) -> None:
        """Start the server. Topics are known by now: a viewer that comes just when there is a new one may miss it."""
        websocket = self._foxglove.websocket
        host, port = self._gate.behind
        try:
            self._server = self._foxglove.start_server(
                name=f"mrp_sumo: {name}",
                host=host,
                port=port,
                capabilities=[websocket.Capability.Time],
                server_listener=_listener(websocket, playback),
                context=self._context,
                playback_time_range=(EPOCH_NS, EPOCH_NS + round(until_s * 1e9)),
            )
        except RuntimeError as error:  # somebody was faster
            raise MrpSumoError(f"--foxglove: {str(error).removeprefix('FoxgloveError: ')}") from None
        self._gate.is_there.set()

    def _stop(self) -> None:
        """Let go of the port, and of what was said."""
        if self._server is not None:
            self._server.stop()
        if self._playback is not None:
            self._playback.close()
        self._server = self._playback = None
        self._channels = {}

    def advertise(self, topic: str, typename: str) -> None:
        """Have a channel for a topic of a type `package/Type`."""
        if topic in self._channels:
            return
        full = typename.replace("/", "/msg/")
        definition = self._store.generate_msgdef(full, ros_version=2)[0]
        schema = self._foxglove.Schema(name=full, encoding="ros2msg", data=definition.encode())
        self._channels[topic] = self._foxglove.Channel(topic, message_encoding="cdr", schema=schema, context=self._context)

    def _send(self, topic: str, t_ns: int, message: bytes) -> None:
        self._channels[topic].log(message, log_time=EPOCH_NS + t_ns)

    def _tick(self, position: Position) -> None:
        if self._server is None:
            return
        self._server.broadcast_time(EPOCH_NS + position.now_ns)
        if position.ended:
            self._server.broadcast_playback_state(_state(self._foxglove.websocket, position, False, ""))


@dataclass
class Showing(Listener):
    """A listener for one run."""

    view: FoxgloveView
    bag: LiveBag
    playback: Playback
    name: str
    until_s: float

    def hear(self, state: Moment) -> None:
        if state.step == 1:  # all that is said at the beginning has been said
            self.view.start(self.name, self.until_s, self.playback)
        self.say(self.bag.of(state), round(state.now_s * 1e9))

    def say(self, messages: Iterable[Said], now_ns: int) -> None:
        """Say something at a time of the run."""
        said = []
        for topic, typename, message in messages:
            self.view.advertise(topic, typename)
            said.append((topic, message))
        self.playback.add(said, now_ns)


def _listener(websocket: Any, playback: Playback) -> Any:
    """What hears viewers, in threads of the server."""

    class FoxgloveListener(websocket.ServerListener):  # type: ignore[misc]
        def on_subscribe(self, client: Any, channel: Any) -> None:
            playback.listens(client.id, channel.topic)

        def on_unsubscribe(self, client: Any, channel: Any) -> None:
            playback.leaves(client.id, channel.topic)

        def on_playback_control_request(self, request: Any) -> Any:
            to_ns = None if request.seek_time is None else request.seek_time - EPOCH_NS
            position = playback.control(request.playback_command == websocket.PlaybackCommand.Play, request.playback_speed, to_ns)
            return _state(websocket, position, to_ns is not None, request.request_id)

    return FoxgloveListener()


def _state(websocket: Any, position: Position, did_seek: bool, request: str) -> Any:
    status = websocket.PlaybackStatus
    now = (
        status.Ended
        if position.ended
        else status.Buffering
        if position.buffering
        else status.Playing
        if position.playing
        else status.Paused
    )
    return websocket.PlaybackState(now, EPOCH_NS + position.now_ns, position.speed, did_seek, request)
