"""The process of a planner or assigner from outside: loads it, and answers calls over the socket that it inherits.

A call is a tuple of its name and arguments. It is acknowledged when it has arrived, so that its time can be measured from then on, and
answered by (answer, error, seconds): errors travel as one line with the plug-in's file and line.
"""

import sys
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

from mrp_sumo.core.children import connection_to_parent
from mrp_sumo.errors import MrpSumoError, PlanError, PlugInError, ScenarioError
from mrp_sumo.planning.answer_check import WrongAnswer, checked_assignment, checked_result
from mrp_sumo.plugins.description import describe
from mrp_sumo.plugins.face import place_of
from mrp_sumo.plugins.kinds import KINDS
from mrp_sumo.plugins.registry import made
from mrp_sumo.plugins.source import Source, blamed
from mrp_sumo.plugins.trust import trust_everything


class _Server:
    """A plug-in and the calls that can be made to it."""

    plug_in: Any
    source: Source

    def load(self, kind: str, source: Source, parameters: dict[str, Any]) -> dict[str, Any]:
        """Facts that the caller needs of it."""
        self.source = source
        self.plug_in = made(KINDS[kind], source, parameters)
        places = {name: place_of(getattr(self.plug_in, name)) for name in ("prepare", "plan", "assign") if hasattr(self.plug_in, name)}
        return {"places": places, **{name: getattr(self.plug_in, name, None) for name in ("assigns", "guarantee")}}

    def describe(self, kind: str, source: Source, parameters: dict[str, Any]) -> dict[str, Any]:
        """The entry of `mrp-sumo list` about it."""
        self.source = source
        return {"described": describe(KINDS[kind], source)}

    def call(self, name: str, arguments: tuple[Any, ...]) -> tuple[Any, float]:
        """The checked answer, and the seconds that the plug-in took."""
        method = getattr(self.plug_in, name)
        began, cpu_began = perf_counter(), process_time()
        answer = method(*arguments)
        time_s, cpu_s = perf_counter() - began, process_time() - cpu_began
        check: dict[str, Callable[[], Any]] = {
            "plan": lambda: checked_result(answer, arguments[0], time_s, cpu_s, assigns=self.plug_in.assigns),
            "assign": lambda: checked_assignment(answer, arguments[0]),
        }
        try:
            return check[name]() if name in check else None, time_s
        except WrongAnswer as error:
            raise PlugInError(f"{place_of(method)}: {name}() {error}") from None


def main() -> None:
    """Answer calls until there are no more."""
    trust_everything()  # the parent has asked
    connection = connection_to_parent()
    sys.dont_write_bytecode = True  # bytecode knows a change by whole seconds only, and plug-ins are edited
    server = _Server()
    while True:
        try:
            name, *arguments = connection.recv()
        except EOFError:
            return
        connection.send(None)
        answer, time_s = None, 0.0
        error: Exception | None = None
        try:
            if name in ("load", "describe"):
                answer = getattr(server, name)(*arguments)
            else:
                answer, time_s = server.call(name, tuple(arguments))
        except MemoryError:
            error = MemoryError()
        except BaseException as caught:
            error = _travelling(caught, server, name)
        connection.send((answer, error, time_s))


def _travelling(error: BaseException, server: _Server, name: str) -> MrpSumoError:
    """An error as one that every process knows."""
    if isinstance(error, ScenarioError) and name == "load":
        return error
    if isinstance(error, PlanError) and name == "assign":  # there is no assignment
        return PlanError(str(error))
    return blamed(error, server.source, getattr(getattr(server, "plug_in", None), name, None))
