"""A pymavlink client has policies fly the tasks that they were trained for, and counts the successes.

    python task_test.py KESTREL STARTS RUN... [-- more arguments of `kestrel fly`]

Each RUN, the directory of a run or the name of a pilot that comes with the program, flies from the first STARTS starts of
its evaluation behind MAVLink; as many succeed, by the true state, as `kestrel evaluate` counts on the same starts. RUN:TASK is
one task of a run that has several. Needs the packages of requirements.txt. Exit status 0 if every check passed.
"""

import json
import os
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

from client import COMMAND, NAN, Client
from judge import Simulated, checks_of, conclude, expect, run_checks

ENDED = re.compile(r"task (\d+): (success|failure), ([a-z ]+), ([0-9.]+) s")

EVENT = ["EVENT", "UNKNOWN_410"]
"""pymavlink's usual dialect does not know it."""

TASK_ENDED = 1 << 24 | 2
"""The number of the event, by the vehicle's metadata: start, outcome, seconds."""

SPEED = ["--speed", "10"]
"""What a client in Python can read on a busy machine: faster, datagrams are lost, and with them the end of a task."""

HELD_SECS = 1.0
"""For which it is watched after a success, from a second later on [simulated s]."""

DRIFT_M = 1.0
"""Farthest that it goes in that time: it comes to rest from the speed of its task, 2 m/s in a Cross, and back."""


def event_of(message):
    """Number, start, outcome and seconds of an event about a task."""
    told = bytes(message.get_msgbuf())
    return struct.unpack("<I9xIBf", told[10 : 10 + told[1]].ljust(22, b"\0")[:22])


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, kestrel, run, starts, vehicle, client):
        self._kestrel = kestrel
        self._run, *self._task = run
        self._starts = starts
        self._vehicle = vehicle
        self._client = client
        self._ends = {}

    def hears_a_heartbeat(self):
        self._client.receive("HEARTBEAT", within_secs=60.0)
        self._client.may_pause()

    def refuses_what_is_no_start(self):
        for start in [-1.0, 0.5, float("inf")]:
            result = self._client.command(COMMAND.MAV_CMD_USER_1, start)
            expect(result == COMMAND.MAV_RESULT_DENIED, f"start {start} was answered with {result}")

    def flies_its_task_from_every_start(self):
        for start in range(self._starts):
            # The first from the ground, the others as the next.
            self._client.accepted(COMMAND.MAV_CMD_USER_1, NAN if start else 0.0)
            told = self._client.receive("STATUSTEXT", within_secs=60.0, where=lambda told: ENDED.match(told.text))
            number, verdict, cause, secs = ENDED.match(told.text).groups()
            expect(int(number) == start, f"start {start} was told as {told.text}")
            event = self._client.receive(EVENT, where=lambda told: event_of(told)[0] == TASK_ENDED)
            told = event_of(event)
            expect(told[1:3] == (start, verdict == "success"), f"start {start}, a {verdict}, is the event {told}")
            self._ends[start] = (verdict, cause, float(secs))

    def succeeds_as_often_as_its_evaluation(self):
        subprocess.run(
            [self._kestrel, "evaluate", self._run, *self._task, "--episodes", str(self._starts)],
            check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        reports = json.loads((folder_of(self._run) / "evaluation.json").read_text(encoding="utf-8"))
        # Of several tasks `fly` has the first.
        report = reports[0] if isinstance(reports, list) else reports
        expected = round(report["rows"][0]["success_rate"] * self._starts)
        found = sum(verdict == "success" for verdict, _, _ in self._ends.values())
        print(f"        {found} of {self._starts} succeed, {expected} in the evaluation", flush=True)
        expect(abs(found - expected) <= 0.02 * self._starts, f"{found} successes, {expected} in the evaluation")

    def holds_after_a_success(self):
        start = next((start for start, end in self._ends.items() if end[0] == "success"), None)
        if start is None:
            return
        self._client.accepted(COMMAND.MAV_CMD_USER_1, start)
        self._client.says(f"task {start}: success")
        # The log of the true state may lag behind the message.
        self._client.pass_time(HELD_SECS)
        begin = self._vehicle.true.now()
        expect(begin["mode"] == "holding", f"it is {begin['mode']}")
        self._client.pass_time(HELD_SECS)
        now = self._vehicle.true.now()
        drift = sum((a - b) ** 2 for a, b in zip(begin["position"], now["position"])) ** 0.5
        expect(now["mode"] == "holding" and drift < DRIFT_M, f"it is {now['mode']}, {drift:.2f} m away")

    def stops_the_task_for_a_command(self):
        self._client.accepted(COMMAND.MAV_CMD_USER_1, 0.0)
        result = self._client.command(COMMAND.MAV_CMD_USER_1, 1.0)
        expect(result == COMMAND.MAV_RESULT_DENIED, f"a second task was answered with {result}")
        self._client.accepted(COMMAND.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, NAN, NAN, NAN)
        self._client.says("task stopped")


def folder_of(run):
    """The directory of a run, or that which the program makes for a pilot of this name."""
    if os.path.isdir(run):
        return pathlib.Path(run)
    return next(pathlib.Path(os.environ["XDG_CACHE_HOME"]).glob(f"kestrel/*/pilots/{run}"))


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    kestrel, starts, *runs = sys.argv[1:]
    more = []
    if "--" in runs:
        runs, more = runs[: runs.index("--")], runs[runs.index("--") + 1 :]
    flown = []
    for run in runs:
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_CACHE_HOME"] = folder
            name, _, task = run.partition(":")
            chosen = [name, "--task", task] if task else [name]
            print(f"{run}:", flush=True)
            with Simulated(kestrel, [*chosen, *SPEED, *more], folder) as vehicle, Client(vehicle) as client:
                flown.append(run_checks(checks_of(Flight(kestrel, chosen, int(starts), vehicle, client))))
    sys.exit(conclude(*flown))


if __name__ == "__main__":
    main()
