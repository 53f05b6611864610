#!/usr/bin/env bash
# Policies fly the simulator through the interfaces of autopilots, as programs of this machine.
#
#   tests/adapters.sh
#
# Each adapter of tests/firmware/adapters is an autopilot's own interface around assets/pilots/hover.kestrel: the controller of
# crazyflie-firmware (tests/firmware/crazyflie has its headers) and the neural interface of Betaflight's forks, both as
# `kestrel export` completes them. It flies EPISODES starts of hover's evaluation, 64 unless told otherwise, and must succeed in
# as many of a hundred as the pilot of this machine to within two; with motors that carry 168 % of the weight in place of the 215
# % of the training, to within five.
#
# The app for crazyflie-firmware also flies two policies that see beams: one whose app casts them in the maps of its thirteen
# rooms, and one with the five rangers of the Multi-ranger deck; and one with a memory. With a battery that leaves 72 % of the
# thrust room-1 is flown as badly as by the pilot of this machine, and once the app learns what the rotors lack by ten of a
# hundred better at least.
#
# The controller of Betaflight's forks also meets 12,000 states with special values, a rate that is lost and a goal that grows old,
# compiled as firmwares do: no motor stops.
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

adapter() { # NAME ARGUMENT...: an adapter with the autopilot's part
  gcc -std=gnu11 -O2 -Wall -Wextra -Werror -DDEBUG_STREAM=stderr -I "$run/$1" -I firmware-shim/crazyflie/include \
    -I tests/firmware/crazyflie "$adapters/adapter.c" "$adapters/$1.c" "$run/$1/policy.c" "${@:2}" \
    target/debug/libkestrel_pilot.a -lpthread -ldl -lm -o "$out/$1"
}

flies_as_here() { # NAME POINTS [OPTION...]: by how many points of a hundred fewer flights may succeed
  target/debug/kestrel evaluate "$run" "${@:3}" --episodes "${EPISODES:-64}" --processor program --image "$out/$1" >"$out/$1.txt"
  local status=$?
  cat "$out/$1.txt"
  [ $status -eq 0 ] &&
    awk -v points="$2" '/the program/ { program = $3 } /this machine/ { here = $3 }
      END { exit !(here > 50 && program >= here - points) }' "$out/$1.txt"
}

in_doubt() { # FLAG...: what the controller of Betaflight's forks does, compiled so
  local include=(-I "$run/betaflight" -Wall -Wextra -Werror)
  gcc -std=c99 "$@" "${include[@]}" -c "$run/betaflight/nn_controller.c" -o "$out/nn_controller.o" &&
    gcc -std=c99 -O1 "${include[@]}" "$adapters/betaflight_doubts.c" "$out/nn_controller.o" "$run/betaflight/policy.c" \
      target/debug/libkestrel_pilot.a -lpthread -ldl -lm -o "$out/doubts" &&
    "$out/doubts" >"$out/doubts.txt" && grep -q 'of 12000 special states [0-9]* refused, 0 motors stopped' "$out/doubts.txt" &&
    grep -q 'without a rate: 111 of the policy, 0 motors stopped, then code 104' "$out/doubts.txt" &&
    grep -q 'with the rate again it flies: 1' "$out/doubts.txt" &&
    grep -q 'a goal is flown to for 499 ms, then code 120' "$out/doubts.txt"
}

# Without checkpoints it is the policy file that is exported.
programs && pilot_library cargo && run_with_pilot hover "$run" && rm -r "$run/checkpoints" &&
  target/debug/kestrel export "$run" --target crazyflie >/dev/null &&
  target/debug/kestrel export "$run" --target betaflight >/dev/null
verdict $? "the programs build, and export the policy"
adapter crazyflie "$run/crazyflie/kestrel_controller.c" -DCONFIG_CRAZYFLIE_THRUST_UPGRADE_KIT
verdict $? "the controller of crazyflie-firmware builds"
flies_as_here crazyflie 2
verdict $? "a policy flies through the controller interface of crazyflie-firmware"
adapter crazyflie "$run/crazyflie/kestrel_controller.c" && flies_as_here crazyflie 5
verdict $? "it flies so with the motors of a stock Crazyflie"
run=$out/crosses
mkdir -p "$run" && target/debug/kestrel export crosses --target crazyflie --output "$run" >/dev/null &&
  adapter crazyflie "$run/crazyflie/kestrel_controller.c" -DCONFIG_CRAZYFLIE_THRUST_UPGRADE_KIT
verdict $? "the controller builds around a policy that sees a scan, with the maps of its rooms"
run=crosses
for room in 0:incremental-cross-0 6:incremental-cross-6 12:harder-cross-16; do
  ROOM=${room%%:*} flies_as_here crazyflie 5 --task "${room#*:}"
  verdict $? "a policy flies ${room#*:} by beams that the controller casts in its map"
done
run=$out/room-1
mkdir -p "$run" && target/debug/kestrel export room-1 --target crazyflie --output "$run" >/dev/null &&
  adapter crazyflie "$run/crazyflie/kestrel_controller.c" -DCONFIG_CRAZYFLIE_THRUST_UPGRADE_KIT
verdict $? "the controller builds around the policy of a furnished room"
run=room-1
empty=scenario.randomisation.battery_share=[0.85,0.85]
flies_as_here crazyflie 8 --set "$empty"
verdict $? "with an empty battery it flies as badly as here"
COMPENSATES=1 flies_as_here crazyflie -10 --set "$empty"
verdict $? "it flies better once it learns what its rotors lack"
run=$out/run-ranger
rm -rf "$run" && target/debug/kestrel train configs/aviaries/incremental-cross-0.yaml --run "$run" \
  --set 'scenario.sensors=[range: {}]' --set training.total_steps=524288 --set evaluation.episodes=16 >/dev/null 2>&1 &&
  rm -r "$run/checkpoints" && target/debug/kestrel export "$run" --target crazyflie >/dev/null &&
  adapter crazyflie "$run/crazyflie/kestrel_controller.c" -DCONFIG_CRAZYFLIE_THRUST_UPGRADE_KIT
verdict $? "the controller builds around a policy that sees the Multi-ranger"
flies_as_here crazyflie 5
verdict $? "a policy flies by the rangers' log variables"
run=$out/run-memory
rm -rf "$run" && pilot_library cargo --features recurrent && target/debug/kestrel train configs/aviaries/takeoff.yaml --run "$run" \
  --set training.total_steps=1048576 --set training.minibatch=4096 --set training.memory.units=8 \
  --set evaluation.episodes=16 >/dev/null 2>&1 && rm -r "$run/checkpoints" &&
  target/debug/kestrel export "$run" --target crazyflie >/dev/null &&
  grep -q '^KESTREL_FEATURES ?= ,recurrent$' "$run/crazyflie/Kbuild" &&
  adapter crazyflie "$run/crazyflie/kestrel_controller.c" -DCONFIG_CRAZYFLIE_THRUST_UPGRADE_KIT
verdict $? "the controller builds around a policy with a memory"
flies_as_here crazyflie 5
verdict $? "a policy with a memory flies through the controller interface of crazyflie-firmware"
run=$out/run-hover
pilot_library cargo && adapter betaflight "$run/betaflight/nn_controller.c"
verdict $? "the neural interface of Betaflight's forks builds"
flies_as_here betaflight 2
verdict $? "a policy flies through the neural interface of Betaflight's forks"
adapter betaflight "$run/betaflight/nn_controller.c" -DGREATEST_SPEED=1964.0f && flies_as_here betaflight 5
verdict $? "it flies so with weaker motors, of which none takes the moment from the others"
for flags in -O0 -Os "-O3 -ffast-math"; do
  # shellcheck disable=SC2086  # flags
  in_doubt $flags
  verdict $? "with $flags no motor stops in doubt: it holds, then hands over"
done
summary
