"""What `kestrel replay` writes, read by programs that others wrote: MCAP by mcap-ros2-support and rosbags, Parquet by DuckDB,
MP4 by FFmpeg.

    python replay_test.py KESTREL

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

import av
import duckdb
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


def across(row, name, parts):
    return [row[name.format(part)] for part in parts]


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
        abs((time - BEGINNING) * 1e-9 - row["time_secs"]) < 1e-6 for (time, _), row in zip(states, table)
    )
    yield "positions and attitudes are those of the table", all(
        close(numbers(message.pose.pose.position, *"xyz"), across(row, "position_{}_m", "xyz"))
        and close(numbers(message.pose.pose.orientation, *"wxyz"), across(row, "attitude_{}", "wxyz"))
        for (_, message), row in zip(states, table)
    )
    yield "velocities in the world are those of the table", all(
        close(numbers(message.twist.linear, *"xyz"), across(row, "velocity_{}_m_per_s", "xyz"))
        for (_, message, _), row in zip(messages["/drone0/twist"], table)
    )
    speeds = [math.hypot(*numbers(message.twist.twist.linear, *"xyz")) for _, message in states]
    yield "speeds in the body are those in the world", numpy.allclose(
        speeds, [math.hypot(*across(row, "velocity_{}_m_per_s", "xyz")) for row in table], rtol=1e-6
    )
    yield "rotors turn as in the table", all(
        close(message.velocity, across(row, "rotor_{}_rad_per_s", range(4)))
        for (_, message, _), row in zip(messages["/drone0/rotors"], table)
    )
    yield "actions and rewards are those of the table", all(
        close(message.data, across(row, "action_{}", range(len(message.data))))
        for (_, message, _), row in zip(messages["/drone0/action"], table)
    ) and all(
        close([message.data for _, message, _ in found], [row["reward_" + topic.split("/")[-1]] for row in table if "action_0" in row])
        for topic, found in messages.items()
        if "/reward/" in topic
    )
    force = [math.hypot(*numbers(message.linear_acceleration, *"xyz")) for _, message, _ in messages["/drone0/imu"]]
    yield "the accelerometer feels gravity at the start", abs(force[0] - 9.8) < 0.01


def of_room(messages, table):
    """What is seen in a furnished room with a floor."""
    down = [message.range for _, message, _ in messages["/drone0/range/down"]]
    tilted = [2 * (row["attitude_x"] ** 2 + row["attitude_y"] ** 2) for row in table]
    first = table[0]["position_z_m"] / (1 - tilted[0])
    yield "the ranger sees the floor below", abs(down[0] - first) < 1e-3
    yield "nothing is seen through the floor", all(
        metres <= row["position_z_m"] / (1 - tilt) + 1e-3 for metres, row, tilt in zip(down, table, tilted)
    )
    yield "rangers see furniture", any(message.range < 4.0 for _, message, _ in messages["/drone0/range/front"])
    image = messages["/drone0/camera/image"][0][1]
    yield "images have the size and the colours that they name", (image.width, image.height, len(image.data)) == (
        160, 120, 160 * 120 * 3
    ) and len(set(bytes(image.data))) > 5  # fmt: skip
    kinds = {marker.type for _, message, _ in messages["/world"] for marker in message.markers}
    yield "a furnished room has its bodies", kinds >= {1, 3} and len(messages["/world"][0][1].markers) > 20


def of_parquet(kestrel, folder, table):
    """DuckDB reads the numbers of the table, to the bit, and nothing where the table has nothing."""
    path = folder / "flight.parquet"
    subprocess.run([kestrel, "replay", "hover", "-o", str(path)], check=True, capture_output=True)
    found = duckdb.sql(f"SELECT * FROM '{path}'")
    read = [{name: value for name, value in zip(found.columns, row) if value is not None} for row in found.fetchall()]
    yield "a Parquet file has the numbers of the table", read == table and len(read) > 100
    yield "its columns are doubles with units", set(map(str, found.types)) == {"DOUBLE"} and "position_x_m" in found.columns


def of_film(kestrel, folder):
    """FFmpeg decodes every picture, in the colours of the GIF of the same flight."""
    film, gif = folder / "flight.mp4", folder / "flight.gif"
    command = [kestrel, "replay", "configs/aviaries/room-1.yaml", "--pilot", "scripted", "-o", str(film), str(gif)]
    subprocess.run(command, check=True, capture_output=True)
    with av.open(str(film)) as container, av.open(str(gif)) as animated:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        expected = [frame.to_ndarray(format="rgb24") for frame in animated.decode(video=0)]
        yield "a film is H.264, 25 pictures a second", (stream.codec.name, stream.average_rate) == ("h264", 25)
    yield "a film ends with a pause", len(pictures) == len(expected) + 37
    errors = [numpy.abs(one.astype(float) - other).mean() for one, other in zip(pictures, expected)]
    yield "its pictures are those of the GIF", max(errors) < 6.0
    yield "it is smaller", 2 * film.stat().st_size < gif.stat().st_size


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
    _, table = replay(kestrel, folder, "hover")
    yield from of_parquet(kestrel, folder, rows(table))
    yield from of_film(kestrel, folder)


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
