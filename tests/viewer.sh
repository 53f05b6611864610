#!/usr/bin/env bash
# Windows on a virtual screen: of a flight that is over, with keys and mouse, of one behind MAVLink and of a policy in training; and
# what is said without a screen.
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

session=(fly assets/pilots/hover.kestrel --view --listen 127.0.0.1:14791 --ground-station 127.0.0.1:14792)
training=(train cross --watch --run "$place/run")
nothing_begins_without_a_screen() {
  DISPLAY="" timeout 60 $kestrel "${session[@]}" >"$place/said" 2>&1
  [ $? -eq 2 ] && ! grep -q "MAVLink system" "$place/said" || return 1
  DISPLAY="" timeout 60 $kestrel "${training[@]}" >"$place/said" 2>&1
  [ $? -eq 2 ] && [ ! -e "$place/run" ] && grep -q 'error: cannot open a window' "$place/said"
}
told() { # DISPLAY NAME: its window is there, and told to quit
  local window
  export DISPLAY=$1
  window=$(timeout 50 xdotool search --sync --onlyvisible --name "$2" | head -1) || return 1
  xdotool windowfocus --sync "$window"
  sleep 2
  xdotool key q
  unset DISPLAY
}
a_closed_window_ends_the_session() { # DISPLAY
  DISPLAY=$1 timeout 60 $kestrel "${session[@]}" >"$place/said" 2>&1 &
  local flying=$!
  told "$1" "^kestrel: " && wait $flying && grep -q "^Flew " "$place/said"
}
training_goes_on_without_its_window() { # DISPLAY: and leaves a checkpoint when it is stopped
  DISPLAY=$1 timeout 60 $kestrel "${training[@]}" >"$place/said" 2>&1 &
  local learning=$!
  told "$1" "^kestrel train" && sleep 1 && kill $learning || return 1
  wait $learning
  [ $? -eq 130 ] && grep -q "^Saved after" "$place/said"
}

check "without a screen there is one clear error" refuses_without_a_screen
check "without a screen no flight and no training begins" nothing_begins_without_a_screen
mkfifo "$place/display"
Xvfb -displayfd 3 -screen 0 1280x800x24 3>"$place/display" 2>/dev/null &
screen=$!
read -r display <"$place/display"
check "the window opens, takes keys and the mouse, and ends when told" ends_when_told ":$display"
check "a session is seen, and ends with its window" a_closed_window_ends_the_session ":$display"
check "a policy in training is seen, and trains on without its window" training_goes_on_without_its_window ":$display"

summary
