#!/usr/bin/env bash
# `kestrel view` in a window on a virtual screen, with keys and mouse, and what it says without a screen.
#
#   tests/viewer.sh
#
# Installs xvfb and xdotool where they are missing and this is root. Ends with "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh
# shellcheck source=tests/packages.sh
. tests/packages.sh
# shellcheck source=tests/programs.sh
. tests/programs.sh

need "a virtual screen" screen || exit 1
programs || exit 1
screen=
trap 'kill $screen 2>/dev/null; rm -rf "$place"' EXIT
export XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-$place}
unset WAYLAND_DISPLAY WAYLAND_SOCKET DISPLAY
kestrel=target/debug/kestrel

view() { # DISPLAY: at its first flight, until it is told to quit
  DISPLAY=$1 timeout 60 $kestrel view configs/cross.yaml --policy assets/pilots/cross.kestrel
}
refuses_without_a_screen() { # one message, status 2
  view "" >"$place/said" 2>&1
  [ $? -eq 2 ] && [ "$(grep -c 'error: cannot open a window' "$place/said")" -eq 1 ] &&
    grep -q "headless" "$place/said" && ! grep -q panicked "$place/said"
}
ends_when_told() { # DISPLAY: opens, takes keys, a drag and the wheel, and quits with status 0
  view "$1" >"$place/said" 2>&1 &
  local viewer=$! window
  export DISPLAY=$1
  window=$(timeout 50 xdotool search --sync --onlyvisible --name "^kestrel: " | head -1) || return 1
  xdotool windowfocus --sync "$window"
  xdotool mousemove --window "$window" 200 200 mousedown 1 mousemove --window "$window" 260 230 mouseup 1 click 4
  xdotool key space Right c n Up r
  sleep 1
  kill -0 $viewer || return 1
  xdotool key q
  unset DISPLAY
  wait $viewer
}

check "without a screen there is one clear error" refuses_without_a_screen
mkfifo "$place/display"
Xvfb -displayfd 3 -screen 0 1280x800x24 3>"$place/display" 2>/dev/null &
screen=$!
read -r display <"$place/display"
check "the window opens, takes keys and the mouse, and ends when told" ends_when_told ":$display"

summary
