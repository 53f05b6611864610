"""`kestrel fly --video`: pymavlink is told of a camera, and FFmpeg (PyAV) plays its stream.

    python video_test.py KESTREL RUN_OR_POLICY

KESTREL is the path of `kestrel`. Exit status 0 if every check passed.
"""

import contextlib
import socket
import sys
import tempfile

import av
import numpy as np
from client import COMMAND, Client
from judge import CheckFailed, Simulated, checks_of, conclude, expect, free_port, run_checks

CAMERA = 100
"""MAV_COMP_ID_CAMERA."""

PICTURES = 30

PATIENCE_US = "15000000"
"""Of FFmpeg's [µs]."""


class Watching:
    """The checks, in the order in which they are made."""

    def __init__(self, client):
        self._client = client
        self._url = None

    def _told(self, kind, message_id):
        """What the camera tells when it is asked."""
        self._client.drain()
        self._client.mav.command_long_send(
            1, CAMERA, COMMAND.MAV_CMD_REQUEST_MESSAGE, 0, message_id, 0, 0, 0, 0, 0, 0
        )
        of_camera = lambda message: message.get_srcComponent() == CAMERA  # noqa: E731
        return self._client.receive(kind, where=of_camera)

    def check_the_camera_says_what_it_is_and_where_its_stream_is(self):
        beat = self._told("HEARTBEAT", 0)
        expect(beat.type == COMMAND.MAV_TYPE_CAMERA, f"it is of type {beat.type}")
        camera = self._told("CAMERA_INFORMATION", COMMAND.MAVLINK_MSG_ID_CAMERA_INFORMATION)
        expect(camera.flags == COMMAND.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM, f"its flags are {camera.flags}")
        stream = self._told("VIDEO_STREAM_INFORMATION", COMMAND.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION)
        expect(stream.type == COMMAND.VIDEO_STREAM_TYPE_RTSP, f"a stream of type {stream.type}")
        expect(stream.encoding == COMMAND.VIDEO_STREAM_ENCODING_H264, f"encoded as {stream.encoding}")
        expect((stream.resolution_h, stream.resolution_v) == (640, 480), f"{stream}")
        self._url = stream.uri
        expect(self._url.startswith("rtsp://127.0.0.1:"), self._url)

    def _playing(self, transport):
        options = {"rtsp_transport": transport, "stimeout": PATIENCE_US, "timeout": PATIENCE_US}
        return contextlib.closing(av.open(self._url, options=options))

    def _played(self, transport):
        """Pictures as a player has them: red, green, blue."""
        with self._playing(transport) as player:
            pictures = []
            for picture in player.decode(video=0):
                pictures.append(picture.to_ndarray(format="rgb24").astype(int))
                self._client.tend()
                if len(pictures) == PICTURES:
                    return pictures
        raise CheckFailed("the stream has ended")

    def check_a_player_plays_it_over_tcp(self):
        pictures = self._played("tcp")
        expect(pictures[0].shape == (480, 640, 3), f"{pictures[0].shape}")
        expect(pictures[0].std() > 20, "there is nothing to be seen")

    def check_a_player_plays_it_over_udp(self):
        pictures = self._played("udp")
        expect(pictures[-1].std() > 20, "there is nothing to be seen")

    def check_two_players_see_the_drone_take_off(self):
        with self._playing("tcp") as other:
            before = self._played("tcp")[-1]
            self._client.accepted(COMMAND.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            self._client.accepted(COMMAND.MAV_CMD_NAV_TAKEOFF, *[float("nan")] * 7)
            self._client.wait_for_mode("holding")
            after = self._played("tcp")[-1]
            changed = np.abs(after - before).mean()
            expect(changed > 10, f"the picture has changed by {changed:.1f} on average")
            expect(next(other.decode(video=0)).width == 640, "the other one sees nothing")


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    kestrel, policy = sys.argv[1:]
    video = f"127.0.0.1:{free_port(range(18554, 18654), socket.SOCK_STREAM)}"
    with tempfile.TemporaryDirectory() as folder:
        with Simulated(kestrel, [policy, "--video", video], folder) as vehicle, Client(vehicle) as client:
            return conclude(run_checks(checks_of(Watching(client))))


if __name__ == "__main__":
    sys.exit(main())
