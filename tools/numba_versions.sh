#!/usr/bin/env bash
# Run the tests of the searches' kernels with the oldest numba that pyproject.toml allows; .venv has the newest.
#   tools/numba_versions.sh
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
oldest=$(sed -n 's/.*"numba>=\([0-9.]*\),.*/\1/p' pyproject.toml)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-warn-conflicts --target "$folder" "numba~=$oldest.0" \
  "numpy==$(.venv/bin/python -c 'import numpy; print(numpy.__version__)')"
PYTHONPATH="$folder" .venv/bin/python -c "import numba; assert numba.__version__.startswith('$oldest.'), numba.__version__"
NUMBA_CACHE_DIR="$folder/cache" PYTHONPATH="$folder" .venv/bin/python -m pytest -m kernel tests/search -n auto
