#!/usr/bin/env bash
# Ships pilots, and makes the page that shows all of them: docs/pilots.md, from assets/pilots.
#
#   tests/pilots.sh                                   judges and draws those that are shipped: some minutes
#   tests/pilots.sh runs/solved/room-1-201 …          ships the policies of these runs before, each by the name of its task
#   tests/pilots.sh aviaries/hover=runs/solved/hover-201      … or by this name
#
# Builds the program first, unless KESTREL names one: it carries the pilots.
set -euo pipefail
cd "$(dirname "$0")/.."
for run in "$@"; do
    name=$(sed -n 's/^name: //p' "${run#*=}/config.yaml")
    [ "$run" = "${run#*=}" ] || name=${run%%=*}
    mkdir -p "$(dirname "assets/pilots/$name")"
    cp "${run#*=}/policy.kestrel" "assets/pilots/$name.kestrel"
done
[ -n "${KESTREL:-}" ] || cargo build --quiet --release
exec python3 tests/python/pilots_page.py "${KESTREL:-target/release/kestrel}"
