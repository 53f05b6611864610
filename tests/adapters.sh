#!/usr/bin/env bash
# Policies fly the simulator through the interfaces of autopilots, as programs of this machine.
#
#   tests/adapters.sh
#
# Each adapter of tests/firmware/adapters is an autopilot's own interface around assets/pilots/hover.kestrel: the controller of
# crazyflie-firmware (tests/firmware/crazyflie has its headers) and the neural interface of Betaflight's forks, both as
# `kestrel export` completes them. It flies EPISODES starts of hover's evaluation, 64 unless told otherwise, and must succeed in
# as many of a hundred as the pilot of this machine to within two.
#
# Needs Rust and gcc. Ends with "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh
# shellcheck source=tests/programs.sh
. tests/programs.sh

out=target/adapters
run=$out/run-hover
adapters=tests/firmware/adapters
mkdir -p "$out"

adapter() { # NAME SOURCE...: an adapter with the autopilot's part
  gcc -std=gnu11 -O2 -Wall -Wextra -Werror -DDEBUG_STREAM=stderr -I "$run/$1" -I firmware-shim/crazyflie/include \
    -I tests/firmware/crazyflie "$adapters/adapter.c" "$adapters/$1.c" "$run/$1/policy.c" "${@:2}" \
    target/debug/libkestrel_pilot.a -lpthread -ldl -lm -o "$out/$1"
}

flies_as_here() { # NAME
  target/debug/kestrel evaluate "$run" --episodes "${EPISODES:-64}" --processor program --image "$out/$1" >"$out/$1.txt"
  local status=$?
  cat "$out/$1.txt"
  [ $status -eq 0 ] &&
    awk '/the program/ { program = $3 } /this machine/ { here = $3 } END { exit !(here > 50 && program >= here - 2) }' "$out/$1.txt"
}

# Without checkpoints it is the policy file that is exported.
programs && pilot_library cargo && run_with_pilot hover "$run" && rm -r "$run/checkpoints" &&
  target/debug/kestrel export "$run" --target crazyflie >/dev/null &&
  target/debug/kestrel export "$run" --target betaflight >/dev/null
verdict $? "the programs build, and export the policy"
adapter crazyflie "$run/crazyflie/kestrel_controller.c"
verdict $? "the controller of crazyflie-firmware builds"
flies_as_here crazyflie
verdict $? "a policy flies through the controller interface of crazyflie-firmware"
adapter betaflight "$run/betaflight/nn_controller.c"
verdict $? "the neural interface of Betaflight's forks builds"
flies_as_here betaflight
verdict $? "a policy flies through the neural interface of Betaflight's forks"
summary
