"""Print a script with which a shell completes commands and options.

bash: eval "$(mrp-sumo completion bash)", zsh: eval "$(mrp-sumo completion zsh)" after compinit, both in the shell's start file;
fish: mrp-sumo completion fish > ~/.config/fish/completions/mrp-sumo.fish
"""

import argparse
import re
from importlib import import_module

from mrp_sumo.cli.printing import say

BASH = """_mrp_sumo() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} words=""
  if [ "$COMP_CWORD" -eq 1 ]; then
    words="{commands}"
  elif [[ $word == -* ]]; then
    case ${{COMP_WORDS[1]}} in
{cases}
    esac
  elif [ "$COMP_CWORD" -eq 2 ]; then
    case ${{COMP_WORDS[1]}} in
{names}
    esac
  fi
  COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _mrp_sumo mrp-sumo
"""
ZSH = "autoload -U +X bashcompinit && bashcompinit\n"


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo completion`."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"))


def run(options: argparse.Namespace) -> int:
    """Print the script."""
    from mrp_sumo.cli.main import COMMANDS

    accepted = {name: _options(module) for name, (module, _) in COMMANDS.items()}
    known = _names()
    if options.shell == "fish":
        say("complete -c mrp-sumo -n __fish_use_subcommand -f")
        for name, (_, about) in COMMANDS.items():
            say(f"complete -c mrp-sumo -n __fish_use_subcommand -a {name} -d '{about.replace(chr(39), '')}'")
            inside = f"complete -c mrp-sumo -n '__fish_seen_subcommand_from {name}'"
            if name in known:
                say(f"{inside} -a '{' '.join(known[name])}'")
            for option in accepted[name]:
                say(f"{inside} {'-l' if option.startswith('--') else '-s'} {option.lstrip('-')}")
        return 0
    cases = "\n".join(f'      {name}) words="{" ".join(words)}" ;;' for name, words in accepted.items())
    names = "\n".join(f'      {name}) words="{" ".join(words)}" ;;' for name, words in known.items())
    script = BASH.format(commands=" ".join(COMMANDS), cases=cases, names=names)
    say(*((ZSH if options.shell == "zsh" else "") + script).splitlines())
    return 0


def _options(module: str) -> list[str]:
    """All options of a command, as its help has them."""
    parser = argparse.ArgumentParser()
    import_module(module).arguments(parser)
    rows = re.findall(r"^  (-.*?)(?:  |$)", parser.format_help(), re.MULTILINE)  # `-h, --help` before the meaning
    return sorted({option for row in rows for option in re.findall(r"(?<!\S)--?[a-z][-\w]*", row)})


def _names() -> dict[str, list[str]]:
    """What the first word after a command may be, beside a file."""
    from mrp_sumo.cli.listing import COMES_WITH_IT
    from mrp_sumo.maps.catalogue import bundled_folder, bundled_maps
    from mrp_sumo.plugins.kinds import KINDS

    scenarios, suites = (sorted(path.stem for path in bundled_folder("scenarios").glob(f"{where}*.yaml")) for where in ("", "suites/"))
    return {
        **dict.fromkeys(("run", "plan", "capacity"), scenarios),
        "import": sorted(bundled_maps()),
        "batch": suites,
        "list": [*KINDS, *COMES_WITH_IT],
        "completion": ["bash", "fish", "zsh"],
    }
