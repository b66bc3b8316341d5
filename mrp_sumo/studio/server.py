"""The web server of a workbench, on this machine alone: its page, the folder's files, checks, and the commands that it starts.

Every address begins with a token that nobody can guess. What a page of the folder says runs in a sandbox, since it may be anybody's.
"""

import http.client
import json
from collections.abc import Callable, Mapping
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, quote, urlsplit

from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.reading import read_json, read_text
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.robots import robot_type
from mrp_sumo.maps.catalogue import bundled_folder, bundled_maps
from mrp_sumo.reports.replay.constants import constants_module, css_variables
from mrp_sumo.reports.replay.page import page_of
from mrp_sumo.studio import scenarios
from mrp_sumo.studio.answers import curve, paired, waits
from mrp_sumo.studio.commands import first_map, words_of
from mrp_sumo.studio.findings import check, drawn
from mrp_sumo.studio.jobs import ADDRESS, Jobs
from mrp_sumo.studio.workspace import Stale, Workspace, lanes_over_floor
from mrp_sumo.wire.gate import PATIENCE_S, LocalHandler, LocalServer

MOST_BYTES = 32 * 2**20  # of what a page sends
BLOCK_BYTES = 2**16
SHARED = ("elements.js",)  # scripts of the replay page
FRAMED = "frame-ancestors 'self'"  # by pages of this server
SANDBOX = f"sandbox; {FRAMED}"  # which runs no scripts
KINDS = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8", ".html": "text/html; charset=utf-8"}
DEFAULT_ROBOT = "turtlebot3"
Values = Mapping[str, Any]


class Studio:
    """A workbench over one folder."""

    def __init__(self, root: Path, opened: str, port: int = 0) -> None:
        """The page opens something at first, '' for nothing, at a port, 0 for any. Raises MrpSumoError where the port cannot be had."""
        self.workspace = Workspace(root.resolve())
        self.opened = opened
        self.jobs = Jobs(self.workspace.root)
        self.server = LocalServer(port, type("Handler", (_Handler,), {"studio": self}))

    @property
    def address(self) -> str:
        return self.server.address

    def close(self) -> None:
        """End its commands, and let go of the port."""
        self.jobs.close()
        self.server.server_close()

    # what the page asks for

    def start_page(self, _: Values) -> Any:
        """All that the page begins with."""
        return {
            "folder": self.workspace.root.name or str(self.workspace.root),
            "opened": self.opened,
            "bundled": sorted(bundled_maps()),
            "robots": sorted(path.stem for path in bundled_folder("robots").glob("*.yaml")),
            "fields": self.fields,
        }

    @cached_property
    def fields(self) -> list[dict[str, Any]]:
        """The options of scenarios."""
        return scenarios.fields()

    def files(self, _: Values) -> Any:
        return self.workspace.files()

    def open(self, values: Values) -> Any:
        """A map or a plan as a drawing."""
        return self.workspace.open(_text(values, "path"), _chosen(values))

    def layers(self, values: Values) -> Any:
        """Layers of a plan, to choose from."""
        return self.workspace.layers(_text(values, "path"))

    def digest(self, values: Values) -> Any:
        """The digest of a file, for pages that have it open."""
        return {"digest": self.workspace.digest(_text(values, "path"))}

    def text(self, values: Values) -> Any:
        """A text, and its digest."""
        name = _text(values, "path")
        text = read_text(self.workspace.path(name), scenarios.MOST_BYTES)
        return {"text": text, "digest": self.workspace.digest(name), "fault": scenarios.fault_of(self.workspace.path(name), text)}

    def check(self, values: Values) -> Any:
        """Findings about a drawing."""
        return check(values.get("document"), self.workspace.path(_text(values, "path")), self._robot(values.get("robot")))

    def save(self, values: Values) -> Any:
        name = _text(values, "path")
        digest, like = str(values.get("digest", "")), str(values.get("like", ""))
        return {"digest": self.workspace.save_drawing(name, values.get("document"), digest, like)}

    def save_text(self, values: Values) -> Any:
        name, text = _text(values, "path"), str(values.get("text", ""))
        digest = self.workspace.save_text(name, text, str(values.get("digest", "")))
        return {"digest": digest, "fault": scenarios.fault_of(self.workspace.path(name), text)}

    def scenario(self, values: Values) -> Any:
        """A scenario's text, with another value where a key is named, what it says, and its first fault."""
        path, text = self.workspace.path(_text(values, "path")), str(values.get("text", ""))
        if "key" in values:
            text = scenarios.with_value(path, text, str(values["key"]), values.get("value"))
        return {"text": text, "values": scenarios.values_of(path, text), "fault": scenarios.fault_of(path, text)}

    def propose(self, values: Values) -> Any:
        """Lanes wherever a robot has room, over a plan; walls of a picture, too."""
        pitch_m, radius_m = (_number(values, key) for key in ("pitch_m", "radius_m"))
        return lanes_over_floor(self.workspace, _text(values, "plan"), _chosen(values), pitch_m, radius_m)

    def start(self, values: Values) -> Any:
        words, out = words_of(self.workspace, values)
        return self.jobs.start(words, out).document()

    def stop(self, values: Values) -> Any:
        """End a command."""
        job = self.jobs.of(str(values.get("number", "")))
        job.stop()
        return job.document()

    def commands(self, _: Values) -> Any:
        return self.jobs.documents()

    def curve(self, values: Values) -> Any:
        """Points of a study so far, and its answer, where it has one."""
        folder = self.workspace.path(_text(values, "out"))
        answer = read_json(folder / "answer.json") if (folder / "answer.json").is_file() else {}
        return {**curve(folder), "answer": answer.get("answer")}

    def paired(self, values: Values) -> Any:
        """The difference between two variants on the same orders."""
        name = _text(values, "out")
        return {"out": name, **paired(self.workspace.path(name), first_map(self.workspace, name))}

    def waits(self, values: Values) -> Any:
        """Places where robots of a run stood and waited, and for how long, on a drawing of its map."""
        name = _text(values, "path")
        xy, waited_s = waits(load_run(self.workspace.path(_text(values, "run"))))
        drawing = self.workspace.open(name, {})
        places = drawn(xy, drawing["document"], self.workspace.path(name))
        return {"places": [[*place, round(seconds, 1)] for place, seconds in zip(places, waited_s.tolist())]}

    def _robot(self, name: object) -> RobotType:
        return robot_type(str(name or DEFAULT_ROBOT), bundled_folder("robots"), self.workspace.root)


Answer = Callable[[Studio, Values], Any]


def _by_name(*answers: Answer) -> dict[str, Answer]:
    return {answer.__name__: answer for answer in answers}


GETS = {"start": Studio.start_page} | _by_name(
    Studio.files, Studio.open, Studio.layers, Studio.digest, Studio.text, Studio.commands, Studio.curve, Studio.paired, Studio.waits
)
POSTS = _by_name(Studio.check, Studio.save, Studio.save_text, Studio.scenario, Studio.propose, Studio.start, Studio.stop)


class _Handler(LocalHandler):
    studio: Studio
    policy = FRAMED

    def do_GET(self) -> None:
        place = self.place()
        if place is None:
            return
        values = dict(parse_qsl(urlsplit(self.path).query))
        if place.startswith("api/"):
            self._ask(GETS, place.removeprefix("api/"), values)
        elif place.startswith("live/"):
            self._relay(place.removeprefix("live/"), None)
        elif place == "picture":
            self._show(lambda: self.studio.workspace.picture(_text(values, "path")))
        elif place == "replay":
            self._show(lambda: (KINDS[".html"], page_of(load_run(self.studio.workspace.path(_text(values, "run")))).encode()))
        elif place == "page":
            self._show(lambda: (KINDS[".html"], _page_of_folder(self.studio.workspace.path(_text(values, "path")))), SANDBOX)
        else:
            self._own(place or "page.html")

    def do_POST(self) -> None:
        place = self.place()
        if place is None:
            return
        size = int(self.headers.get("Content-Length") or 0)
        if size > MOST_BYTES:
            self.close_connection = True
            self._say(413, {"error": f"{size} bytes, expected at most {MOST_BYTES}"})
            return
        data = self.rfile.read(size)
        if place.startswith("live/"):
            self._relay(place.removeprefix("live/"), data)
            return
        if place == "add":
            name = dict(parse_qsl(urlsplit(self.path).query)).get("path", "")
            self._ask({place: lambda studio, _: studio.workspace.add(name, data)}, place, {})
            return
        try:
            values = json.loads(data or b"{}")
        except (ValueError, RecursionError):
            values = None
        if not isinstance(values, dict):
            self._say(400, {"error": "expected an object of JSON"})
            return
        self._ask(POSTS, place.removeprefix("api/"), values)

    def _ask(self, known: Mapping[str, Answer], name: str, values: Values) -> None:
        if name not in known:
            self._say(404, {"error": "not here"})
            return
        try:
            said = known[name](self.studio, values)
        except Stale as error:
            self._say(409, {"error": str(error)})
        except MrpSumoError as error:
            self._say(400, {"error": str(error)})
        except OSError as error:
            self._say(400, {"error": f"{Path(str(error.filename or '')).name}: {error.strerror}"})
        else:
            self._say(200, said)

    def _say(self, status: int, said: Any) -> None:
        self.answer(status, "application/json", json.dumps(said, separators=(",", ":"), allow_nan=False).encode())

    def _show(self, made: Callable[[], tuple[str, bytes]], policy: str = FRAMED) -> None:
        try:
            kind, body = made()
        except (MrpSumoError, OSError) as error:
            self.answer(400, "text/plain; charset=utf-8", str(error).encode())
            return
        self.policy = policy
        self.answer(200, kind, body)

    def _own(self, name: str) -> None:
        if name == "constants.js":
            self.answer(200, KINDS[".js"], constants_module().encode())
            return
        folder = resources.files("mrp_sumo.reports.replay") if name in SHARED else resources.files("mrp_sumo.studio") / "page"
        if "/" in name or Path(name).suffix not in KINDS or not (folder / name).is_file():
            self.answer(404, "text/plain; charset=utf-8", b"not here")
            return
        text = (folder / name).read_text(encoding="utf-8")
        if name == "page.css":
            text = text.replace("{{light}}", css_variables("light")).replace("{{dark}}", css_variables("dark"))
        self.answer(200, KINDS[Path(name).suffix], text.encode())

    def _relay(self, place: str, data: bytes | None) -> None:
        """Hand a request on to the live view of a run that this workbench started, and hand its answer back as it comes."""
        number, _, rest = place.partition("/")
        try:
            match = ADDRESS.match(self.studio.jobs.of(number).address)
        except MrpSumoError:
            match = None
        if match is None:
            self.answer(404, "text/plain; charset=utf-8", b"the run is over")
            return
        behind = http.client.HTTPConnection("127.0.0.1", int(match[1]), timeout=None if rest == "events" else PATIENCE_S)
        try:
            behind.request("GET" if data is None else "POST", f"/{match[2]}/{quote(rest)}", data)
            answer = behind.getresponse()
            self.send_response(answer.status)
            for name in ("Content-Type", "Content-Length"):
                if value := answer.getheader(name):
                    self.send_header(name, value)
            self.send_safe_headers()
            self.end_headers()
            while block := answer.read1(BLOCK_BYTES):
                self.wfile.write(block)
                self.wfile.flush()
        except (OSError, http.client.HTTPException):
            pass  # one of the two has gone
        finally:
            self.close_connection = True
            behind.close()


def _page_of_folder(path: Path) -> bytes:
    if path.suffix != ".html" or not path.is_file():
        raise MrpSumoError(f"{path.name}: no page")
    return path.read_bytes()


def _chosen(values: Values) -> dict[str, Any]:
    """Layers, unit, scale and page of a plan, as `load_map` has them."""
    chosen: dict[str, Any] = {"unit": values["unit"]} if values.get("unit") else {}
    if text := values.get("layers"):
        try:
            layers = json.loads(text)
        except (ValueError, RecursionError):
            layers = None
        if not isinstance(layers, list):
            raise MrpSumoError("layers: expected a list")
        chosen["layers"] = tuple(map(str, layers))
    for key, name, kind in (("scale", "meters_per_pixel", float), ("page", "page", int)):
        if key in values:
            try:
                chosen[name] = kind(values[key])
            except (TypeError, ValueError):
                raise MrpSumoError(f"{key}: found '{str(values[key])[:40]}', expected a number") from None
    return chosen


def _text(values: Values, key: str) -> str:
    value = values.get(key)
    if not isinstance(value, str) or not value:
        raise MrpSumoError(f"{key}: expected text")
    return value


def _number(values: Values, key: str) -> float:
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MrpSumoError(f"{key}: expected a number")
    return float(value)
