"""What the tests of clients share: a simulated vehicle, its true state, and the list of checks."""

import json
import math
import os
import socket
import subprocess
import time

REST_HEIGHT_M = 0.02
"""The hull of a resting Crazyflie is centred 12.5 mm above the floor."""


class CheckFailed(Exception):
    """What was seen instead of what was expected."""


def expect(condition, text):
    if not condition:
        raise CheckFailed(text)


def free_port(candidates=(0,), kind=socket.SOCK_DGRAM):
    for candidate in candidates:
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", candidate))
            except OSError:
                continue
            return probe.getsockname()[1]
    raise CheckFailed(f"none of the ports {candidates} is free")


def rounded(position):
    return [round(value, 3) for value in position]


class TrueState:
    """The true-state log, read while it grows."""

    def __init__(self, path):
        self.path = path
        self.file = None
        self.partial = ""
        self.moments = []

    def read(self):
        """Every moment so far; the last one is now."""
        if self.file is None:
            if not os.path.exists(self.path):
                return self.moments
            self.file = open(self.path, encoding="utf-8")
        *lines, self.partial = (self.partial + self.file.read()).split("\n")
        self.moments += [json.loads(line) for line in lines]
        return self.moments

    def now(self):
        """The last moment; the vehicle speaks its first words before it writes its first line."""
        end = time.monotonic() + 10.0
        while not self.read():
            expect(time.monotonic() < end, f"nothing in {self.path}")
            time.sleep(0.01)
        return self.moments[-1]

    def at(self, secs):
        return min(self.read(), key=lambda moment: abs(moment["secs"] - secs))

    def position(self):
        return self.now()["position"]

    def wait_for(self, condition, what, within_secs):
        """Waits for a condition on the present moment; the time limit is wall time."""
        end = time.monotonic() + within_secs
        while not condition(self.now()):
            expect(time.monotonic() < end, f"not {what} after {within_secs} s: {self.now()}")
            time.sleep(0.02)

    def wait_near(self, point, radius_m, within_secs):
        """Waits until the vehicle is near a point [m, world]."""
        near = lambda moment: math.dist(moment["position"], point) < radius_m  # noqa: E731
        self.wait_for(near, f"within {radius_m} m of {rounded(point)}", within_secs)

    def expect_rest(self):
        """On the floor, disarmed, motors stopped."""
        now = self.now()
        expect(now["position"][2] < REST_HEIGHT_M, f"{now['position'][2]:.3f} m above the floor")
        expect(not now["armed"] and now["rotor_targets"] == [0, 0, 0, 0], f"not stopped: {now}")


class Simulated:
    """A vehicle in its own process: KESTREL is the path of `kestrel`, or of `kestrel-shim`."""

    def __init__(self, kestrel, arguments, folder, listen=None):
        self.listen = listen or f"127.0.0.1:{free_port()}"
        self.ground_station = f"127.0.0.1:{free_port()}"
        self.true = TrueState(os.path.join(folder, "true_state.jsonl"))
        self.output = os.path.join(folder, "output.txt")
        command = [kestrel] if "shim" in os.path.basename(kestrel) else [kestrel, "fly"]
        self.command = [
            *command,
            *arguments,
            *("--listen", self.listen),
            *("--ground-station", self.ground_station),
        ]
        log = ["--true-state-log", self.true.path]
        with open(self.output, "w", encoding="utf-8") as output:
            self.process = subprocess.Popen([*self.command, *log], stdout=output, stderr=subprocess.STDOUT)

    def said(self):
        with open(self.output, encoding="utf-8") as output:
            return output.read().strip()

    def expect_alive(self):
        expect(self.process.poll() is None, f"it ended with status {self.process.returncode}: {self.said()}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()


def run_checks(checks):
    """Runs (name, function) pairs in order; what comes after a failed one is not tried. How many passed and failed."""
    passed = 0
    for name, check in checks:
        try:
            check()
        except Exception as failure:  # noqa: BLE001  (whatever a client raises is what it shows)
            reason = failure if isinstance(failure, CheckFailed) else repr(failure)
            print(f"FAILED  {name}: {reason}", flush=True)
            break
        print(f"ok      {name}", flush=True)
        passed += 1
    return passed, len(checks) - passed


def conclude(*flights):
    """Tells the sum of what flights passed and failed. The program's exit status."""
    passed, failed = (sum(counts) for counts in zip(*flights))
    print(f"{passed} passed, {failed} failed", flush=True)
    return 1 if failed else 0


def checks_of(flight):
    """The methods of a flight that do not begin with an underscore, in the order in which they are written."""
    names = [name for name in vars(type(flight)) if not name.startswith("_")]
    return [(name.replace("_", " "), getattr(flight, name)) for name in names]
