#!/usr/bin/env bash
# Build the wheel, install it with its locked dependencies into an empty environment, and use it from a folder far from the sources: a run, a
# batch, a report, a replay page, a plug-in from a file. Prints the size of the environment and its ten largest packages.
#   tools/wheel.sh [--tour] [--keep DIR]    # --tour: follows the README, too, line by line; --keep leaves the wheel in DIR
set -euo pipefail
tour='' keep=''
while [ $# -gt 0 ]; do
  case $1 in
    --tour) tour=yes ;;
    --keep) keep=$2; shift ;;
    *) echo "wheel: '$1' is no option, expected --tour or --keep DIR" >&2; exit 2 ;;
  esac
  shift
done
cd "$(dirname "${BASH_SOURCE[0]}")/.."
project=$PWD
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
pip_of() { "$scratch/$1/bin/python" -m pip --quiet --disable-pip-version-check "${@:2}"; }
for env in build env; do "${PYTHON:-python3}" -m venv "$scratch/$env"; done
pip_of build install --require-hashes --requirement requirements/build.txt
pip_of build wheel --no-deps --no-build-isolation --wheel-dir "$scratch/dist" .
wheel=$(ls "$scratch"/dist/mrp_sumo-*.whl)
pip_of env install --require-hashes --requirement requirements/run.txt
pip_of env install --no-deps "$wheel"

mkdir "$scratch/work"
cd "$scratch/work"
export PATH="$scratch/env/bin:$PATH" PYTHONPATH=''
cat > longest.py <<'PY'
"""The longest wait for another robot."""


def longest_wait_s(run):
    """The longest of all waits."""
    return max((event.duration_s for event in run.execution.events if event.kind == "waited"), default=0.0)
PY
printf 'base: office_5\nuntil: plan\ngrid_search:\n  planner: [astar, prioritised]\n' > suite.yaml
python - << PY
import mrp_sumo, pathlib
assert not pathlib.Path(mrp_sumo.__file__).is_relative_to("$project"), mrp_sumo.__file__
assert (pathlib.Path(mrp_sumo.__file__).parent / "py.typed").is_file()
PY
mrp-sumo run office_5 --planner prioritised --metric longest.py:longest_wait_s --replay --out run
grep -q '"longest_wait_s"' run/result.json
test -s run/replay.html
mrp-sumo batch suite.yaml --out batch
mrp-sumo report batch
test -s batch/report/index.html
mrp-sumo render run --video run.gif --to 1 --size 320x240
mrp-sumo list planners > planners.txt
mrp-sumo run office_5 --set map=nowhere 2> refusal.txt && exit 1
test "$(wc -l < refusal.txt)" = 1
if mrp-sumo render run --video run.mp4 2> refusal.txt; then exit 1; fi
grep -q 'mrp-sumo\[video\]' refusal.txt
[ -z "$tour" ] || python "$project/tools/docs.py" --check README.md
cd "$project"
if [ -n "$keep" ]; then mkdir -p "$keep" && cp "$wheel" "$keep"; fi
echo "wheel: $(du -h "$wheel" | cut -f1), environment: $(du -sh "$scratch/env" | cut -f1)"
du -sm "$scratch"/env/lib/python*/site-packages/* | sort -rn | awk 'NR <= 10 {sub(".*/", "", $2); printf "  %5d MB  %s\n", $1, $2}'
