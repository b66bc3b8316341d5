"""A batch under way as a page that fills: how many runs are done, how they ended, which are still to come."""

import html
from collections.abc import Callable
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import Any

from mrp_sumo.errors import BatchError
from mrp_sumo.experiments.batch import is_under_way
from mrp_sumo.io.results import read_plan, read_record, record_files
from mrp_sumo.reports.live.broadcast import Broadcast
from mrp_sumo.reports.live.server import LiveServer


class BatchView:
    """Shows the folder of one batch to a browser. Records are read once each."""

    def __init__(self, folder: Path, port: int = 0) -> None:
        """Raises BatchError for a folder of no batch, MrpSumoError where the port cannot be had."""
        plan = read_plan(folder)
        self.folder, self.suite = folder, plan["suite"]
        self._number = {key: k for k, key in enumerate(plan["keys"])}
        self._seen: set[str] = set()  # files
        self._ended: list[str] = []  # when runs did
        self._said = ""  # of the batch's state
        self.num_done = 0
        self.broadcast = Broadcast()
        self.server = LiveServer(self.broadcast, port)
        text = (resources.files("mrp_sumo.reports.live") / "batch.html").read_text(encoding="utf-8")
        self.server.page = text.replace("{{title}}", html.escape(self.suite)).replace("{{size}}", str(len(self._number))).encode()
        self.server.start()

    @property
    def num_runs(self) -> int:
        return len(self._number)

    @property
    def state(self) -> str:
        return "complete" if self.num_done == self.num_runs else "under way" if is_under_way(self.folder) else "not under way"

    def look(self, report: Callable[[str], None]) -> None:
        """Say what is new; `report` is called with a line for each file that cannot be used."""
        runs: list[list[Any]] = []
        for path in [path for path, _ in record_files(self.folder) if path not in self._seen]:
            self._seen.add(path)
            try:
                record = read_record(Path(path))
            except BatchError as error:
                report(f"{error}; left out")
                continue
            if (number := self._number.get(record["key"])) is None:
                continue
            planner = (record["scenario"].get("planner") or {}).get("name", "")
            runs.append([number, record["status"], bool(record["success"]), planner, str(record["reason"])[:200]])
            self._ended.append(record["ended_at"])
        self.num_done += len(runs)
        state = self.state
        if runs or state != self._said:
            self._said = state
            self.broadcast.say("runs", {"runs": runs, "state": state, "left_s": self._left_s() if state == "under way" else None})

    def close(self) -> None:
        """Nothing more comes."""
        self.broadcast.say_last(None)
        self.broadcast.end()
        self.server.close()

    def _left_s(self) -> float | None:
        """How long what is missing takes at the rate of late; None where that is not known."""
        late = sorted(self._ended)[-50:]
        if len(late) < 2:
            return None
        first, last = (datetime.fromisoformat(ended_at) for ended_at in (late[0], late[-1]))
        rate = (len(late) - 1) / max((last - first).total_seconds(), 1.0)  # as they are known to a second
        return (self.num_runs - self.num_done) / rate
