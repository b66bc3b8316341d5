"""Factsheets of VDA 5050, 2.1 and 3.0, of types of robots, and types of robots from factsheets.

Written against the text and schemas of github.com/VDA5050/VDA5050, tags 2.1.0 and 3.0.0. The origin of a sheet of ours is the middle of the
body. Accelerations of `physicalParameters` are with the heaviest load, as the text has it; those without are of a load set EMPTY of no
weight. What a sheet has no member for, and the text leaves to the manufacturer, is written as figures with our names into
`constraints` of steered wheels (steering_max_rad) and the description of `order.edges.orientation`, which says that a vehicle may reverse.

Refuses a sheet without length, width or top speed, and figures that a type cannot have.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

from mrp_sumo.core.arrivals import ServiceTime
from mrp_sumo.core.robot_type import DIFFERENTIAL, Actions, Loaded, RobotShape, RobotType, Wheels
from mrp_sumo.errors import MapError, MrpSumoError, OptionError, in_one_line, nearest
from mrp_sumo.files.reading import json_value, shortened
from mrp_sumo.formats.vda.messages import MANUFACTURER, Dialect, Json, Sender, VehicleLimits
from mrp_sumo.maps.readers.json_fields import Fields
from mrp_sumo.maps.yaml_text import read_text

OF_RUNS = {  # actions that runs know, with their scopes
    **dict.fromkeys(("pick", "drop", "service", "startCharging"), ("NODE",)),
    **dict.fromkeys(("startPause", "stopPause", "cancelOrder", "stateRequest", "factsheetRequest"), ("INSTANT",)),
}
SPECIFICATION, BODY = "typeSpecification", "physicalParameters"
OLD_WORDS = {  # section -> names of 3.0 -> those of 2.1
    "": {"mobileRobotGeometry": "agvGeometry"},
    SPECIFICATION: {"mobileRobotKinematics": "agvKinematic", "mobileRobotClass": "agvClass", "maximumLoadMass": "maxLoadMass"},
    BODY: {
        **{"minimumSpeed": "speedMin", "maximumSpeed": "speedMax", "maximumAcceleration": "accelerationMax"},
        **{"maximumDeceleration": "decelerationMax", "minimumHeight": "heightMin", "maximumHeight": "heightMax"},
    },
    "loadSets": {
        **{"maximumWeight": "maxWeight", "maximumSpeed": "agvSpeedLimit"},
        **{"maximumAcceleration": "agvAccelerationLimit", "maximumDeceleration": "agvDecelerationLimit"},
    },
    "envelopes2d": {"envelope2dId": "set", "vertices": "polygonPoints"},
}
FIGURES = {  # of `physicalParameters`, by the keys of a type; the first three have to be there
    "length_m": "length",
    "width_m": "width",
    "max_speed_mps": "maximumSpeed",
    "accel_mps2": "maximumAcceleration",
    "decel_mps2": "maximumDeceleration",
}
KINEMATICS = {"DIFFERENTIAL": "DIFF", "OMNIDIRECTIONAL": "OMNI", "THREE_WHEEL": "THREEWHEEL"}  # of 3.0 -> of 2.1
GUESSED = {"accel_mps2": 0.5, "decel_mps2": 0.5, "turn_rate_rad_s": 1.0}
STEERING_RAD = 1.2
WHEELBASE = 0.7  # of the length, where wheels are not listed
EMPTY, LOADED = "EMPTY", "LOADED"
ORIENTATION = "order.edges.orientation"
NOT_HELD = ("gap_m", "battery", "mtbf_h", "mttr_h", "mtbf_shape", "mttr_sigma", "tow_s", "maintenance", "lane_class_mps", "intervals")
SAME_M = 1e-6


def word(section: str, key: str, is_new: bool) -> str:
    """A member's name in a version."""
    return key if is_new else OLD_WORDS[section].get(key, key)


def factsheet(
    dialect: Dialect, robot: RobotType, *, actions: Mapping[str, Sequence[str]] = OF_RUNS, limits: VehicleLimits | None = None
) -> Json:
    """The factsheet of a type of robots, without its header. Heights are not known here: 0."""
    new, with_load = dialect.is_new, robot.with_load

    def said(section: str, content: Json) -> Json:
        return {word(section, key, new): value for key, value in content.items()}

    is_steered, kind = robot.is_vehicle, robot.kinematics.kind
    kinematics = "THREE_WHEEL" if is_steered else "OMNIDIRECTIONAL" if kind == "omni" else "DIFFERENTIAL"
    specification: Json = {
        "seriesName": _series(robot)[1],
        **({"seriesDescription": robot.source} if robot.source else {}),
        "mobileRobotKinematics": kinematics if new else KINEMATICS[kinematics],
        "mobileRobotClass": "TUGGER" if kind == "tugger" else "FORKLIFT" if is_steered else "CARRIER",
        "maximumLoadMass": robot.max_load_kg or 0.0,
        "localizationTypes": ["NATURAL"],
        "navigationTypes": ["VIRTUAL_LINE_GUIDED"],
    }
    body: Json = {"minimumSpeed": 0.0, "maximumSpeed": robot.max_speed_mps}
    if new and robot.turn_rate_rad_s is not None:
        body["maximumAngularSpeed"] = robot.turn_rate_rad_s
    body |= {"maximumAcceleration": with_load.accel_mps2, "maximumDeceleration": with_load.decel_mps2}
    body |= {"minimumHeight": 0.0, "maximumHeight": 0.0, "width": robot.width_m, "length": robot.length_m}
    known = [
        {"actionType": each, "actionScopes": list(scopes)}
        | ({"pauseAllowed": False, "cancelAllowed": each != "startCharging"} if new else {})
        for each, scopes in actions.items()
    ]
    optional: list[Json] = []
    if is_steered and robot.kinematics.reverse:
        top = robot.kinematics.reverse_mps
        more = {} if top is None else {"description": f"reverse_mps: {top}"}
        optional = [{"parameter": ORIENTATION, "support": "SUPPORTED", **more}]
    sheet: Json = {
        SPECIFICATION: said(SPECIFICATION, specification),
        BODY: said(BODY, body),
        "protocolLimits": _protocol_limits(new, limits),
        "protocolFeatures": {"optionalParameters": optional, "mobileRobotActions" if new else "agvActions": known},
        "mobileRobotGeometry": {
            **({"wheelDefinitions": _wheels(robot)} if is_steered else {}),
            "envelopes2d": [said("envelopes2d", envelope) for envelope in _envelopes(robot)],
        },
        "loadSpecification": {
            **({"loadPositions": [str(k + 1) for k in range(robot.capacity)]} if robot.capacity > 1 else {}),
            **({"loadSets": sets} if (sets := [said("loadSets", one) for one in _load_sets(robot)]) else {}),
        },
    }
    return said("", sheet)


def lost(robot: RobotShape, dialect: Dialect) -> str:
    """Figures of a type that its factsheet has no member for, in one line; '' where it has all."""
    wheels, loaded = robot.kinematics, robot.loaded or Loaded()
    gone = [key for key in ("turn_rate_rad_s",) if not dialect.is_new and robot.turn_rate_rad_s is not None]
    gone += [key for key in NOT_HELD if _differs(robot, key)]
    gone += [f"kinematics.{key}" for key in ("gear_s", "lateral_mps2", "docking") if _differs(wheels, key)]
    gone += ["trailers"] * bool(robot.trailers)
    gone += [f"loaded.{key}" for key in ("turn_rate_rad_s", "mass_kg") if getattr(loaded, key) is not None]
    for f in fields(Actions) if robot.actions else ():
        time = getattr(robot.actions, f.name)
        if time is not None and (f.name not in ("pick", "drop") or time.constant_s is None):
            gone.append(f"actions.{f.name}" + (" (but its mean)" if f.name in ("pick", "drop") else ""))
    return ", ".join(gone)


def factsheet_file(robot: RobotType, version: str) -> str:
    """The text of a file with the factsheet of a type."""
    dialect, (manufacturer, series) = Dialect(version), _series(robot)
    sheet = Sender(dialect, series, manufacturer).message("factsheet", 0.0, factsheet(dialect, robot))
    return json.dumps(sheet, indent=1) + "\n"


def is_factsheet(path: Path) -> bool:
    """True for a JSON file, or a log's first line, with a type's specification or physical parameters."""
    if path.suffix.lower() not in (".json", ".jsonl") or not path.is_file():
        return False
    try:
        text = read_text(path).text
        document = _document(text) if SPECIFICATION in text or BODY in text else None
    except (MapError, ValueError, RecursionError):
        return False
    return isinstance(document, Mapping) and (SPECIFICATION in document or BODY in document)


def read_factsheet(path: Path) -> tuple[RobotType, list[str]]:
    """The type of robots that a factsheet describes, and a line on each figure that was guessed or left out. Raises MrpSumoError."""
    text = read_text(path)
    try:
        document = _document(text.text)
    except (ValueError, RecursionError) as error:
        raise MapError(f"{shortened(path)}: not JSON: {in_one_line(str(error))}") from None
    return _Sheet(Fields(text), path, document).read()


def _document(text: str) -> Any:
    """A factsheet as JSON, alone or as the payload of a message; of several lines the first."""
    try:
        document = json_value(text)
    except ValueError:
        document = json_value(text.partition("\n")[0])
    payload = document.get("payload") if isinstance(document, Mapping) else None
    return payload if isinstance(payload, Mapping) else document


@dataclass
class _Sheet:
    """A factsheet as it is read."""

    fields: Fields
    path: Path
    document: Any
    notes: list[str] = field(default_factory=list)
    is_new: bool = True

    def read(self) -> tuple[RobotType, list[str]]:
        document = self.fields.mapping(self.document, "")
        about = self.fields.object(document, SPECIFICATION, "")
        body = self.fields.object(document, BODY, "")
        self.is_new = not {"agvKinematic", "agvClass"} & set(about) and not {"speedMax", "accelerationMax"} & set(body)
        figures = self._body(body)
        geometry = self.fields.object(document, word("", "mobileRobotGeometry", self.is_new), "", {})
        middle_m, with_load = self._envelopes(geometry, figures)
        wheels = self._kinematics(about, geometry, document, middle_m, figures["length_m"])
        if wheels.kind != "differential":
            figures.pop("turn_rate_rad_s", None)
        elif "turn_rate_rad_s" not in figures:
            figures["turn_rate_rad_s"] = self._guess("turn_rate_rad_s", "the sheet does not say it")
        loads = self._loads(document, figures, middle_m, with_load)
        manufacturer = self.fields.text(document, "manufacturer", "", "")
        series = self.fields.text(about, "seriesName", SPECIFICATION, "")
        name = ".".join(part for part in (manufacturer, series) if part)
        source = self.fields.text(about, "seriesDescription", SPECIFICATION, "") or f"VDA 5050 factsheet of {name or self.path.name}"
        most_kg = self.fields.number(about, self._word(SPECIFICATION, "maximumLoadMass"), SPECIFICATION, 0.0) or loads.pop("most_kg", 0.0)
        loads.pop("most_kg", None)
        try:
            robot = RobotType(
                self.path.stem,
                **figures,
                vehicle_type="" if manufacturer == MANUFACTURER else name,
                kinematics=wheels,
                max_load_kg=most_kg or None,
                source=source,
                **loads,
            )
        except OptionError as error:
            raise MrpSumoError(f"{shortened(self.path)}: {error}") from None
        return robot, self.notes

    def _word(self, section: str, key: str) -> str:
        return word(section, key, self.is_new)

    def _guess(self, key: str, why: str) -> float:
        self.notes.append(f"guessed: {key} {GUESSED[key]:g}, as {why}")
        return GUESSED[key]

    def _body(self, body: Mapping[str, Any]) -> dict[str, Any]:
        figures: dict[str, Any] = {}
        for key, member in FIGURES.items():
            said = self._word(BODY, member)
            value = abs(self.fields.number(body, said, BODY, 0.0)) if key in GUESSED else self.fields.number(body, said, BODY)
            if value <= 0 and key not in GUESSED:
                raise self.fields.fault(f"{BODY}.{said}", f"found {value:g}, expected more than 0")
            figures[key] = value or self._guess(key, f"{BODY}.{said} is 0 or missing")
        if rate := self.fields.number(body, "maximumAngularSpeed", BODY, 0.0):
            figures["turn_rate_rad_s"] = rate
        return figures

    def _envelopes(self, geometry: Mapping[str, Any], figures: dict[str, Any]) -> tuple[float, dict[str, float]]:
        """Middle of the body ahead of the origin, and length and width with a load. A body that is drawn larger is that large."""
        at = self._word("", "mobileRobotGeometry")
        boxes: dict[bool, tuple[float, float, float, float]] = {}
        for where, envelope in self.fields.each(geometry, "envelopes2d", at, []):
            name, points = (self._word("envelopes2d", key) for key in ("envelope2dId", "vertices"))
            of = self.fields.text(envelope, name, where, "")
            vertices = self.fields.each(envelope, points, where)
            places = [(self.fields.number(p, "x", on), self.fields.number(p, "y", on)) for on, p in vertices]
            if len(places) < 3:
                raise self.fields.fault(f"{where}.{points}", f"found {len(places)} points, expected 3 or more")
            x, y = zip(*places)
            box = (min(x), max(x), min(y), max(y))
            if _area_m2(places) < 0.98 * (box[1] - box[0]) * (box[3] - box[2]):
                self.notes.append(f"left out: the shape of envelope '{of[:40]}', of which its length and width are taken")
            loaded = "load" in of.lower() and not re.search(r"un-?_?load", of.lower())
            before = boxes.get(loaded, box)
            boxes[loaded] = (min(box[0], before[0]), max(box[1], before[1]), min(box[2], before[2]), max(box[3], before[3]))
        middle_m = 0.0
        if body := boxes.get(False):
            middle_m = (body[0] + body[1]) / 2
            for key, size_m in (("length_m", body[1] - body[0]), ("width_m", 2 * max(abs(body[2]), abs(body[3])))):
                if size_m > figures[key] + SAME_M:
                    self.notes.append(f"{key} is {size_m:g}, as the envelope is larger than {BODY}.{FIGURES[key]}, {figures[key]:g}")
                    figures[key] = round(size_m, 6)
        if not (both := boxes.get(True)):
            return middle_m, {}
        return middle_m, {"length_m": 2 * max(both[1] - middle_m, middle_m - both[0]), "width_m": 2 * max(abs(both[2]), abs(both[3]))}

    def _kinematics(
        self, about: Mapping[str, Any], geometry: Mapping[str, Any], document: Mapping[str, Any], middle_m: float, length_m: float
    ) -> Wheels:
        member = self._word(SPECIFICATION, "mobileRobotKinematics")
        said = self.fields.text(about, member, SPECIFICATION)
        kind = next((new for new, old in KINEMATICS.items() if said in (new, old)), None)
        if kind is None:
            known = KINEMATICS if self.is_new else list(KINEMATICS.values())
            raise self.fields.fault(
                f"{SPECIFICATION}.{member}", f"found '{said[:40]}', expected {', '.join(known)}{nearest(said[:40], known)}"
            )
        if kind != "THREE_WHEEL":
            return Wheels("omni") if kind == "OMNIDIRECTIONAL" else DIFFERENTIAL
        figures = self._axles(geometry, middle_m, length_m)
        is_tugger = self.fields.text(about, self._word(SPECIFICATION, "mobileRobotClass"), SPECIFICATION, "") == "TUGGER"
        if is_tugger:
            self.notes.append("left out: trailers, which a factsheet does not list")
            figures["kind"] = "tugger"
        features = self.fields.object(document, "protocolFeatures", "", {})
        listed = self.fields.each(features, "optionalParameters", "protocolFeatures", [])
        optional = [one for _, one in listed if one.get("parameter") == ORIENTATION]
        figures["reverse"] = bool(optional)
        if optional:
            figures["reverse_mps"] = _figure(optional[0].get("description"), "reverse_mps")
        elif not is_tugger:
            self.notes.append(f"guessed: kinematics.reverse false, as optionalParameters do not list {ORIENTATION}")
        try:
            return Wheels(**figures)
        except OptionError as error:
            raise MrpSumoError(f"{shortened(self.path)}: {self._word('', 'mobileRobotGeometry')}: {error}") from None

    def _axles(self, geometry: Mapping[str, Any], middle_m: float, length_m: float) -> dict[str, Any]:
        """Wheelbase, steering and axle of what has a steered axle and one that does not steer."""
        at = self._word("", "mobileRobotGeometry")
        steered, fixed, most_rad = [], [], None
        for where, wheel in self.fields.each(geometry, "wheelDefinitions", at, []):
            place = self.fields.object(wheel, "position", where)
            x_m = self.fields.number(place, "x", f"{where}.position")
            if wheel.get("isActiveSteered") is True:
                steered.append(x_m)
                most_rad = _figure(wheel.get("constraints"), "steering_max_rad") or most_rad
            elif wheel.get("type") in ("FIXED", "DRIVE"):
                fixed.append(x_m)
        if most_rad is None:
            self.notes.append(f"guessed: kinematics.steering_max_rad {STEERING_RAD:g}, which a factsheet has no member for")
        figures: dict[str, Any] = {"kind": "ackermann" if len(steered) > 1 else "tricycle", "steering_max_rad": most_rad or STEERING_RAD}
        if not steered or not fixed:
            figures["wheelbase_m"] = round(WHEELBASE * length_m, 3)
            what = f"{at}.wheelDefinitions has no {'steered' if fixed else 'fixed'} wheel"
            self.notes.append(f"guessed: kinematics.wheelbase_m {figures['wheelbase_m']:g}, as {what}")
            return figures
        front_m, axle_m = sum(steered) / len(steered), sum(fixed) / len(fixed)
        is_rear = front_m > axle_m
        behind_m = middle_m - axle_m if is_rear else axle_m - middle_m
        if behind_m < -SAME_M:
            self.notes.append(f"kinematics.axle_m is 0: the fixed axle is {-behind_m:.2f} m on the other side of the middle of the body")
        base_m, behind_m = round(abs(front_m - axle_m), 6), round(max(behind_m, 0.0), 6)
        figures |= {"wheelbase_m": base_m, "fixed_axle": "rear" if is_rear else "front"}
        return figures | ({"axle_m": behind_m} if abs(behind_m - base_m / 2) > SAME_M else {})

    def _loads(self, document: Mapping[str, Any], figures: dict[str, Any], middle_m: float, with_load: dict[str, float]) -> dict[str, Any]:
        """Figures with a load, actions and capacity; the strictest of several load sets."""
        fields, at = self.fields, "loadSpecification"
        about = fields.object(document, at, "", {})
        positions = fields.list(about, "loadPositions", at, [])
        limits: dict[str, list[float]] = {}
        times: dict[str, list[float]] = {}
        weights: list[float] = []
        for where, one in fields.each(about, "loadSets", at, []):
            of = {key: abs(fields.number(one, self._word("loadSets", member), where, 0.0)) for key, member in list(FIGURES.items())[2:]}
            weight = fields.number(one, self._word("loadSets", "maximumWeight"), where, 0.0)
            if fields.text(one, "setName", where, "") == EMPTY:
                figures |= {key: value for key, value in of.items() if value and key in GUESSED} if not weight else {}
                continue
            weights.append(weight)
            for key, value in of.items():
                limits.setdefault(key, []).extend([value] * (value > 0))
            for action, member in (("pick", "pickTime"), ("drop", "dropTime")):
                times.setdefault(action, []).extend([t] if (t := fields.number(one, member, where, 0.0)) > 0 else [])
            self._load_box(one, where, middle_m, with_load)
        if len(weights) > 1:
            self.notes.append(f"the strictest limits and longest times of {len(weights)} load sets hold for all loads")
        loaded: dict[str, float] = {}
        for key, name in (("max_speed_mps", "speed_mps"), ("accel_mps2", "accel_mps2"), ("decel_mps2", "decel_mps2")):
            if limits.get(key) and min(limits[key]) < figures[key]:
                loaded[name] = min(limits[key])
        loaded |= {key: round(size_m, 6) for key, size_m in with_load.items() if size_m > figures[key] + SAME_M}
        actions = {action: ServiceTime(constant_s=max(of)) for action, of in times.items() if of}
        return {
            "loaded": Loaded(**loaded) if loaded else None,
            "actions": Actions(**actions) if actions else None,
            "capacity": max(1, len(positions)),
            "most_kg": max(weights, default=0.0),
        }

    def _load_box(self, one: Mapping[str, Any], where: str, middle_m: float, with_load: dict[str, float]) -> None:
        """Have the body with a load cover a load set's box."""
        box = self.fields.object(one, "loadDimensions", where, None)
        if box is None:
            return
        place = self.fields.object(one, "boundingBoxReference", where, {})
        x_m, y_m, theta = (self.fields.number(place, key, f"{where}.boundingBoxReference", 0.0) for key in ("x", "y", "theta"))
        x_m = x_m if place else middle_m
        size = [self.fields.number(box, key, f"{where}.loadDimensions") for key in ("length", "width")]
        along, across = abs(math.cos(theta)), abs(math.sin(theta))
        for key, offset_m, reach_m in (
            ("length_m", x_m - middle_m, (along * size[0] + across * size[1]) / 2),
            ("width_m", y_m, (across * size[0] + along * size[1]) / 2),
        ):
            with_load[key] = max(with_load.get(key, 0.0), 2 * (abs(offset_m) + reach_m))


def _series(robot: RobotType) -> tuple[str, str]:
    manufacturer, _, series = robot.in_layouts.partition(".")
    return (manufacturer, series) if series else (MANUFACTURER, manufacturer)


def _differs(of: Any, key: str) -> bool:
    """True if a figure is not the default."""
    each = type(of).__dataclass_fields__[key]
    return bool(getattr(of, key) != (each.default if each.default_factory is MISSING else each.default_factory()))


def _wheels(robot: RobotShape) -> list[Json]:
    """The fixed axle, as one wheel in its middle, and the steered wheel or wheels. Their sizes are not known: 0."""
    wheels, base_m = robot.kinematics, robot.kinematics.wheelbase_m or 0.0
    axle_m = -wheels.ahead_m
    steered_m = axle_m + (base_m if wheels.fixed_axle == "rear" else -base_m)
    sides_m = (robot.width_m / 2, -robot.width_m / 2) if wheels.kind == "ackermann" else (0.0,)
    size = {"diameter": 0.0, "width": 0.0}
    fixed = {"type": "FIXED", "isActiveDriven": False, "isActiveSteered": False, "position": _point(axle_m, 0.0) | {"theta": 0.0}, **size}
    limit = {"constraints": f"steering_max_rad: {wheels.steering_max_rad}"}
    turned = [
        {"type": "DRIVE", "isActiveDriven": True, "isActiveSteered": True, "position": _point(steered_m, y_m), **size, **limit}
        for y_m in sides_m
    ]
    return [fixed, *turned]


def _envelopes(robot: RobotShape) -> Iterator[Json]:
    """Rectangles around the body, and around body and load where that is larger."""
    bodies = {EMPTY: robot, LOADED: robot.with_load}
    for name, body in bodies.items():
        if name == EMPTY or (body.length_m, body.width_m) != (robot.length_m, robot.width_m):
            x_m, y_m = body.length_m / 2, body.width_m / 2
            corners = ((x_m, y_m), (-x_m, y_m), (-x_m, -y_m), (x_m, -y_m))
            yield {"envelope2dId": name, "vertices": [_point(*corner) for corner in corners]}


def _load_sets(robot: RobotShape) -> Iterator[Json]:
    """One set for all loads, and one of no weight where accelerations are others without."""
    loaded, with_load = robot.loaded or Loaded(), robot.with_load
    limits = {"maximumWeight": robot.max_load_kg, "maximumSpeed": loaded.speed_mps}
    limits |= {"maximumAcceleration": loaded.accel_mps2, "maximumDeceleration": loaded.decel_mps2}
    one: Json = {key: value for key, value in limits.items() if value is not None}
    for action, member in (("pick", "pickTime"), ("drop", "dropTime")):
        if robot.actions is not None and (time := getattr(robot.actions, action)) is not None:
            one[member] = round(time.mean_s, 6)
    if one:
        yield {"setName": LOADED, "loadType": "ANY", **one}
    if (with_load.accel_mps2, with_load.decel_mps2) != (robot.accel_mps2, robot.decel_mps2):
        both = {"maximumAcceleration": robot.accel_mps2, "maximumDeceleration": robot.decel_mps2}
        yield {"setName": EMPTY, "loadType": "NONE", "maximumWeight": 0.0, **both}


def _protocol_limits(new: bool, limits: VehicleLimits | None) -> Json:
    strings: Json = {}
    arrays: Json = {}
    if limits is not None:
        names = ("maximumMessageLength", "maximumIdLength") if new else ("msgLen", "idLen")
        strings = dict(zip(names, (limits.payload, limits.identifier)))
        arrays = dict.fromkeys(("order.nodes", "order.edges"), limits.nodes)
        arrays |= dict.fromkeys(("node.actions", "edge.actions", "instantActions"), limits.actions)
    least = {"minimumOrderInterval": 0.0, "minimumStateInterval": 0.0} if new else {"minOrderInterval": 0.0, "minStateInterval": 0.0}
    return {
        "maximumStringLengths" if new else "maxStringLens": strings,
        "maximumArrayLengths" if new else "maxArrayLens": arrays,
        "timing": least,
    }


def _point(x_m: float, y_m: float) -> Json:
    return {"x": round(x_m, 6), "y": round(y_m, 6)}


def _figure(text: Any, key: str) -> float | None:
    """A figure that free text says as `key: 1.2`."""
    said = re.search(rf"\b{key}\s*[:=]\s*([0-9]+(?:\.[0-9]+)?)", text) if isinstance(text, str) else None
    return float(said[1]) if said else None


def _area_m2(places: Sequence[tuple[float, float]]) -> float:
    return abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(places, [*places[1:], places[0]]))) / 2
