"""The command `mrp-sumo`: finds the subcommand's module, turns expected failures into one line and an exit code.

0: done. 1: the run finished without all robots at their goals, or a check failed. 2: bad input. 130: Ctrl-C. 143: SIGTERM.
A subcommand is a module of this folder with `arguments(parser)` and `run(options) -> exit code`; `options.command_line` are its words.
"""

import argparse
import atexit
import errno
import gc
import logging
import os
import re
import shlex
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from mrp_sumo import __version__
from mrp_sumo.cli.ending import without_loss
from mrp_sumo.cli.printing import say, say_progress, warn
from mrp_sumo.core.children import leave_current_folder
from mrp_sumo.core.interrupts import exit_code, heed_signals
from mrp_sumo.errors import MrpSumoError, PlugInError, nearest, sentence
from mrp_sumo.maps.catalogue import bundled_folder

COMMANDS = {  # subcommand -> (module, help): help stays here so that --help imports no module
    "run": ("mrp_sumo.cli.run", "plan a scenario, execute it in SUMO, measure it, write the run folder"),
    "init": ("mrp_sumo.cli.init", "write a first scenario for a map: stations, orders, fleet, charging"),
    "capacity": ("mrp_sumo.cli.capacity", "find out how many robots fit, and what binds"),
    "import": ("mrp_sumo.cli.import_map", "make a nav graph, a SUMO network and a picture of a map, or a run of a recorded log"),
    "plan": ("mrp_sumo.cli.plan", "plan a scenario or a benchmark instance without driving"),
    "validate": ("mrp_sumo.cli.validate", "check a plan, a log of VDA 5050 messages or a fleet log archive"),
    "convert": ("mrp_sumo.cli.convert", "convert a map, a plan or a type of robots to another format"),
    "generate": ("mrp_sumo.cli.generate", "make a warehouse, grid, ring or random map of any size"),
    "batch": ("mrp_sumo.cli.batch", "make the runs of a suite in parallel; started again, go on where it was"),
    "paper": ("mrp_sumo.cli.paper", "make everything of the MRP-Bench paper and set its numbers beside ours"),
    "status": ("mrp_sumo.cli.status", "show how far a batch is"),
    "query": ("mrp_sumo.cli.query", "query the results of a batch in SQL"),
    "compare": ("mrp_sumo.cli.compare", "compare two result folders run by run; exit code 1 when the second is worse"),
    "reproduce": ("mrp_sumo.cli.reproduce", "make a run or a batch again and say whether every byte is the same"),
    "export": ("mrp_sumo.cli.export", "make a bag, CSV, GeoJSON, FCD, VDA 5050 messages or an archive of a run"),
    "analyze": ("mrp_sumo.cli.analyze", "compute MRP-Bench's metrics of a bag, metrics of your own, or the audits of a run again"),
    "calibrate": ("mrp_sumo.cli.calibrate", "make a robot type and disturbances of a fleet's log, each figure with an interval"),
    "predict": ("mrp_sumo.cli.predict", "hold a simulation against a fleet's log: calibrated on its first part, compared on the rest"),
    "vda5050": ("mrp_sumo.cli.vda5050", "let robots be VDA 5050 vehicles at an MQTT broker, or drive such vehicles"),
    "replay": ("mrp_sumo.cli.replay", "write the replay page of a run: one HTML file for any browser"),
    "render": ("mrp_sumo.cli.render", "draw a picture of a moment of a run, or a video"),
    "list": ("mrp_sumo.cli.listing", "list planners, policies, metrics, maps, robots, scenarios, suites, ... with their parameters"),
    "trust": ("mrp_sumo.cli.trust", "let scenarios and suites of a folder run the programs that they name"),
    "warmup": ("mrp_sumo.cli.warmup", "compile all kernels ahead, once after installing"),
    "report": ("mrp_sumo.cli.report", "write a page of tables and charts about a batch or a run"),
    "studio": ("mrp_sumo.cli.studio", "draw a site in the browser, run it, ask it how many robots"),
    "demo": ("mrp_sumo.cli.demo", "see what there is in a minute: a run, a lifelong run, a comparison, on one page"),
    "completion": ("mrp_sumo.cli.completion", "print what lets bash, zsh or fish complete commands and options"),
    "schema": ("mrp_sumo.cli.schema", "print the JSON schema of scenario files"),
}
SLOW = ("run", "init", "plan", "capacity", "batch", "reproduce", "paper", "predict", "report", "studio", "demo", "vda5050")  # to start
MOST = 2**63  # of whole numbers; no number of anything is as large
COLOURS = "\x1b(?!\\[(?:(?:[0-4]|3[1-6])?;?)*m)"  # bold, dim, red, ..., but nothing that hides text
OBEYED = re.compile(f"{COLOURS}|[\x00-\x08\x0b-\x1a\x1c-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")
COLLECT = (100_000, 20, 100)  # rarely: loading libraries makes many objects and no garbage


COMPLAINTS = (  # of argparse, and what is said instead
    (r"argument (.*): invalid int value: (.*)", "{0}: found {1}, expected a whole number"),
    (
        r"argument (.*): invalid float value: ('\d+(?:\.\d+)?\s*(?:s|sec|min|h)')",
        "{0}: found {1}, expected a number of seconds, such as 300",
    ),
    (r"argument (.*): invalid float value: (.*)", "{0}: found {1}, expected a number"),
    (r"argument (.*): ignored explicit argument (.*)", "{0}: found {1}, expected nothing after it"),
    (r"argument (.*): expected one argument", "{0}: expected a value after it"),
    (r"argument (.*): invalid choice: (.*) \(choose from (.*)\)", "{0}: found {1}, expected one of {2}"),
)


class Parser(argparse.ArgumentParser):
    """argparse, whose errors are one line each, and whose whole numbers are small enough to count something."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.register("type", int, _whole_number)

    def error(self, message: str) -> NoReturn:
        for pattern, line in COMPLAINTS:
            if match := re.fullmatch(pattern, message):
                raise MrpSumoError(f"{line.format(*match.groups())}; see `{self.prog} --help`")
        if message.startswith("unrecognized arguments: -"):
            word = message.split()[2].partition("=")[0].lstrip("-")
            known = sorted(set(re.findall(r"--([\w-]+)", self.format_help())))
            close = nearest(word, known, limit=0).replace("'", "'--", 1)
            message += close or ("; other keys of the scenario: --set KEY=VALUE" if "set" in known else "")
        raise MrpSumoError(f"{message.replace('argument -', '-', 1)}; see `{self.prog} --help`")


def _whole_number(text: str) -> int:
    number = int(text)
    if abs(number) >= MOST:
        raise argparse.ArgumentTypeError(f"found a number of {len(str(abs(number)))} digits, expected less than {MOST:g}")
    return number


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    gc.set_threshold(*COLLECT)
    try:
        return without_loss(lambda: _dispatch(_of_the_process() if arguments is None else list(arguments)))
    except PlugInError as error:
        warn(error)
        return 1
    except MrpSumoError as error:
        for line in str(error).split("\n"):
            warn(line)
        return 2
    except KeyboardInterrupt as error:
        warn(str(error) or "interrupted")
        return exit_code(error)
    except MemoryError:
        warn("out of memory: there are too many robots, orders or cells for this machine")
        return 1
    except BrokenPipeError:  # `mrp-sumo ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except RuntimeError as error:
        if not str(error).startswith("Symlink loop"):  # as Path.resolve reports one
            raise
        warn(f"{sentence(OSError(errno.ELOOP, ''))}: {str(error).removeprefix('Symlink loop from ')}")
        return 2
    except OSError as error:
        if error.errno is None:  # none of the system's
            raise
        from mrp_sumo.files.reading import shortened

        if isinstance(error.filename, str | bytes | os.PathLike):
            warn(f"{shortened(Path(os.fsdecode(error.filename)))}: {sentence(error)}")
        else:  # about a file that is open, or a temporary one
            warn(f"{error.strerror if error.errno == errno.ENOENT else sentence(error)}")
        return 2


def _of_the_process() -> list[str]:
    """The arguments of this process, which ends with the command: it need not look for garbage then in all that it has loaded."""
    leave_current_folder()
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # without a home it does without a cache, and says so at length
    warnings.filterwarnings("ignore", r"Glyph \d+", UserWarning)  # a picture shows boxes for letters that its font lacks
    heed_signals()
    setattr(sys.stdout, "write", partial(_write, sys.stdout.write))  # noqa: B010  mypy knows it as a method
    atexit.register(_keep_garbage)
    return sys.argv[1:]


def _write(write: Callable[[str], int], text: str) -> int:
    """Write a text without what a terminal would obey, but for the colours of our tables: names in it may be anybody's."""
    return write(OBEYED.sub(lambda match: repr(match[0])[1:-1], text))


def _keep_garbage() -> None:
    if "duckdb" not in sys.modules:  # which prints a line for each object of its own that is left
        gc.freeze()


def _dispatch(arguments: list[str]) -> int:
    if len(arguments) > 1 and arguments[0] == "help":
        arguments = [*arguments[1:2], "--help"]
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        _print_help()
        return 0
    if odd := next((argument for argument in arguments if "\0" in argument), None):
        raise MrpSumoError(f"{odd[:80]!r} holds a null byte, which no name or path does")
    name = arguments[0]
    if name in ("-V", "--version"):
        say(f"mrp-sumo {__version__}")
        return 0
    if name not in COMMANDS and (Path(name).is_file() or (bundled_folder("scenarios") / f"{name}.yaml").is_file()):
        raise MrpSumoError(f"expected a command before '{name}', such as `mrp-sumo run {shlex.quote(name)}`")
    if name.startswith("-"):
        raise MrpSumoError(f"expected a command before {name}, such as `mrp-sumo run office_9 {name}`")
    if name not in COMMANDS:
        raise MrpSumoError(f"unknown command '{name}'{nearest(name, COMMANDS, limit=len(COMMANDS))}")
    module, summary = COMMANDS[name]
    if name in SLOW:
        say_progress(f"{name} ...")
    command = import_module(module)
    parser = Parser(prog=f"mrp-sumo {name}", description=command.__doc__ or summary, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.set_defaults(command_line=["mrp-sumo", *arguments])  # for lines that tell how to go on
    command.arguments(parser)
    return int(command.run(parser.parse_args(arguments[1:])))


def _print_help() -> None:
    say("usage: mrp-sumo COMMAND ...", "", "Benchmark and co-simulation of AGV fleets.", "", "commands:")
    width = max(map(len, COMMANDS))
    for name, (_, summary) in COMMANDS.items():
        say(f"  {name:<{width}}  {summary}")
    say("", "`mrp-sumo COMMAND --help` explains a command; `mrp-sumo --version` prints the version.")
