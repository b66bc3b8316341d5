#!/usr/bin/env bash
# What the browser tests and tools/bench_replay.py need beside Python: Debian's Chromium, and playwright-core and axe-core in .venv/node. Needs root, node and npm.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
command -v chromium >/dev/null || { apt-get update -qq && apt-get install -y -qq chromium >/dev/null; }
for package in playwright-core@1.65.1 axe-core@4.14.1; do
  [ -d ".venv/node/node_modules/${package%@*}" ] || npm install --silent --no-audit --no-fund --prefix .venv/node "$package"
done
