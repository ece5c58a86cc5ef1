"""`torquectl view --foxglove`, read by an independent WebSocket client and other people's ROS 2 decoder."""

import json
import re
import struct
import sys
import time

import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from processes import BINARIES, CLIENT, LEG, Process, daemon
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

sys.path.insert(0, str(CLIENT))
import torqued  # noqa: E402

pytestmark = pytest.mark.real_time

HEAD = struct.Struct("<BIQ")


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TORQUED_RUN_DIR", str(tmp_path_factory.mktemp("run")))
        with daemon(LEG, "--simulate"), Process(BINARIES / "torquectl", "view", "--foxglove", "127.0.0.1:0") as viewer:
            yield viewer.wait_for(r"ws://127\.0\.0\.1:\d+")[0]


def opened(url, protocol="foxglove.websocket.v1", **more):
    return connect(url, subprotocols=[protocol], open_timeout=20, **more)


@pytest.mark.parametrize("protocol", ["foxglove.websocket.v1", "foxglove.sdk.v1"])
def test_a_client_reads_joint_states_and_wrenches_as_they_are_recorded(robot, protocol):
    client = torqued.Client("leg")
    with opened(robot, protocol) as socket:
        assert socket.subprotocol == protocol
        info, offered = (json.loads(socket.recv(timeout=20)) for _ in range(2))
        assert (info["op"], info["name"]) == ("serverInfo", "torqued: leg")
        channels = {channel["topic"]: channel for channel in offered["channels"]}
        assert {"/joint_states", "/imu"} < set(channels) and any(topic.startswith("/wrench/") for topic in channels)
        assert {channel["encoding"] for channel in channels.values()} == {"cdr"}
        topics = {7: "/joint_states", 9: next(topic for topic in channels if topic.startswith("/wrench/"))}
        wish = [{"id": number, "channelId": channels[topic]["id"]} for number, topic in topics.items()]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wish}))
        decoders = {}
        for number, topic in topics.items():
            of = channels[topic]
            schema = Schema(id=1, name=of["schemaName"], encoding=of["schemaEncoding"], data=of["schema"].encode())
            decoders[number] = DecoderFactory().decoder_for(of["encoding"], schema)
        found, seen = {7: [], 9: []}, {}
        while len(found[7]) < 300:
            data = socket.recv(timeout=20)
            kind, number, unix_ns = HEAD.unpack_from(data)
            assert kind == 1
            found[number].append((unix_ns, decoders[number](data[HEAD.size :])))
            while (record := client.latest()) is not None:
                seen[tuple(joint.q for joint in record.cycle.measured.joints[:6])] = record.cycle.sequence
        # A second, as the recordings' messages have it.
        assert abs(1e-9 * found[7][-1][0] - time.time()) < 5.0
        times = [unix_ns for unix_ns, _ in found[7]]
        assert times == sorted(times)
        message = found[7][0][1]
        assert message.name == list(client.joint_names)
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == found[7][0][0]
        same = [message for _, message in found[7] if tuple(message.position) in seen]
        assert len(same) > 20, "the positions are those of shared memory, to the last bit"
        assert len(found[9]) == pytest.approx(len(found[7]), abs=2)
        # Nothing more of what is no longer wanted.
        socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [7, 9]}))
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            try:
                socket.recv(timeout=0.5)
            except TimeoutError:
                break
        else:
            pytest.fail("messages without a subscription")


def test_pages_of_other_sites_and_other_protocols_are_refused(robot):
    with pytest.raises(InvalidStatus, match="403"):
        opened(robot, origin="https://example.com")
    with pytest.raises(InvalidStatus, match="400"):
        opened(robot, protocol="chat")
    with opened(robot, origin="https://app.foxglove.dev") as socket:
        assert json.loads(socket.recv(timeout=20))["op"] == "serverInfo"
        socket.send("no wish")
        socket.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 999}]}))
        assert json.loads(socket.recv(timeout=20))["op"] == "advertise"


def test_an_address_that_is_taken_is_refused(robot):
    address = re.sub("ws://", "", robot)
    viewer = Process(BINARIES / "torquectl", "view", "--foxglove", address)
    assert viewer.wait() == 2
    assert f"--foxglove {address}" in viewer.output()
