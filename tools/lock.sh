#!/usr/bin/env bash
# Write requirements/*.txt, exact versions with the hashes of all their files for every platform, from pyproject.toml and
# constraints.txt. Run it after changing either.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
[ -x .venv/bin/uv ] || .venv/bin/python -m pip --quiet install --constraint constraints.txt uv
lock() {
  local to=requirements/$1.txt
  shift
  .venv/bin/uv pip compile --quiet --universal --python-version "${python:-3.11}" --generate-hashes --constraints constraints.txt --no-header \
    --no-emit-index-url --no-emit-find-links --no-annotate --output-file "$to" "$@"
  chmod 644 "$to"
}
lock build requirements/build.in
lock run pyproject.toml
lock test pyproject.toml --extra test --extra cluster --extra rl --extra video
python=3.11.5 lock docs pyproject.toml --extra docs  # pymdown-extensions needs it
