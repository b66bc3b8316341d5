"""Completion: the shell offers commands, options and names as they are."""

import shutil
import subprocess

import pytest

from mrp_sumo.cli.main import COMMANDS, main


@pytest.mark.skipif(not shutil.which("bash"), reason="no bash")
def test_bash_completes_commands_options_and_names(capsys):
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out

    def offered(*words):
        ask = f"{script}\nCOMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _mrp_sumo; echo ${{COMPREPLY[@]}}"
        return subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True).stdout.split()

    assert offered("mrp-sumo", "re") == [name for name in COMMANDS if name.startswith("re")]
    assert offered("mrp-sumo", "render", "--ro") == ["--robots"]
    assert offered("mrp-sumo", "run", "office") == ["office_5", "office_9", "office_doors"]
    assert offered("mrp-sumo", "run", "office_9", "off") == []


def test_other_shells_name_every_command(capsys):
    for shell in ("zsh", "fish"):
        assert main(["completion", shell]) == 0
        script = capsys.readouterr().out
        assert all(name in script for name in COMMANDS)
