"""What `kestrel replay -o flight.mcap` writes, read by programs that others wrote: mcap, mcap-ros2-support and rosbags.

    python mcap_test.py KESTREL

KESTREL is the path of the binary. rosbags knows ROS 2's messages by itself: what a file says of them must be the same, and
both decode the same numbers, which are those of the CSV of the same flight. Exit status 0 if every check passed.
"""

import collections
import csv
import math
import pathlib
import subprocess
import sys
import tempfile

import numpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TOPICS = {
    "/tf", "/world", "/drone0/odom", "/drone0/twist", "/drone0/imu", "/drone0/rotors", "/drone0/action", "/drone0/goal",
    "/drone0/range/front", "/drone0/range/back", "/drone0/range/left", "/drone0/range/right", "/drone0/range/up",
    "/drone0/range/down", "/drone0/camera/image", "/drone0/camera/camera_info", "/drone0/outcome",
}  # fmt: skip
"""What every flight of one drone has, beside its reward terms."""

BEGINNING = 1_000_000_000
"""Time at which a flight begins [ns]."""


def replay(kestrel, folder, *arguments):
    """Writes a flight's files, and returns their paths."""
    mcap, table = folder / "flight.mcap", folder / "flight.csv"
    command = [kestrel, "replay", *arguments, "-o", str(mcap), str(table)]
    subprocess.run(command, check=True, capture_output=True)
    return mcap, table


def decoded(path):
    """Topic to (time, message by mcap-ros2-support, raw bytes), and topic to schema."""
    messages, schemas = collections.defaultdict(list), {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, content in reader.iter_decoded_messages():
            messages[channel.topic].append((message.log_time, content, message.data))
            schemas[channel.topic] = schema
    return messages, schemas


def rows(path):
    with open(path, newline="") as file:
        return [{name: float(value) for name, value in row.items() if value} for row in csv.DictReader(file)]


def numbers(message, *names):
    return [getattr(message, name) for name in names]


def close(found, expected):
    return bool(numpy.allclose(found, expected, rtol=0.0, atol=1e-12))


def of_messages(messages, schemas):
    """rosbags knows every message, in the form of Jazzy, and decodes the same."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for topic, schema in schemas.items():
        said = get_types_from_msg(schema.data.decode(), schema.name)
        # A definition is (constants, fields); which constants are repeated is a file's own choice.
        yield f"{topic} is ROS 2's {schema.name}", all(store.fielddefs[name][1] == said[name][1] for name in said)
        _, by_mcap, raw = messages[topic][-1]
        by_rosbags = store.deserialize_cdr(raw, schema.name)
        yield f"{topic} is read alike by two programs", alike(by_mcap, by_rosbags)
        yield f"{topic} is encoded as ROS 2 does", bytes(store.serialize_cdr(by_rosbags, schema.name)) == bytes(raw)


def alike(left, right):
    if hasattr(right, "__dataclass_fields__"):
        return all(alike(getattr(left, name), getattr(right, name)) for name in right.__dataclass_fields__ if name[0].islower())
    if isinstance(right, (list, tuple, numpy.ndarray)):
        return len(left) == len(right) and all(alike(one, other) for one, other in zip(left, right))
    return left == right or (isinstance(left, float) and math.isnan(left) and math.isnan(right))


def of_flight(messages, table):
    """The messages tell of the flight what the table tells."""
    states = [(time, message) for time, message, _ in messages["/drone0/odom"]]
    yield "there is an odometry for every line of the table", len(states) == len(table)
    yield "times are those of the table", all(
        abs((time - BEGINNING) * 1e-9 - row["secs"]) < 1e-6 for (time, _), row in zip(states, table)
    )
    yield "positions and attitudes are those of the table", all(
        close(numbers(message.pose.pose.position, *"xyz"), [row[name] for name in ("px", "py", "pz")])
        and close(numbers(message.pose.pose.orientation, *"wxyz"), [row[name] for name in ("qw", "qx", "qy", "qz")])
        for (_, message), row in zip(states, table)
    )
    yield "velocities in the world are those of the table", all(
        close(numbers(message.twist.linear, *"xyz"), [row[name] for name in ("vx", "vy", "vz")])
        for (_, message, _), row in zip(messages["/drone0/twist"], table)
    )
    speeds = [math.hypot(*numbers(message.twist.twist.linear, *"xyz")) for _, message in states]
    yield "speeds in the body are those in the world", numpy.allclose(
        speeds, [math.hypot(row["vx"], row["vy"], row["vz"]) for row in table], rtol=1e-6
    )
    yield "rotors turn as in the table", all(
        close(message.velocity, [row[f"m{rotor}"] for rotor in range(4)])
        for (_, message, _), row in zip(messages["/drone0/rotors"], table)
    )
    yield "actions and rewards are those of the table", all(
        close(message.data, [row[f"a{index}"] for index in range(len(message.data))])
        for (_, message, _), row in zip(messages["/drone0/action"], table)
    ) and all(
        close([message.data for _, message, _ in found], [row["r_" + topic.split("/")[-1]] for row in table if "a0" in row])
        for topic, found in messages.items()
        if "/reward/" in topic
    )
    force = [math.hypot(*numbers(message.linear_acceleration, *"xyz")) for _, message, _ in messages["/drone0/imu"]]
    yield "the accelerometer feels gravity at the start", abs(force[0] - 9.8) < 0.01


def of_room(messages, table):
    """What is seen in a furnished room with a floor."""
    down = [message.range for _, message, _ in messages["/drone0/range/down"]]
    tilted = [2 * (row["qx"] ** 2 + row["qy"] ** 2) for row in table]
    first = table[0]["pz"] / (1 - tilted[0])
    yield "the ranger sees the floor below", abs(down[0] - first) < 1e-3
    yield "nothing is seen through the floor", all(
        metres <= row["pz"] / (1 - tilt) + 1e-3 for metres, row, tilt in zip(down, table, tilted)
    )
    yield "rangers see furniture", any(message.range < 4.0 for _, message, _ in messages["/drone0/range/front"])
    image = messages["/drone0/camera/image"][0][1]
    yield "images have the size and the colours that they name", (image.width, image.height, len(image.data)) == (
        160, 120, 160 * 120 * 3
    ) and len(set(bytes(image.data))) > 5  # fmt: skip
    kinds = {marker.type for _, message, _ in messages["/world"] for marker in message.markers}
    yield "a furnished room has its bodies", kinds >= {1, 3} and len(messages["/world"][0][1].markers) > 20


def of_frames(messages, frames):
    """Every frame that a message names hangs in the tree, at every moment a unit quaternion."""
    tree = [transform for _, message, _ in messages["/tf"] for transform in message.transforms]
    placed = {transform.child_frame_id for transform in tree} | {"world"}
    named = {marker.header.frame_id for _, message, _ in messages["/world"] for marker in message.markers}
    named |= {message.header.frame_id for _, message, _ in messages["/drone0/camera/image"] + messages["/drone0/imu"]}
    yield f"the frames {', '.join(sorted(frames))} are placed", placed == frames | {"world"} and named <= placed
    lengths = [math.hypot(*numbers(transform.transform.rotation, *"wxyz")) for transform in tree]
    yield "attitudes are unit quaternions", max(abs(length - 1.0) for length in lengths) < 1e-6


def checks(kestrel, folder):
    mcap, table = replay(kestrel, folder, "hover")
    first = mcap.read_bytes()
    messages, schemas = decoded(mcap)
    rewards = {topic for topic in messages if topic.startswith("/drone0/reward/")}
    yield "a flight has its topics", set(messages) - rewards == TOPICS and rewards
    yield from of_messages(messages, schemas)
    yield from of_flight(messages, rows(table))
    yield from of_frames(messages, {"drone0", "drone0/camera"})
    outcome = messages["/drone0/outcome"]
    yield "how it ended is told once", [message.data for _, message, _ in outcome] == ["time limit, success"]
    replay(kestrel, folder, "hover")
    yield "the same flight gives the same bytes", mcap.read_bytes() == first
    mcap, table = replay(kestrel, folder, "configs/examples/land-on-a-moving-pad.yaml", "--pilot", "scripted")
    messages, schemas = decoded(mcap)
    yield from of_frames(messages, {"drone0", "drone0/camera", "movable0"})
    mcap, table = replay(kestrel, folder, "configs/aviaries/room-1.yaml", "--pilot", "scripted")
    messages, schemas = decoded(mcap)
    yield from of_room(messages, rows(table))


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    passed = failed = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, passes in checks(sys.argv[1], pathlib.Path(folder)):
            if not passes:
                print(f"FAILED  {name}")
            passed, failed = passed + bool(passes), failed + (not passes)
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
