#!/usr/bin/env bash
# Clients that others wrote fly a policy as they are published, and its true state is judged: pymavlink, MAVSDK 3 and 4,
# MAVProxy, cflib and cfclient for the Crazyflie's own protocol, FFmpeg for its camera, and Cyclone DDS for ROS 2's.
#
#   tests/clients.sh [KESTREL [POLICY]]
#
# KESTREL is the path of `kestrel` (target/debug/kestrel if it is left out). Installs each client's packages into an
# environment of its own under target, where they are missing. What a client said is kept in target/test-logs. Ends with
# "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh
# shellcheck source=tests/packages.sh
. tests/packages.sh

kestrel=${1:-target/debug/kestrel}
policy=${2:-assets/pilots/hover.kestrel}
logs=target/test-logs
# Five times what the slowest one takes.
limit_secs=600
mkdir -p "$logs"

fly() { # NAME ENVIRONMENT: runs a test in its environment; leaves what it said, and its status
  timeout "$limit_secs" "target/$2/bin/python" "tests/python/$1_test.py" "$kestrel" "$policy" >"$logs/$1.log" 2>&1
  echo $? >"$place/$1.status"
}

tell() { # NAME CLIENT: what became of its checks, and all that it said if one failed
  local log=$logs/$1.log status sums
  status=$(cat "$place/$1.status" 2>/dev/null || echo nothing)
  sums=$(grep -aoE '^[0-9]+ passed, [0-9]+ failed' "$log" | awk '{p += $1; f += $3} END {print p + 0, f + 0}')
  printf -- '-- %s\n' "$2"
  # The sum of all clients is told once, at the end.
  if [ "$status" = 0 ]; then grep -aE '^ok ' "$log"; else grep -avE '^[0-9]+ passed, [0-9]+ failed' "$log"; fi
  passed=$((passed + ${sums% *}))
  failed=$((failed + ${sums#* }))
  if [ "$status" != 0 ] && [ "${sums#* }" -eq 0 ]; then
    echo "FAILED: $2 ended with status $status"
    failed=$((failed + 1))
  fi
}

declare -A needs=([venv]=requirements [venv-mavsdk3]=mavsdk3-requirements [venv-mavsdk4]=mavsdk4-requirements
  [venv-mavproxy]=mavproxy-requirements [venv-cflib]=crtp-requirements [venv-cfclient]=cfclient-requirements)
for environment in "${!needs[@]}"; do
  check "packages of target/$environment" \
    python_environment "target/$environment" "tests/python/${needs[$environment]}.txt"
done

# These fly faster than the wall clock, and use a processor.
fly fly venv
fly signing venv
# These mostly wait for it.
fly mavsdk3 venv-mavsdk3 &
fly mavsdk4 venv-mavsdk4 &
fly mavproxy venv-mavproxy &
fly crtp venv-cflib &
fly ros2 venv &
wait
# These encode and decode pictures.
fly video venv &
fly ai_deck venv-cflib &
wait
# It looks for drones where the one before is.
fly cfclient venv-cfclient

tell fly "pymavlink"
tell signing "pymavlink, with a key"
tell mavsdk3 "MAVSDK 3"
tell mavsdk4 "MAVSDK 4"
tell mavproxy "MAVProxy"
tell crtp "cflib"
tell ros2 "Cyclone DDS, as a ROS 2 node would"
tell video "FFmpeg, of the stream of the camera"
tell ai_deck "cflib, of an AI-deck"
tell cfclient "cfclient"
summary
