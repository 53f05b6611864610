"""A real Betaflight flies `kestrel-shim bridge`; this program is its pilot, who sees the true position.

    python betaflight_test.py KESTREL_SHIM [ARGUMENTS]
    python betaflight_test.py KESTREL CONFIG [ARGUMENTS]

Betaflight is no part of this project: the environment variable BETAFLIGHT_BIN names the binary of its target SITL
(obj/betaflight_*_SITL, of March 2026 or later: it must know `--config`). Without it nothing is run, and that is said. Exit
status 0 if every check passed or nothing was run.
"""

import math
import socket
import struct
import subprocess
import sys
import time

from bridged import Bridged, CheckFailed, autopilots_file, expect, fly_with

RADIO = ("127.0.0.1", 9004)
READY_SECS = 8.0
"""Betaflight does not arm in its first five seconds."""

STARTS = 3
START_SECS = 5.0
"""Some starts of Betaflight on a busy machine never get as far as its motors."""

ANGLE_LIMIT = math.radians(60.0)
"""Tilt of a full stick: `angle_limit`."""

TILT_LIMIT = math.radians(12.0)
GOAL = [1.0, 0.0, 1.0]


class Pilot:
    """Moves the sticks. The drone faces east at first."""

    def __init__(self, bridged):
        self.bridged = bridged
        self.radio = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.hover_throttle = 0.58
        self.last_secs = bridged.secs()
        self.heading = 0.0

    def send(self, throttle, right=0.0, forward=0.0, turn=0.0, *, armed):
        sticks = [1500 + 500 * right, 1500 + 500 * forward, 1000 + 1000 * throttle, 1500 + 500 * turn]
        switches = [2000 if armed else 1000, 2000]
        channels = [int(min(2000, max(1000, pulse))) for pulse in [*sticks, *switches, *[1500] * 10]]
        self.radio.sendto(struct.pack("<d16H", time.monotonic(), *channels), RADIO)

    def wait(self, secs, *, armed):
        end = self.bridged.secs() + secs
        while self.bridged.secs() < end:
            self.send(0.0, armed=armed)
            self.pause()

    def fly_to(self, goal, secs):
        """Flies towards a point, counted from the start, for so long."""
        end = self.bridged.secs() + secs
        while self.bridged.secs() < end:
            here, (east_speed, north_speed, _) = self.bridged.offset(), self.bridged.velocity()
            east = 0.12 * max(-1.0, min(1.0, goal[0] - here[0])) - 0.16 * east_speed
            north = 0.12 * max(-1.0, min(1.0, goal[1] - here[1])) - 0.16 * north_speed
            cosine, sine = math.cos(self.heading), math.sin(self.heading)
            self.move(goal[2], forward=cosine * east + sine * north, left=cosine * north - sine * east)

    def hold_sticks(self, height, secs, **sticks):
        end = self.bridged.secs() + secs
        while self.bridged.secs() < end:
            self.move(height, **sticks)

    def move(self, height, *, forward=0.0, left=0.0, turn=0.0):
        """One moment at a height [m], tilted [rad] or turning [of a full stick]."""
        now = self.bridged.secs()
        missing = height - self.bridged.offset()[2]
        self.hover_throttle += 0.06 * max(-1.0, min(1.0, missing)) * min(0.1, now - self.last_secs)
        self.last_secs = now
        throttle = self.hover_throttle + 0.18 * missing - 0.14 * self.bridged.velocity()[2]
        forward, left = (max(-TILT_LIMIT, min(TILT_LIMIT, tilt)) / ANGLE_LIMIT for tilt in (forward, left))
        self.send(throttle, -left, forward, turn, armed=True)
        self.pause()

    def pause(self):
        self.bridged.expect_alive()
        time.sleep(0.01)


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, betaflight, kestrel, arguments, folder):
        configure = [betaflight, "--config", autopilots_file("betaflight.cli")]
        subprocess.run(configure, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT, timeout=30.0, check=True)
        self.bridged = Bridged(kestrel, [*arguments, "--peer", "betaflight"], folder)
        self.betaflight = betaflight

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.bridged.__exit__()

    def it_commands_the_motors(self):
        for _ in range(STARTS):
            self.bridged.start("Betaflight", ["stdbuf", "-oL", self.betaflight])
            end = time.monotonic() + START_SECS
            while time.monotonic() < end:
                if "commands the motors" in self.bridged.said("bridge"):
                    return
                time.sleep(0.1)
            self.bridged.stop()
        raise CheckFailed(f"not after {STARTS} starts of {START_SECS:.0f} s")

    def it_arms(self):
        self.pilot = Pilot(self.bridged)
        self.pilot.wait(READY_SECS, armed=False)
        expect(self._rotor_targets() == [0.0] * 4, f"turning before it is armed: {self._rotor_targets()}")
        self.pilot.wait(1.0, armed=True)
        expect(min(self._rotor_targets()) > 0.0, f"no rotor turns: {self.bridged.said('Betaflight')[-500:]}")

    def it_takes_off_and_hovers_at_one_metre(self):
        self.pilot.fly_to([0.0, 0.0, 1.0], 10.0)
        self.bridged.expect_stayed_within([0.0, 0.0, 1.0], 0.2, 3.0)

    def it_flies_a_metre_forward(self):
        self.pilot.fly_to(GOAL, 8.0)
        self.bridged.expect_stayed_within(GOAL, 0.25, 1.0)

    def a_turn_to_the_right_is_one(self):
        self.pilot.hold_sticks(GOAL[2], 1.0, turn=0.3)
        self.pilot.hold_sticks(GOAL[2], 0.7)
        before = self.bridged.velocity()
        self.pilot.hold_sticks(GOAL[2], 0.7, forward=math.radians(8.0))
        gained = [now - then for now, then in zip(self.bridged.velocity(), before, strict=True)]
        self.pilot.heading = math.atan2(gained[1], gained[0])
        expect(-150.0 < math.degrees(self.pilot.heading) < -30.0, f"forward is {gained} then")
        self.pilot.fly_to(GOAL, 8.0)
        self.bridged.expect_stayed_within(GOAL, 0.25, 1.0)

    def it_lands(self):
        begin = self.bridged.secs()
        while (height := GOAL[2] - 0.3 * (self.bridged.secs() - begin)) > -0.2:
            self.pilot.fly_to([*GOAL[:2], height], 0.1)
        self.pilot.wait(1.0, armed=False)
        self.bridged.expect_within([*GOAL[:2], 0.0], 0.4)
        expect(abs(self.bridged.offset()[2]) < 0.02, f"{self.bridged.offset()[2]:.2f} m above the floor")
        expect(self._rotor_targets() == [0.0] * 4, f"turning after it was disarmed: {self._rotor_targets()}")

    def _rotor_targets(self):
        return self.bridged.true.now()["rotor_targets"]


if __name__ == "__main__":
    sys.exit(fly_with("BETAFLIGHT_BIN", "obj/betaflight_*_SITL", Flight))
