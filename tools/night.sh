#!/usr/bin/env bash
# What CI has no time for, some hours: every documented option, work driven under every engine, planner and dispatcher, long measurements; the
# kernels without compiling; the README's tour from the wheel, and what every page of the documentation shows.
#   tools/night.sh
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
./tools/setup.sh test
./tools/test.sh -m campaign -n auto
NUMBA_DISABLE_JIT=1 .venv/bin/python -m pytest -m "kernel and not compiled" -n auto
./tools/wheel.sh --tour
./tools/docs.sh
