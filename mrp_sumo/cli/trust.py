"""Trust the programs that scenarios and suites of a folder name: plug-in files, and commands of external planners.

Without that, they run only when they are named on the command line, or with --trust. Folders inside are trusted too. The list is
kept in the user's configuration, $XDG_CONFIG_HOME/mrp-sumo/trusted.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.printing import say_either
from mrp_sumo.errors import MrpSumoError


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo trust`."""
    parser.add_argument("folder", nargs="?", metavar="DIR", type=Path, help="trust this folder from now on")
    parser.add_argument("--list", action="store_true", help="print the folders that are trusted")
    parser.add_argument("--forget", metavar="DIR", type=Path, help="trust this folder no longer")
    parser.add_argument("--json", action="store_true", help="print the list as JSON, as it is afterwards")


def run(options: argparse.Namespace) -> int:
    """Change or print the list."""
    from mrp_sumo.plugins.trust import forget_folder, trust_folder, trusted_folders

    if [options.folder is not None, options.list, options.forget is not None].count(True) != 1:
        raise MrpSumoError("expected either DIR, --list or --forget DIR")
    if options.folder is not None:
        lines = [f"trusted: programs that files in {trust_folder(options.folder)} name"]
    elif options.forget is not None:
        lines = [f"no longer trusted: {forget_folder(options.forget)}"]
    else:
        lines = [str(folder) for folder in trusted_folders()]
    say_either(options.json, {"trusted": [str(folder) for folder in trusted_folders()]}, *lines, indent=2)
    return 0
