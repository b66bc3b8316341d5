"""Step-wise planners that are other programs: one line of JSON in, one line of JSON out, for each step.

The program is started by its command, without a shell. First it is sent a line about the problem: `rows` of the map ('.' is free), `start`
cells (row x width + column), `seed`. Then, for each step, a line with `time`, `cell` and `heading` of each robot (0 east, 1 south,
2 west, 3 north), `task_of` (-1: none), and `pool`: for each task that is revealed its number, the cells of its errands that are left,
and whether it is open. It answers each of these with a line that has `actions`, a letter a robot (F forward, R right, L left,
W wait) in one string, or numbers 0 to 3, and, if it wants to choose them, `tasks`. Its input ends with the last step. What it prints
on stderr is shown. Refuses commands that cannot be started, answers that are none, and those that come too late.
"""

import json
import os
import select
import shlex
import subprocess
import weakref
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, process_time
from typing import Any

import numpy as np

from mrp_sumo.core.children import kill_family
from mrp_sumo.core.step_wise import StepWiseProblem
from mrp_sumo.errors import PlanError, PlugInError
from mrp_sumo.planning.step_wise import Decision, Observation, tasks_in_turn

LETTERS = {letter: number for number, letter in enumerate("FRLW")}
MOST_BYTES = 2**26  # of an answer


@dataclass(frozen=True)
class StepProgram:
    """Another program, asked with a line of JSON in each step."""

    command: str = ""  # such as "python policy.py"
    limit_s: float = 10.0  # wall time for an answer, the first one included; what is later ends the run

    def __post_init__(self) -> None:
        if not self.words:
            raise PlanError('no command, expected one such as command="python policy.py"')
        if not self.limit_s > 0:
            raise PlanError(f"limit_s is {self.limit_s}, expected more than 0")

    @property
    def words(self) -> list[str]:
        """The command, split as a shell does."""
        try:
            return shlex.split(self.command)
        except ValueError as error:
            raise PlanError(f"command '{self.command}': {error}") from None

    def prepare(self) -> None:
        """There is nothing to compile."""

    def begin(self, problem: StepWiseProblem, seed: int) -> "Conversation":
        """The program at work."""
        return Conversation(self.words, problem, seed, self.limit_s)


class Conversation:
    """A program that runs, and is asked."""

    def __init__(self, words: list[str], problem: StepWiseProblem, seed: int, limit_s: float) -> None:
        self._name, self._limit_s, self._buffer = Path(words[0]).name, limit_s, b""
        try:
            self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        except OSError as error:
            raise PlanError(f"'{words[0]}' cannot be started: {error.strerror}") from None
        self.close = weakref.finalize(self, _end, self._process)
        rows = ["".join("." if free else "@" for free in row) for row in problem.free.tolist()]
        self._send({"rows": rows, "start": problem.start.tolist(), "seed": seed}, 0)

    def cpu_s(self) -> float:
        """CPU time of this process and of the program so far."""
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:  # it is gone, or this is no Linux
            return process_time()
        return process_time() + (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def step(self, seen: Observation) -> Decision:
        """See Stepper."""
        pool = [
            {"task": task, "errands": seen.errands_left(task).tolist(), "open": done > 0}  # in the order of their numbers
            for task, done in sorted(seen.pool.items())
        ]
        about = {"time": seen.time, "cell": seen.cell.tolist(), "heading": seen.heading.tolist(), "task_of": seen.task_of.tolist()}
        self._send({**about, "pool": pool}, seen.time)
        return self._decision(self._line(seen.time), seen)

    def _decision(self, line: bytes, seen: Observation) -> Decision:
        try:
            answer = json.loads(line)
        except ValueError:
            answer = None
        if not isinstance(answer, dict) or "actions" not in answer:
            text = line.decode(errors="replace").strip()[:80]
            raise self._fault(f"answers {text!r}, expected a JSON object with actions", seen.time)
        chosen, num_robots = answer["actions"], seen.problem.num_robots
        actions = self._numbers([LETTERS.get(a, -1) for a in chosen] if isinstance(chosen, str) else chosen, "actions", 3, seen)
        if answer.get("tasks") is None:
            return Decision(actions.astype(np.int8), tasks_in_turn(seen))
        tasks = self._numbers(answer["tasks"], f"tasks (-1 for none) of {num_robots} robots", np.iinfo(np.int64).max, seen, least=-1)
        return Decision(actions.astype(np.int8), tasks)

    def _numbers(self, numbers: Any, what: str, most: int, seen: Observation, least: int = 0) -> np.ndarray:
        num_robots = seen.problem.num_robots
        if not isinstance(numbers, list) or len(numbers) != num_robots:
            shape = f"{len(numbers)} of them" if isinstance(numbers, list) else type(numbers).__name__
            raise self._fault(f"{what}: found {shape}, expected {num_robots}", seen.time)
        wrong = next((r for r, v in enumerate(numbers) if isinstance(v, bool) or not isinstance(v, int) or not least <= v <= most), None)
        if wrong is not None:
            raise self._fault(f"{what}: robot {wrong} has none that there is", seen.time)
        return np.array(numbers, np.int64)

    def _send(self, document: dict[str, Any], time: int) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(document, separators=(",", ":")).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            raise self._fault(self._ending(), time) from None

    def _line(self, time: int) -> bytes:
        """The next line, without blocking for longer than the limit."""
        assert self._process.stdout is not None
        pipe, until_s = self._process.stdout.fileno(), monotonic() + self._limit_s
        while b"\n" not in self._buffer:
            ready, _, _ = select.select([pipe], [], [], max(0.0, until_s - monotonic()))
            if not ready:
                raise self._fault(f"has not answered within {self._limit_s:g} s", time)
            part = os.read(pipe, 65536)
            if not part:
                raise self._fault(self._ending(), time)
            self._buffer += part
            if len(self._buffer) > MOST_BYTES:
                raise self._fault(f"answers more than {MOST_BYTES} bytes", time)
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line

    def _ending(self) -> str:
        try:
            return f"ended with exit code {self._process.wait(2)}"
        except subprocess.TimeoutExpired:
            return "closed its output"

    def _fault(self, what: str, time: int) -> PlugInError:
        self.close()
        return PlugInError(f"program '{self._name}', step {time}: {what}")


def _end(process: "subprocess.Popen[bytes]") -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            try:
                pipe.close()
            except OSError:  # what was not sent yet
                continue
    try:
        process.wait(0.2)  # its input has ended
    except subprocess.TimeoutExpired:
        kill_family(process.pid)
        process.wait()
