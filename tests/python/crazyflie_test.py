"""Bitcraze's own firmware flies `kestrel bridge`, with its PID controller and with a policy; cflib commands it, and the true
position is judged.

    python crazyflie_test.py KESTREL CONFIG [ARGUMENTS]

The firmware is no part of this project: the environment variable CRAZYFLIE_SITL names a binary for this machine, built as
CrazySim builds it, with the folder that `kestrel export RUN --target crazyflie` writes as its out-of-tree controller and with
the power distribution of today's crazyflie-firmware (`controlModeForce`). Estimator, commander, controllers and power
distribution are the firmware's, the drone is ours. Needs the packages of crtp-requirements.txt. Without the variable nothing
is run, and that is said. Exit status 0 if every check passed or nothing was run.
"""

import math
import os
import sys
import time

import cflib.crtp
from bridged import Bridged, CheckFailed, expect, fly_with
from cflib.crazyflie import Crazyflie
from cflib.crazyflie.log import LogConfig
from cflib.crazyflie.syncCrazyflie import SyncCrazyflie
from cflib.crazyflie.syncLogger import SyncLogger
from judge import rounded

CLIENTS = "udp://127.0.0.1:19850"
FIRMWARE_PORT = "19950"

PID, OUT_OF_TREE = 1, 5
"""`stabilizer.controller` of CrazySim's firmware."""

KALMAN = 2

POINTS = [(0.0, 0.0, 1.0), (0.5, 0.0, 1.0), (0.5, 0.4, 1.3)]
"""Counted from the start [m]. A policy flies half a metre at a time."""

POINT_SECS = 8.0
TAKEOFF_SECS = 3.0
JUDGED_SECS = 2.0
"""At the end of the time at each point."""

MEAN_ERROR_M = 0.03
FARTHEST_M = 0.1


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, firmware, kestrel, arguments, folder):
        self.bridged = Bridged(kestrel, [*arguments, "--peer", "crazyflie"], folder)
        self.firmware = firmware
        self.folder = folder
        self.link = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.link is not None:
            self.link.close_link()
        self.bridged.__exit__()

    @property
    def _client(self):
        return self.link.cf

    def it_commands_the_motors(self):
        self._wait_said("waits for")
        self.bridged.start("firmware", ["stdbuf", "-oL", self.firmware, FIRMWARE_PORT, "127.0.0.1"])
        self._wait_said("commands the motors")

    def a_client_finds_its_parameters(self):
        cflib.crtp.init_drivers()
        client = Crazyflie(rw_cache=os.path.join(self.folder, "cache"))
        self.link = SyncCrazyflie(CLIENTS, cf=client)
        self.link.open_link()
        self.link.wait_for_params()
        for group, name in (("stabilizer", "controller"), ("kestrel", "enable")):
            element = client.param.toc.get_element_by_complete_name(f"{group}.{name}")
            expect(element is not None, f"no parameter {group}.{name}: is the policy's app in this firmware?")
        client.param.set_value("stabilizer.estimator", KALMAN)
        time.sleep(2.0)

    def its_own_pid_flies_to_three_points(self):
        self._fly_with(PID)

    def its_own_pid_lands(self):
        self._land()

    def the_policy_flies_to_three_points(self):
        self._fly_with(OUT_OF_TREE)
        variables = LogConfig("kestrel", period_in_ms=100)
        for name, kind in (("flying", "uint8_t"), ("answer", "int32_t")):
            variables.add_variable(f"kestrel.{name}", kind)
        with SyncLogger(self.link, variables) as logger:
            _, values, _ = next(iter(logger))
        expect(values["kestrel.flying"] == 1, f"the policy does not fly: {values}")

    def the_policy_holds_a_heading(self):
        begin = self.bridged.secs()
        self._hold(POINTS[-1], POINT_SECS, yaw_deg=60.0)
        self._expect_error(POINTS[-1], begin)
        w, x, y, z = self.bridged.true.now()["attitude"]
        yaw_deg = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
        expect(abs(yaw_deg - 60.0) < 5.0, f"it faces {yaw_deg:.1f} degrees instead of 60")

    def the_policy_lands(self):
        self._land()

    def _fly_with(self, controller):
        self._client.param.set_value("stabilizer.controller", controller)
        time.sleep(1.0)
        chosen = int(self._client.param.get_value("stabilizer.controller"))
        expect(chosen == controller, f"controller {chosen} flies instead of {controller}")
        # As its users do it: a step from the floor winds up the integrators of a PID.
        self._client.high_level_commander.takeoff(self.bridged.origin()[2] + POINTS[0][2], TAKEOFF_SECS)
        time.sleep(TAKEOFF_SECS + 1.0)
        errors = []
        for point in POINTS:
            self._hold(point, POINT_SECS)
            errors.append(self._expect_error(point))
        print(f"   mean errors {[f'{100.0 * error:.1f} cm' for error in errors]}", flush=True)

    def _hold(self, point, secs, yaw_deg=0.0):
        """Sends a point, counted from the start, for so many simulated seconds."""
        there = [now + then for now, then in zip(point, self.bridged.origin(), strict=True)]
        end = self.bridged.secs() + secs
        while self.bridged.secs() < end:
            self._client.commander.send_position_setpoint(*there, yaw_deg)
            self.bridged.expect_alive()
            time.sleep(0.05)

    def _expect_error(self, point, since=0.0):
        there = [now + then for now, then in zip(point, self.bridged.origin(), strict=True)]
        moments = self.bridged.true.read()
        end = moments[-1]["secs"]
        errors = [
            math.dist(moment["position"], there)
            for moment in moments
            if moment["secs"] > max(since, end - JUDGED_SECS)
        ]
        mean, farthest = sum(errors) / len(errors), max(errors)
        expect(mean <= MEAN_ERROR_M and farthest < FARTHEST_M, f"{mean:.3f} m from {point}, up to {farthest:.3f}")
        return mean

    def _land(self):
        self._client.commander.send_notify_setpoint_stop()
        self._client.high_level_commander.land(self.bridged.origin()[2], 3.0)
        time.sleep(5.0)
        now = self.bridged.true.now()
        expect(abs(self.bridged.offset()[2]) < 0.02, f"{self.bridged.offset()[2]:.2f} m above the floor")
        expect(max(now["rotor_targets"]) < 200.0, f"turning after it landed: {rounded(now['rotor_targets'])}")

    def _wait_said(self, words, within_secs=30.0):
        end = time.monotonic() + within_secs
        while words not in self.bridged.said("bridge"):
            if time.monotonic() > end:
                raise CheckFailed(f"the bridge said {self.bridged.said('bridge')[-500:]!r}")
            self.bridged.expect_alive()
            time.sleep(0.1)


if __name__ == "__main__":
    sys.exit(fly_with("CRAZYFLIE_SITL", "cf2", Flight))
