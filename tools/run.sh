#!/usr/bin/env bash
# Set up .venv beside this project if need be, then `mrp-sumo run`: by default the warehouse with nine robots.
#   tools/run.sh [SCENARIO.yaml] [options of `mrp-sumo run`]
set -euo pipefail
project=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
"$project/tools/setup.sh"
case "${1-}" in
  "" | -*) set -- "$project/scenarios/warehouse_9.yaml" "$@" ;;
  *) [ -e "$1" ] || [ ! -e "$project/$1" ] || set -- "$project/$1" "${@:2}" ;;
esac
exec "$project/.venv/bin/mrp-sumo" run "$@"
