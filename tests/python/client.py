"""A pymavlink client of a simulated vehicle, as the tests of messages need it."""

import math
import os
import socket
import struct
import time

os.environ["MAVLINK20"] = "1"
# The dialect that has AVAILABLE_MODES, besides all of the common one.
os.environ["MAVLINK_DIALECT"] = "development"

from pymavlink import mavutil  # noqa: E402  (reads both when imported)

from judge import CheckFailed, expect, rounded  # noqa: E402

COMMAND = mavutil.mavlink
SPEED = ["--speed", "5"]
"""Simulated seconds per second, unless the arguments say otherwise."""

HEARTBEAT_SECS = 0.5
"""Of wall time: less than COM_DL_LOSS_T of simulated time at any speed up to 20."""

RECEIVE_BYTES = 4 << 20
"""Of datagrams that wait for this program, as far as the system allows it: on a busy machine it comes late to them."""

POSITION_ONLY = 0b110111111000
VELOCITY_ONLY = 0b110111000111
NAN = float("nan")


class Client:
    """A ground station that listens where the vehicle speaks."""

    def __init__(self, vehicle, key=None):
        self.vehicle = vehicle
        self.true = vehicle.true
        self.link = mavutil.mavlink_connection(f"udpin:{vehicle.ground_station}", source_system=255)
        self.link.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)
        self.mav = self.link.mav
        if key is not None:
            self.link.setup_signing(key)
        self.last_heartbeat = 0.0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.link.close()

    def tend(self):
        """Tells the vehicle now and then that it is there; finds out whether the vehicle still is."""
        self.vehicle.expect_alive()
        if time.monotonic() - self.last_heartbeat > HEARTBEAT_SECS:
            self.last_heartbeat = time.monotonic()
            self.mav.heartbeat_send(COMMAND.MAV_TYPE_GCS, COMMAND.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def receive(self, kind, within_secs=5.0, where=lambda message: True):
        """The next message of a kind, or of several, that passes `where`; the time limit is wall time."""
        end = time.monotonic() + within_secs
        while time.monotonic() < end:
            message = self.link.recv_match(type=kind, blocking=True, timeout=0.1)
            if message is not None and where(message):
                return message
            self.tend()
        raise CheckFailed(f"no {kind} within {within_secs} s")

    def drain(self):
        """Forgets what came so far."""
        self.tend()
        while self.link.recv_match(blocking=False) is not None:
            pass

    def says(self, words):
        """Waits for these words."""
        self.receive("STATUSTEXT", where=lambda told: words in told.text)

    def command(self, command, *parameters):
        """The result of a command, whose other parameters are zero."""
        self.drain()
        filled = [*parameters, *[0.0] * (7 - len(parameters))]
        self.mav.command_long_send(1, 1, command, 0, *filled)
        return self.receive("COMMAND_ACK", where=lambda ack: ack.command == command).result

    def accepted(self, command, *parameters):
        result = self.command(command, *parameters)
        expect(result == COMMAND.MAV_RESULT_ACCEPTED, f"command {command} answered with result {result}")

    def send_target(self, mask, north, east, down, velocity=0.0):
        self.mav.set_position_target_local_ned_send(
            0, 1, 1, COMMAND.MAV_FRAME_LOCAL_NED, mask,
            north, east, down, velocity, velocity, velocity, 0, 0, 0, 0, 0,
        )

    def go_to(self, point):
        """Sends a point [m, world] as a set-point."""
        self.send_target(POSITION_ONLY, point[1], point[0], -point[2])

    def wait_until(self, condition, what, within_secs):
        """Waits for a condition on all true moments; the time limit is simulated time."""
        begin = self.true.now()["secs"]
        while not condition(self.true.read()):
            self.drain()
            now = self.true.now()
            doing = now.get("mode", "flown by another autopilot")
            expect(
                now["secs"] - begin < within_secs,
                f"not {what} after {within_secs} simulated s; at {rounded(now['position'])}, {doing}",
            )
            time.sleep(0.02)

    def wait_for_mode(self, mode, within_secs=20.0):
        self.wait_until(lambda moments: moments[-1]["mode"] == mode, mode, within_secs)

    def wait_near(self, point, within_secs=25.0, radius_m=0.15):
        near = lambda moments: math.dist(moments[-1]["position"], point) < radius_m  # noqa: E731
        self.wait_until(near, f"within {radius_m} m of {rounded(point)}", within_secs)

    def pass_time(self, secs):
        """Of simulated time."""
        begin = self.true.now()["secs"]
        self.wait_until(lambda moments: moments[-1]["secs"] - begin > secs, "later", 10.0 * secs)

    def set_parameter(self, name, value, kind=COMMAND.MAV_PARAM_TYPE_REAL32, within_secs=5.0):
        """The value that it has then, as the float of the message; the time limit is wall time."""
        self.drain()
        self.mav.param_set_send(1, 1, name.encode(), value, kind)
        return self.receive("PARAM_VALUE", within_secs, where=lambda told: told.param_id == name).param_value

    def set_integer(self, name, value, within_secs=5.0):
        """The value that a parameter has then; integers travel as the float of the same bytes."""
        float_of = struct.unpack("<f", struct.pack("<i", value))[0]
        told = self.set_parameter(name, float_of, COMMAND.MAV_PARAM_TYPE_INT32, within_secs)
        return struct.unpack("<i", struct.pack("<f", told))[0]

    def may_pause(self):
        """From here on it is no loss of the ground station if this program does not come to send its heartbeats."""
        told = self.set_integer("NAV_DLL_ACT", 0)
        expect(told == 0, f"NAV_DLL_ACT is {told} instead of 0")

    def upload(self, plan, items):
        """The result of an upload of items: frame, command, four parameters, x, y and z."""
        self.drain()
        self.mav.mission_count_send(1, 1, len(items), plan)
        while True:
            told = self.receive(["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"])
            if told.get_type() == "MISSION_ACK":
                return told.type
            frame, command, *parameters, x, y, z = items[told.seq]
            self.mav.mission_item_int_send(1, 1, told.seq, frame, command, 0, 1, *parameters, x, y, z, plan)

    def download(self, plan):
        """The items of a plan."""
        self.drain()
        self.mav.mission_request_list_send(1, 1, plan)
        items = []
        for number in range(self.receive("MISSION_COUNT", where=lambda told: told.mission_type == plan).count):
            self.mav.mission_request_int_send(1, 1, number, plan)
            told = self.receive("MISSION_ITEM_INT", where=lambda told, number=number: told.seq == number)
            parameters = [told.param1, told.param2, told.param3, told.param4]
            items.append((told.frame, told.command, *parameters, told.x, told.y, told.z))
        self.mav.mission_ack_send(1, 1, COMMAND.MAV_MISSION_ACCEPTED, plan)
        return items

    def clear(self, plan):
        self.drain()
        self.mav.mission_clear_all_send(1, 1, plan)
        result = self.receive("MISSION_ACK", where=lambda told: told.mission_type == plan).type
        expect(result == COMMAND.MAV_MISSION_ACCEPTED, f"clearing was answered with {result}")


def with_speed(arguments):
    """The arguments of a flight that need not wait for the wall clock."""
    return arguments if "--speed" in arguments else [*arguments, *SPEED]
