"""Every command of README and the book is run as it stands there, but for less time: a reader's copy must not be the first.

    python pages_test.py KESTREL

KESTREL is the path of the binary. Commands run in a folder of their own, in the order in which they stand, with the runs that
the pages call `runs/hover-seed0-1` or `RUN` beside them. What is shortened stands in SHORTENED, what is run by another suite
or cannot be run here in ELSEWHERE; a command in neither that fails, or that nobody knows, is a failure. Exit status 0 if
every check passed.
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]

PAGES = ["README.md", "firmware-shim/README.md", "core-nostd/README.md", "firmware-shim/onboard/README.md", "CONTRIBUTING.md"]
"""Beside those of docs."""

SHORTENED = [
    (r"^kestrel train (?!--resume|.*runs/first)", " --set training.total_steps=65536 --set evaluation.episodes=4"),
    (r"^kestrel train configs/(hover|px4-neural|any)(?!.*analytic=null)", " --set training.analytic.total_steps=24576"),
    (r"^kestrel evaluate", " --episodes 4"),
    (r"^kestrel baseline", " --episodes 4"),
    (r"^kestrel fly", " --for-secs 1 --speed max --listen 127.0.0.1:0 --ground-station 127.0.0.1:9"),
    (r"^kestrel view (?!.*--headless)", " --headless window.png"),
]
"""Beginnings of commands, and what is written behind them here."""

REPLACED = {
    "--episodes 4096": "",
    "--episodes 1000": "",
    "--episodes 400": "",
    "RUN": "runs/hover-seed0-1",
    "STUDY...": "tiny",
    "STUDY": "tiny",
    "search run FILE": "search run anchor-strength",
    "flights/*.yaml": "configs/tests/hover.yaml",
    "kestrel replay flight ": "kestrel replay flight.recording ",
    "runs/mine/policy.kestrel": "assets/pilots/hover.kestrel",
}
"""Placeholders, and what stands for them."""

ELSEWHERE = [
    (r"^git clone", "a reader's first step: .ci/run"),
    (r"^tests/|^cargo (check|test|fmt)", "tests/run"),
    (r"^cargo build|^cargo run .*--features", "tests/run builds these features"),
    (r"^rustup|^RUSTFLAGS|--processor qemu|^mpirun", "tests/firmware.sh, tests/mpi.sh"),
    (r"^cd runs/hover/crazyflie|^make ", "needs Bitcraze's firmware: tests/adapters.sh compiles the app against its headers"),
    (r"^kestrel identify", "needs flight logs: tests of kestrel-identify with logs of their own"),
    (r"^kestrel bridge|^PX4_SYS|arducopter|betaflight_SITL|^cf2 ", "needs an autopilot: tests/python/*_test.py when one is named"),
    (r"^pip |^maturin ", "tests/python-package.sh"),
    (r"^sim-host/web/build|^python3 -m http", "tests/web.sh"),
    (r"^kestrel fly .*--view|^kestrel train .*--watch", "needs a screen: tests/viewer.sh"),
    (r"^ffplay", "tests/python/video_test.py plays it by FFmpeg's libraries"),
    (r"^ros2 |--ros2", "tests/python/ros2_test.py"),
    (r"^source <\(kestrel completions", "tests/command_line/runs.rs"),
    (r"^kestrel train configs/(aviaries/(unseen-rooms|forest)|benchmarks/hundred)", "minutes: kestrel-experiments trains in drawn rooms"),
    (r"^kestrel search run", "hours: tests/command_line/search.rs with a search of seconds"),
    (r"^kestrel study run", "hours: tests/command_line/study.rs with a study of seconds"),
    (r"^cargo run --release -- bench", "minutes: tests/command_line/runs.rs measures some rows"),
    (r"^kestrel aviary generate", "half a minute: tests/command_line/aviary.rs makes some"),
    (r"^kestrel test configs", "a minute: tests/command_line/flight_tests.rs"),
]
"""What is not run, and who does it."""


def commands(text):
    """The lines of a page's blocks for shells, without comments."""
    for body in re.findall(r"```(?:sh|bash|console)\n(.*?)```", text, re.S):
        for line in body.replace("\\\n", " ").splitlines():
            line = re.sub(r"(^|\s)# .*$", "", line).strip()
            if line:
                yield re.sub(r"\s+", " ", line)


def adapted(command):
    """As it is run here."""
    command = re.sub(r"^cargo run --release -- ", "kestrel ", command)
    for found, other in REPLACED.items():
        command = (command + " ").replace(found, other).rstrip()
    more = [words for beginning, words in SHORTENED if re.search(beginning, command)]
    return command + "".join(more)


def prepared(folder, shell):
    """What the pages take for granted."""
    for name in ("configs", "assets", "docs", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("results", "__pycache__"))
    shutil.copy(ROOT / "RESULTS.md", folder)
    shutil.copy(ROOT / "tests/golden/foreign/sb3-ppo.safetensors", folder / "policy.safetensors")
    shell("kestrel train configs/hover.yaml --run runs/hover-seed0-1 --set training.analytic.total_steps=24576")
    shell("kestrel baseline configs/hover.yaml --episodes 1 --record flight.recording")
    shell("kestrel study run tests/command_line/tiny-study.yaml --directory tiny --set seeds.count=1")


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    kestrel = pathlib.Path(sys.argv[1]).resolve()
    passed, failed, elsewhere, took = 0, 0, set(), []
    with tempfile.TemporaryDirectory() as place:
        folder, programs = pathlib.Path(place) / "reader", pathlib.Path(place) / "bin"
        folder.mkdir()
        programs.mkdir()
        (programs / "kestrel").symlink_to(kestrel)
        environment = os.environ | {"PATH": f"{programs}:{os.environ['PATH']}", "XDG_CACHE_HOME": f"{place}/cache"}

        def shell(command):
            """Whether it ended well, and what it said."""
            try:
                ended = subprocess.run(
                    ["bash", "-c", command], cwd=folder, env=environment, text=True, timeout=300,
                    stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                )  # fmt: skip
            except subprocess.TimeoutExpired:
                return False, "still running after 300 s"
            return ended.returncode == 0, ended.stdout[-1500:]

        prepared(folder, shell)
        pages = PAGES + sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").glob("*.md"))
        for page in pages:
            for command in commands((ROOT / page).read_text(encoding="utf-8")):
                reason = next((reason for pattern, reason in ELSEWHERE if re.search(pattern, command)), None)
                if reason:
                    elsewhere.add(f"{command}: {reason}")
                    continue
                begun = time.monotonic()
                succeeded, said = shell(adapted(command))
                took.append((time.monotonic() - begun, command))
                passed, failed = passed + succeeded, failed + (not succeeded)
                if not succeeded:
                    print(f"FAILED  {page}: {command}\n  as {adapted(command)}\n{said}", flush=True)
    print(f"{len(elsewhere)} commands are run elsewhere:")
    print("\n".join(f"  {line}" for line in sorted(elsewhere)))
    print("the slowest:", ", ".join(f"{command} ({secs:.0f} s)" for secs, command in sorted(took, reverse=True)[:8]))
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
