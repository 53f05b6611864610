"""A real ArduPilot (Copter) flies `kestrel-shim bridge`, commanded by pymavlink and judged by the true position.

    python ardupilot_test.py KESTREL_SHIM [ARGUMENTS]
    python ardupilot_test.py KESTREL CONFIG [ARGUMENTS]

ArduPilot is no part of this project: the environment variable ARDUCOPTER_BIN names the binary of its board sitl
(build/sitl/bin/arducopter). Without it nothing is run, and that is said. Exit status 0 if every check passed or nothing
was run.
"""

import os
import sys
import time

from bridged import Bridged, CheckFailed, autopilots_file, expect, fly_with

os.environ["MAVLINK20"] = "1"

PARAMETERS = autopilots_file("ardupilot.parm")
SPEED = ["--speed", "5"]
"""Simulated seconds per second, unless the arguments say otherwise."""

GOAL = [1.0, 2.0, 2.0]
READY_SECS = 90.0
"""Of simulated time; the estimator wants about forty before it trusts the GPS."""

POSITION_ONLY = 0b110111111000


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, arducopter, kestrel, arguments, folder):
        arguments = arguments if "--speed" in arguments else [*arguments, *SPEED]
        self.bridged = Bridged(kestrel, [*arguments, "--peer", "ardupilot"], folder)
        # As fast as the bridge wants it.
        speed = ["--speedup", "100"]
        self.bridged.start("ArduPilot", [arducopter, "--model", "JSON:127.0.0.1", *speed, "--defaults", PARAMETERS])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.bridged.__exit__()

    def it_connects(self):
        from pymavlink import mavutil

        self.mavlink = mavutil.mavlink
        self.client = mavutil.mavlink_connection("tcp:127.0.0.1:5760", source_system=255, retries=60)
        expect(self.client.wait_heartbeat(timeout=60.0), "no heartbeat")

    def it_arms_in_guided(self):
        begin = self.bridged.true.now()["secs"]
        guided = self.client.mode_mapping()["GUIDED"]
        while not self._accepted(self.mavlink.MAV_CMD_DO_SET_MODE, 1, guided) or not self._accepted(
            self.mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1
        ):
            expect(self._secs() - begin < READY_SECS, f"not armed; {self._last_words()}")
            self._pass_time(1.0)

    def it_takes_off_to_two_metres(self):
        expect(self._accepted(self.mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, GOAL[2]), "no take-off")
        self._pass_time(12.0)
        self.bridged.expect_stayed_within([0.0, 0.0, GOAL[2]], 0.3, 2.0)

    def it_flies_to_a_point(self):
        east, north, up = GOAL
        self.client.mav.set_position_target_local_ned_send(
            0, 1, 1, self.mavlink.MAV_FRAME_LOCAL_NED, POSITION_ONLY, north, east, -up, 0, 0, 0, 0, 0, 0, 0, 0
        )
        self._pass_time(12.0)
        self.bridged.expect_stayed_within(GOAL, 0.4, 2.0)

    def it_lands(self):
        land = self.client.mode_mapping()["LAND"]
        expect(self._accepted(self.mavlink.MAV_CMD_DO_SET_MODE, 1, land), "the mode LAND is refused")
        begin = self._secs()
        while self.bridged.true.now()["rotor_targets"] != [0.0] * 4:
            expect(self._secs() - begin < 30.0, f"not landed, at {self.bridged.offset()}; {self._last_words()}")
            self._pass_time(0.5)
        expect(abs(self.bridged.offset()[2]) < 0.02, f"{self.bridged.offset()[2]:.2f} m above the floor")
        self.bridged.expect_within([*GOAL[:2], 0.0], 0.5)

    def _secs(self):
        self.bridged.expect_alive()
        return self.bridged.secs()

    def _pass_time(self, secs):
        end = self._secs() + secs
        while self._secs() < end:
            self.client.mav.heartbeat_send(
                self.mavlink.MAV_TYPE_GCS, self.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0
            )
            self._read()
            time.sleep(0.02)

    def _read(self):
        while self.client.recv_match(blocking=False) is not None:
            pass

    def _accepted(self, command, *parameters):
        """Whether a command, whose other parameters are zero, is accepted."""
        self._read()
        self.client.mav.command_long_send(1, 1, command, 0, *[*parameters, *[0.0] * (7 - len(parameters))])
        end = time.monotonic() + 5.0
        while time.monotonic() < end:
            ack = self.client.recv_match(type="COMMAND_ACK", blocking=True, timeout=1.0)
            if ack and ack.command == command:
                return ack.result == self.mavlink.MAV_RESULT_ACCEPTED
        raise CheckFailed(f"command {command} is not answered")

    def _last_words(self):
        told = self.client.messages.get("STATUSTEXT")
        return told.text if told else "it said nothing"


if __name__ == "__main__":
    sys.exit(fly_with("ARDUCOPTER_BIN", "build/sitl/bin/arducopter", Flight))
