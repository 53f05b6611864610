"""MAVSDK 3 flies a policy through links that lose, double, reorder and delay what passes, and flights that succeed are counted.

    python lossy_test.py KESTREL POLICY [--flights 4] [--loss 0.05] [--at-once 4] [--may-fail 0] [--seed 1]

KESTREL is the path of `kestrel-shim`, or of `kestrel`. Needs the packages of mavsdk3-requirements.txt; a flight takes half a
minute, since MAVSDK counts wall time. What the client repeats by itself is all that is repeated; only the version, which it
does not wait for, is asked for until it is known. Exit status 0 if no more flights fail than may.
"""

import argparse
import asyncio
import concurrent.futures
import math
import os
import subprocess
import sys
import tempfile
import time
import warnings

from judge import CheckFailed, Simulated, expect

warnings.simplefilter("ignore", FutureWarning)

import grpc  # noqa: E402
from mavsdk.action import ActionError  # noqa: E402
from mavsdk.info import InfoError  # noqa: E402
from mavsdk.mission import MissionError, MissionItem, MissionPlan  # noqa: E402
from mavsdk.offboard import OffboardError, PositionNedYaw  # noqa: E402
from mavsdk.param import ParamError  # noqa: E402

import mavsdk3_test  # noqa: E402
from mavsdk3_test import WAIT_SECS, first  # noqa: E402

DUPLICATION = 0.05
REORDERING = 0.2
DELAY_SECS = 0.03

NAN = float("nan")

FAILURES = (
    *(ActionError, InfoError, MissionError, OffboardError, ParamError),
    *(CheckFailed, asyncio.TimeoutError, subprocess.TimeoutExpired, OSError, grpc.RpcError),
)


class Flight(mavsdk3_test.Flight):
    """The nine steps."""

    STEPS = (
        *("connects", "tells_its_version", "is_healthy", "lists_and_sets_parameters", "arms", "takes_off"),
        *("flies_offboard", "flies_a_mission", "lands"),
    )

    def tells_its_version(self):
        async def ask():
            while True:
                try:
                    return await self._drone.info.get_version()
                except InfoError:
                    await asyncio.sleep(0.5)

        version = self._run(ask())
        expect((version.flight_sw_major, version.flight_sw_minor) == (0, 1), f"version {version}")

    def flies_offboard(self):
        async def fly():
            await self._drone.offboard.set_position_ned(PositionNedYaw(0.4, 0.5, -1.0, 0.0))
            # Like PX4 the vehicle wants set-points before the mode, and the first one may be lost.
            await asyncio.sleep(0.5)
            await self._drone.offboard.start()

        self._run(fly())
        self._true.wait_near([0.5, 0.4, 1.0], 0.15, WAIT_SECS)
        self._run(self._drone.offboard.stop())

    def flies_a_mission(self):
        async def fly():
            home = await first(self._drone.telemetry.home())
            north = 1 / 111_195
            east = north / math.cos(math.radians(home.latitude_deg))

            def item(metres_north, metres_east, height):
                return MissionItem(
                    home.latitude_deg + metres_north * north, home.longitude_deg + metres_east * east, height,
                    0.4, False, NAN, NAN, MissionItem.CameraAction.NONE, NAN, NAN, 0.15, NAN, NAN,
                    MissionItem.VehicleAction.NONE,
                )

            await self._drone.mission.set_return_to_launch_after_mission(False)
            await self._drone.mission.upload_mission(MissionPlan([item(0.5, 0.0, 1.0), item(0.0, 0.5, 1.2)]))
            await self._drone.mission.start_mission()
            await first(
                self._drone.mission.mission_progress(),
                lambda progress: progress.total > 0 and progress.current == progress.total,
            )

        self._run(fly())
        self._true.wait_near([0.5, 0.0, 1.2], 0.2, WAIT_SECS)

    def lands(self):
        self._run(self._drone.action.land())
        self._run(first(self._drone.telemetry.armed(), lambda armed: not armed))
        self._true.expect_rest()
        self._vehicle.expect_alive()


def fly(options):
    """What stopped the flight, if anything did."""
    faults = f"loss={options.loss},duplicate={DUPLICATION},reorder={REORDERING},delay={DELAY_SECS},seed={options.seed}"
    arguments = [options.policy, "--link-faults", faults]
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    with tempfile.TemporaryDirectory() as folder, Simulated(options.kestrel, arguments, folder) as vehicle:
        flight = Flight(vehicle, loop)
        for name in Flight.STEPS:
            try:
                getattr(flight, name)()
            except FAILURES as failure:
                text = f"{name}: {type(failure).__name__} {failure}"
                return " ".join(text.split())
    return None


def fly_alone(options, seed):
    """The same in a process of its own, as MAVSDK's server needs one; and how long it took [s]."""
    command = [sys.executable, __file__, options.kestrel, options.policy]
    command += ["--loss", str(options.loss), "--seed", str(seed), "--flights", "1"]
    start = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True)
    *_, verdict = done.stdout.strip().split("\n")
    return None if done.returncode == 0 else verdict, time.monotonic() - start


def fly_all(options):
    """How many flights failed."""
    failed = 0
    seeds = range(options.seed, options.seed + options.flights)
    with concurrent.futures.ThreadPoolExecutor(options.at_once) as pool:
        flights = {pool.submit(fly_alone, options, seed): seed for seed in seeds}
        for flight in concurrent.futures.as_completed(flights):
            failure, secs = flight.result()
            failed += failure is not None
            print(f"  flight {flights[flight]:3} after {secs:5.1f} s: {failure or 'all nine steps'}", flush=True)
    return failed


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kestrel")
    parser.add_argument("policy")
    parser.add_argument("--flights", type=int, default=4)
    parser.add_argument("--loss", type=float, default=0.05)
    parser.add_argument("--at-once", type=int, default=4)
    parser.add_argument("--may-fail", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.flights == 1:
        failure = fly(options)
        print(failure or "all nine steps", flush=True)
        # MAVSDK's threads would keep the process.
        os._exit(0 if failure is None else 1)
    failed = fly_all(options)
    print(f"{options.flights - failed} of {options.flights} flights at a loss of {options.loss:.0%} each way")
    right = failed <= options.may_fail
    print("1 passed, 0 failed" if right else "0 passed, 1 failed")
    sys.exit(0 if right else 1)


if __name__ == "__main__":
    main()
