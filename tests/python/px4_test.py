"""A real PX4 flies `kestrel-shim bridge`, commanded by pymavlink and judged by the true position.

    python px4_test.py KESTREL_SHIM

KESTREL_SHIM is the path of the binary. PX4 is no part of this project: the environment variable PX4_BIN names the
binary of a built `px4_sitl_default` (build/px4_sitl_default/bin/px4, with its folder etc beside bin). Without it nothing
is run, and that is said. Exit status 0 if every check passed or nothing was run.
"""

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time

os.environ["MAVLINK20"] = "1"

AUTOSTART = "10016"
"""PX4's airframe `none_iris`: a quad X that waits for a simulator on TCP 4560."""

GAINS = {
    "MC_ROLLRATE_P": 0.07,
    "MC_ROLLRATE_I": 0.2,
    "MC_ROLLRATE_D": 0.002,
    "MC_PITCHRATE_P": 0.07,
    "MC_PITCHRATE_I": 0.2,
    "MC_PITCHRATE_D": 0.002,
    "MC_ROLL_P": 6.5,
    "MC_PITCH_P": 6.5,
    "MC_YAW_P": 3.0,
    "MPC_Z_P": 1.5,
    "MPC_Z_VEL_P_ACC": 8.0,
    "MPC_Z_VEL_I_ACC": 6.0,
    "MPC_THR_MAX": 1.0,
    "MPC_THR_HOVER": 0.444,
    "MIS_TAKEOFF_ALT": 2.5,
}
"""Of PX4's airframe `4901_crazyflie21`, but for the hover throttle: thrust to weight is 2.25 here."""

GOAL_NED = (2.0, 1.0, -2.5)
GOAL_RADIUS_M = 0.5
READY_SECS = 120.0
NAN = float("nan")
POSITION_AND_YAW = 2552


class CheckFailed(Exception):
    """What was seen instead of what was expected."""


def expect(condition, text):
    if not condition:
        raise CheckFailed(text)


def true_position(path):
    """The last whole line of the log: north, east, down [m]."""
    with open(path, encoding="utf-8") as log:
        *lines, _ = log.read().split("\n")
    expect(lines, f"nothing in {path}")
    east, north, up = json.loads(lines[-1])["position"]
    return north, east, -up


class Ground:
    """A client of PX4's offboard port."""

    def __init__(self, mavutil):
        self.mavlink = mavutil.mavlink
        self.client = mavutil.mavlink_connection("udpin:127.0.0.1:14540", source_system=245, source_component=190)
        expect(self.client.wait_heartbeat(timeout=READY_SECS), "no heartbeat of PX4")

    def set_parameters(self):
        for name, value in GAINS.items():
            self.client.param_set_send(name, value)
            reply = self.client.recv_match(type="PARAM_VALUE", blocking=True, timeout=5.0)
            expect(reply, f"{name} is not confirmed")

    def wait_until_ready(self):
        end = time.monotonic() + READY_SECS
        check = self.mavlink.MAV_SYS_STATUS_PREARM_CHECK
        while time.monotonic() < end:
            status = self.client.recv_match(type="SYS_STATUS", blocking=True, timeout=5.0)
            if status and status.onboard_control_sensors_health & check:
                return
        raise CheckFailed(f"PX4 is not ready to arm after {READY_SECS:.0f} s")

    def command(self, number, *parameters):
        parameters = [*parameters, *[NAN] * (7 - len(parameters))]
        for attempt in range(4):
            self.client.mav.command_long_send(1, 1, number, attempt, *parameters)
            ack = self.client.recv_match(type="COMMAND_ACK", blocking=True, timeout=1.0)
            if ack and ack.command == number:
                expect(ack.result == 0, f"command {number} is answered with {ack.result}")
                return
        raise CheckFailed(f"command {number} is not answered")

    def go_to(self, position, secs):
        end = time.monotonic() + secs
        offboard = False
        while time.monotonic() < end:
            self.client.mav.set_position_target_local_ned_send(
                0, 1, 1, 1, POSITION_AND_YAW, *position, 0, 0, 0, 0, 0, 0, 0, 0
            )
            if not offboard and time.monotonic() > end - secs + 0.5:
                self.command(self.mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
                offboard = True
            time.sleep(0.05)


def fly(ground, log):
    ground.set_parameters()
    ground.wait_until_ready()
    start = true_position(log)
    ground.command(ground.mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    ground.command(ground.mavlink.MAV_CMD_NAV_TAKEOFF)
    time.sleep(10.0)
    height = start[2] - true_position(log)[2]
    expect(1.8 < height < 3.2, f"take-off to 2.5 m reached {height:.2f} m")
    ground.go_to(GOAL_NED, 15.0)
    distance = math.dist(true_position(log), [a + b for a, b in zip(start, GOAL_NED, strict=True)])
    expect(distance < GOAL_RADIUS_M, f"{distance:.2f} m from the set-point")
    ground.command(ground.mavlink.MAV_CMD_NAV_LAND)
    time.sleep(15.0)
    height = start[2] - true_position(log)[2]
    expect(abs(height) < 0.05, f"landed {height:.2f} m above the floor")


def main():
    [shim] = sys.argv[1:]
    px4 = os.environ.get("PX4_BIN")
    if not px4:
        print("px4_test: NOT RUN, for PX4_BIN names no PX4 (build/px4_sitl_default/bin/px4)")
        return 0
    from pymavlink import mavutil

    px4 = os.path.abspath(px4)
    etc = os.path.join(os.path.dirname(os.path.dirname(px4)), "etc")
    with tempfile.TemporaryDirectory() as folder:
        log = os.path.join(folder, "true_state.jsonl")
        processes = [subprocess.Popen([shim, "bridge", "--peer", "px4", "--true-state-log", log])]
        try:
            time.sleep(0.5)
            environment = {**os.environ, "PX4_SYS_AUTOSTART": AUTOSTART, "PX4_SIM_MODEL": "none_iris"}
            processes.append(subprocess.Popen([px4, "-d", "-i", "0", etc], cwd=folder, env=environment))
            fly(Ground(mavutil), log)
        except CheckFailed as failure:
            print(f"px4_test: FAILED: {failure}")
            return 1
        finally:
            for process in reversed(processes):
                process.send_signal(signal.SIGINT)
                process.wait(timeout=10)
    print("px4_test: PX4 took off, went to a set-point and landed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
