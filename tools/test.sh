#!/usr/bin/env bash
# Set up .venv with the test extra if need be, check style and types, run the tests; arguments go to pytest.
#   tools/test.sh [-k cbs] [options of pytest]
set -euo pipefail
project=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
"$project/tools/setup.sh" test
cd "$project"
bin=.venv/bin
if [ $# -eq 0 ]; then
  "$bin/ruff" format --check --quiet .
  "$bin/ruff" check --quiet .
  "$bin/mypy" --no-error-summary
  exec "$bin/python" -m pytest -n auto
fi
exec "$bin/python" -m pytest "$@"
