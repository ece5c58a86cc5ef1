"""A robot's torques as ROS 2 topics, without ROS: zenoh, as ROS's `rmw_zenoh_cpp` speaks it.

    python -m torqued.ros leg                                    # beside `ros2 run rmw_zenoh_cpp rmw_zenohd`
    python -m torqued.ros leg --urdf robot.urdf --rate 200
    python -m torqued.ros leg --control                          # and takes joint commands by the lease
    python -m torqued.ros leg --listen tcp/0.0.0.0:7447 --no-router

Topics, of the ROS domain `--domain`:

- `joint_states` (sensor_msgs/JointState): q, dq, and tau_hat as effort; NaN where it is not known.
- `ROBOT/joint_sigma` (sensor_msgs/JointState): the effort's standard deviation, as effort.
- `ROBOT/external_effort` (sensor_msgs/JointState): tau_ext, the torque of contacts, as effort.
- `ROBOT/ft/SENSOR` (geometry_msgs/WrenchStamped): what the part beyond a sensor applies, filtered.
- `diagnostics` (diagnostic_msgs/DiagnosticArray): state, fault, events, once a second.
- `robot_description` (std_msgs/String), kept for who comes later: the URDF of `--urdf`.
- `ROBOT/joint_command` (sensor_msgs/JointState), taken with `--control`: positions (mode position), else velocities
  (mode velocity) of the joints that it names, the others being held, else efforts (mode torque) of all joints. 0.2 s
  after the last velocities or efforts the robot holds; positions it goes on to.

A message's stamp is the time of its samples, to a millisecond: SYNC of the cycle, less a filter's delay. Ends with the daemon (exit code
1), at SIGINT or SIGTERM (0). Needs PyPI's eclipse-zenoh and rosbags (`pip install torqued[ros]`).
"""

import argparse
import math
import signal
import struct
import sys
import threading
import time
import uuid
from pathlib import Path

from . import Client, Commander, CommandLostError, NoDaemonError, NotFollowedError
from .commander import AlreadyCommandedError
from .layout import EVENTS, Mode, RobotState, TorqueFlags

try:
    import numpy as np
    import zenoh
    from rosbags.typesys import Stores, get_typestore
except ImportError as missing:
    sys.exit(f"torqued.ros: {missing.name} is missing; pip install torqued[ros]")

#: Longest time without a command of velocities or efforts, s.
COMMAND_TIMEOUT_S = 0.2
#: Interval of references while a command is followed, s.
SEND_S = 0.01
#: Interval of diagnostics, s.
DIAGNOSTICS_S = 1.0
STORE = get_typestore(Stores.ROS2_JAZZY)
LEVELS = {"ok": 0, "warn": 1, "error": 2}


def message(name):
    """The class of a ROS message."""
    return STORE.types[name]


Time, Header, String = (
    message(name) for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", "std_msgs/msg/String")
)
JointState, WrenchStamped = message("sensor_msgs/msg/JointState"), message("geometry_msgs/msg/WrenchStamped")
Wrench, Vector3 = message("geometry_msgs/msg/Wrench"), message("geometry_msgs/msg/Vector3")
DiagnosticArray = message("diagnostic_msgs/msg/DiagnosticArray")
DiagnosticStatus, KeyValue = message("diagnostic_msgs/msg/DiagnosticStatus"), message("diagnostic_msgs/msg/KeyValue")


def array(values):
    """Numbers of a message."""
    return np.fromiter(values, float)


def mangled(name):
    """A name as part of a key expression."""
    return name.replace("/", "%")


class Endpoint:
    """A topic of a node: its key, and the token by which other nodes find it (rmw_zenoh_cpp, docs/design.md)."""

    def __init__(self, node, kind, topic, type_name, qos):
        package, _, name = type_name.split("/")
        dds, hashed = f"{package}::msg::dds_::{name}_", STORE.hash_rihs01(type_name)
        self.key = f"{node.domain}/{topic}/{dds}/{hashed}"
        entity = node.next_entity()
        token = f"{node.prefix}/{entity}/{kind}/{node.suffix}/{mangled('/' + topic)}/{dds}/{hashed}/{qos}"
        self._token = node.session.liveliness().declare_token(token)


class Publisher(Endpoint):
    """A topic that this program publishes. `keeps`: the newest message is for those who come later, too."""

    def __init__(self, node, topic, type_name, keeps=False):
        # Reliable; durability only where it is not the default; the newest one or ten messages.
        super().__init__(node, "MP", topic, type_name, ":1:,1:,:,:,," if keeps else "::,10:,:,:,,")
        self._type, self._sequence, self._gid = type_name, 0, uuid.uuid4().bytes
        if keeps:
            cache = zenoh.ext.CacheConfig(max_samples=1)
            self._publisher = zenoh.ext.declare_advanced_publisher(
                node.session, self.key, cache=cache, publisher_detection=True
            )
        else:
            self._publisher = node.session.declare_publisher(self.key)

    def publish(self, value):
        self._sequence += 1
        # rmw_zenoh_cpp, attachment_helpers.cpp: number, time of sending, the publisher's identity with its length.
        attachment = struct.pack("<qqB", self._sequence, time.time_ns(), len(self._gid)) + self._gid
        data = bytes(STORE.serialize_cdr(value, self._type))
        self._publisher.put(data, encoding=zenoh.Encoding("application/cdr"), attachment=attachment)


class Node:
    """A node of ROS 2."""

    def __init__(self, session, domain, name):
        self.session, self.domain, self._entities = session, domain, 0
        self.prefix, self.suffix = f"@ros2_lv/{domain}/{session.info.zid()}/0", f"%/%/{mangled(name)}"
        self._token = session.liveliness().declare_token(f"{self.prefix}/0/NN/{self.suffix}")

    def next_entity(self):
        self._entities += 1
        return self._entities


class Clock:
    """The loop's clock by ROS's: their least difference as records came, of the last 5 to 10 s. What the fastest
    record took on its way, some 0.1 ms, is in it."""

    SPAN_S = 5.0

    def __init__(self):
        self._least, self._before, self._began = math.inf, math.inf, time.monotonic()

    def note(self, stamp_ns):
        """A record with this stamp has just come."""
        if time.monotonic() > self._began + self.SPAN_S:
            self._least, self._before, self._began = math.inf, self._least, time.monotonic()
        self._least = min(self._least, time.time_ns() - stamp_ns)

    def at(self, stamp_ns, before_s=0.0):
        """ROS's time of so long before a stamp."""
        now_ns = stamp_ns + min(self._least, self._before) - round(1e9 * before_s)
        return Time(sec=now_ns // 10**9, nanosec=now_ns % 10**9)


def torque(estimate):
    """A torque, or NaN where it is not valid."""
    return estimate.tau if estimate.flags & TorqueFlags.VALID else math.nan


class Topics:
    """What is published of a robot."""

    def __init__(self, node, client, urdf):
        self._client, self._clock, robot = client, Clock(), client.robot
        joints = "sensor_msgs/msg/JointState"
        self._states = Publisher(node, "joint_states", joints)
        self._sigma = Publisher(node, f"{robot}/joint_sigma", joints)
        self._external = Publisher(node, f"{robot}/external_effort", joints)
        self._ft = [
            Publisher(node, f"{robot}/ft/{name}", "geometry_msgs/msg/WrenchStamped") for name in client.ft_names
        ]
        self._diagnostics = Publisher(node, "diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        self._diagnosed = 0.0
        if urdf is not None:
            self._description = Publisher(node, "robot_description", "std_msgs/msg/String", keeps=True)
            self._description.publish(String(data=urdf))

    def _header(self, record, delay_s=0.0, frame=""):
        """`delay_s`: age of the samples at SYNC."""
        gather_s = 1e-9 * record.timing.gather_ns
        return Header(stamp=self._clock.at(record.cycle.stamp_ns, gather_s + delay_s), frame_id=frame)

    def _joints(self, record, position=(), velocity=(), effort=()):
        return JointState(
            header=self._header(record),
            name=self._client.joint_names,
            position=array(position),
            velocity=array(velocity),
            effort=array(effort),
        )

    def publish(self, record):
        """Publishes a record."""
        cycle = record.cycle
        self._clock.note(cycle.stamp_ns)
        measured, estimated = cycle.measured.joints[: cycle.joint_count], cycle.estimated.joints[: cycle.joint_count]
        self._states.publish(
            self._joints(
                record, (j.q for j in measured), (j.dq for j in measured), (torque(j.tau_hat) for j in estimated)
            )
        )
        self._sigma.publish(self._joints(record, effort=(j.tau_hat.sigma for j in estimated)))
        self._external.publish(self._joints(record, effort=(j.tau_ext for j in estimated)))
        for name, publisher, ft in zip(self._client.ft_names, self._ft, cycle.measured.ft):
            force, moment = ft.wrench_hat.force, ft.wrench_hat.torque
            wrench = Wrench(force=Vector3(*force), torque=Vector3(*moment))
            header = self._header(record, cycle.measured.filter_delay_s, name)
            publisher.publish(WrenchStamped(header=header, wrench=wrench))
        if time.monotonic() >= self._diagnosed + DIAGNOSTICS_S:
            self._diagnosed = time.monotonic()
            self._diagnostics.publish(self._diagnosis(record))

    def _diagnosis(self, record):
        cycle = record.cycle
        fault = next((event for event in EVENTS if event.number == cycle.fault), None)
        counts = [(event.name, str(count)) for event, count in zip(EVENTS, cycle.events) if count]
        values = [("state", RobotState(cycle.state).name.lower()), ("late_cycles", str(record.timing.late_cycles)), *counts]
        status = DiagnosticStatus(
            level=LEVELS["error"] if cycle.fault else LEVELS["warn"] if counts else LEVELS["ok"],
            name=f"torqued: {self._client.robot}",
            message=f"{fault.number} {fault.name}: {fault.cause}" if fault else "no fault",
            hardware_id=self._client.robot,
            values=[KeyValue(key=key, value=value) for key, value in values],
        )
        return DiagnosticArray(header=self._header(record), status=[status])


class Commands(Endpoint):
    """Joint commands of other nodes, followed by the lease of this program."""

    def __init__(self, node, client):
        super().__init__(node, "MS", f"{client.robot}/joint_command", "sensor_msgs/msg/JointState", "::,10:,:,:,,")
        self._client, self._names = client, client.joint_names
        self._newest, self._taken, self._said = None, None, ""
        self._new, self._ended = threading.Event(), threading.Event()
        self._subscriber = node.session.declare_subscriber(self.key, self._take)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def end(self):
        self._ended.set()
        self._new.set()
        self._thread.join()

    def _take(self, sample):
        command = STORE.deserialize_cdr(bytes(sample.payload), "sensor_msgs/msg/JointState")
        self._newest = time.monotonic(), command
        self._new.set()

    def _say(self, text):
        if text and text != self._said:
            print(f"torqued.ros: {text}", file=sys.stderr, flush=True)
        self._said = text

    def _asked(self, command):
        """Mode and values by joint; a message where the command cannot be meant."""
        unknown = set(command.name) - set(self._names)
        if unknown:
            raise ValueError(f"joint_command: no joint {', '.join(sorted(unknown))}; allowed: {', '.join(self._names)}")
        kinds = ((Mode.POSITION, command.position), (Mode.VELOCITY, command.velocity), (Mode.TORQUE, command.effort))
        mode, values = next(((mode, values) for mode, values in kinds if len(values)), (None, ()))
        if mode is None or len(values) != len(command.name) or not all(map(math.isfinite, values)):
            raise ValueError("joint_command: allowed: a finite position, velocity or effort for each name")
        # In mode torque nothing holds a joint that nobody named.
        missing = set(self._names) - set(command.name)
        if mode == Mode.TORQUE and missing:
            raise ValueError(f"joint_command: efforts without joint {', '.join(sorted(missing))}; allowed: all joints")
        return mode, dict(zip(command.name, values))

    def _run(self):
        while not self._ended.is_set():
            self._new.wait()
            if self._ended.is_set():
                return
            self._new.clear()
            try:
                self._asked(self._newest[1])
                with Commander(self._client) as commander:
                    commander.hold_until_ready(5.0)
                    self._follow(commander)
                self._say("")
            except (ValueError, NoDaemonError, NotFollowedError, CommandLostError, AlreadyCommandedError) as error:
                self._say(str(error))

    def _follow(self, commander):
        """Follows commands until none has come for a while; then the lease is given back, and the robot holds."""
        reference = commander.reference
        hold = [joint.q_d for joint in reference.joints]
        current, sent, sent_at = None, None, 0.0
        while not self._ended.is_set():
            came, command = self._newest
            mode, values = self._asked(command)
            if mode == Mode.POSITION:
                # The lease may have taken longer than a command's time: positions count until they were sent.
                shown = command is sent and time.monotonic() - sent_at > COMMAND_TIMEOUT_S
                over = shown and commander.status.commander.motion_left_s <= 0.0
            else:
                over = time.monotonic() - came > COMMAND_TIMEOUT_S
            if over:
                self._new.clear()
                return
            for name, joint, q in zip(self._names, reference.joints, hold):
                if mode == Mode.POSITION:
                    joint.q_d, joint.dq_d = values.get(name, joint.q_d if current == mode else q), 0.0
                elif mode == Mode.VELOCITY:
                    joint.dq_d = values.get(name, 0.0)
                else:
                    joint.tau_d = values[name]
            reference.mode = current = mode
            commander.send()
            if command is not sent:
                sent, sent_at = command, time.monotonic()
            time.sleep(SEND_S)


def session(arguments):
    """A session as rmw_zenoh_cpp's: a peer of the router, without multicast."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    connect = [] if arguments.no_router else [arguments.router]
    config.insert_json5("connect/endpoints", str(connect).replace("'", '"'))
    config.insert_json5("listen/endpoints", f'["{arguments.listen}"]')
    # A history for those who come later needs times.
    config.insert_json5("timestamping/enabled", "true")
    return zenoh.open(config)


def parse(arguments):
    parser = argparse.ArgumentParser(
        prog="python -m torqued.ros", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("robot", help="name of the robot that torqued runs")
    parser.add_argument("--domain", type=int, default=0, help="ROS_DOMAIN_ID [default: 0]")
    parser.add_argument("--rate", type=float, default=100.0, help="messages a second, Hz, 1 to 1000 [default: 100]")
    parser.add_argument("--urdf", type=Path, help="publish this file as robot_description")
    parser.add_argument("--control", action="store_true", help="follow ROBOT/joint_command")
    parser.add_argument("--router", default="tcp/127.0.0.1:7447", help="zenoh router [default: %(default)s]")
    parser.add_argument("--no-router", action="store_true", help="connect to no router")
    parser.add_argument("--listen", default="tcp/127.0.0.1:0", help="endpoint to listen at [default: %(default)s]")
    result = parser.parse_args(arguments)
    if not 1.0 <= result.rate <= 1000.0:
        parser.error(f"--rate is {result.rate}; allowed: 1 to 1000")
    if not 0 <= result.domain <= 232:
        parser.error(f"--domain is {result.domain}; allowed: 0 to 232")
    return result


def main(arguments=None):
    """Publishes until the daemon ends; the exit code."""
    arguments = parse(arguments)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    try:
        client = Client(arguments.robot)
        urdf = arguments.urdf.read_text() if arguments.urdf else None
    except (NoDaemonError, OSError) as error:
        print(f"torqued.ros: {error}", file=sys.stderr)
        return 1
    with session(arguments) as opened:
        node = Node(opened, arguments.domain, f"torqued_{arguments.robot}")
        topics = Topics(node, client, urdf)
        commands = Commands(node, Client(arguments.robot)) if arguments.control else None
        print(f"publishing {arguments.robot} at {arguments.rate:g} Hz, domain {arguments.domain}", flush=True)
        due = time.monotonic()
        try:
            while not ended.is_set():
                topics.publish(client.latest() or client.next_record())
                due = max(due + 1.0 / arguments.rate, time.monotonic())
                ended.wait(due - time.monotonic())
        except NoDaemonError as error:
            print(f"torqued.ros: {error}", file=sys.stderr)
            return 1
        finally:
            if commands is not None:
                commands.end()
    return 0


if __name__ == "__main__":
    sys.exit(main())
