#!/usr/bin/env bash
# Make .venv with the locked versions; does nothing when it is up to date.
#   tools/setup.sh [test|docs]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
extra=${1:+[$1]}
# the extras hold all that a plain installation has
for have in "" "[test]" "[docs]"; do
  stamp=.venv/installed$have
  if [ -e "$stamp" ] && { [ -z "$extra" ] || [ "$have" = "$extra" ]; } && cat pyproject.toml requirements/*.txt | cmp -s - "$stamp"; then
    exit 0
  fi
done
python=${PYTHON:-python3}
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "setup: $("$python" --version) found, Python 3.11 or later needed" >&2; exit 2; }
echo "setting up .venv (once; some minutes) ..." >&2
[ -x .venv/bin/python ] || "$python" -m venv .venv
pip=(.venv/bin/python -m pip --quiet --disable-pip-version-check)
# exact versions, and no file whose hash is not in requirements/
locked=(--require-hashes --requirement "requirements/${1:-run}.txt")
project=(--no-deps --no-build-isolation --editable .)
# uv installs several times as fast; it is told where pip is told to look, and pip does what it cannot do
setting() { "${pip[@]}" config get "global.$1" 2> /dev/null || "${pip[@]}" config get ":env:.$1" 2> /dev/null || true; }
with_uv() {
  local index=${UV_DEFAULT_INDEX-$(setting index-url)} links=${UV_FIND_LINKS-$(setting find-links)} certificates=${SSL_CERT_FILE-$(setting cert)}
  env ${index:+"UV_DEFAULT_INDEX=$index"} ${links:+"UV_FIND_LINKS=$links"} ${certificates:+"SSL_CERT_FILE=$certificates"} \
    .venv/bin/uv pip install --quiet --python .venv/bin/python "$@" 2> /dev/null
}
with_pip() { "${pip[@]}" install "$@" 2> >(grep -v '^WARNING' >&2); }
with_pip --require-hashes --requirement requirements/build.txt
with_uv "${locked[@]}" || with_pip "${locked[@]}"
with_uv "${project[@]}" || with_pip "${project[@]}"
# compile ahead what the bundled scenarios use; for the tests, which run in several processes, everything
[ "$extra" = "[test]" ] && planners=() || planners=(execution cbs)
.venv/bin/mrp-sumo warmup --quiet ${planners[@]+"${planners[@]}"}
cat pyproject.toml requirements/*.txt > ".venv/installed$extra"
