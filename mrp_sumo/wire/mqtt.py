"""MQTT: the connections of vehicles, one each, and the one of a master.

A client calls a broker and listens nowhere. All connections are served by one thread: a selector says which has something to read. A
connection that is lost is made again, while its user goes on. Needs the extra `vda5050`, which has paho-mqtt.
"""

import json
import selectors
import socket
import ssl
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.errors import MrpSumoError, sentence
from mrp_sumo.files.reading import read_text, require_regular, shortened
from mrp_sumo.formats.vda.messages import Dialect
from mrp_sumo.wire.link import FROM_VEHICLES, TO_VEHICLES, Received

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage

KEEP_ALIVE_S = 15
CONNECT_S = 5.0  # for a broker to answer
RETRY_S = 2.0
ROUND_S = 1.0  # between looks at keep-alives and lost connections
MOST_WAITING = 10_000  # messages that have come in and nobody has taken: a flood has no more memory
MQTT_PORT, MQTTS_PORT = 1883, 8883


@dataclass(frozen=True)
class Broker:
    """The broker's address, and credentials for it."""

    host: str
    port: int
    user: str = ""
    password: str = ""
    tls: bool = False
    ca: Path | None = None  # certificates of authorities to trust; the system's by default
    certificate: Path | None = None  # one's own, with its key
    key: Path | None = None

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def broker_at(address: str, *, tls: bool = False, **how: Any) -> Broker:
    """The broker at `HOST` or `HOST:PORT`; IPv6 addresses in brackets. Raises MrpSumoError for an address that is none."""
    default = MQTTS_PORT if tls else MQTT_PORT
    host, _, port = address.rpartition(":") if address.count(":") == 1 or "]:" in address else (address, "", str(default))
    if not host.strip("[]") or not port.isascii() or not port.isdigit() or not 0 < int(port) < 2**16:
        raise MrpSumoError(f"--broker {address[:80]}: expected HOST or HOST:PORT, with a port from 1 to 65535")
    return Broker(host.strip("[]"), int(port), tls=tls, **how)


def password_of(path: Path | None) -> str:
    """The first line of a file."""
    return "" if path is None else (read_text(path, 2**16).splitlines() or [""])[0]


class Connections:
    """Connections to a broker, by name. See `wire.link.Link`."""

    def __init__(self, broker: Broker, dialect: Dialect, manufacturer: str, report: Callable[[str], None] = lambda line: None) -> None:
        """`report` is called with a line when the broker is gone, and when it is back."""
        try:
            from paho.mqtt import client
        except ImportError:
            raise MrpSumoError("MQTT needs paho-mqtt: pip install 'mrp-sumo[vda5050]'") from None
        self._mqtt = client
        self.broker, self._dialect, self._manufacturer = broker, dialect, manufacturer
        self._clients: dict[str, Client] = {}
        self._names: dict[int, str] = {}  # of sockets that are watched
        self._topics: dict[str, frozenset[str]] = {}  # that are subscribed to, by connection
        self._welcome: dict[str, Mapping[str, bytes]] = {}
        self._refused = ""
        self._inbox: list[Received] = []
        self._selector = selectors.DefaultSelector()
        self._next_round = self._next_try = 0.0
        self._report, self._is_away = report, False
        self.lost = 0  # messages for which there was no connection, or no room

    def add(self, name: str, topics: frozenset[str], *, will: tuple[str, bytes] | None = None) -> None:
        """Connect, and subscribe to topics. Raises MrpSumoError when there is no broker, or it does not let one in.

        The name is a part of the client's identifier; `will` is the topic and payload that the broker sends, retained, when the
        connection breaks.
        """
        mqtt = self._mqtt
        made = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, client_id=f"mrp_sumo_{name}", protocol=mqtt.MQTTv311)
        made.max_queued_messages_set(1000)
        made.connect_timeout = CONNECT_S
        made.on_connect, made.on_message = self._on_connect, self._on_message
        if self.broker.user:
            made.username_pw_set(self.broker.user, self.broker.password)
        if self.broker.tls:
            self._secure(made)
        if will is not None:
            made.will_set(will[0], will[1], qos=1, retain=True)
        made.user_data_set(name)
        self._clients[name], self._topics[name] = made, topics
        try:
            self._connect(name)
        except (OSError, ValueError) as error:
            raise MrpSumoError(f"no connection to the broker {self.broker}: {_why(error)}") from None
        until = time.monotonic() + CONNECT_S
        while not made.is_connected() and not self._refused and time.monotonic() < until:
            self._read(0.05)
        self._write()
        if self._refused or not made.is_connected():
            why = self._refused or "no answer"
            raise MrpSumoError(f"the broker {self.broker} does not let '{name}' in: {why}")

    def on_return(self, name: str, messages: Mapping[str, bytes]) -> None:
        """Publish these, retained, by topic, whenever the connection is made; now for the first time."""
        self._welcome[name] = messages
        self._greet(name)

    def send(self, name: str, topic: str, payload: bytes, *, qos: int = 0, retain: bool = False) -> None:
        """Publish over a connection; lost where there is none."""
        client = self._clients[name]
        if not client.is_connected():
            self.lost += 1
            return
        client.publish(topic, payload, qos, retain)

    def receive(self, wait_s: float) -> list[Received]:
        """See Link."""
        self._write()
        self._read(wait_s)
        self._write()
        now = time.monotonic()
        if now >= self._next_round:
            self._next_round = now + ROUND_S
            for client in self._clients.values():
                client.loop_misc()
            self._return(now)
        messages, self._inbox = self._inbox, []
        return messages

    def close(self) -> None:
        """See Link."""
        for client in self._clients.values():
            for _ in range(100):  # what is still to be written
                if not client.want_write():
                    break
                client.loop_write()
            client.disconnect()
            client.loop_write()
        self._selector.close()

    def topic(self, serial: str, kind: str) -> str:
        return self._dialect.topic(serial, kind, self._manufacturer)

    def _secure(self, client: "Client") -> None:
        broker = self.broker
        for path in (broker.ca, broker.certificate, broker.key):
            if path is not None:
                require_regular(path, 2**20)
        try:
            client.tls_set(
                None if broker.ca is None else str(broker.ca),
                None if broker.certificate is None else str(broker.certificate),
                None if broker.key is None else str(broker.key),
            )
        except (OSError, ValueError) as error:
            files = ", ".join(shortened(path) for path in (broker.ca, broker.certificate, broker.key) if path is not None)
            raise MrpSumoError(f"TLS: {files}: {_why(error)}") from None

    def _connect(self, name: str) -> None:
        client = self._clients[name]
        client.connect(self.broker.host, self.broker.port, KEEP_ALIVE_S)
        socket_: Any = client.socket()
        socket_.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._names[socket_.fileno()] = name
        self._selector.register(socket_, selectors.EVENT_READ)

    def _read(self, wait_s: float) -> None:
        """Read what sockets have, waiting for the first so long; a client reads a packet at a time."""
        ready = self._selector.select(max(0.0, wait_s)) if self._names else []
        for _ in range(MOST_WAITING):
            for key, _events in ready:
                self._read_one(key.fd)
            ready = self._selector.select(0.0) if ready and self._names else []
            if not ready:
                return

    def _read_one(self, fd: int) -> None:
        client = self._clients[self._names[fd]]
        client.loop_read()
        while (socket_ := client.socket()) is not None and getattr(socket_, "pending", int)():  # TLS has read more than it has handed over
            client.loop_read()
        if socket_ is None or socket_.fileno() != fd:
            self._forget(fd)

    def _write(self) -> None:
        """Write what could not be written at once: callbacks write nothing themselves, and sockets may be full."""
        for client in self._clients.values():
            if client.want_write():
                client.loop_write()

    def _forget(self, fd: int) -> None:
        self._selector.unregister(fd)
        del self._names[fd]

    def _return(self, now: float) -> None:
        """Make lost connections again, one at a time where the broker does not answer."""
        watched = set(self._names.values())
        for fd, name in list(self._names.items()):
            if self._clients[name].socket() is None:
                self._forget(fd)
                watched.discard(name)
        if now < self._next_try:
            return
        for name in self._clients:
            if name not in watched:
                try:
                    self._connect(name)
                except (OSError, ValueError) as error:
                    self._next_try = now + RETRY_S
                    if not self._is_away:
                        self._report(f"no connection to the broker {self.broker}: {_why(error)}; trying again")
                    self._is_away = True
                    return
        if self._is_away:
            self._report(f"the broker {self.broker} is back")
        self._is_away = False

    def _on_connect(self, client: "Client", name: str, flags: object, reason: Any, properties: object) -> None:
        if reason.is_failure:
            self._refused = str(reason).lower()
            return
        for topic in sorted(self._topics[name]):
            client.subscribe(topic)
        self._greet(name)

    def _greet(self, name: str) -> None:
        for topic, payload in self._welcome.get(name, {}).items():
            self.send(name, topic, payload, qos=1, retain=True)

    def _on_message(self, client: "Client", name: str, message: "MQTTMessage") -> None:
        if len(self._inbox) >= MOST_WAITING:
            self.lost += 1
        elif message.topic in self._topics[name]:
            *_, serial, kind = message.topic.split("/")
            self._inbox.append(Received(serial, kind, bytes(message.payload)))


@dataclass
class _End:
    """See Link."""

    connections: Connections

    def receive(self, wait_s: float) -> list[Received]:
        """See Link."""
        return self.connections.receive(wait_s)

    def close(self) -> None:
        """See Link."""
        self.connections.close()


class VehicleLink(_End):
    """The ends of vehicles: a connection each, whose last will says that it is broken."""

    def join(self, serial: str, online: bytes, broken: bytes) -> None:
        """Connect a vehicle, with the payloads that say that its connection is there, and that it broke. Raises MrpSumoError."""
        connection = self.connections.topic(serial, "connection")
        topics = frozenset(self.connections.topic(serial, kind) for kind in TO_VEHICLES)
        self.connections.add(serial, topics, will=(connection, broken))
        self.connections.on_return(serial, {connection: online})

    def publish(self, serial: str, kind: str, payload: bytes) -> None:
        """See Link."""
        lasting = kind in ("connection", "factsheet")
        self.connections.send(serial, self.connections.topic(serial, kind), payload, qos=int(kind == "connection"), retain=lasting)


@dataclass
class MasterLink(_End):
    """The end of a master: one connection."""

    serials: frozenset[str]

    def join(self) -> None:
        """Connect. Raises MrpSumoError."""
        kinds = [kind for kind in FROM_VEHICLES if kind != "visualization"]
        self.connections.add("master", frozenset(self.connections.topic(serial, kind) for kind in kinds for serial in self.serials))

    def publish(self, serial: str, kind: str, payload: bytes) -> None:
        """See Link."""
        self.connections.send("master", self.connections.topic(serial, kind), payload)


def encoded(payload: Mapping[str, Any]) -> bytes:
    return json.dumps(payload, separators=(",", ":"), allow_nan=False).encode()


def _why(error: Exception) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not trusted: {error.verify_message}"
    if isinstance(error, ssl.SSLError):  # whose numbers are its own
        return " ".join(str(error.reason or error).replace("_", " ").lower().split())
    return sentence(error) if isinstance(error, OSError) and error.errno is not None and error.errno > 0 else " ".join(str(error).split())
