#!/usr/bin/env bash
# What tests need beside Python and skip without: Chromium with playwright-core, Foxglove's mcap readers and vda-5050-lib from npm (in
# .venv/node), and ROS 1's rosbag of Debian. Quick when all is there. What cannot be had here is said, and is no failure: the tests say why they skip.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
export npm_config_fetch_retries=1 npm_config_fetch_retry_mintimeout=500 npm_config_fetch_retry_maxtimeout=2000  # no registry: say so soon
readers=(@foxglove/rosmsg@5.0.5 @foxglove/rosmsg2-serialization@3.1.0 @mcap/core@2.2.2 @mcap/nodejs@1.0.2 @mcap/support@1.1.0)
missing() { echo "ci_tools: no $1; its tests will skip" >&2; }

timeout 300 ./tools/browser.sh 2>/dev/null || missing "Chromium or playwright-core"
[ -d .venv/node/node_modules/@mcap/core ] ||
  timeout 120 npm install --silent --no-audit --no-fund --prefix .venv/node "${readers[@]}" >/dev/null 2>&1 || missing "mcap readers of npm"
[ -d .venv/node/node_modules/vda-5050-lib ] ||
  timeout 120 npm install --silent --no-audit --no-fund --prefix .venv/node vda-5050-lib@1.4.0 >/dev/null 2>&1 || missing "vda-5050-lib of npm"
/usr/bin/python3 -c 'import rosbag' 2>/dev/null ||
  { timeout 120 apt-get update -qq && timeout 300 apt-get install -y -qq --no-install-recommends python3-rosbag; } >/dev/null 2>&1 || missing "rosbag of ROS 1"
exit 0
