"""Judges every pilot of assets/pilots in its own task, takes a picture of its flight, and writes docs/pilots.md.

    python pilots_page.py KESTREL

Pilots fly by their names, from the starts of their task's evaluation.
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

PILOTS = pathlib.Path("assets/pilots")
PAGE = pathlib.Path("docs/pilots.md")
PICTURES = pathlib.Path("docs/pictures/pilots")
ACROSS = 4
"""Pictures in a row."""

HEAD = """# The pilots that come with the program

The program carries a policy for most tasks, in fixed point. It flies by the name of its task:

```sh
kestrel fly room-1                        # a MAVLink vehicle in room 1
kestrel evaluate room-1                   # how often it succeeds
kestrel view room-1                       # its flight in a window: build with --features viewer
kestrel render room-1 -o room-1.gif       # the same as a film
kestrel evaluate room-0 room-1 --tasks room-0 room-1
kestrel export room-1 --target c          # for your firmware
```

`tests/pilots.sh` makes this page. "Success" is that of the fixed-point policy in the starts of the
task's own evaluation, with Wilson's 95 % interval, beside the scripted pilot, which knows the map.
A pilot is the policy of `kestrel train NAME --seed 201`; `cross`, `hover`, `hover-2-1-plus` and
`hover-cf2x` are those of seed 0, `any` that of 918, `forest` that of 929, `forest-team` that of
946, `harder-cross-11-vision` that of 701, `land-vision` that of 702, `land-with-obstacles` that of
704, `race`, `room-0` and `room-0-vision` those of 801, `room-2` and `room-2-vision` those of 802,
`room-1` and `room-1-vision` those of 804, `unseen-rooms` that of 912, `unseen-rooms-beams` that of
939, `unseen-rooms-tof` that of 953.

"""


def evaluated(kestrel, name, cache):
    """The report of a pilot, and the folder of its run."""
    environment = {**os.environ, "XDG_CACHE_HOME": cache}
    subprocess.run([kestrel, "evaluate", name], check=True, env=environment, stdout=subprocess.DEVNULL)
    folder = next(pathlib.Path(cache).glob(f"kestrel/*/pilots/{name}"))
    reports = json.loads((folder / "evaluation.json").read_text(encoding="utf-8"))
    return reports if isinstance(reports, list) else [reports]


def photographed(kestrel, name, secs, cache):
    """A picture from behind, halfway."""
    picture = PICTURES / f"{name}.png"
    picture.parent.mkdir(parents=True, exist_ok=True)
    look = ["--panels", "chase", "--columns", "200", "--at", f"{secs:.2f}", "-o", str(picture)]
    environment = {**os.environ, "XDG_CACHE_HOME": cache}
    subprocess.run([kestrel, "render", name, *look], check=True, env=environment, stdout=subprocess.DEVNULL)
    return picture


def about(name):
    """The first sentence of the task's file."""
    path = next(path for path in [f"configs/{name}.yaml", f"configs/aviaries/{name}.yaml"] if os.path.exists(path))
    comment = []
    for line in pathlib.Path(path).read_text(encoding="utf-8").splitlines():
        if line.startswith("# yaml-language-server") or (not comment and line in ("#", "")):
            continue
        if not line.startswith("# "):
            break
        comment.append(line[2:])
    return re.split(r"(?<=\.) |: ", " ".join(comment))[0].rstrip(".")


def judged(kestrel, name):
    """A row of the table, and a cell of the grid."""
    with tempfile.TemporaryDirectory() as cache:
        reports = evaluated(kestrel, name, cache)
        fixed = [next(row for row in report["rows"] if row["pilot"] == "fixed16") for report in reports]
        scripted = [next(row for row in report["rows"] if row["pilot"] == "scripted pilot") for report in reports]
        picture = photographed(kestrel, name, fixed[0]["length_secs"] / 2, cache)
    mean = lambda rows: f"{100 * sum(row['success_rate'] for row in rows) / len(rows):.1f} %"
    low, high = fixed[0]["success_interval"]
    interval = f"{100 * low:.1f} to {100 * high:.1f}" if len(fixed) == 1 else f"{len(fixed)} tasks"
    size = f"{(PILOTS / name).with_suffix('.kestrel').stat().st_size / 1024:.1f}"
    row = f"| `{name}` | {about(name)} | {mean(fixed)} | {interval} | {mean(scripted)} | {size} |"
    return row, f"![{name}]({picture.relative_to(PAGE.parent)})<br>`{name}`"


def main(kestrel):
    names = sorted(str(path.relative_to(PILOTS).with_suffix("")) for path in PILOTS.rglob("*.kestrel"))
    rows, cells = zip(*(judged(kestrel, name) for name in names))
    cells = list(cells) + [""] * (-len(cells) % ACROSS)
    grid = [f"| {' | '.join(cells[at:at + ACROSS])} |" for at in range(0, len(cells), ACROSS)]
    grid = ["|" + "  |" * ACROSS, "|" + "---|" * ACROSS, *grid]
    table = ["| pilot | task | success | 95 % interval | scripted pilot | KiB |", "|---|---|--:|--:|--:|--:|", *rows]
    PAGE.write_text(HEAD + "\n".join(grid) + "\n\n" + "\n".join(table) + "\n", encoding="utf-8")
    print(PAGE)


if __name__ == "__main__":
    main(sys.argv[1])
