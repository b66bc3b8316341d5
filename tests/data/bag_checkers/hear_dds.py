#!/usr/bin/env python3
"""Listen on 127.0.0.1 as a ROS 2 node with Cyclone DDS would: its topic and type names, reliable volatile readers, plain CDR.

    python hear_dds.py DOMAIN TOPIC...

Prints "ready", then, until it is killed, a line per message: topic and bytes as hexadecimal digits, decoded and encoded again with types
that are written down here from the .msg files.
"""

import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Listener
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, int32, sequence, uint8, uint32, uint64
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

HERE = """<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs::msg::dds_::Clock_"):
    clock: Time


@dataclass
class Location(IdlStruct, typename="rmf_fleet_msgs::msg::dds_::Location_"):
    t: Time
    x: float32
    y: float32
    yaw: float32
    obey_approach_speed_limit: bool
    approach_speed_limit: float32
    level_name: str
    index: uint64


@dataclass
class RobotMode(IdlStruct, typename="rmf_fleet_msgs::msg::dds_::RobotMode_"):
    mode: uint32
    mode_request_id: uint64


@dataclass
class RobotState(IdlStruct, typename="rmf_fleet_msgs::msg::dds_::RobotState_"):
    name: str
    model: str
    task_id: str
    seq: uint64
    mode: RobotMode
    battery_percent: float32
    location: Location
    path: sequence[Location]


@dataclass
class FleetState(IdlStruct, typename="rmf_fleet_msgs::msg::dds_::FleetState_"):
    name: str
    robots: sequence[RobotState]


@dataclass
class DoorMode(IdlStruct, typename="rmf_door_msgs::msg::dds_::DoorMode_"):
    value: uint32


@dataclass
class DoorState(IdlStruct, typename="rmf_door_msgs::msg::dds_::DoorState_"):
    door_time: Time
    door_name: str
    current_mode: DoorMode


@dataclass
class LiftState(IdlStruct, typename="rmf_lift_msgs::msg::dds_::LiftState_"):
    lift_time: Time
    lift_name: str
    available_floors: sequence[str]
    current_floor: str
    destination_floor: str
    door_state: uint8
    motion_state: uint8
    available_modes: sequence[uint8]
    current_mode: uint8
    session_id: str


TYPES = {"/fleet_states": FleetState, "/lift_states": LiftState, "/door_states": DoorState, "/clock": Clock}


class Report(Listener):
    def __init__(self, topic):
        super().__init__()
        self.topic = topic

    def on_data_available(self, reader):
        for sample in reader.take(100):
            if isinstance(sample, TYPES[self.topic]):  # not the news that a writer has gone
                print(self.topic, sample.serialize(use_version_2=False).hex(), flush=True)


def main():
    domain, topics = int(sys.argv[1]), sys.argv[2:]
    loopback = Domain(domain, HERE)
    participant = DomainParticipant(domain)
    qos = Qos(
        Policy.Reliability.Reliable(10**9),
        Policy.History.KeepLast(100),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
    readers = [DataReader(participant, Topic(participant, f"rt{name}", TYPES[name]), qos=qos, listener=Report(name)) for name in topics]
    print("ready", flush=True)
    while readers and loopback:
        time.sleep(1)


if __name__ == "__main__":
    main()
