#!/usr/bin/env bash
# Trains tasks of configs/aviaries by their own commands, one thread each, and prints a row of docs/solved-tasks.md for each.
# What is in FOLDER already is not trained again. A task takes a third of a minute to four minutes of a core for each seed, one
# with a camera four to eight.
#
#   tests/solved-tasks.sh FOLDER "SEEDS" TASK …
#   tests/solved-tasks.sh runs/solved "201 202 203 204 205" takeoff meetup
set -euo pipefail
cd "$(dirname "$0")/.."
kestrel=${KESTREL:-target/release/kestrel}
folder=$1 seeds=$2
shift 2
mkdir -p "$folder"
seconds=0
for task in "$@"; do case $task in *room*-vision | *cross*-vision) ((seconds += 400)) ;; *) ((seconds += 40)) ;; esac; done
echo "$# tasks, $(wc -w <<<"$seeds") seeds each: about $((seconds * $(wc -w <<<"$seeds") / 60)) minutes of one core" >&2
for task in "$@"; do
    for seed in $seeds; do
        run=$folder/$task-$seed
        [ -e "$run.secs" ] && continue
        rm -rf "$run"
        TIMEFORMAT='%U %S'
        { time "$kestrel" train "configs/aviaries/$task.yaml" --seed "$seed" --threads 1 --run "$run" >"$run.log" 2>&1; } \
            2>"$run.time"
        mv "$run.time" "$run.secs"
    done
    python3 - "$folder" "$task" $seeds <<'PY'
import json, pathlib, sys

folder, task, seeds = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3:]
share = lambda rate: f"{100 * rate:.1f}"
reports = [json.loads((folder / f"{task}-{seed}/evaluation.json").read_text()) for seed in seeds]
rows = [{row["pilot"]: row["success_rate"] for row in report["rows"]} for report in reports]
secs = [sum(map(float, (folder / f"{task}-{seed}.secs").read_text().split()[-2:])) for seed in seeds]
last = (folder / f"{task}-{seeds[0]}/metrics.jsonl").read_text().splitlines()[-1]
floats = ", ".join(share(row["float32"]) for row in rows)
lost = max(row["float32"] - next(v for k, v in row.items() if k.startswith("fixed")) for row in rows)
first = rows[0]
print(
    f"| `{task}` | {json.loads(last)['steps'] / 1e6:.1f} M | {min(secs):.0f} to {max(secs):.0f} s | {floats} "
    f"| {100 * lost:.1f} | {share(first['scripted pilot'])} % | {share(first['do nothing'])} % |"
)
PY
done
