"""A bridge with a real autopilot behind it: what the tests of autopilots share.

The autopilots are no part of this project. Each test takes the path of a built one from an environment variable; without
it nothing is run, and that is said.
"""

import math
import os
import signal
import subprocess
import sys
import tempfile
import time

from judge import CheckFailed, TrueState, checks_of, conclude, expect, rounded, run_checks


class Bridged:
    """A simulation and the autopilot that flies it, each in its own process."""

    def __init__(self, kestrel, arguments, folder):
        self.folder = folder
        self.true = TrueState(os.path.join(folder, "true_state.jsonl"))
        self.processes = []
        command = [os.path.abspath(kestrel), "bridge", *arguments, "--true-state-log", self.true.path]
        self.start("bridge", command, os.getcwd())

    def start(self, name, command, working_folder=None):
        """Starts a program in a folder, or in the flight's; what it says goes to a file of that name in the flight's."""
        with open(os.path.join(self.folder, f"{name}.txt"), "w", encoding="utf-8") as output:
            process = subprocess.Popen(command, cwd=working_folder or self.folder, stdout=output, stderr=subprocess.STDOUT)
        self.processes.append((name, process))

    def stop(self):
        """Ends the program that was started last."""
        _, process = self.processes.pop()
        process.send_signal(signal.SIGINT)
        try:
            process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def said(self, name):
        with open(os.path.join(self.folder, f"{name}.txt"), encoding="utf-8", errors="replace") as output:
            return output.read()

    def expect_alive(self):
        for name, process in self.processes:
            expect(process.poll() is None, f"the {name} ended with status {process.returncode}: {self.said(name)[-500:]}")

    def secs(self):
        return self.true.now()["secs"]

    def origin(self):
        """Where the drone stood at first."""
        self.true.now()
        return self.true.moments[0]["position"]

    def offset(self):
        """East, north and up from the start [m]."""
        return [now - then for now, then in zip(self.true.position(), self.origin(), strict=True)]

    def velocity(self):
        return self.true.now()["velocity"]

    def expect_within(self, point, radius_m):
        """That it is near a point, counted from the start [m]."""
        distance = math.dist(self.offset(), point)
        expect(distance < radius_m, f"{distance:.2f} m from {point}, at {rounded(self.offset())}")

    def expect_stayed_within(self, point, radius_m, secs):
        """That it never left a point, counted from the start, during the last seconds."""
        moments = self.true.read()
        end = moments[-1]["secs"]
        wanted = [there + then for there, then in zip(point, self.origin(), strict=True)]
        farthest = max(math.dist(moment["position"], wanted) for moment in moments if moment["secs"] > end - secs)
        expect(farthest < radius_m, f"up to {farthest:.2f} m from {point}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        while self.processes:
            self.stop()


def autopilots_file(name):
    """The path of a file of settings for an autopilot."""
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    return os.path.join(root, "assets", "autopilots", name)


def fly_with(variable, usual_path, fly):
    """Has `fly(autopilot, kestrel, arguments, folder)` make a flight, whose checks are run. The program's exit status."""
    program = os.path.basename(sys.argv[0]).removesuffix(".py")
    autopilot = os.environ.get(variable)
    if not autopilot:
        print(f"{program}: NOT RUN, for {variable} names no binary ({usual_path})")
        return 0
    kestrel, *arguments = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        begin = time.monotonic()
        with fly(os.path.abspath(autopilot), kestrel, arguments, folder) as flight:
            status = conclude(run_checks(checks_of(flight)))
            moments, wall_secs = flight.bridged.true.read(), time.monotonic() - begin
        secs = moments[-1]["secs"] if moments else 0.0
        print(f"{secs:.0f} simulated seconds in {wall_secs:.0f} s", flush=True)
        print(flight.bridged.said("bridge").strip().split("\n")[-1], flush=True)
    return status
