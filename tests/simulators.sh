#!/usr/bin/env bash
# A policy flies, unchanged, the Crazyflie of simulators that others wrote: RotorPy, PyBullet with the model of
# gym-pybullet-drones, PyFlyt and Crazyflow.
#
#   tests/simulators.sh [POLICY [STARTS [SIMULATOR...]]]     # an empty POLICY: the shipped ones
#
# The core's pilot (observation, network, rate loop and mixer) is called through its C interface; each simulator brings mass,
# inertia, rotors and air. Thrusts go to its own rotors by its own constants. The starts are those of the evaluation in
# configs/hover.yaml: half a metre away, up to 90 degrees tilted, moving and turning, any heading; 8 s, 256 of them unless told
# otherwise. A simulator passes if at least 98 % come to stay within 5 cm from 4 s on, and if none of those turns farther than
# HEADING_DEG from the heading of its start, which is commanded: 10 unless told otherwise, 180 for a policy that sees none.
#
# Unless told otherwise, Crazyflow's Crazyflies with motors of 116 to 136 ms are flown by the pilot that has learned on the
# airframe crazyflie_2_1_plus, all others by that of configs/hover.yaml as it is.
#
# The table is printed and kept in target/simulators/table.md. Each simulator's packages are installed into an environment under
# target where they are missing. Ends with "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh
# shellcheck source=tests/packages.sh
. tests/packages.sh

policy=${1:-}
starts=${2:-256}
shift $(($# < 2 ? $# : 2))
[ $# -gt 0 ] || set -- rotorpy pybullet pyflyt crazyflow crazyflow-P250 crazyflow-T350 crazyflow-brushless
heading=${HEADING_DEG:-10}
[ -z "$policy" ] || policy=$(realpath "$policy")
here=$PWD
out=target/simulators
mkdir -p "$out"

library() { # the core's pilot for many drones, as Python loads it
  cargo rustc --quiet -p kestrel-crazyflie --features recurrent --lib --crate-type staticlib &&
    gcc -shared -fPIC -O2 -Wall -Wextra -Werror -I firmware-shim/crazyflie/include tests/simulators/pilot.c \
      target/debug/libkestrel_pilot.a -lpthread -ldl -lm -o "$out/pilot.so"
}

environment() { # SIMULATOR: which one it needs
  case $1 in
  rotorpy | pybullet) echo rotorpy ;;
  *) echo "${1%%-*}" ;;
  esac
}

pilot() { # SIMULATOR: the policy that flies it
  local shipped=$here/assets/pilots
  case $1 in
  crazyflow | crazyflow-P250) echo "${policy:-$shipped/hover-2-1-plus.kestrel}" ;;
  *) echo "${policy:-$shipped/hover.kestrel}" ;;
  esac
}

fly() { # SIMULATOR: its row of the table
  local python
  python=$PWD/target/venv-$(environment "$1")/bin/python
  # Where a simulator may leave what it wants.
  (cd "$out" && "$python" "$OLDPWD/tests/simulators/flights.py" ./pilot.so "$(pilot "$1")" "$starts" "$1" 2>"$1.log") | grep "^| $1 |"
}

good() { # ROW: whether enough of the starts settled, and held their heading
  awk -F ' *[|] *' -v heading="$heading" '{ exit !($5 >= 98 && $9 <= heading) }' <<<"$1"
}

check "the core's pilot is a library for Python" library
for needed in $(for simulator; do environment "$simulator"; done | sort -u); do
  check "packages of target/venv-$needed" python_environment "target/venv-$needed" "tests/simulators/$needed-requirements.txt"
done

{
  echo "| simulator | drone | starts | settled [%] | mean error [cm] | median of all [cm] | turned by [°] | at most [°] | s |"
  echo "|---|---|---|---|---|---|---|---|---|"
} | tee "$out/table.md"
rows=()
for simulator; do
  row=$(fly "$simulator") || cat "$out/$simulator.log"
  rows+=("$row")
  echo "$row" | tee -a "$out/table.md"
done
for simulator; do
  good "${rows[0]}"
  verdict $? "$(basename "$(pilot "$simulator")") flies the Crazyflie of $simulator"
  rows=("${rows[@]:1}")
done
summary
