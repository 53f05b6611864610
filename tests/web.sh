#!/usr/bin/env bash
# The page: built, served, and used by a browser without a screen.
#
#   tests/web.sh
#
# Installs Chromium where no browser is and this is root. Ends with "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh
# shellcheck source=tests/packages.sh
. tests/packages.sh
# shellcheck source=tests/programs.sh
. tests/programs.sh

need "a browser" browser && python_environment target/venv-web tests/python/web-requirements.txt && programs || exit 1
kestrel=$PWD/target/debug/kestrel

refuses() { # WORDS ARGUMENT...: one message with these words, status 2, and nothing is touched
  local words=$1 status
  shift
  sim-host/web/build "$@" >"$place/said" 2>&1
  status=$?
  [ $status -eq 2 ] && grep -q "$words" "$place/said"
}

mkdir "$place/mine" && touch "$place/mine/thesis.tex"
check "the page goes into no folder that holds other things" refuses "expected an empty folder" "$place/mine" "$kestrel"
check "without a folder there is one clear error" refuses "found no folder"
check "the page is built" sim-host/web/build target/page "$kestrel"
if [ "$failed" -eq 0 ]; then
  check "and built again in its place" sim-host/web/build target/page "$kestrel"
  target/venv-web/bin/python tests/python/web_test.py "$kestrel" target/page | tee "$place/browser"
  sums=$(grep -oE '[0-9]+ passed, [0-9]+ failed' "$place/browser")
  passed=$((passed + $(echo "${sums:-0 passed, 1 failed}" | cut -d' ' -f1)))
  failed=$((failed + $(echo "${sums:-0 passed, 1 failed}" | cut -d' ' -f3)))
fi
summary
