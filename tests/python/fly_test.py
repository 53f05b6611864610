"""A pymavlink client flies `kestrel fly` and judges the true position.

    python fly_test.py KESTREL RUN_OR_POLICY [more arguments of `kestrel fly`]

KESTREL is the path of the binary. Exit status 0 if every check passed.
"""

import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil  # noqa: E402  (reads MAVLINK20 when imported)

SPEED = ["--speed", "5"]
"""Simulated seconds per second, unless the arguments say otherwise."""

OFFSETS = [(0.6, 0.0, 1.0), (0.6, -0.5, 1.4), (-0.4, 0.3, 0.8)]
"""Set-points east and north of the start and above the floor [m]."""

ARRIVAL_RADIUS_M = 0.10
DWELL_SECS = 1.0
LANDING_RADIUS_M = 0.3
REST_HEIGHT_M = 0.02
"""The hull of a resting Crazyflie is centred 12.5 mm above the floor."""

COMMAND = mavutil.mavlink
POSITION_ONLY = 0b110111111000
VELOCITY_ONLY = 0b110111000111
NAN = float("nan")


class CheckFailed(Exception):
    """What was seen instead of what was expected."""


def expect(condition, text):
    if not condition:
        raise CheckFailed(text)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


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
        end = time.monotonic() + 5.0
        while not self.read():
            expect(time.monotonic() < end, f"nothing in {self.path}")
            time.sleep(0.01)
        return self.moments[-1]

    def at(self, secs):
        return min(self.read(), key=lambda moment: abs(moment["secs"] - secs))


class Vehicle:
    """`kestrel fly`, its true state, and a client that listens where a ground station would."""

    def __init__(self, command, folder):
        self.listen = f"127.0.0.1:{free_port()}"
        self.ground_station = f"127.0.0.1:{free_port()}"
        self.true_state = TrueState(os.path.join(folder, "true_state.jsonl"))
        self.arguments = [
            *command,
            *("--listen", self.listen),
            *("--ground-station", self.ground_station),
            *([] if "--speed" in command else SPEED),
        ]
        self.client = mavutil.mavlink_connection(f"udpin:{self.ground_station}", source_system=255)
        log = ["--true-state-log", self.true_state.path]
        self.output = os.path.join(folder, "output.txt")
        with open(self.output, "w", encoding="utf-8") as output:
            self.process = subprocess.Popen(
                [*self.arguments, *log], stdout=output, stderr=subprocess.STDOUT
            )

    def said(self):
        with open(self.output, encoding="utf-8") as output:
            return output.read().strip()

    def receive(self, kind, within_secs=5.0, where=lambda message: True):
        """The next message of a kind that passes `where`; the time limit is wall time."""
        end = time.monotonic() + within_secs
        while time.monotonic() < end:
            message = self.client.recv_match(type=kind, blocking=True, timeout=0.1)
            if message is not None and where(message):
                return message
            if self.process.poll() is not None:
                raise CheckFailed(f"kestrel ended with status {self.process.returncode}: {self.said()}")
        raise CheckFailed(f"no {kind} within {within_secs} s")

    def drain(self):
        while self.client.recv_match(blocking=False) is not None:
            pass

    def command(self, command, *parameters):
        """The result of a command, whose other parameters are zero."""
        self.drain()
        filled = [*parameters, *[0.0] * (7 - len(parameters))]
        self.client.mav.command_long_send(1, 1, command, 0, *filled)
        return self.receive("COMMAND_ACK", where=lambda ack: ack.command == command).result

    def accepted(self, command, *parameters):
        result = self.command(command, *parameters)
        expect(result == COMMAND.MAV_RESULT_ACCEPTED, f"command {command} answered with result {result}")

    def send_target(self, mask, north, east, down, velocity=0.0):
        self.client.mav.set_position_target_local_ned_send(
            0, 1, 1, COMMAND.MAV_FRAME_LOCAL_NED, mask,
            north, east, down, velocity, velocity, velocity, 0, 0, 0, 0, 0,
        )

    def wait_until(self, condition, what, within_secs):
        """Waits for a condition on all true moments; the time limit is simulated time."""
        begin = self.true_state.now()["secs"]
        while not condition(self.true_state.read()):
            self.drain()
            expect(self.process.poll() is None, f"kestrel ended: {self.said()}")
            now = self.true_state.now()
            expect(
                now["secs"] - begin < within_secs,
                f"not {what} after {within_secs} simulated s; at {rounded(now['position'])}, {now['mode']}",
            )
            time.sleep(0.02)


def rounded(position):
    return [round(value, 3) for value in position]


def stayed(moments, point, since_secs):
    """Whether the last second since a time was spent within the arrival radius of a point."""
    now = moments[-1]["secs"]
    if now - since_secs < DWELL_SECS:
        return False
    for moment in reversed(moments):
        if now - moment["secs"] > DWELL_SECS:
            return True
        if math.dist(moment["position"], point) > ARRIVAL_RADIUS_M:
            return False
    return False


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, vehicle):
        self.vehicle = vehicle
        self.start = None
        self.target = None

    def hears_a_heartbeat(self):
        heartbeat = self.vehicle.receive("HEARTBEAT", within_secs=20.0)
        expect(heartbeat.type == COMMAND.MAV_TYPE_QUADROTOR, f"it is of type {heartbeat.type}")
        expect(not heartbeat.base_mode & COMMAND.MAV_MODE_FLAG_SAFETY_ARMED, "it is armed from the start")
        self.start = self.vehicle.true_state.now()["position"]

    def answers_a_client_that_speaks_first(self):
        other = mavutil.mavlink_connection(f"udpout:{self.vehicle.listen}", source_system=254)
        end = time.monotonic() + 5.0
        heard = None
        while heard is None and time.monotonic() < end:
            other.mav.heartbeat_send(COMMAND.MAV_TYPE_GCS, COMMAND.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            heard = other.recv_match(type="HEARTBEAT", blocking=True, timeout=0.2)
        other.close()
        expect(heard is not None and heard.get_srcSystem() == 1, f"heard {heard}")

    def a_busy_port_is_one_clear_error(self):
        second = subprocess.run(
            self.vehicle.arguments, capture_output=True, text=True, timeout=30, check=False
        )
        lines = second.stderr.strip().splitlines()
        expect(second.returncode == 2, f"exit status {second.returncode}")
        expect(len(lines) == 1 and "in use" in lines[0], f"it said {lines}")

    def survives_garbage(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            host, port = self.vehicle.listen.split(":")
            for length in range(300):
                sender.sendto(bytes([0xFD, length % 256]) + os.urandom(length), (host, int(port)))
        status = self.vehicle.receive("SYS_STATUS", where=lambda status: status.errors_comm > 0)
        expect(status.errors_comm <= 1000, f"{status.errors_comm} errors counted")

    def refuses_to_take_off_unarmed(self):
        result = self.vehicle.command(COMMAND.MAV_CMD_NAV_TAKEOFF)
        expect(result != COMMAND.MAV_RESULT_ACCEPTED, "it accepted")

    def refuses_an_unknown_command(self):
        result = self.vehicle.command(60_000)
        expect(result == COMMAND.MAV_RESULT_UNSUPPORTED, f"result {result}")

    def ignores_another_system(self):
        vehicle = self.vehicle
        vehicle.client.mav.command_long_send(7, 1, COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
        begin = vehicle.true_state.now()["secs"]
        vehicle.wait_until(lambda moments: moments[-1]["secs"] - begin > 1.0, "later", 5.0)
        expect(not vehicle.true_state.now()["armed"], "a command to system 7 armed it")

    def arms(self):
        self.vehicle.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        armed = COMMAND.MAV_MODE_FLAG_SAFETY_ARMED
        self.vehicle.receive("HEARTBEAT", where=lambda heartbeat: heartbeat.base_mode & armed)

    def takes_off(self):
        self.vehicle.accepted(COMMAND.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
        self.vehicle.wait_until(lambda moments: moments[-1]["mode"] == "holding", "holding", 20.0)
        height = self.vehicle.true_state.now()["position"][2]
        expect(abs(height - 1.0) < 0.25, f"holding at {height:.3f} m instead of the default of 1 m")

    def refuses_to_disarm_in_the_air(self):
        result = self.vehicle.command(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        expect(result == COMMAND.MAV_RESULT_TEMPORARILY_REJECTED, f"result {result}")

    def refuses_velocities_and_nan(self):
        vehicle = self.vehicle
        vehicle.drain()
        vehicle.send_target(VELOCITY_ONLY, 0, 0, 0, velocity=1.0)
        text = vehicle.receive("STATUSTEXT").text
        expect("only positions" in text, f"it said {text!r}")
        vehicle.send_target(POSITION_ONLY, NAN, NAN, NAN)
        text = vehicle.receive("STATUSTEXT").text
        expect("finite" in text, f"it said {text!r}")
        expect(vehicle.true_state.now()["mode"] == "holding", "it changed its mode")

    def reaches(self, index):
        east, north, up = OFFSETS[index]
        self.target = [self.start[0] + east, self.start[1] + north, up]
        self.vehicle.send_target(POSITION_ONLY, self.target[1], self.target[0], -self.target[2])
        sent_secs = self.vehicle.true_state.now()["secs"]
        self.vehicle.wait_until(
            lambda moments: stayed(moments, self.target, sent_secs),
            f"within {ARRIVAL_RADIUS_M} m of {rounded(self.target)} for {DWELL_SECS} s",
            25.0,
        )

    def reaches_the_first_set_point(self):
        self.reaches(0)

    def reaches_the_second_set_point(self):
        self.reaches(1)

    def reaches_the_third_set_point(self):
        self.reaches(2)

    def tells_the_truth(self):
        for _ in range(20):
            told = self.vehicle.receive("LOCAL_POSITION_NED")
            true = self.vehicle.true_state.at(told.time_boot_ms / 1000)
            error = math.dist([told.y, told.x, -told.z], true["position"])
            expect(error < 0.02, f"told {error:.3f} m from the true position")

    def lands_below_the_last_set_point(self):
        self.vehicle.accepted(COMMAND.MAV_CMD_NAV_LAND, 0, 0, 0, NAN)
        self.vehicle.wait_until(lambda moments: moments[-1]["mode"] == "landed", "landed", 20.0)
        position = self.vehicle.true_state.now()["position"]
        aside = math.dist(position[:2], self.target[:2])
        expect(aside < LANDING_RADIUS_M, f"landed {aside:.3f} m aside")
        expect(0.0 < position[2] < REST_HEIGHT_M, f"landed at a height of {position[2]:.3f} m")

    def disarms_and_rests(self):
        vehicle = self.vehicle
        vehicle.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        armed = COMMAND.MAV_MODE_FLAG_SAFETY_ARMED
        vehicle.receive("HEARTBEAT", where=lambda heartbeat: not heartbeat.base_mode & armed)
        begin = vehicle.true_state.now()["secs"]
        vehicle.wait_until(lambda moments: moments[-1]["secs"] - begin > 1.0, "later", 5.0)
        now = vehicle.true_state.now()
        expect(not now["armed"] and now["rotor_targets"] == [0, 0, 0, 0], f"not stopped: {now}")
        expect(math.hypot(*now["velocity"]) < 1e-3, f"moving at {now['velocity']}")

    def ends_cleanly_on_ctrl_c(self):
        self.vehicle.process.send_signal(signal.SIGINT)
        status = self.vehicle.process.wait(timeout=10)
        expect(status == 0, f"exit status {status}: {self.vehicle.said()}")


CHECKS = [
    Flight.hears_a_heartbeat,
    Flight.answers_a_client_that_speaks_first,
    Flight.a_busy_port_is_one_clear_error,
    Flight.survives_garbage,
    Flight.refuses_to_take_off_unarmed,
    Flight.refuses_an_unknown_command,
    Flight.ignores_another_system,
    Flight.arms,
    Flight.takes_off,
    Flight.refuses_to_disarm_in_the_air,
    Flight.refuses_velocities_and_nan,
    Flight.reaches_the_first_set_point,
    Flight.reaches_the_second_set_point,
    Flight.reaches_the_third_set_point,
    Flight.tells_the_truth,
    Flight.lands_below_the_last_set_point,
    Flight.disarms_and_rests,
    Flight.ends_cleanly_on_ctrl_c,
]


def run(vehicle):
    """Numbers of checks that passed and failed; what depends on a failed check is not tried."""
    flight = Flight(vehicle)
    for index, check in enumerate(CHECKS):
        name = check.__name__.replace("_", " ")
        try:
            check(flight)
        except (CheckFailed, subprocess.TimeoutExpired, OSError) as failure:
            print(f"FAILED  {name}: {failure}")
            return index, len(CHECKS) - index
        print(f"ok      {name}")
    return len(CHECKS), 0


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    kestrel, *arguments = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        vehicle = Vehicle([kestrel, "fly", *arguments], folder)
        try:
            passed, failed = run(vehicle)
        finally:
            vehicle.process.kill()
            vehicle.process.wait()
            vehicle.client.close()
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
