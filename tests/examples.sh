#!/usr/bin/env bash
# Trains every task of configs/examples and films a flight, for docs/examples.md: about five minutes.
#
#   tests/examples.sh FOLDER [SEED]
#
# Runs go to FOLDER, where those that are finished are not trained again. Builds the program first, unless KESTREL names one.
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -ge 1 ] || {
  sed -n '2,/^[^#]/s/^# \{0,1\}//p' tests/examples.sh
  exit 2
}
[ -n "${KESTREL:-}" ] || cargo build --quiet --release
kestrel=${KESTREL:-target/release/kestrel}
# Those with long flights are smaller.
declare -A columns=([race-two-laps]=104 [meet-at-a-height]=120)
for task in configs/examples/*.yaml; do
  name=$(basename "$task" .yaml)
  [ -e "$1/$name/evaluation.json" ] || "$kestrel" train "$task" --seed "${2:-901}" --run "$1/$name"
  "$kestrel" render "$1/$name" --panels chase --columns "${columns[$name]:-144}" --samples 2 \
    -o "docs/pictures/examples/$name.gif"
done
