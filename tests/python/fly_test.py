"""A pymavlink client flies `kestrel fly` message by message and judges the true position.

    python fly_test.py KESTREL RUN_OR_POLICY [more arguments of `kestrel fly`]

KESTREL is the path of `kestrel`, or of `kestrel-shim`. Needs the packages of requirements.txt. Exit status 0 if every
check passed.
"""

import json
import math
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import zlib

from client import COMMAND, NAN, POSITION_ONLY, VELOCITY_ONLY, Client, with_speed
from judge import Simulated, checks_of, conclude, expect, rounded, run_checks
from pymavlink import mavutil
from pymavlink.mavftp import MAVFTP, FtpError

OFFSETS = [(0.6, 0.0, 1.0), (0.6, -0.5, 1.4), (-0.4, 0.3, 0.8)]
"""Set-points east and north of the start and above the floor [m]."""

ARRIVAL_RADIUS_M = 0.10
DWELL_SECS = 1.0
LANDING_RADIUS_M = 0.3

MISSION, FENCE = COMMAND.MAV_MISSION_TYPE_MISSION, COMMAND.MAV_MISSION_TYPE_FENCE
LOCAL_NED, GLOBAL = COMMAND.MAV_FRAME_LOCAL_NED, COMMAND.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


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


def checksum(content):
    """CRC-32 that begins and ends without inversion, as in metadata."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


class Flight:
    """The checks, in the order in which they are flown."""

    def __init__(self, vehicle, client):
        self._vehicle = vehicle
        self._true = vehicle.true
        self._client = client
        self._modes = {}
        self._start = None
        self._target = None

    def hears_a_heartbeat(self):
        heartbeat = self._client.receive("HEARTBEAT", within_secs=20.0)
        expect(heartbeat.type == COMMAND.MAV_TYPE_QUADROTOR, f"it is of type {heartbeat.type}")
        expect(not heartbeat.base_mode & COMMAND.MAV_MODE_FLAG_SAFETY_ARMED, "it is armed from the start")
        self._start = self._true.position()

    def answers_a_client_that_speaks_first(self):
        other = mavutil.mavlink_connection(f"udpout:{self._vehicle.listen}", source_system=254)
        end = time.monotonic() + 5.0
        heard = None
        while heard is None and time.monotonic() < end:
            other.mav.heartbeat_send(COMMAND.MAV_TYPE_GCS, COMMAND.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            heard = other.recv_match(type="HEARTBEAT", blocking=True, timeout=0.2)
        other.close()
        expect(heard is not None and heard.get_srcSystem() == 1, f"heard {heard}")

    def a_busy_port_is_one_clear_error(self):
        second = subprocess.run(self._vehicle.command, capture_output=True, text=True, timeout=30, check=False)
        lines = second.stderr.strip().splitlines()
        expect(second.returncode == 2, f"exit status {second.returncode}")
        expect(len(lines) == 1 and "in use" in lines[0], f"it said {lines}")

    def survives_garbage(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            host, port = self._vehicle.listen.split(":")
            for length in range(300):
                sender.sendto(bytes([0xFD, length % 256]) + os.urandom(length), (host, int(port)))
        status = self._client.receive("SYS_STATUS", where=lambda status: status.errors_comm > 0)
        expect(status.errors_comm <= 1000, f"{status.errors_comm} errors counted")

    def tells_the_time(self):
        before = self._true.now()["secs"]
        self._client.mav.timesync_send(0, 12345)
        told = self._client.receive("TIMESYNC", where=lambda told: told.ts1 == 12345)
        expect(before <= told.tc1 * 1e-9 <= self._true.now()["secs"] + 0.1, f"{told.tc1} ns after {before} s")

    def lists_its_parameters(self):
        self._client.drain()
        self._client.mav.param_request_list_send(1, 1)
        names, count = {}, None
        while len(names) != count:
            told = self._client.receive("PARAM_VALUE")
            names[told.param_index], count = told.param_id, told.param_count
        expect({"MIS_TAKEOFF_ALT", "GF_ACTION", "NAV_DLL_ACT"} <= set(names.values()), f"parameters {names}")
        expect(sorted(names.values()) == [names[index] for index in range(len(names))], f"not in order: {names}")
        index = next(index for index, name in names.items() if name == "MIS_TAKEOFF_ALT")
        self._client.mav.param_request_read_send(1, 1, b"", index)
        told = self._client.receive("PARAM_VALUE")
        expect((told.param_id, told.param_value) == ("MIS_TAKEOFF_ALT", 1.0), f"parameter {index} is {told}")

    def sets_parameters_within_their_bounds(self):
        client = self._client
        for value, expected in ((0.9, 0.9), (50.0, 0.9), (NAN, 0.9), (1.0, 1.0)):
            told = client.set_parameter("MIS_TAKEOFF_ALT", value)
            expect(abs(told - expected) < 1e-6, f"{told} after {value} was asked for")
        for value, expected in ((5, 5), (4, 5), (2, 2)):
            told = client.set_integer("GF_ACTION", value)
            expect(told == expected, f"{told} after {value} was asked for")
        client.may_pause()
        client.mav.param_request_read_send(1, 1, b"NO_SUCH_THING", -1)
        error = client.receive("PARAM_ERROR").error
        expect(error == COMMAND.MAV_PARAM_ERROR_DOES_NOT_EXIST, f"error {error}")

    def _download(self, files, path):
        """What a file holds."""
        held = []
        files.cmd_get([path], callback=lambda file: held.append(file.read()))
        outcome = files.process_ftp_reply("get", timeout=20.0)
        expect(outcome.error_code == FtpError.Success and held, f"{path}: error {outcome.error_code}")
        return held[0]

    def hands_out_its_metadata(self):
        client = self._client
        client.drain()
        client.mav.command_long_send(1, 1, COMMAND.MAV_CMD_REQUEST_MESSAGE, 0, 397, 0, 0, 0, 0, 0, 0)
        # pymavlink 2.4.50 does not know COMPONENT_METADATA: time, checksum and place of the file.
        told = bytes(client.receive(["COMPONENT_METADATA", "UNKNOWN_397"]).get_msgbuf())
        _, crc, place = struct.unpack("<II100s", told[10 : 10 + told[1]].ljust(108, b"\0"))
        files = MAVFTP(client.link, 1, 1)
        listed = files.cmd_list(["/"]).directory_listing
        names = {f"/{entry.name}": entry.size_b for entry in listed or []}
        general = self._download(files, place.rstrip(b"\0").decode().removeprefix("mftp://"))
        expect(checksum(general) == crc, f"checksum {checksum(general)} instead of {crc}")
        sizes, contents = {"/general.json": len(general)}, {}
        for metadata in json.loads(general)["metadataTypes"]:
            path = metadata["uri"].removeprefix("mftp://")
            contents[metadata["type"]] = content = self._download(files, path)
            sizes[path] = len(content)
            expect(checksum(content) == metadata["fileCrc"], f"checksum {checksum(content)}: {metadata}")
        expect(names == sizes, f"it lists {names} instead of {sizes}")
        (component,) = json.loads(contents[4])["components"]
        expect(component["namespace"] == "kestrel", f"events of {component}")
        content = contents[1]
        parameters = {entry["name"]: entry for entry in json.loads(content)["parameters"]}
        height = parameters.get("MIS_TAKEOFF_ALT", {})
        expect((height.get("default"), height.get("units")) == (1.0, "m"), f"{height} among {list(parameters)}")

    def writes_no_file_and_says_so(self):
        files = MAVFTP(self._client.link, 1, 1)
        for outcome in (files.cmd_rm(["/general.json"]), files.cmd_mkdir(["/folder"])):
            expect(outcome.error_code == FtpError.FileProtected, f"error {outcome.error_code}")

    def names_its_modes(self):
        self._client.drain()
        self._client.mav.command_long_send(1, 1, COMMAND.MAV_CMD_REQUEST_MESSAGE, 0, 435, 0, 0, 0, 0, 0, 0)
        while not self._modes or len(self._modes) < told.number_modes:
            told = self._client.receive("AVAILABLE_MODES")
            self._modes[told.mode_name] = told.custom_mode
        policy = re.search('Policy "(.*?)"', self._vehicle.said()).group(1)
        expect({f"RL:{policy}", "PID", "Hold", "Offboard", "Land"} <= set(self._modes), f"modes {self._modes}")
        self._modes["policy"] = self._modes[f"RL:{policy}"]

    def refuses_to_take_off_unarmed(self):
        result = self._client.command(COMMAND.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, 1.0)
        expect(result == COMMAND.MAV_RESULT_TEMPORARILY_REJECTED, f"result {result}")

    def refuses_an_unknown_command(self):
        result = self._client.command(60_000)
        expect(result == COMMAND.MAV_RESULT_UNSUPPORTED, f"result {result}")

    def ignores_another_system(self):
        arm = COMMAND.MAV_CMD_COMPONENT_ARM_DISARM
        self._client.mav.command_long_send(7, 1, arm, 0, 1, 0, 0, 0, 0, 0, 0)
        self._client.pass_time(1.0)
        expect(not self._true.now()["armed"], "a command to system 7 armed it")

    def arms(self):
        self._client.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        armed = COMMAND.MAV_MODE_FLAG_SAFETY_ARMED
        self._client.receive("HEARTBEAT", where=lambda heartbeat: heartbeat.base_mode & armed)

    def takes_off(self):
        self._client.accepted(COMMAND.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
        self._client.wait_for_mode("holding")
        height = self._true.position()[2]
        expect(abs(height - 1.0) < 0.25, f"holding at {height:.3f} m instead of the default of 1 m")

    def refuses_to_disarm_in_the_air(self):
        result = self._client.command(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        expect(result == COMMAND.MAV_RESULT_TEMPORARILY_REJECTED, f"result {result}")

    def has_velocities_wait_and_refuses_nan(self):
        self._client.drain()
        self._client.send_target(VELOCITY_ONLY, 0, 0, 0, velocity=0.5)
        self._client.says("waits for the offboard mode")
        self._client.send_target(POSITION_ONLY, NAN, NAN, NAN)
        self._client.says("not a finite number")
        expect(self._true.now()["mode"] == "holding", "it changed its mode")

    def hands_over_to_the_pid_and_back(self):
        choices = (("PID", "PID", self._choose_by_command), ("policy", "Hold", self._choose_by_message))
        for name, shown, choose in choices:
            choose(self._modes[name])
            # Clients of PX4 are told that a policy holds.
            mode = self._modes[shown]
            self._client.receive("CURRENT_MODE", where=lambda told, mode=mode: told.custom_mode == mode)
            point, begin = self._true.position(), self._true.now()["secs"]
            self._client.pass_time(3.0)
            moments = [moment for moment in self._true.read() if moment["secs"] > begin]
            strayed = max(math.dist(moment["position"], point) for moment in moments)
            expect(strayed < 0.2, f"with the {name} it strayed by {strayed:.3f} m")

    def _choose_by_command(self, mode):
        self._client.accepted(COMMAND.MAV_CMD_DO_SET_MODE, COMMAND.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode)

    def _choose_by_message(self, mode):
        self._client.mav.set_mode_send(1, COMMAND.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode)

    def reaches_the_first_set_point(self):
        self._reach(0)

    def reaches_the_second_set_point(self):
        self._reach(1)

    def reaches_the_third_set_point(self):
        self._reach(2)

    def _point(self, east, north, up):
        return [self._start[0] + east, self._start[1] + north, up]

    def _reach(self, index):
        self._target = self._point(*OFFSETS[index])
        self._client.go_to(self._target)
        sent_secs = self._true.now()["secs"]
        self._client.wait_until(
            lambda moments: stayed(moments, self._target, sent_secs),
            f"within {ARRIVAL_RADIUS_M} m of {rounded(self._target)} for {DWELL_SECS} s",
            25.0,
        )

    def tells_the_truth(self):
        for _ in range(20):
            told = self._client.receive("LOCAL_POSITION_NED")
            true = self._true.at(told.time_boot_ms / 1000)
            error = math.dist([told.y, told.x, -told.z], true["position"])
            expect(error < 0.02, f"told {error:.3f} m from the true position")

    def _waypoint(self, east, north, up):
        x, y, z = self._point(east, north, up)
        where = (round(y * 1e4), round(x * 1e4), -z)
        return (LOCAL_NED, COMMAND.MAV_CMD_NAV_WAYPOINT, 0.5, 0.0, 0.0, 0.0, *where)

    def keeps_a_mission(self):
        mission = [self._waypoint(0.5, 0.0, 1.0), self._waypoint(0.5, 0.5, 1.25), self._waypoint(0.0, 0.5, 1.0)]
        result = self._client.upload(MISSION, mission)
        expect(result == COMMAND.MAV_MISSION_ACCEPTED, f"the upload was answered with {result}")
        loaded = self._client.download(MISSION)
        expect(loaded == mission, f"{loaded} came back instead of {mission}")
        orbit = (LOCAL_NED, COMMAND.MAV_CMD_DO_ORBIT, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
        result = self._client.upload(MISSION, [mission[0], orbit])
        expect(result == COMMAND.MAV_MISSION_UNSUPPORTED, f"an orbit was answered with {result}")
        expect(self._client.download(MISSION) == mission, "the refused mission replaced the former one")

    def flies_the_mission(self):
        self._client.accepted(COMMAND.MAV_CMD_MISSION_START)
        for number in range(3):
            # What is reached is told more than once, in case a link loses it.
            new = lambda told, number=number: told.seq >= number  # noqa: E731
            reached = self._client.receive("MISSION_ITEM_REACHED", within_secs=20.0, where=new).seq
            expect(reached == number, f"item {reached} was reached instead of {number}")
        self._client.wait_near(self._point(0.0, 0.5, 1.0))
        self._client.clear(MISSION)
        expect(self._client.download(MISSION) == [], "it still has a mission")
        result = self._client.command(COMMAND.MAV_CMD_MISSION_START)
        expect(result == COMMAND.MAV_RESULT_TEMPORARILY_REJECTED, f"a start without a mission: {result}")

    def stays_within_an_uploaded_fence(self):
        client = self._client
        home = client.receive("HOME_POSITION")
        # 0.01 m of latitude are 9e-8 degrees.
        north = round(1.2 / 111_195 * 1e7)
        circle = (GLOBAL, COMMAND.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, 2.5, 0.0, 0.0, 0.0)
        pillar = (GLOBAL, COMMAND.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, 0.25, 0.0, 0.0, 0.0)
        fence = [
            (*circle, home.latitude, home.longitude, 0.0),
            (*pillar, home.latitude + north, home.longitude, 0.0),
        ]
        result = client.upload(FENCE, fence)
        expect(result == COMMAND.MAV_MISSION_ACCEPTED, f"the upload was answered with {result}")
        expect(client.download(FENCE) == fence, "another fence came back")
        for outside in (self._point(2.6, 0.0, 1.0), self._point(0.0, 1.2, 1.0)):
            # The same words are not said twice within a second.
            client.pass_time(1.1)
            client.go_to(outside)
            client.says("outside the fence")
        expect(self._true.now()["mode"] == "holding", f"it is {self._true.now()['mode']}")
        client.clear(FENCE)
        expect(client.download(FENCE) == [], "it still has a fence")
        self._target = self._point(0.4, 0.4, 1.0)
        client.go_to(self._target)
        client.wait_near(self._target)

    def lands_below_the_last_set_point(self):
        self._client.accepted(COMMAND.MAV_CMD_NAV_LAND, 0, 0, 0, NAN)
        self._client.wait_for_mode("landed")
        position = self._true.position()
        aside = math.dist(position[:2], self._target[:2])
        expect(aside < LANDING_RADIUS_M, f"landed {aside:.3f} m aside")
        expect(position[2] > 0.0, f"landed at a height of {position[2]:.3f} m")

    def disarms_and_rests(self):
        self._client.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        armed = COMMAND.MAV_MODE_FLAG_SAFETY_ARMED
        self._client.receive("HEARTBEAT", where=lambda heartbeat: not heartbeat.base_mode & armed)
        self._client.pass_time(1.0)
        self._true.expect_rest()
        velocity = self._true.now()["velocity"]
        expect(math.hypot(*velocity) < 1e-3, f"moving at {velocity}")

    def ends_cleanly_on_ctrl_c(self):
        self._vehicle.process.send_signal(signal.SIGINT)
        status = self._vehicle.process.wait(timeout=10)
        expect(status == 0, f"exit status {status}: {self._vehicle.said()}")


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    kestrel, *arguments = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        with Simulated(kestrel, with_speed(arguments), folder) as vehicle, Client(vehicle) as client:
            status = conclude(run_checks(checks_of(Flight(vehicle, client))))
    sys.exit(status)


if __name__ == "__main__":
    main()
