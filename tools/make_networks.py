"""Draw the bundled maps: networks/{office,warehouse,airport,hospital,hospital_levels}/<name>.building.yaml, networks/kiva/kiva.map,
networks/plant/plant.*.

    .venv/bin/python tools/make_networks.py [FOLDER]

The layouts are this project's own. Office, warehouse and airport have the key facts of Table I of the MRP-Bench paper (extent, vertices,
edges) and are otherwise unlike its maps. Stations stand on a lattice of 0.4 m, the paper's cell, except for the westernmost and
southernmost, which are 0.2 m off it: so cells of 0.4 m counted from there have the lanes in their middle, never on the border between two.
The same bytes come out every time.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from mrp_sumo.maps.drawing import Drawing, _number, _text
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.opentcs_file import write_opentcs

HOLD = {"is_holding_point": True}
PARK = {"is_parking_spot": True}
CHARGE = {"is_charger": True, "is_parking_spot": True}


@dataclass(frozen=True)
class DrawnLift:
    """A cabin that stops at the same place on all levels of a building; its door is on its south side."""

    x_m: float
    y_m: float
    width_m: float
    depth_m: float
    door_m: float  # width of the door


def office() -> Drawing:
    """Two corridors around desk islands, rooms on both sides: 29 vertices, 32 edges, 4 loops."""
    d = Drawing("office", 21.5, 12.0)
    cross = (2.4, 6.4, 10.8, 14.8, 19.2)
    south_y, north_y = 4.8, 7.2

    south = [d.station(x, south_y) for x in cross]
    north = [d.station(x, north_y) for x in cross]
    lobby = d.station(cross[0], 6.0, "lobby", **HOLD)
    d.lane(d.station(0.6, 6.0, "entrance"), lobby)
    d.lane(south[0], lobby, north[0])
    for k in (1, 2, 3):
        d.lane(south[k], north[k])
    east = d.station(cross[4], 6.0)
    d.lane(south[4], east, north[4])
    d.lane(east, d.station(20.8, 6.0, "parking_1", **PARK))
    d.lane(*south)
    d.lane(north[0], north[1], d.station(8.8, north_y, "coffee_point", **HOLD), north[2], north[3], north[4])

    d.lane(north[0], d.station(2.4, 8.8, "reception"))
    d.lane(north[1], d.station(6.4, 9.6, "meeting_room_1"))
    d.lane(north[2], d.station(10.8, 9.6, "meeting_room_2"))
    d.lane(north[3], d.station(14.8, 9.6, "boardroom"), d.station(16.4, 9.6, "boardroom_screen"))
    d.lane(north[4], d.station(19.2, 9.6, "print_room"))
    d.lane(south[0], d.station(2.4, 2.0, "pantry"))
    d.lane(south[1], d.station(6.4, 2.0, "office_1"))
    d.lane(south[2], d.station(10.8, 2.0, "office_2"))
    d.lane(south[3], d.station(14.8, 2.0, "supply_room", pickup_dispenser="supply_dispenser"))
    hub = d.lane(south[4], d.station(19.2, 2.4, "charging_room"))
    d.lane(hub, d.station(17.6, 2.4, "charger_1", **CHARGE))
    d.lane(hub, d.station(19.2, 0.6, "charger_2", **CHARGE))
    d.lane(hub, d.station(20.8, 2.4, "charger_3", **CHARGE))

    d.floor((0, 0), (21.5, 0), (21.5, 12), (0, 12))
    d.wall((0, 0), (0, 12), gaps=[(6.0, 1.8)])
    d.wall((0, 12), (21.5, 12), (21.5, 0), (0, 0))
    d.wall((0, 3.6), (21.5, 3.6), gaps=[(2.4, 2.0), (6.4, 1.1), (10.8, 1.1), (14.8, 1.2), (19.2, 1.6)])
    for x in (4.4, 8.4, 12.8, 16.4):
        d.wall((x, 0), (x, 3.6))
    d.wall((4.4, 8.4), (21.5, 8.4), gaps=[(6.4, 1.1), (10.8, 1.1), (14.8, 1.6), (19.2, 1.2)])
    for x in (4.4, 8.6, 12.6, 17.6):
        d.wall((x, 8.4), (x, 12))
    d.door((0, 5.1), (0, 6.9), "main_entrance", "double_sliding")
    d.door((5.85, 8.4), (6.95, 8.4), "meeting_room_1_door")
    d.door((10.25, 8.4), (11.35, 8.4), "meeting_room_2_door")
    d.door((14.0, 8.4), (15.6, 8.4), "boardroom_door", "double_hinged")
    d.door((6.95, 3.6), (5.85, 3.6), "office_1_door")
    d.door((11.35, 3.6), (10.25, 3.6), "office_2_door")

    for x0, x1 in ((3.6, 5.2), (7.6, 9.6), (12.0, 13.6), (16.0, 18.0)):  # desk islands between the corridors
        shelves(d, x0, 5.5, x1, 6.5, 2, 2)
    d.wall((0.9, 11.0), (0.9, 9.8), (3.6, 9.8), (3.6, 10.4), (1.5, 10.4), (1.5, 11.0), (0.9, 11.0))  # reception desk
    d.box(5.3, 10.5, 7.7, 11.3)
    d.box(9.4, 10.5, 11.8, 11.3)
    d.box(13.3, 10.4, 16.9, 11.4)
    d.box(17.8, 11.2, 21.3, 11.8)  # printers
    d.box(0.2, 0.2, 4.2, 0.8)  # kitchen counter
    d.box(0.5, 1.6, 1.3, 2.6)
    d.box(5.2, 0.4, 7.6, 1.1)
    d.box(9.4, 0.4, 11.8, 1.1)
    d.box(13.0, 0.2, 16.2, 0.7)  # shelves
    d.box(13.0, 1.2, 13.5, 3.2)
    d.box(15.9, 1.2, 16.2, 3.2)
    return d


def warehouse() -> Drawing:
    """Seven aisles between racks, docks and packing to the south, chargers to the north: 54 vertices, 59 edges, 6 loops."""
    d = Drawing("warehouse", 22.0, 27.0)
    aisles = (2.6, 5.6, 8.4, 11.2, 14.0, 16.8, 19.6)
    front_y, back_y = 8.4, 24.0

    front = [d.station(x, front_y) for x in aisles]
    back = [d.station(x, back_y) for x in aisles]
    for k, x in enumerate(aisles):
        letter = "abcdefg"[k]
        d.lane(front[k], *(d.station(x, y, f"pick_{letter}{i}") for i, y in enumerate((12.0, 16.0, 20.4), 1)), back[k])
    d.lane(*front)
    d.lane(*back)
    for k, x in enumerate(aisles):
        d.lane(back[k], d.station(x, 25.6, f"charger_{k + 1}", **CHARGE) if k < 4 else d.station(x, 25.6, f"parking_{k - 3}", **PARK))

    for k, beside, zone, docks in ((0, 1, "receiving", (1, 2)), (6, 5, "shipping", (4, 3))):
        near = d.lane(front[k], d.station(aisles[k], 4.8, zone, **HOLD))
        far = d.lane(near, d.station(aisles[beside], 4.8, f"{zone}_staging", **HOLD))
        for at, x, dock in ((near, aisles[k], f"dock_{docks[0]}"), (far, aisles[beside], f"dock_{docks[1]}")):
            d.lane(at, d.station(x, 1.8, dock, dock_name=dock))
    d.lane(front[2], d.station(aisles[2], 6.0, "packing_1"))
    d.lane(front[4], d.station(aisles[4], 6.0, "packing_2"))
    d.lane(front[3], d.station(aisles[3], 4.8, "office_hatch", **HOLD), d.station(aisles[3], 2.2, "office"))

    d.floor((0, 0), (22, 0), (22, 27), (0, 27), texture="concrete")
    gates = [aisles[k] for k in (0, 1, 5, 6)]
    d.wall((0, 0), (22, 0), gaps=[(x, 2.2) for x in gates])
    d.wall((22, 0), (22, 27), (0, 27), (0, 0))
    for k, x in enumerate(gates, 1):
        d.door((x - 1.1, 0), (x + 1.1, 0), f"dock_gate_{k}", "sliding")

    middles = [0.98, *((a + b) / 2 for a, b in pairwise(aisles)), 21.02]
    for k, x in enumerate(middles):
        single = k in (0, 7)
        half = 0.42 if single else 0.6
        shelves(d, x - half, 9.6, x + half, 22.8, 1 if single else 2, 11)  # bays of 1.2 m, back to back
    for x in middles[1:4]:  # between the chargers
        d.wall((x, 25.4), (x, 27))

    d.wall((9.4, 3.6), (12.9, 3.6), gaps=[(11.2, 1.2)])  # the office
    d.wall((9.4, 3.6), (9.4, 0))
    d.wall((12.9, 3.6), (12.9, 0))
    d.box(9.8, 0.4, 12.5, 1.1)
    for x in (aisles[2], aisles[4]):
        d.box(x - 1.0, 4.2, x + 1.0, 5.0)
    for x0 in (3.6, 17.7):  # pallets between the gates
        for y0 in (0.5, 1.6, 2.7):
            d.box(x0, y0, x0 + 1.0, y0 + 0.8)
    for y0 in (4.4, 5.6, 6.8):
        d.box(0.3, y0, 1.1, y0 + 0.9)
        d.box(20.9, y0, 21.7, y0 + 0.9)
    return d


def airport() -> Drawing:
    """A concourse of two lanes, gates on both sides, a terminal hall to the south: 210 vertices, 244 edges, 35 loops."""
    d = Drawing("airport", 282.0, 64.0)
    link_x = [6.0 + 18.0 * k for k in range(16)]
    middle_x = [x + 8.8 for x in link_x[:-1]]
    south_y, north_y = 38.0, 42.0
    wings = [0, 1, 2, 3, 4, 11, 12, 13, 14, 15]  # cross links with a gate to the south
    hall_x = sorted(link_x[6:10] + middle_x[6:9])

    # concourse
    south = [d.station(x, south_y) for x in link_x]
    north = [d.station(x, north_y) for x in link_x]
    south_middle = [d.station(x, south_y, f"concourse_south_{k}", **HOLD) for k, x in enumerate(middle_x, 1)]
    north_middle = [d.station(x, north_y, f"concourse_north_{k}", **HOLD) for k, x in enumerate(middle_x, 1)]
    for row, between in ((south, south_middle), (north, north_middle)):
        d.lane(*(s for pair in zip(row, between) for s in pair), row[-1])
    for a, b in zip(south, north):
        d.lane(a, b)
    for x, name, k in ((2.2, "west", 0), (279.6, "east", -1)):
        d.lane(
            south[k],
            d.station(x, south_y, f"{name}_lounge", **PARK),
            d.station(x, north_y, f"{name}_viewpoint", **PARK),
            north[k],
        )

    # gates
    for k, x in enumerate(link_x):
        d.lane(north[k], d.station(x, 49.2), d.station(x, 56.4, f"gate_{k + 1}"))
    for number, k in enumerate(wings, 17):
        d.lane(south[k], d.station(link_x[k], 31.2), d.station(link_x[k], 24.4, f"gate_{number}"))

    # rooms between the gates
    north_rooms = (
        "restrooms_1 bookshop cafe_1 pharmacy restrooms_2 duty_free jewellery restrooms_3 "
        "cafe_2 toys restrooms_4 chapel cafe_3 nursery restrooms_5"
    )
    for k, name in enumerate(north_rooms.split()):
        d.lane(north_middle[k], d.station(middle_x[k], 48.8, name))
    south_rooms = "cleaning_1 pizzeria restrooms_6 newsagent lost_property restrooms_7 bank first_aid sushi cleaning_2"
    for k, name in zip((0, 1, 2, 3, 4, 10, 11, 12, 13, 14), south_rooms.split()):
        d.lane(south_middle[k], d.station(middle_x[k], 31.6, name))
    for k, name in ((5, "parking_west"), (10, "parking_east")):
        d.lane(south[k], d.station(link_x[k], 31.6, name, **PARK))
    for number, k in enumerate((1, 3, 5, 7, 9, 11, 13), 1):
        d.lane(south_middle[k], d.station(middle_x[k], 40.0, f"kiosk_{number}"))

    # terminal hall: security, check-in, baggage reclaim, entrances
    inner, middle, outer = ([d.station(x, y) for x in hall_x] for y in (26.0, 16.0, 6.0))
    for row in (inner, middle, outer):
        d.lane(*row)
    concourse = sorted(south[6:10] + south_middle[6:9], key=lambda s: d.stations[s][0])
    for k, x in enumerate(hall_x):
        d.lane(concourse[k], d.station(x, 32.0, f"security_{k + 1}", **HOLD), inner[k])
        d.lane(inner[k], d.station(x, 21.2, f"check_in_{k + 1}"), middle[k])
        d.lane(middle[k], d.station(x, 11.2, f"reclaim_{k + 1}"), outer[k])
    for number, k in enumerate((0, 2, 4, 6), 1):
        d.lane(outer[k], d.station(hall_x[k], 1.8, f"entrance_{number}"))
    for x, side, k, names in ((106.0, -1, 0, ("car_rental", "tourist_information")), (176.0, 1, -1, ("police", "taxi_desk"))):
        hub = d.lane(inner[k], d.station(x, 26.0))
        first = 1 if side < 0 else 4
        for number, (dx, dy) in enumerate(((0, 3.2), (2.4 * side, 0), (0, -3.2)), first):
            d.lane(hub, d.station(x + dx, 26.0 + dy, f"charger_{number}", **CHARGE))
        d.lane(middle[k], d.station(x, 16.0, names[0]))
        d.lane(outer[k], d.station(x, 6.0, names[1]))

    _airport_walls(d, link_x, middle_x, wings, hall_x)
    return d


def _airport_walls(d: Drawing, link_x: list[float], middle_x: list[float], wings: list[int], hall_x: list[float]) -> None:
    d.floor((0, 34), (282, 34), (282, 46), (0, 46), texture="carpet")
    d.floor((102, 0), (180, 0), (180, 34), (102, 34), texture="marble")
    d.wall((0, 34), (0, 46))
    d.wall((282, 34), (282, 46))
    d.wall((0, 46), (282, 46), gaps=[(x, 8.0) for x in link_x] + [(x, 2.4) for x in middle_x])
    rooms = [middle_x[k] for k in (0, 1, 2, 3, 4, 10, 11, 12, 13, 14)] + [link_x[5], link_x[10]]
    d.wall((0, 34), (282, 34), gaps=[(link_x[k], 8.0) for k in wings] + [(x, 2.4) for x in rooms + hall_x])

    for k, x in enumerate(link_x):
        _gate_bay(d, x, 46.0, 60.0, 64.0)
        if k in wings:
            _gate_bay(d, x, 34.0, 20.8, 16.4)
    for x in middle_x:  # rooms fill what the bays leave
        k = middle_x.index(x)
        d.wall((link_x[k] + 6, 53), (link_x[k + 1] - 6, 53))
        d.floor((link_x[k] + 6, 46), (link_x[k + 1] - 6, 46), (link_x[k + 1] - 6, 53), (link_x[k] + 6, 53), texture="tiles")
    for k in (0, 1, 2, 3, 10, 11, 12, 13, 14, 4):
        left, right = link_x[k] + 6, link_x[k + 1] - 6
        d.wall((left, 34), (left, 28), (right, 28), (right, 34))
        d.floor((left, 28), (right, 28), (right, 34), (left, 34), texture="tiles")
    for x0, x1 in ((90, 102), (180, 192)):
        d.wall((x0, 28), (x1, 28))
        d.floor((x0, 28), (x1, 28), (x1, 34), (x0, 34), texture="tiles")

    for k, x in enumerate(link_x[:-1]):  # moving walkways, and kiosks in every other stretch
        if k % 2 == 0:
            shelves(d, x + 2, 39.3, x + 16, 40.7, 1, 2)
        else:
            _oval(d, x + 4.4, 40, 1.6, 0.7)
            _oval(d, x + 13.4, 40, 1.6, 0.7)

    d.wall((102, 0), (102, 34))
    d.wall((180, 0), (180, 34))
    d.wall((102, 0), (180, 0), gaps=[(hall_x[k], 4.0) for k in (0, 2, 4, 6)])
    for number, k in enumerate((0, 2, 4, 6), 1):
        d.door((hall_x[k] - 2, 0), (hall_x[k] + 2, 0), f"entrance_door_{number}", "double_sliding")
    for x in hall_x:  # scanners beside each security lane
        d.box(x - 2.2, 30.2, x - 1.2, 33.4)
        d.box(x + 1.2, 30.2, x + 2.2, 33.4)
    for a, b in pairwise(hall_x):
        middle = (a + b) / 2
        d.wall((a + 2.2, 31.8), (b - 2.2, 31.8))
        shelves(d, middle - 1.6, 17.8, middle + 1.6, 24.2, 2, 4)  # check-in island
        _oval(d, middle, 11.0, 1.9, 3.2)  # carousel
        _oval(d, middle, 11.0, 1.0, 2.3)
    for wall_x, door_x in ((102, 110), (180, 172)):  # charging rooms and offices on both sides of the hall
        d.wall((door_x, 20), (door_x, 32), gaps=[(26.0, 2.4)])
        d.wall((wall_x, 32), (door_x, 32))
        d.wall((wall_x, 20), (door_x, 20))
        d.wall((door_x, 0), (door_x, 20), gaps=[(16.0, 2.4), (6.0, 2.4)])
        d.wall((wall_x, 11), (door_x, 11))


def _gate_bay(d: Drawing, x: float, inside_y: float, glass_y: float, tip_y: float) -> None:
    """Side walls, rows of seats, the desk, and the jet bridge out to the aircraft."""
    out = 1 if glass_y > inside_y else -1
    d.floor((x - 6, inside_y), (x + 6, inside_y), (x + 6, glass_y), (x - 6, glass_y), texture="carpet")
    left, right = max(x - 6, 0.0), min(x + 6, 282.0)
    d.wall((left, inside_y), (left, glass_y))
    d.wall((right, glass_y), (right, inside_y))
    d.wall((left, glass_y), (right, glass_y), gaps=[(x + 2.5, 2.0)])
    d.wall((x + 1.5, glass_y), (x + 1.5, glass_y + out), (x - 1.0, tip_y), (x + 1.0, tip_y), (x + 3.5, glass_y + out), (x + 3.5, glass_y))
    for k in range(3):
        y = inside_y + out * (4.4 + 2.2 * k)
        for x0 in (x - 5.0, x + 1.8):
            shelves(d, x0, y, x0 + 3.2, y + 0.8 * out, 1, 2)
    d.box(x - 4.4, min(glass_y - 1.8 * out, glass_y - 2.4 * out), x - 1.4, max(glass_y - 1.8 * out, glass_y - 2.4 * out))


def _oval(d: Drawing, x: float, y: float, half_x: float, half_y: float) -> None:
    """An octagon with two long sides."""
    cut = min(half_x, half_y) * 0.6
    d.wall(
        (x - half_x + cut, y - half_y),
        (x + half_x - cut, y - half_y),
        (x + half_x, y - half_y + cut),
        (x + half_x, y + half_y - cut),
        (x + half_x - cut, y + half_y),
        (x - half_x + cut, y + half_y),
        (x - half_x, y + half_y - cut),
        (x - half_x, y - half_y + cut),
        (x - half_x + cut, y - half_y),
    )


def hospital() -> Drawing:
    """Two corridors of two lanes, wards to the north, services to the south, chargers between: 93 vertices, 109 edges, 17 loops."""
    d = Drawing("hospital", 38.4, 24.0)
    columns = [2.4 + 4.8 * k for k in range(8)]
    crossings, inner = (0, 2, 5, 7), (1, 3, 4, 6)

    lanes = [[d.station(x, y) for x in columns] for y in (7.2, 8.8, 15.2, 16.8)]
    for row in lanes:
        d.lane(*row)
    south, south_inner, north_inner, north = lanes
    for a, b in (*zip(south, south_inner), *zip(north_inner, north), *((south_inner[k], north_inner[k]) for k in crossings)):
        d.lane(a, b)

    services = ["pharmacy", "laboratory", "kitchen", "laundry", "supply", "emergency", "radiology", "waste"]
    for x, at, name in zip(columns, south, services):
        door = d.lane(at, d.station(x, 4.8, name, **HOLD))
        d.lane(d.station(x - 1.2, 4.8, f"{name}_1"), door, d.station(x + 1.2, 4.8, f"{name}_2"))
        if name == "emergency":
            d.lane(door, d.station(x, 3.0, "ambulance_bay"))
    for k, (x, at) in enumerate(zip(columns, north), 1):
        door = d.lane(at, d.station(x, 19.2, f"ward_{k}", **HOLD))
        d.lane(d.station(x - 1.2, 19.2, f"ward_{k}_west"), door, d.station(x + 1.2, 19.2, f"ward_{k}_east"))
    for number, (k, name) in enumerate(zip(inner, ("theatre_1", "nurses", "intensive_care", "theatre_2")), 1):
        d.lane(south_inner[k], d.station(columns[k], 11.2, name))
        d.lane(north_inner[k], d.station(columns[k], 12.8, f"charger_{number}", **CHARGE))
    for number, (at, x, y) in enumerate(
        ((south_inner[0], 0.6, 8.8), (north_inner[0], 0.6, 15.2), (south_inner[-1], 37.6, 8.8), (north_inner[-1], 37.6, 15.2)), 1
    ):
        d.lane(at, d.station(x, y, f"parking_{number}", **PARK))

    d.floor((0, 0), (38.4, 0), (38.4, 24), (0, 24))
    d.wall((0, 0), (38.4, 0), (38.4, 24), (0, 24), (0, 0))
    for y, outer_y in ((6.0, 0), (18.0, 24)):
        d.wall((0, y), (38.4, y), gaps=[(x, 1.6) for x in columns])
        for x in columns[:-1]:
            d.wall((x + 2.4, y), (x + 2.4, outer_y))
    for west, east in pairwise(crossings):
        x0, x1 = columns[west] + 1.2, columns[east] - 1.2
        gaps = [(columns[k], 1.6) for k in inner if west < k < east]
        d.wall((x0, 10.0), (x1, 10.0), gaps=gaps)
        d.wall((x0, 14.0), (x1, 14.0), gaps=gaps)
        d.wall((x0, 12.0), (x1, 12.0))
        for x in (x0, x1):
            d.wall((x, 10.0), (x, 14.0))
    for x, name in zip(columns, services):
        d.door((x - 0.8, 6.0), (x + 0.8, 6.0), f"{name}_door", "double_sliding")
        shelves(d, x - 1.8, 0.6, x + 1.8, 1.4, 4, 1)
    for k, x in enumerate(columns, 1):
        d.door((x - 0.8, 18.0), (x + 0.8, 18.0), f"ward_{k}_door", "double_sliding")
        for bed in (-1.8, 0.6):
            d.box(x + bed, 21.4, x + bed + 1.2, 23.6)
    return d


LIFTS = {"lift_west": DrawnLift(14.4, 12.2, 2.4, 2.4, 1.4), "lift_east": DrawnLift(21.6, 12.2, 2.4, 2.4, 1.4)}
LEVEL_HEIGHT_M = 4.2
ROOMS = {  # of each level, south and north of the corridor, from the west; the lifts are between those to the north
    "L1": (("pharmacy", "kitchen", "laundry", "supply", "waste", "sterile"), ("emergency", "triage", "radiology", "office")),
    "L2": (("theatre_1", "theatre_2", "recovery", "care_1", "laboratory", "blood_bank"), ("ward_21", "ward_22", "ward_23", "ward_24")),
    "L3": (("ward_31", "ward_32", "ward_33", "ward_34", "linen", "medicine"), ("ward_35", "ward_36", "ward_37", "ward_38")),
}
HATCHES = ("laboratory", "blood_bank", "medicine")  # rooms behind doors of half a metre


def hospital_levels() -> dict[str, Drawing]:
    """Three levels around two lifts: on each a corridor of two lanes between rooms. Some rooms are for small robots only."""
    levels = {}
    columns = (3.6, 8.4, 14.4, 21.6, 27.6, 32.4)
    for level, (south_rooms, north_rooms) in ROOMS.items():
        d = levels[level] = Drawing("hospital_levels", 36.0, 16.8)
        south, north = ([d.station(x, y) for x in columns] for y in (6.0, 8.4))
        for row in (south, north, *zip(south, north)):
            d.lane(*row)
        d.lane(south[0], d.station(1.2, 6.0, f"{level}_charger_1", **CHARGE))
        d.lane(north[-1], d.station(34.8, 8.4, f"{level}_charger_2", **CHARGE))
        d.lane(north[0], d.station(1.2, 8.4, f"{level}_parking_1", **PARK))
        d.lane(south[-1], d.station(34.8, 6.0, f"{level}_parking_2", **PARK))
        d.floor((0, 0), (36.0, 0), (36.0, 16.8), (0, 16.8))
        d.wall((0, 0), (36.0, 0), (36.0, 16.8), (0, 16.8), (0, 0))
        doors: dict[float, list[tuple[float, float]]] = {4.8: [], 9.6: []}
        of_north = (*north_rooms[:2], "", "", *north_rooms[2:])
        for row, rooms, wall_y, room_y in ((south, south_rooms, 4.8, 2.4), (north, of_north, 9.6, 13.2)):
            for x, at, room in zip(columns, row, rooms):
                width = 0.5 if room in HATCHES else 1.2 if room else 2.4
                doors[wall_y].append((x, width))
                if room:
                    d.lane(at, d.station(x, room_y, f"{level}_{room}"))
                    d.door((x - width / 2, wall_y), (x + width / 2, wall_y), f"{level}_{room}_door", "sliding")
        for wall_y, gaps in doors.items():
            d.wall((0, wall_y), (36.0, wall_y), gaps=gaps)
        for name, lift in LIFTS.items():
            d.lane(north[columns.index(lift.x_m)], d.station(lift.x_m, 12.0, f"{level}_{name}", lift_cabin=name))
            west, east, door_y = lift.x_m - 1.3, lift.x_m + 1.3, lift.y_m - 1.3
            d.wall(
                (west, door_y),
                (east, door_y),
                (east, lift.y_m + 1.3),
                (west, lift.y_m + 1.3),
                (west, door_y),
                gaps=[(lift.x_m, lift.door_m)],
            )
        for x in (6.0, 11.4, 18.0, 24.6, 30.0):
            d.wall((x, 0), (x, 4.8))
            if x != 18.0:
                d.wall((x, 9.6), (x, 16.8))
        for x in columns:
            d.box(x - 0.9, 0.4, x + 0.9, 1.2)
    return levels


def kiva() -> str:
    """MovingAI's text of the map of 33 x 46 cells that rolling-horizon planners are compared on.

    Every fourth row from the highest on is free. In the rows between stand three blocks of pods; a row of pods is closed, the rows
    above and below it are the endpoints where robots stop.
    """
    rows = ["." * 46 if r % 4 == 0 else ".......".join(("", ".".join([("@" if r % 4 == 2 else ".") * 10] * 3), "")) for r in range(33)]
    return "\n".join(["type octile", "height 33", "width 46", "map", *rows, ""])


def plant() -> dict[str, Any]:
    """A LIF of forklifts that circle a plant: a one-way ring of 42 x 20 m with rounded corners and an aisle across, and spurs to the ring.

    Into a spur they drive forwards, out of it backwards.
    """
    places = {"B1": (12, 0), "B2": (21, 0), "B3": (30, 0), "B4": (39, 0), "R1": (42, 3), "R2": (42, 10), "R3": (42, 17), "T1": (39, 20)}
    places |= {"T2": (30, 20), "T3": (21, 20), "T4": (12, 20), "T5": (3, 20), "L1": (0, 17), "L2": (0, 10), "L3": (0, 3), "B0": (3, 0)}
    places |= {"M1": (21, 6), "M2": (21, 14)}
    spurs = {"goods_in": ("B1", (12, -4)), "goods_out": ("B3", (30, -4)), "press": ("R2", (46, 10)), "lathe": ("T2", (30, 24))}
    spurs |= {"mill": ("T4", (12, 24)), "charger_1": ("L2", (-4, 10)), "charger_2": ("L1", (-4, 17)), "buffer": ("M1", (17, 6))}
    actions = {"goods_in": "pick", "goods_out": "drop", "charger_1": "startCharging", "charger_2": "startCharging"}
    ring = ["B0", "B1", "B2", "B3", "B4", "R1", "R2", "R3", "T1", "T2", "T3", "T4", "T5", "L1", "L2", "L3", "B0"]
    corner = {("B4", "R1"): (42, 0), ("R3", "T1"): (42, 20), ("T5", "L1"): (0, 20), ("L3", "B0"): (0, 0)}
    edges = []

    def edge(a: str, b: str, **params: Any) -> None:
        ends = {"edgeId": f"{a}-{b}", "startNodeId": a, "endNodeId": b}
        edges.append({**ends, "vehicleTypeEdgeProperties": [{"vehicleTypeId": "plant.forklift", "rotationAllowed": False, **params}]})

    for a, b in [*pairwise(ring), ("B2", "M1"), ("M1", "M2"), ("M2", "T3")]:
        if (a, b) not in corner:
            edge(a, b, maxSpeed=1.5)
            continue
        points = [places[a], corner[a, b], places[b]]  # a quarter circle: the weight in the middle is cos(45 deg)
        controls = [{"x": float(x), "y": float(y), "weight": w} for (x, y), w in zip(points, (1.0, 0.70710678, 1.0))]
        edge(a, b, maxSpeed=0.8, trajectory={"degree": 2, "knotVector": [0.0, 0.0, 0.0, 1.0, 1.0, 1.0], "controlPoints": controls})
    for name, (at, _) in spurs.items():
        edge(at, name, maxSpeed=0.8)
        edge(name, at, maxSpeed=0.5, vehicleOrientation=3.1415927, orientationType="TANGENTIAL")
    nodes = []
    for name, (x, y) in (places | {name: xy for name, (_, xy) in spurs.items()}).items():
        params: dict[str, Any] = {"vehicleTypeId": "plant.forklift"}
        if name in actions:
            params["actions"] = [{"actionType": actions[name], "requirementType": "OPTIONAL", "blockingType": "HARD"}]
        position = {"x": float(x), "y": float(y)}
        nodes.append({"nodeId": name, "mapId": "hall", "nodePosition": position, "vehicleTypeNodeProperties": [params]})
    stations = [{"stationId": f"{name}_station", "interactionNodeIds": [name]} for name in spurs if "charger" not in name]
    about = {"projectIdentification": "plant", "creator": "mrp_sumo", "exportTimestamp": "2026-11-22T00:00:00.00Z", "lifVersion": "1.0.0"}
    layout = {"layoutId": "hall", "layoutVersion": "1", "layoutLevelId": "hall", "nodes": nodes, "edges": edges, "stations": stations}
    return {"metaInformation": about, "layouts": [layout]}


def shelves(d: Drawing, x0: float, y0: float, x1: float, y1: float, columns: int, rows: int) -> None:
    """A box divided into bays: a rack, a row of desks or seats."""
    xs = [x0 + (x1 - x0) * i / columns for i in range(columns + 1)]
    ys = [y0 + (y1 - y0) * j / rows for j in range(rows + 1)]
    for x in xs:
        d.wall(*((x, y) for y in ys))
    for y in ys:
        d.wall(*((x, y) for x in xs))


def building_text(name: str, levels: Mapping[str, Drawing], height_m: float, lifts: Mapping[str, DrawnLift]) -> str:
    """The file of a building of several levels, each of the same extent and so much higher than the one before, and its lifts.

    A lift stops where a station of a level is in its cabin.
    """
    lines = [line for k, (level, drawing) in enumerate(levels.items()) for line in drawing.level(level, k * height_m, fiducials=True)]
    lines.append("lifts:")
    lowest, *_, highest = levels
    for lift, drawn in lifts.items():
        x, y = levels[lowest].pixels(drawn.x_m, drawn.y_m)
        door = f"{{door_type: 2, motion_axis_orientation: 0, width: {_number(drawn.door_m)}, x: 0, y: {_number(-drawn.depth_m / 2)}}}"
        lines += [
            f"  {lift}:",
            f"    depth: {_number(drawn.depth_m)}",
            f"    doors: {{door: {door}}}",
            f"    highest_floor: {highest}",
            f"    initial_floor_name: {lowest}",
            f"    level_doors: {{{', '.join(f'{level}: [door]' for level in levels)}}}",
            f"    lowest_floor: {lowest}",
            "    plugins: true",
            f"    reference_floor_name: {lowest}",
            f"    width: {_number(drawn.width_m)}",
            f"    x: {_number(x)}",
            f"    y: {_number(y)}",
            "    yaw: 0",
        ]
    return _text(name, lines)


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent / "networks"
    for draw in (office, warehouse, airport, hospital):
        drawing = draw()
        path = folder / drawing.name / f"{drawing.name}.building.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        drawing.write(path)
        print(f"{path}: {len(drawing.stations)} vertices, {len(drawing.lanes)} edges, {len(drawing.walls)} walls")
    levels = hospital_levels()
    path = folder / "hospital_levels" / "hospital_levels.building.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(building_text("hospital_levels", levels, LEVEL_HEIGHT_M, LIFTS), encoding="utf-8", newline="\n")
    print(f"{path}: {sum(len(drawing.stations) for drawing in levels.values())} vertices on {len(levels)} levels")
    path = folder / "kiva" / "kiva.map"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(kiva(), encoding="utf-8", newline="\n")
    print(path)
    path = folder / "plant" / "plant.lif.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(plant(), indent=1) + "\n", encoding="utf-8", newline="\n")
    print(path)
    map_ = load_map(path)
    at_crossing = {map_.nav.vertex_of_name[name] for name in ("B2", "T3")}  # where the aisle leaves the ring, and comes back
    options = tuple({**params, "mutex": "aisle"} if v in at_crossing else params for v, params in enumerate(map_.nav.vertex_options))
    write_opentcs(replace(map_, nav=replace(map_.nav, vertex_options=options)), path.with_name("plant.xml"))
    print(path.with_name("plant.xml"))


if __name__ == "__main__":
    main()
