"""PX4's neural control module flies `kestrel bridge` with an exported policy; pymavlink commands it, and the true position is
judged.

    python px4_module_test.py KESTREL CONFIG [more arguments of `bridge`]

CONFIG is the experiment file of the policy, configs/px4-neural.yaml. PX4 is no part of this project: the environment variable
PX4_BIN names the binary of a PX4 that was built with the module and with the sources that `kestrel export RUN --target px4`
writes (build/px4_sitl_neural/bin/px4, with its folder etc beside bin). CONFIG is trained and exported here for the parameters,
and to find out whether PX4 has this policy or another. Without such a PX4 nothing is run, and that is said. Needs the packages
of requirements.txt. Exit status 0 if every check passed or nothing was run.
"""

import functools
import math
import mmap
import os
import pathlib
import subprocess
import sys
import tempfile
import time

from client import COMMAND, with_speed
from judge import conclude, expect, rounded
from px4_test import Flight, fly, parameters

MODULE = "px4-mc_nn_control"
"""What a PX4 with the module has beside its binary."""

MODE = "Neural Control"
AVAILABLE_MODES = 435
"""The message."""

TAKE_OFF_M = 2.0

AUTO_AND_EXTERNAL_MODES = 0b1010
"""Of COM_RCL_EXCEPT: where sticks that fall silent are no failure."""

SETTLING_SECS = 5.0
HOVER_SECS = 20.0

MEAN_ERRORS_M = {"off": 0.05, "1": 0.3}
"""Limits by the true position, over seeds of the instruments' noise, with which PX4's estimate wanders."""

ESTIMATED_ERROR_M = 0.1
"""Limit of the mean by PX4's estimate."""

LOWEST_M = 0.5
HEADING_DEG = 10.0

HOLD = (4, 3)
"""PX4's numbers of its own mode of that name."""

STICK_SECS = 2.0
STICK_M_PER_S = 0.5
"""How fast the module moves its set-point when a stick is all the way forward."""

STICK_PERIOD_SECS = 0.02
"""Of wall time."""

STICK_TOLERANCE_M = 0.2


def heading_of(moment):
    """Counter-clockwise from east [rad]."""
    w, x, y, z = moment["attitude"]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def turned_deg(before, after):
    """From one heading to another [rad], the shorter way round."""
    return math.degrees(math.remainder(after - before, math.tau))


class NeuralFlight(Flight):
    """The checks, in the order in which they are flown."""

    def __init__(self, *processes, noise):
        super().__init__(*processes)
        self._mean_error_m = MEAN_ERRORS_M[noise]

    def px4_becomes_ready(self):
        self._become_ready(1)

    def it_takes_off_and_stays(self):
        self._take_off()

    def its_own_control_holds(self):
        self._client.pass_time(SETTLING_SECS)
        self._hold("PX4's own control")

    def the_network_holds(self):
        self._switch(*self._network())
        self._hold("the network")

    def sticks_move_the_set_point(self):
        before = self._true.now()
        self._steer(1000, STICK_SECS)
        self._steer(0, SETTLING_SECS)
        path, heading = STICK_SECS * STICK_M_PER_S, heading_of(before)
        ahead = (path * math.cos(heading), path * math.sin(heading), 0.0)
        goal = [a + b for a, b in zip(before["position"], ahead, strict=True)]
        error = math.dist(self._true.position(), goal)
        self._tell(f"{error:.3f} m from the point {path:.1f} m ahead")
        expect(error < STICK_TOLERANCE_M, f"at {rounded(self._true.position())} instead of {rounded(goal)}")

    def px4_takes_over(self):
        before = self._true.now()
        self._switch(*HOLD)
        self._client.pass_time(2.0 * SETTLING_SECS)
        farthest = max(math.dist(moment["position"], before["position"]) for moment in self._since(before))
        self._tell(f"it went up to {farthest:.3f} m away")
        expect(self._stayed_near(self._true.position()), f"it does not come to rest, at {rounded(self._true.position())}")

    def it_lands_and_stops_its_motors(self):
        self._land()

    def every_step_was_commanded(self):
        self._expect_steps(connections=1)

    def _network(self):
        """Main and sub mode of the module, which has asked for them when it started."""
        self._client.drain()
        self._client.mav.command_long_send(1, 1, COMMAND.MAV_CMD_REQUEST_MESSAGE, 0, AVAILABLE_MODES, 0, 0, 0, 0, 0, 0)
        custom = self._client.receive("AVAILABLE_MODES", where=lambda told: told.mode_name.startswith(MODE)).custom_mode
        self._tell(f"{MODE} is main mode {custom >> 16 & 0xFF}, sub mode {custom >> 24}")
        return custom >> 16 & 0xFF, custom >> 24

    def _switch(self, main, sub):
        self._client.accepted(COMMAND.MAV_CMD_DO_SET_MODE, COMMAND.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, main, sub)
        self._client.receive("HEARTBEAT", where=lambda told: told.custom_mode == main << 16 | sub << 24)

    def _hold(self, who):
        """Stays for some simulated time where it is. Distances and headings are counted from the first."""
        before, estimated = self._true.now(), []
        while self._true.now()["secs"] < before["secs"] + HOVER_SECS:
            self._client.drain()
            told = self._client.receive("LOCAL_POSITION_NED")
            estimated.append((told.y, told.x, -told.z))
        moments = self._since(before)
        errors = [math.dist(moment["position"], before["position"]) for moment in moments]
        mean, farthest = sum(errors) / len(errors), max(errors)
        by_estimate = sum(math.dist(position, estimated[0]) for position in estimated) / len(estimated)
        turned = max((turned_deg(heading_of(before), heading_of(moment)) for moment in moments), key=abs)
        lowest = min(moment["position"][2] for moment in moments) - self._start[2]
        self._tell(f"{who}: {mean:.3f} m on average, {farthest:.3f} m at most, by its estimate {by_estimate:.3f} m")
        self._tell(f"it turned by {turned:+.1f} degrees, and was never below {lowest:.2f} m")
        expect(lowest > LOWEST_M, f"{lowest:.2f} m above where it stood")
        expect(mean <= self._mean_error_m, f"{mean:.3f} m away instead of {self._mean_error_m} m")
        expect(by_estimate <= ESTIMATED_ERROR_M, f"{by_estimate:.3f} m away by its estimate")
        expect(abs(turned) <= HEADING_DEG, f"it turned by {turned:.1f} degrees")

    def _since(self, before):
        return [moment for moment in self._true.read() if moment["secs"] >= before["secs"]]

    def _steer(self, forward, secs):
        """Holds a stick, from -1000 to 1000, for some simulated time."""
        end = self._true.now()["secs"] + secs
        while self._true.now()["secs"] < end:
            self._client.mav.manual_control_send(1, forward, 0, 500, 0, 0)
            self._client.drain()
            time.sleep(STICK_PERIOD_SECS)


def exported(kestrel, config, folder):
    """The folder that `kestrel export` writes of a policy that is trained for it."""
    run = pathlib.Path(folder) / "run"
    train = [kestrel, "train", config, "--run", str(run), "--set", "evaluation.episodes=16"]
    subprocess.run(train, check=True, capture_output=True)
    subprocess.run([kestrel, "export", str(run), "--target", "px4"], check=True, capture_output=True)
    return run / "px4"


def has_model(binary, model):
    """Whether a program contains the bytes of a file."""
    with open(binary, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as program:
        return program.find(model.read_bytes()) >= 0


def main():
    binary = os.environ.get("PX4_BIN")
    if not binary or not os.path.exists(os.path.join(os.path.dirname(binary), MODULE)):
        print("px4_module_test: NOT RUN, for PX4_BIN names no PX4 with neural control (build/px4_sitl_neural/bin/px4)")
        return 0
    kestrel, config, *arguments = with_speed(sys.argv[1:])
    with tempfile.TemporaryDirectory() as folder:
        export = exported(kestrel, config, folder)
        network = "this" if has_model(binary, export / "control_net.tflite") else "ANOTHER"
        print(f"        PX4 was built with {network} policy", flush=True)
        motors = parameters(export / "kestrel.params", MIS_TAKEOFF_ALT=TAKE_OFF_M, COM_RCL_EXCEPT=AUTO_AND_EXTERNAL_MODES)
    flights = []
    for noise in MEAN_ERRORS_M:
        bridged = [config, "--thrust-curve", str(motors["THR_MDL_FAC"]), "--noise", noise, *arguments]
        print(f"        noise {noise}", flush=True)
        flights.append(fly(binary, kestrel, bridged, functools.partial(NeuralFlight, noise=noise), motors))
    return conclude(*flights)


if __name__ == "__main__":
    sys.exit(main())
