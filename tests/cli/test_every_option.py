"""Every documented option of every command, once from end to end: it works and says nothing on stderr, or is refused in one line."""

import argparse
import contextlib
import re
import shlex
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import ezdxf
import pytest
from campaigns.fuzz import make_material
from PIL import Image
from wire.test_mqtt import certificate, free_port, open_port  # noqa: F401  a fixture
from wire.worlds import scenario as carts

from mrp_sumo.cli.main import COMMANDS

CONSOLE = Path(sys.executable).with_name("mrp-sumo")
METRIC = "def longest(run):\n    return 1.0\n"
DRIVEN = "base: {map: small.building.yaml, robots: 2, execution: {engine: kinematic, time_limit_s: 60}}\ngrid_search: {seed: 0..1}\n"
EXTERNAL = f"'{CONSOLE} plan --map {{map}} --scen {{scen}} --robots {{agents}} --time-limit {{time_limit}} --out {{out}} --format paths'"
STUDY = "capacity lifelong.yaml --robots 1..2 --budget 5s --horizon 1min --workers 1"
BEFOREHAND = r"mrp-sumo: .* end runs under way.*|mrp-sumo: .* are hardly enough.*"
CLOSED = "127.0.0.1:1"


@dataclass(frozen=True)
class Line:
    """A command line, in a folder with the material; PORT in it stands for a free port, BROKER for that of a broker."""

    words: str
    code: int = 0
    says: str = ""  # on stderr: a pattern of its one line
    stops: bool = False  # by Ctrl-C, when it has printed where it is


def line(words, code=0, says="", stops=False):
    """A case of a test, named by its words."""
    return pytest.param(Line(words, code, says, stops), id=re.sub(r"[^\w.=-]+", " ", words)[:70].strip())


LINES = (
    *(line(f"{name} {option}") for name in COMMANDS for option in ("--help",)),
    line(
        "run scenario.yaml --type cart.yaml --robots 2 --planner prioritised --seed 4 --time-limit 9 "
        "--policy adg --replay --json --out new",
    ),
    line("run scenario.yaml --set execution.on_deadlock=stop --set heuristic=false --metric mine.py:longest --trust --verbose --out new"),
    line("run --map small.map --scen small.scen --plan plan.txt --out new"),
    line("run hall.png --meters-per-pixel 0.1 --robots 1 --out new"),
    line(f"run scenario.yaml --command {EXTERNAL} --out new"),
    line("run scenario.yaml --live --port PORT --out new", 130, "mrp-sumo: interrupted", stops=True),
    line("run scenario.yaml --foxglove --port PORT --speed 50 --out new", 130, "mrp-sumo: interrupted", stops=True),
    line("run scenario.yaml --rerun new.rrd --out new"),
    line("run scenario.yaml --dds --speed 50 --domain 77 --interface 127.0.0.1 --out new"),
    line("run scenario.yaml --gui --out new", 2, "mrp-sumo: .*display.*"),
    line("init small.building.yaml --type cart.yaml --robots 2 --rate 60 --orders 3 --out new"),
    line("init small.building.yaml --interactive --meters-per-pixel 0.1 --out new", 2, "mrp-sumo: --interactive: no answers.*"),
    line(f"{STUDY} --quick --replays --seed 5 --trust --json --out new", says=BEFOREHAND),
    line(
        f"{STUDY} --set robots.type=cart.yaml --engine kinematic --quick --demand 60/h --on-time 90% "
        "--what-if 'planner: pibt' --out new", says=BEFOREHAND,
    ),
    line(f"{STUDY} --quick --confirm sumo --out new", says=BEFOREHAND),
    line(f"{STUDY} --quick --engine sumo --dry-run", 2, "mrp-sumo: --budget 5s: too little.*"),
    line(f"{STUDY} --quick --scheduler {CLOSED} --out new", 2, "mrp-sumo: --workers is for this machine: .*"),
    line(
        f"{STUDY.replace('--workers 1', '--quick')} --scheduler {CLOSED} --out new", 2,
        f"(?:{BEFOREHAND})\nmrp-sumo: no Dask scheduler at '127.0.0.1:1'.*",
    ),
    line(
        "import small.building.yaml --graph 0 --level L1 --snap 0.1 --split-crossings --join-short 0.1 "
        "--largest-component --robot cart.yaml --json --out new", says="repair: nothing to repair",
    ),
    line("import hall.dxf --reader dxf_plan --layers WALLS --unit m --cell 0.5 --robot-radius 0.2 --out new"),
    line("import small.lif.json --vehicle-type maker.series --check"),
    line("import hall.png --metres-per-pixel 0.1 --check"),
    line("import hall.png --page 2 --check", 2, "mrp-sumo: hall.png: this kind of map has no page to choose"),
    line("convert hall.png new.map --page 2", 2, "mrp-sumo: hall.png: this kind of map has no page to choose"),
    line("import messages.jsonl --map small.building.yaml --out new"),
    line("plan scenario.yaml --set heuristic=false --time-limit 5 --seed 3 --trust --verbose --json"),
    line("plan x.json --steps 5 --planner epibt --out new.json"),
    line("plan --many many.txt"),
    line("plan --map small.map --scen small.scen --robots 2 --out new.txt --format lacam"),
    line("plan --map instance.yaml --assignment linear_sum_assignment"),
    line(f"plan --map small.map --scen small.scen --command {EXTERNAL}"),
    line("validate plan.json --map small.map --scen small.scen --robots 2 --limit 3 --following --json"),
    line("validate run/plan.json --scenario scenario.yaml --seed 3"),
    line("validate solution.json --problem x.json"),
    line("validate --vda5050 messages.jsonl"),
    line("convert hall.png new.map --reader picture_plan --meters-per-pixel 0.1 --cell 0.5 --robot-radius 0.2 --json"),
    line("convert hall.dxf new.geojson --layers WALLS --unit m"),
    line("convert small.lif.json new.xml --vehicle-type maker.series"),
    line("convert small.lif.json typed.lif.json --robot forklift"),
    line("convert forklift forklift.json --vda5050 2.1"),
    line("convert plan.json new.txt --map small.map --format lacam"),
    line(
        "convert small.building.yaml new.nav.yaml --graph 0 --level L1 --snap 0.1 --split-crossings "
        "--join-short 0.1 --largest-component", says="repair: nothing to repair",
    ),
    line("generate warehouse --robots-for 6 --cross-aisles 4 --bays 4 --one-way --out new.building.yaml --json"),
    line("generate grid --vertices 20 --spacing 3 --out new.building.yaml"),
    line("generate ring --vertices 20 --out new.building.yaml"),
    line("generate random --vertices 20 --seed 2 --out new.building.yaml"),
    line(
        "batch driven.yaml --workers 1 --retries 0 --time-limit 60 --memory-limit 4000 --keep-worst 1 "
        "--metric mine.py:longest --trust --json --out new", says="mrp-sumo: the worst run is kept in new/kept",
    ),
    line("batch suite.yaml --dry-run --verbose"),
    line(f"batch suite.yaml --scheduler {CLOSED} --out new", 2, "mrp-sumo: .*127.0.0.1:1.*"),
    line("paper --seeds 1 --workers 1 --maps nowhere --json --out new", 2, "mrp-sumo: nowhere.*"),
    line("status batch --json"),
    line("status batch --live --port PORT", stops=True),
    line("query batch 'select planner from results' --json"),
    line("query batch cost --csv"),
    line("query batch"),
    line("compare batch batch --metric soc_steps --alpha 0.1 --tolerance 2 --strict --json"),
    line("reproduce run --json --trust --base ."),
    line("reproduce batch --runs 1"),
    line("export run --bag --storage sqlite3 --rmf galactic --robots robot_0 --poses --split 5 --repeat-latched 5 --json --out new"),
    *(line(f"export work --{kind} --out new") for kind in ("csv", "geojson", "fcd", "rmf-plans", "viewers", "vda5050 2.1")),
    line("export work --ros1 --out new.bag"),
    line("analyze bag3 --config config.yaml --rmf jazzy --cell 0.3 --tolerance 0.5 --window 5 --timeout 60 --json"),
    line("analyze run --metric soc_steps"),
    line("analyze work --audit"),
    line(
        "vda5050 carts.yaml --broker BROKER --as fleet --version 2.1 --manufacturer maker --speed 20 --duration 4 --state-period 1 "
        "--visualization-period 0 --fault robot_0:breakdown@1+1 --log new.jsonl --json --robots 2 --planner prioritised --set seed=3 "
        "--trust --time-limit 5 --seed 4",
        says="2 vehicles at .*",
    ),
    line(
        f"vda5050 carts.yaml --broker {CLOSED} --tls --ca broker.pem --cert broker.pem --key broker.key --user fleet "
        f"--password-file password --command {EXTERNAL}",
        2,
        f"mrp-sumo: no connection to the broker {CLOSED}.*",
    ),
    line(f"vda5050 carts.yaml --broker {CLOSED} --as master --out new", 2, f"mrp-sumo: no connection to the broker {CLOSED}.*"),
    line("calibrate work --map small.building.yaml --robot cart.yaml --json --out new.yaml"),
    line("calibrate work --against cart.yaml", 2, "mrp-sumo: cart.yaml: has no intervals.*"),
    line("predict lifelong.yaml --log work --hold-out 0.5 --orders orders.csv --runs 3 --json --out new", 2, "mrp-sumo: .*"),
    line("import --log work --map small.building.yaml --licence CC0-1.0 --json --out new"),
    line("export work --archive new --anonymise --move --licence CC0-1.0 --json"),
    line("replay run --json --out new.html"),
    line("replay run --serve --port PORT", stops=True),
    line("render run --at 2 --dpi 50 --json --out new.png"),
    line("render run work --video new.gif --from 1 --to 2 --speed 4 --size 320x240 --robots robot_0 --level L1 --titles one two"),
    *(line(f"list {kind} --json") for kind in ("planners", "suites")),
    line("trust --json ."),
    line("trust --list"),
    line("trust --forget .", 2, "mrp-sumo: .* is not in the list of trusted folders"),
    line("warmup astar --quiet"),
    line("warmup astar --json"),
    line("report batch --json --out new"),
    line("run office_5 --error-bands --live", 2, "mrp-sumo: --error-bands: with --live people may steer the run, .*"),
    line("run office_5 --interval seed=1:2", 2, "mrp-sumo: --interval is for --error-bands"),
    line("run office_5 --intervals x.yaml", 2, "mrp-sumo: --intervals is for --error-bands"),
    line("capacity warehouse_lifelong --error-bands --interval none", 2, "mrp-sumo: --interval none: expected KEY=LOW:HIGH or .*"),
    line("run office_5 --error-bands --interval robots.type.max_speed_mps=100%", 2, "mrp-sumo: --interval .*: found 100 %, expected .*"),
    line("capacity warehouse_lifelong --intervals x.yaml", 2, "mrp-sumo: --intervals is for --error-bands"),
    line("studio hall.png --no-browser --port PORT", stops=True),
    line("studio --json --port none", 2, "mrp-sumo: --port: found 'none', expected a whole number up to 65535"),
    line("demo --no-open --out new"),
    line("demo --json --out new", says=r"(?:.*\n)*.*mrp-sumo report new/planners"),
    *(line(f"completion {shell}") for shell in ("bash", "zsh", "fish")),
    line("schema"),
)  # fmt: skip


def parser_of(command):
    """The arguments of a command."""
    parser = argparse.ArgumentParser()
    import_module(COMMANDS[command][0]).arguments(parser)
    return parser


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_and_choice_has_a_line(command):
    words = {word for case in LINES for word in shlex.split(case.values[0].words) if case.values[0].words.split()[0] == command}
    for action in parser_of(command)._actions:
        assert not action.option_strings or words & set(action.option_strings), f"no line has {'/'.join(action.option_strings)}"
        assert set(action.choices or ()) <= words, f"no line chooses {set(action.choices or ()) - words} of {action.dest}"


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    """A small file of each kind."""
    folder = tmp_path_factory.mktemp("material")
    with contextlib.chdir(folder):
        make_material(folder)
    (folder / "driven.yaml").write_text(DRIVEN)
    (folder / "mine.py").write_text(METRIC)
    (folder / "password").write_text("secret\n")
    drawing = ezdxf.new()
    drawing.layers.add("WALLS")
    drawing.modelspace().add_lwpolyline([(0, 0), (6, 0), (6, 4), (0, 4)], close=True, dxfattribs={"layer": "WALLS"})
    drawing.saveas(folder / "hall.dxf")
    Image.new("L", (60, 40), 255).save(folder / "hall.png")
    carts(folder)
    certificate(folder, "broker")
    return folder


def started(case, folder, port):
    words = case.words.replace("PORT", str(free_port())).replace("BROKER", f"127.0.0.1:{port}")
    home = {"XDG_CONFIG_HOME": str(folder / "config"), "BROWSER": "true", "PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    return subprocess.Popen(
        [CONSOLE, *shlex.split(words)],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=home,
    )


@pytest.mark.campaign
@pytest.mark.parametrize("case", LINES)
def test_line_works_and_says_nothing_beside(case, material, tmp_path, open_port):  # noqa: F811
    folder = shutil.copytree(material, tmp_path / "work")
    with started(case, folder, open_port) as process:
        while case.stops and (printed := process.stdout.readline()):
            if "Ctrl+C" in printed:
                process.send_signal(signal.SIGINT)
        printed, said = process.communicate(timeout=1800)  # of a hang: kernels may have to be compiled on a busy machine
    assert process.returncode == case.code, printed + said
    assert re.fullmatch(f"(?:{case.says})\n" if case.says else "", said), said
    assert not [path.name for path in folder.rglob("*.partial")]
