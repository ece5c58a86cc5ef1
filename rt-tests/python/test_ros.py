"""A simulated leg as ROS 2 topics, read and commanded by another client of rmw_zenoh's wire: `zenoh-ros2-sdk`."""

import math
import socket
import sys
import time

import numpy as np
import pytest
from processes import BINARIES, CLIENT, ROOT, Process, forget_faults
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
from zenoh_ros2_sdk.qos import QosDurability, QosProfile

sys.path.insert(0, str(CLIENT))

import torqued  # noqa: E402

pytestmark = pytest.mark.real_time

LEG = ROOT / "config" / "leg" / "robot.toml"
URDF = ROOT / "robot-models" / "leg" / "robot.urdf"
TIME = "int32 sec\nuint32 nanosec\n"
HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
BREAK = "=" * 80 + "\n"
WITH_HEADER = f"{BREAK}MSG: std_msgs/Header\n{HEADER}{BREAK}MSG: builtin_interfaces/Time\n{TIME}"
JOINT_STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
JOINT_TYPE = "sensor_msgs/msg/JointState"
#: Of the ROS 2 distributions; not computed by the library that torqued.ros uses.
JOINT_HASH = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="module")
def bridge():
    """Daemon and topics; the bridge listens where the other client looks for a router."""
    port = free_port()
    forget_faults()
    with Process(BINARIES / "torqued", "run", LEG, "--simulate", "--json") as daemon:
        daemon.wait_for("running")
        listen = ("--no-router", "--listen", f"tcp/127.0.0.1:{port}")
        options = ("--rate", "200", "--control", "--urdf", URDF, *listen)
        with Process(sys.executable, "-m", "torqued.ros", "leg", *options) as topics:
            topics.wait_for("publishing")
            yield port, topics


def heard(port, topic, type_name, definition, type_hash, seconds=1.5, **options):
    """Messages of a topic, with the time at which each came."""
    messages = []
    subscriber = ROS2Subscriber(
        topic, type_name, lambda message: messages.append((time.time(), message)), msg_definition=definition,
        domain_id=0, router_port=port, type_hash=type_hash, **options,
    )  # fmt: skip
    time.sleep(seconds)
    subscriber.close()
    return messages


def test_joint_states_are_the_daemons(bridge):
    port, _ = bridge
    messages = heard(port, "/joint_states", JOINT_TYPE, JOINT_STATE + WITH_HEADER, JOINT_HASH)
    client = torqued.Client("leg", timeout_s=10.0)
    joints = client.next_record(5.0).cycle
    assert len(messages) > 50
    came, last = messages[-1]
    assert list(last.name) == client.joint_names
    for k in range(joints.joint_count):
        assert abs(last.position[k] - joints.measured.joints[k].q) < 1e-3
        estimate = joints.estimated.joints[k].tau_hat
        assert abs(last.effort[k] - estimate.tau) < 5 * estimate.sigma + 0.5
    stamps = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec for _, message in messages]
    assert all(b > a for a, b in zip(stamps, stamps[1:]))
    # The time of its SYNC by ROS's clock, not that of its sending.
    ages = sorted(came - stamp for (came, _), stamp in zip(messages, stamps))
    assert ages[0] > 0.0 and ages[len(ages) // 2] < 0.05, ages


def test_the_description_waits_for_who_comes_later(bridge):
    port, _ = bridge
    kept = QosProfile(durability=QosDurability.TRANSIENT_LOCAL)
    messages = heard(port, "/robot_description", "std_msgs/msg/String", "string data\n", STRING_HASH, qos=kept)
    assert messages and messages[0][1].data == URDF.read_text()


def test_a_command_moves_the_joint_that_it_names_and_no_other(bridge):
    port, topics = bridge
    client = torqued.Client("leg", timeout_s=10.0)
    names = client.joint_names
    before = [joint.q for joint in client.next_record(5.0).cycle.measured.joints[: len(names)]]
    target = before[0] + math.radians(5.0)
    definition = JOINT_STATE + WITH_HEADER
    publisher = ROS2Publisher(
        "/leg/joint_command", JOINT_TYPE, msg_definition=definition, domain_id=0, router_port=port, type_hash=JOINT_HASH
    )
    header = publisher.session_mgr.store.types["std_msgs/msg/Header"]
    stamp = publisher.session_mgr.store.types["builtin_interfaces/msg/Time"]

    def send(name, value, quantity="position"):
        values = {key: np.array([value] if key == quantity else []) for key in ("position", "velocity", "effort")}
        publisher.publish(header=header(stamp=stamp(sec=0, nanosec=0), frame_id=""), name=[name], **values)

    until = time.monotonic() + 30.0
    send(names[0], target)
    while abs(client.next_record(5.0).cycle.measured.joints[0].q - target) > 2e-3:
        assert time.monotonic() < until, topics.output()
        client.latest()
        time.sleep(0.02)
    after = [joint.q for joint in client.next_record(5.0).cycle.measured.joints[: len(names)]]
    assert all(abs(a - b) < 5e-3 for a, b in zip(after[1:], before[1:]))
    # Velocities count for 0.2 s: then the robot holds, and the joint has gone on by about that time's way.
    for _ in range(25):
        send(names[0], -0.1, "velocity")
        time.sleep(0.02)
    time.sleep(1.5)
    rest = [client.latest() or client.next_record(5.0), client.next_record(5.0)][-1].cycle
    way = target - rest.measured.joints[0].q
    assert rest.state == torqued.RobotState.HOLDING and 0.01 < way < 0.12, (rest.state, way)
    target -= way
    send(names[0], 1.0, "effort")
    topics.wait_for("efforts without joint")
    # Arrived, it gives the lease back and holds; what cannot be meant is said, and moves nothing.
    send("no_such_joint", 1.0)
    topics.wait_for("no joint no_such_joint")
    publisher.close()
    assert abs(client.next_record(5.0).cycle.measured.joints[0].q - target) < 5e-3


def test_arguments_and_a_missing_daemon_are_named():
    for arguments, code, said in (
        (("nobody",), 1, "nobody"),
        (("leg", "--rate", "5000"), 2, "allowed: 1 to 1000"),
        (("leg", "--domain", "900"), 2, "allowed: 0 to 232"),
    ):
        with Process(sys.executable, "-m", "torqued.ros", *arguments) as process:
            assert process.wait(20.0) == code
            assert said in process.output()
