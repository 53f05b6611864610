#!/usr/bin/env bash
# Runs fly their tasks behind MAVLink, as often with success as `kestrel evaluate` says: one that sees beams, one that
# remembers, an imported network of Stable-Baselines3, and seven pilots that come with the program, by their names; one of these
# in two of the thirteen rooms that it learned. The first two are trained for seconds, to be neither perfect nor hopeless.
#
#   tests/tasks.sh KESTREL
#
# Needs the Python environment of tests/run. Ends with "N passed, N failed".
set -euo pipefail
cd "$(dirname "$0")/.."
kestrel=$1
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

trained() { # NAME CONFIG [KESTREL OPTION...]: a run in $out
  local name=$1 config=$2
  shift 2
  "$kestrel" train "configs/aviaries/$config.yaml" --run "$out/$name" --set evaluation.episodes=16 "$@" >"$out/$name.log" 2>&1 ||
    { cat "$out/$name.log"; exit 1; }
}

trained beams room-0 --set training.total_steps=524288
trained memory takeoff --set training.total_steps=1048576 --set training.minibatch=4096 \
  --set training.memory.units=8
"$kestrel" import tests/golden/foreign/sb3-ppo.onnx --task configs/hover.yaml -o "$out/imported" \
  --set evaluation.episodes=16 >"$out/imported.log" 2>&1 || { cat "$out/imported.log"; exit 1; }
target/venv/bin/python tests/python/task_test.py "$kestrel" 12 "$out/beams" "$out/memory" "$out/imported" \
  room-1 land takeoff fly-through-gate maze trajectory crosses:incremental-cross-6 crosses:harder-cross-16
