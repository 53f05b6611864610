"""A real PX4 flies `kestrel bridge`, commanded by pymavlink and judged by the true position.

    python px4_test.py KESTREL [more arguments of `bridge`]

KESTREL is the path of `kestrel-shim`, or of `kestrel` with the experiment file of an aviary as its first argument: one
with three metres of free floor around where its episodes begin, such as configs/aviaries/field.yaml. PX4 is no part of
this project: the environment variable PX4_BIN names the binary of a built `px4_sitl_default`
(build/px4_sitl_default/bin/px4, with its folder etc beside bin). Without it nothing is run, and that is said. Needs the
packages of requirements.txt. Exit status 0 if every check passed or nothing was run.
"""

import contextlib
import itertools
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time

from client import COMMAND, NAN, Client, with_speed
from judge import CheckFailed, TrueState, checks_of, conclude, expect, rounded, run_checks

AUTOSTART = "10016"
"""PX4's airframe `none_iris`: a quad X that waits for a simulator on TCP 4560."""

TAKE_OFF_M = 1.2

PARAMETERS = os.path.join(os.path.dirname(__file__), "../../assets/autopilots/px4.params")

GOAL_M = (2.0, 1.0, TAKE_OFF_M)
"""East and north of the start, and above it."""

ARRIVAL_RADIUS_M = 0.15
LANDING_RADIUS_M = 0.3

READY_SECS = 60.0
"""Simulated: PX4's filters need some five seconds of measurements before it can be armed."""

FLIGHT_SECS = 30.0
DWELL_SECS = 1.0
OFFBOARD = 6
"""PX4's number of the mode in which it follows set-points."""

REST_TOLERANCE_M = 0.005
BOUNCE_M = 0.1
WAKING_STEPS = 500
"""Nobody waits for a PX4 that is still starting."""


REAL, INTEGER = "9", "6"
"""Types of parameters in a file of QGroundControl's."""


def parameters(path, **others):
    """What is set before a flight: a file of QGroundControl's, and others."""
    with open(path, encoding="utf-8") as file:
        rows = [line.split() for line in file if not line.startswith("#")]
    numbers = {REAL: float, INTEGER: int}
    # Set-points come by the wall clock, and PX4 counts simulated time.
    return {"COM_OF_LOSS_T": 10.0, **others, **{name: numbers[kind](value) for _, _, name, value, kind in rows}}


class Bridge:
    """The simulator, in its own process."""

    ground_station = "127.0.0.1:14540"
    """Where PX4 looks for programs that command it."""

    def __init__(self, kestrel, arguments, folder):
        self.true = TrueState(os.path.join(folder, "true_state.jsonl"))
        self.output = os.path.join(folder, "output.txt")
        command = [kestrel, "bridge", *arguments, "--peer", "px4", "--true-state-log", self.true.path]
        with open(self.output, "w", encoding="utf-8") as output:
            self.process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)

    def said(self):
        with open(self.output, encoding="utf-8") as output:
            return output.read().strip()

    def expect_alive(self):
        expect(self.process.poll() is None, f"it ended with status {self.process.returncode}: {self.said()}")

    def wait_until_said(self, words, times=1, within_secs=20.0):
        end = time.monotonic() + within_secs
        while self.said().count(words) < times:
            self.expect_alive()
            expect(time.monotonic() < end, f"it did not say {words!r} {times} times: {self.said()}")
            time.sleep(0.05)

    def end(self):
        """Ends it as Ctrl-C does. Steps, commanded and unanswered ones, connections, pieces of garbage."""
        self.process.send_signal(signal.SIGINT)
        expect(self.process.wait(timeout=10) == 0, f"exit status {self.process.returncode}: {self.said()}")
        return [int(number) for number in re.findall(r"\d+", self.said().splitlines()[-1])]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()


class Px4:
    """The autopilot, in its own process."""

    def __init__(self, binary, folder):
        self.binary = os.path.abspath(binary)
        self.folder = folder
        self.log = os.path.join(folder, "px4.txt")
        self.process = None

    def start(self):
        files = os.path.join(os.path.dirname(os.path.dirname(self.binary)), "etc")
        environment = {**os.environ, "PX4_SYS_AUTOSTART": AUTOSTART, "PX4_SIM_MODEL": "none_iris"}
        with open(self.log, "a", encoding="utf-8") as log:
            self.process = subprocess.Popen(
                [self.binary, "-d", "-i", "0", files],
                cwd=self.folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
            )

    def said(self):
        with open(self.log, encoding="utf-8", errors="replace") as log:
            return log.read().strip()

    def kill(self):
        """As a crash does."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, bridge, px4, client, values):
        self._bridge = bridge
        self._px4 = px4
        self._client = client
        self._parameters = values
        self._true = bridge.true
        self._start = None

    def px4_becomes_ready(self):
        self._become_ready(1)

    def it_takes_off_and_stays(self):
        self._take_off()

    def it_goes_to_a_point(self):
        goal = [a + b for a, b in zip(self._start, GOAL_M, strict=True)]
        self._stream(DWELL_SECS)
        self._client.accepted(COMMAND.MAV_CMD_DO_SET_MODE, COMMAND.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, OFFBOARD)
        begin = self._true.now()["secs"]
        while not self._stayed_near(goal):
            self._stream(0.1)
            waited = self._true.now()["secs"] - begin
            expect(waited < FLIGHT_SECS, f"at {rounded(self._true.position())}, not at {rounded(goal)}")
        self._tell(f"{math.dist(self._true.position(), goal):.3f} m from the point after {waited:.1f} s")

    def it_lands_and_stops_its_motors(self):
        self._land()

    def px4_starts_again_and_flies_again(self):
        self._px4.kill()
        self._bridge.wait_until_said("has gone")
        self._become_ready(2)
        self._take_off()
        self._land()

    def every_step_was_commanded(self):
        self._expect_steps(connections=2)

    def _become_ready(self, times):
        """Starts PX4, for the first or the second time, and waits until it can be armed."""
        self._px4.start()
        self._bridge.wait_until_said("go in step", times)
        begin, ready = self._true.now()["secs"], False
        self._client.drain()
        self._client.receive("HEARTBEAT", within_secs=30.0)
        for name, value in self._parameters.items():
            told = self._set(name, value)
            expect(math.isclose(told, value, rel_tol=1e-6), f"{name} is {told} instead of {value}")
        while not ready:
            status = self._client.receive("SYS_STATUS", within_secs=30.0)
            ready = status.onboard_control_sensors_health & COMMAND.MAV_SYS_STATUS_PREARM_CHECK
            waited = self._true.now()["secs"] - begin
            expect(ready or waited < READY_SECS, f"not ready to arm after {waited:.0f} simulated s")
        self._tell(f"ready after {waited:.1f} simulated s")

    def _set(self, name, value):
        """Sets a parameter; a PX4 that is still starting hears none, and does not say so."""
        setting = self._client.set_integer if isinstance(value, int) else self._client.set_parameter
        for _ in range(20):
            with contextlib.suppress(CheckFailed):
                return setting(name, value, within_secs=0.5)
        raise CheckFailed(f"{name} is not confirmed")

    def _take_off(self):
        self._start = self._true.position()
        self._client.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        self._client.accepted(COMMAND.MAV_CMD_NAV_TAKEOFF, *[NAN] * 7)
        place = [*self._start[:2], self._start[2] + self._parameters["MIS_TAKEOFF_ALT"]]
        begin = self._true.now()["secs"]
        self._client.wait_until(lambda _: self._stayed_near(place), f"at {rounded(place)}", FLIGHT_SECS)
        self._tell(f"at {rounded(self._true.position())} after {self._true.now()['secs'] - begin:.1f} s")

    def _land(self):
        place, begin = self._true.position(), len(self._true.read())
        self._client.accepted(COMMAND.MAV_CMD_NAV_LAND, 0, 0, 0, *[NAN] * 4)
        stopped = lambda moments: moments[-1]["rotor_targets"] == [0.0] * 4  # noqa: E731
        self._client.wait_until(stopped, "stopped", FLIGHT_SECS)
        landed = self._true.position()
        heights = [moment["position"][2] - self._start[2] for moment in self._true.read()[begin:]]
        after_touchdown = itertools.dropwhile(lambda height: height > REST_TOLERANCE_M, heights)
        bounce = max(after_touchdown, default=0.0)
        expect(bounce < BOUNCE_M, f"rose {bounce:.2f} m again after it had touched the floor")
        height, drift = heights[-1], math.dist(landed[:2], place[:2])
        self._tell(f"landed {drift:.3f} m beside the place, {1000.0 * height:.1f} mm above where it stood")
        expect(abs(height) < REST_TOLERANCE_M, f"motors stopped {height:.3f} m above where it took off")
        expect(drift < LANDING_RADIUS_M, f"landed {drift:.2f} m beside the place")

    def _expect_steps(self, connections):
        """That the bridge's PX4, which was started so many times, commanded every step but those of its starts."""
        steps, commanded, unanswered, *others = self._bridge.end()
        self._tell(f"{steps} steps, {commanded} commanded, {unanswered} unanswered")
        expect((unanswered, *others) == (0, connections, 0), self._bridge.said())
        expect(steps - commanded < connections * WAKING_STEPS, self._bridge.said())

    def _stayed_near(self, place):
        """Whether the last second was spent there."""
        moments = self._true.read()
        since = moments[-1]["secs"] - DWELL_SECS
        recent = itertools.takewhile(lambda moment: moment["secs"] > since, reversed(moments))
        return all(math.dist(moment["position"], place) < ARRIVAL_RADIUS_M for moment in recent)

    def _stream(self, secs):
        """Sends the point as set-points for some simulated time; PX4 counts from where it was switched on."""
        end = self._true.now()["secs"] + secs
        while self._true.now()["secs"] < end:
            self._client.go_to(GOAL_M)
            self._client.drain()
            time.sleep(0.02)

    def _tell(self, text):
        print(f"        {text}", flush=True)


def fly(binary, kestrel, arguments, flight, values):
    """Has `flight(bridge, px4, client, values)` be made, whose checks are run. How many passed and failed."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Bridge(kestrel, arguments, folder) as bridge,
        Px4(binary, folder) as px4,
        Client(bridge) as client,
    ):
        counts = run_checks(checks_of(flight(bridge, px4, client, values)))
        if counts[1]:
            print(f"The bridge said:\n{bridge.said()}\nPX4 said:\n{px4.said()}")
    return counts


def main():
    binary = os.environ.get("PX4_BIN")
    if not binary:
        print("px4_test: NOT RUN, for PX4_BIN names no PX4 (build/px4_sitl_default/bin/px4)")
        return 0
    kestrel, *arguments = with_speed(sys.argv[1:])
    return conclude(fly(binary, kestrel, arguments, Flight, parameters(PARAMETERS, MIS_TAKEOFF_ALT=TAKE_OFF_M)))


if __name__ == "__main__":
    sys.exit(main())
