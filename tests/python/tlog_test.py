"""pymavlink reads the flight log of `kestrel-shim`.

    python tlog_test.py KESTREL_SHIM POLICY

KESTREL_SHIM is the path of the binary. Exit status 0 if every check passed.
"""

import os
import subprocess
import sys
import tempfile

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil  # noqa: E402  (reads MAVLINK20 when imported)

START_SECS = 1_700_000_000
FLIGHT_SECS = 20


def fly(binary, policy, log, *more):
    command = [binary, policy, "--listen", "127.0.0.1:0", "--ground-station", "127.0.0.1:9", "--speed", "max"]
    command += ["--for-secs", str(FLIGHT_SECS), "--log", log, "--log-start", str(START_SECS), *more]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, timeout=60)


def messages(log):
    """Everything in a log, by the name of the message."""
    connection = mavutil.mavlink_connection(log)
    found = {}
    while (message := connection.recv_match()) is not None:
        found.setdefault(message.get_type(), []).append(message)
    connection.close()
    return found


def every_frame_is_read(found):
    assert "BAD_DATA" not in found, f"{len(found['BAD_DATA'])} frames are damaged"
    heartbeats = len(found["HEARTBEAT"])
    assert FLIGHT_SECS <= heartbeats <= FLIGHT_SECS + 1, f"{heartbeats} heartbeats in {FLIGHT_SECS} s"


def times_are_those_of_the_flight(found):
    for message in found["ATTITUDE"]:
        expected_secs = START_SECS + message.time_boot_ms / 1000
        late_secs = message._timestamp - expected_secs
        assert abs(late_secs) < 0.002, f"logged {late_secs:.4f} s from its own time"
    times = [message._timestamp for message in found["HEARTBEAT"]]
    assert times[0] == START_SECS and times == sorted(times), f"heartbeats at {times}"


def all_is_from_one_vehicle(found):
    systems = {message.get_srcSystem() for all_of_a_kind in found.values() for message in all_of_a_kind}
    assert systems == {1}, f"systems {systems}"


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    checks = [every_frame_is_read, times_are_those_of_the_flight, all_is_from_one_vehicle]
    passed, failed = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        logs = [os.path.join(folder, name) for name in ("first.tlog", "second.tlog")]
        for log in logs:
            fly(*sys.argv[1:], log)
        found = messages(logs[0])

        def the_same_flight_has_the_same_log(_found):
            first, second = (open(log, "rb").read() for log in logs)
            assert first == second, "two flights that nobody disturbs have different logs"

        for check in [*checks, the_same_flight_has_the_same_log]:
            name = check.__name__.replace("_", " ")
            try:
                check(found)
            except (AssertionError, KeyError) as failure:
                print(f"FAILED  {name}: {failure}")
                failed += 1
            else:
                print(f"ok      {name}")
                passed += 1
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
