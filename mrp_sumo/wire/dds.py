"""A run over DDS while it drives, as ROS 2 nodes publish it, without ROS: states of fleet, lifts and doors, requests for these, /clock.

ROS 2 calls a topic `/fleet_states` `rt/fleet_states` in DDS, and a type `rmf_fleet_msgs/msg/FleetState`
`rmf_fleet_msgs::msg::dds_::FleetState_`; queues are reliable, volatile and as deep as Open-RMF's. Needs the extra `dds`.
Nothing leaves this machine unless another interface than the loopback's is asked for.
"""

import socket
from dataclasses import dataclass
from functools import cache
from ipaddress import IPv4Address
from types import TracebackType
from typing import Any, Self

from mrp_sumo.bags.live import DEPTH, LiveMessages
from mrp_sumo.drive.listeners import Listener, Moment
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.outset import record_at_outset
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.experiments.staging.set_up import SetUp

LOOPBACK = "127.0.0.1"
LARGEST_DOMAIN = 232  # whose ports exist
PATIENCE_NS = 1_000_000_000  # for readers to acknowledge the last messages
CONFIG = """<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface address="{address}"/></Interfaces>
<AllowMulticast>{multicast}</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>{peers}</Discovery><Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"""
PEERS = f'<Peers><Peer address="{LOOPBACK}"/></Peers>'  # without multicast, participants are looked for at the ports of the first 32


class DdsView:
    """Publishes the runs of one command. To be used with `with`."""

    def __init__(self, domain: int = 0, address: str = LOOPBACK) -> None:
        """Join a domain. Raises MrpSumoError: without the extra `dds`, and when there is no such domain or interface."""
        try:
            import cyclonedds.domain
            import cyclonedds.pub
            import cyclonedds.topic
        except ImportError:
            raise MrpSumoError("--dds needs cyclonedds: pip install 'mrp-sumo[dds]'") from None
        if not 0 <= domain <= LARGEST_DOMAIN:
            raise MrpSumoError(f"--domain {domain}: expected 0 to {LARGEST_DOMAIN}")
        _check_interface(address)
        local = address == LOOPBACK
        config = CONFIG.format(address=address, multicast="false" if local else "spdp", peers=PEERS if local else "")
        self._dds = cyclonedds
        try:
            self._domain = cyclonedds.domain.Domain(domain, config)
            self._participant = cyclonedds.domain.DomainParticipant(domain)
        except cyclonedds.core.DDSException:  # says no more than that
            raise MrpSumoError(f"--dds: domain {domain} at {address} cannot be joined; are there too many participants?") from None
        self._writers: dict[str, Any] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        for writer in self._writers.values():
            writer.wait_for_acks(PATIENCE_NS)
        self._writers.clear()
        del self._participant, self._domain

    def watch(self, setup: SetUp, solution: Solution) -> Listener:
        """The listener of a run that is about to be driven; rmf_fleet_msgs are of the generation that the scenario records."""
        return Publishing(self, LiveMessages(record_at_outset(setup, solution), setup.scenario.record.rmf_messages))

    def publish(self, topic: str, typename: str, message: bytes, store: Any) -> None:
        """Publish a serialised message of a type `package/Type` that a type store of rosbags has."""
        if topic not in self._writers:
            self._writers[topic] = self._writer(topic, f"{typename.replace('/', '/msg/')}", store)
        writer = self._writers[topic]
        writer.write(writer.data_type.deserialize(message))

    def _writer(self, topic: str, typename: str, store: Any) -> Any:
        from cyclonedds.qos import Policy, Qos

        qos = Qos(
            Policy.Reliability.Reliable(PATIENCE_NS),
            Policy.Durability.Volatile,
            Policy.History.KeepLast(DEPTH[topic]),
            Policy.DataRepresentation(use_cdrv0_representation=True),  # what ROS 2 reads
            Policy.Userdata(f"typehash={store.hash_rihs01(typename)};".encode()),  # as nodes from Iron on have it
        )
        topic_ = self._dds.topic.Topic(self._participant, f"rt{topic}", _struct(typename, store))
        return self._dds.pub.DataWriter(self._participant, topic_, qos)


@dataclass
class Publishing(Listener):
    """A listener for one run."""

    view: DdsView
    live: LiveMessages

    def hear(self, state: Moment) -> None:
        for topic, typename, message in self.live.of(state):
            self.view.publish(topic, typename, message, self.live.messages.typestore)


def _check_interface(address: str) -> None:
    """Raise MrpSumoError where this machine has no interface of an address: DDS says so in lines of its own."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((str(IPv4Address(address)), 0))
    except (OSError, ValueError):
        expected = f"expected the IPv4 address of a network interface of this machine, such as {LOOPBACK}"
        raise MrpSumoError(f"--interface {address[:80]}: {expected}") from None


@cache
def _struct(typename: str, store: Any) -> Any:
    """The DDS type of a ROS type `package/msg/Type`."""
    from cyclonedds.idl import make_idl_struct

    package, _, name = typename.split("/")
    fields = {field: _field(kind.name, what, store) for field, (kind, what) in store.fielddefs[typename][1]}
    return make_idl_struct(f"{name}_", f"{package}::msg::dds_::{name}_", fields)


def _field(kind: str, what: Any, store: Any) -> Any:
    from cyclonedds.idl import types as known

    types: Any = known  # what its annotations say of itself is too narrow
    if kind == "NAME":
        return _struct(what, store)
    if kind == "BASE":
        return {"string": str, "bool": bool}.get(what[0]) or getattr(types, what[0])
    (inner, of), length = what
    one = _field(inner.name, of, store)
    return types.array[one, length] if kind == "ARRAY" else types.sequence[one]
