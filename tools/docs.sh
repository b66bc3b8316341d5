#!/usr/bin/env bash
# Build the documentation's site in site/: what its pages show is run, links are checked. Arguments go to tools/docs.py.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
./tools/setup.sh docs
exec .venv/bin/python tools/docs.py "$@"
