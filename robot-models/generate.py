"""Write robot.urdf and drives.dbc of every robot in this folder.

Usage: python generate.py [FOLDER]      (default: the folder of this script)

The numbers below are the source; where each comes from is written in <robot>/SOURCES.md.
Axes: x forward, y left, z up. Every frame is parallel to the base's when all joints are at zero.
"""

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


# --- bodies -------------------------------------------------------------------------------------

@dataclass(frozen=True)
class Solid:
    """A homogeneous solid, axis-aligned, its centre at `xyz` (m) in the link's frame."""

    kind: str  # box: size x, y, z; cylinder: radius, length along z; cylinder_y: along y; sphere: radius
    size: tuple
    xyz: tuple
    mass: float

    def inertia(self):
        """Principal moments about the centre, kg·m2."""
        m, s = self.mass, self.size
        if self.kind == "box":
            x, y, z = (side * side for side in s)
            return m * (y + z) / 12, m * (x + z) / 12, m * (x + y) / 12
        if self.kind == "sphere":
            return (0.4 * m * s[0] ** 2,) * 3
        along, across = m * s[0] ** 2 / 2, m * (3 * s[0] ** 2 + s[1] ** 2) / 12
        return (across, along, across) if self.kind == "cylinder_y" else (across, across, along)


def composite(solids):
    """Mass, centre of mass and inertia (xx xy xz yy yz zz) about it, of several solids."""
    mass = sum(s.mass for s in solids)
    com = [sum(s.mass * s.xyz[k] for s in solids) / mass for k in range(3)]
    tensor = [[0.0] * 3 for _ in range(3)]
    for s in solids:
        r = [s.xyz[k] - com[k] for k in range(3)]
        square = sum(c * c for c in r)
        for i in range(3):
            for j in range(3):
                tensor[i][j] -= s.mass * r[i] * r[j]
            tensor[i][i] += s.inertia()[i] + s.mass * square
    return mass, com, [tensor[i][j] for i in range(3) for j in range(i, 3)]


@dataclass(frozen=True)
class Joint:
    """A joint and the link that it carries; without an axis the link is fixed.

    Its range is in degrees, of a joint that slides along its axis in mm.
    """

    name: str
    parent: str
    xyz: tuple
    axis: tuple = None
    range_deg: tuple = None
    drive: str = None
    solids: tuple = ()
    link: str = None  # default: the joint's name with _link, or the name itself when fixed
    slides: bool = False
    mimic: str = None  # the joint that it follows, one to one

    @property
    def child(self):
        return self.link or (f"{self.name}_link" if self.axis else self.name)


# Joint limits that follow from the gear: repeated peak torque (N·m) and a speed below its limit (rad/s).
DRIVES = {
    "shd14_100": (19.0, 6.0),
    "shd17_100": (37.0, 6.0),
    "shd20_100": (57.0, 5.0),
    "shd25_100": (110.0, 4.5),
    "shd32_100": (233.0, 4.0),
    # Screws of 5 and 2 mm: force (N), speed (m/s).
    "screw_5": (600.0, 0.25),
    "screw_2": (100.0, 0.1),
}


def number(value):
    return f"{value + 0.0:.9g}"


def numbers(values):
    return " ".join(number(v) for v in values)


def link_xml(name, solids):
    if not solids:
        return [f'  <link name="{name}"/>']
    mass, com, tensor = composite(solids)
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    moments = " ".join(f'{k}="{number(round(v, 12))}"' for k, v in zip(keys, tensor))
    lines = [
        f'  <link name="{name}">',
        "    <inertial>",
        f'      <origin xyz="{numbers(com)}" rpy="0 0 0"/>',
        f'      <mass value="{number(mass)}"/>',
        f"      <inertia {moments}/>",
        "    </inertial>",
    ]
    for s in solids:
        turn = f"{math.pi / 2:.9f} 0 0" if s.kind == "cylinder_y" else "0 0 0"
        shape = {
            "box": lambda: f'<box size="{numbers(s.size)}"/>',
            "sphere": lambda: f'<sphere radius="{number(s.size[0])}"/>',
        }.get(s.kind, lambda: f'<cylinder radius="{number(s.size[0])}" length="{number(s.size[1])}"/>')()
        lines += [
            "    <visual>",
            f'      <origin xyz="{numbers(s.xyz)}" rpy="{turn}"/>',
            f"      <geometry>{shape}</geometry>",
            "    </visual>",
        ]
    return lines + ["  </link>"]


def joint_xml(joint):
    kind = ("prismatic" if joint.slides else "revolute") if joint.axis else "fixed"
    name = joint.name if joint.axis else f"{joint.name}_mount"
    lines = [
        f'  <joint name="{name}" type="{kind}">',
        f'    <parent link="{joint.parent}"/>',
        f'    <child link="{joint.child}"/>',
        f'    <origin xyz="{numbers(joint.xyz)}" rpy="0 0 0"/>',
    ]
    if joint.axis:
        lower, upper = (1e-3 * v if joint.slides else math.radians(v) for v in joint.range_deg)
        effort, velocity = DRIVES[joint.drive]
        lines += [
            f'    <axis xyz="{numbers(joint.axis)}"/>',
            f'    <limit lower="{number(lower)}" upper="{number(upper)}"'
            f' effort="{number(effort)}" velocity="{number(velocity)}"/>',
        ]
    if joint.mimic:
        lines.append(f'    <mimic joint="{joint.mimic}" multiplier="1" offset="0"/>')
    return lines + ["  </joint>"]


def urdf(robot):
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Written by generate.py; sources of the numbers: SOURCES.md. Lengths m, masses kg, angles rad. -->",
        f'<robot name="{robot.name}">',
        *link_xml("base_link", robot.base),
    ]
    for joint in robot.joints:
        lines += joint_xml(joint) + link_xml(joint.child, joint.solids)
    return "\n".join(lines + ["</robot>", ""])


# --- frames -------------------------------------------------------------------------------------

@dataclass
class Message:
    """One frame of the DBC: `signals` are lines made by `intel` or `motorola`."""

    id: int
    name: str
    size: int
    sender: str
    comment: str
    signals: list = field(default_factory=list)


def signal(name, start, bits, order, sign, scale, unit, receiver):
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if sign == "-" else (0, (1 << bits) - 1)
    bounds = f"[{number(low * scale)}|{number(high * scale)}]"
    return f' SG_ {name} : {start}|{bits}@{order}{sign} ({number(scale)},0) {bounds} "{unit}" {receiver}'


def intel(name, start, bits, sign, scale, unit, receiver="TORQUED"):
    return signal(name, start, bits, 1, sign, scale, unit, receiver)


def motorola(name, byte, scale, unit):
    """A signed 16-bit big-endian signal that starts at `byte`, as F/T sensors and IMUs send them."""
    return signal(name, 8 * byte + 7, 16, 0, "-", scale, unit, "TORQUED")


def state(can_id, joint, fd, link="link_angle"):
    message = Message(can_id, f"{joint.upper()}_STATE", 12 if fd else 8, "DRIVES", "Answer to SYNC, sampled at SYNC.")
    message.signals.append(intel(link, 0, 19, "+", 1, "count"))
    if fd:
        message.signals += [
            intel("motor_angle", 24, 24, "+", 1, "count"),
            intel("current", 48, 16, "-", 1, "mA"),
            intel("velocity", 64, 16, "-", 1, "rpm"),
            intel("status", 80, 16, "+", 1, ""),
        ]
    else:
        message.signals += [
            intel("motor_angle", 19, 16, "+", 1, "count"),
            intel("current", 35, 16, "-", 1, "mA"),
            intel("status", 51, 13, "+", 1, ""),
        ]
    return message


def state_of_motor(can_id, joint):
    """Answer of a drive whose encoder is on the motor: it counts turns."""
    message = Message(can_id, f"{joint.upper()}_STATE", 8, "DRIVES", "Answer to SYNC, sampled at SYNC.")
    message.signals = [
        intel("motor_angle", 0, 24, "-", 1, "count"),
        intel("current", 24, 16, "-", 1, "mA"),
        intel("status", 40, 13, "+", 1, ""),
    ]
    return message


def command(can_id, name, joints, size, bits, scale):
    """Set-points of several drives in one frame: each drive takes its own signal."""
    message = Message(can_id, name, size, "TORQUED", "Position set-points, link side, taken on reception.")
    for k, joint in enumerate(joints):
        message.signals.append(intel(f"{joint}_position", k * bits, bits, "-", scale, "rad", "DRIVES"))
    return message


def control(can_id, name, joints):
    """Control words (CiA 402, low byte) of several drives in one frame."""
    size = next(s for s in (*range(1, 9), 12) if s >= len(joints))
    message = Message(can_id, name, size, "TORQUED", "Control words, taken on reception.")
    for k, joint in enumerate(joints):
        message.signals.append(intel(f"{joint}_control", 8 * k, 8, "+", 1, "", "DRIVES"))
    return message


def triple(can_id, name, axes, scale, unit):
    message = Message(can_id, name, 6, "SENSORS", "Answer to SYNC.")
    message.signals = [motorola(axis, 2 * k, scale, unit) for k, axis in enumerate(axes)]
    return message


def sextuple(can_id, name, axes, scales, units):
    message = Message(can_id, name, 12, "SENSORS", "Answer to SYNC.")
    message.signals = [motorola(a, 2 * k, scales[k // 3], units[k // 3]) for k, a in enumerate(axes)]
    return message


STATUS = ("Bits 0 to 7: status word of CiA 402. Bits 8 to 12: last error, 0 none, 1 over-current, "
          "2 over-temperature, 3 encoder, 5 no set-point in time.")
WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
IMU = ("gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z")
FRAME_FORMATS = ["StandardCAN", "ExtendedCAN", *["reserved"] * 12, "StandardCAN_FD", "ExtendedCAN_FD"]


def dbc(messages, fd):
    sync = Message(0x80, "SYNC", 0, "TORQUED", "Starts a cycle: drives and sensors sample and answer.")
    messages = [sync, *messages]
    lines = ['VERSION "1"', "", "NS_ :", "", "BS_:", "", "BU_: TORQUED DRIVES SENSORS"]
    for m in messages:
        lines += ["", f"BO_ {m.id} {m.name}: {m.size} {m.sender}", *m.signals]
    lines += [""] + [f'CM_ BO_ {m.id} "{m.comment}";' for m in messages]
    if fd:
        formats = ",".join(f'"{f}"' for f in FRAME_FORMATS)
        lines += [f'BA_DEF_ BO_ "VFrameFormat" ENUM {formats};', 'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";']
        lines += [f'BA_ "VFrameFormat" BO_ {m.id} 14;' for m in messages if m is not sync]
    lines += [f'CM_ SG_ {m.id} status "{STATUS}";' for m in messages if m.name.endswith("_STATE")]
    return "\n".join(lines + [""])


# --- robots -------------------------------------------------------------------------------------

@dataclass(frozen=True)
class Robot:
    name: str
    base: tuple
    joints: tuple
    messages: tuple
    fd: bool = False


def test_joint():
    joints = (
        Joint("joint", "base_link", (0, 0, 0), Y, (-180, 180), "shd17_100",
              (Solid("box", (0.45, 0.04, 0.04), (0.225, 0, 0), 0.641),), "link"),
        Joint("tip_load", "link", (0.45, 0, 0), solids=(
            Solid("cylinder_y", (0.04, 0.08), (0, 0, 0), 1.2),
            Solid("box", (0.45, 0.04, 0.04), (0.225, 0, 0), 0.641))),
    )
    base = (Solid("cylinder_y", (0.04, 0.08), (0, -0.06, 0), 1.2),)
    messages = (state(0x101, "joint", False), control(0x1f1, "CONTROL", ["joint"]),
                command(0x201, "COMMAND", ["joint"], 4, 32, 1e-7))
    return Robot("test-joint", base, joints, messages)


def leg_chain(prefix, side, parent, hip):
    """Six joints and the foot; `side` is 1 left, -1 right, 0 for a leg on its own."""
    p, roll = prefix, (-20, 35) if side >= 0 else (-35, 20)
    yaw = (-30, 45) if side >= 0 else (-45, 30)
    y = 0.035 * side
    return (
        Joint(f"{p}hip_yaw", parent, hip, Z, yaw, "shd20_100",
              (Solid("cylinder", (0.05, 0.08), (0, 0, 0.05), 1.4),)),
        Joint(f"{p}hip_roll", f"{p}hip_yaw_link", (0, 0, 0), X, roll, "shd32_100",
              (Solid("box", (0.10, 0.08, 0.09), (0, 0, 0), 1.2),)),
        Joint(f"{p}hip_pitch", f"{p}hip_roll_link", (0, y, 0), Y, (-125, 42), "shd25_100",
              (Solid("cylinder_y", (0.05, 0.10), (0, 0, 0), 1.2),
               Solid("box", (0.10, 0.09, 0.24), (0.01, 0, -0.16), 3.0))),
        Joint(f"{p}knee", f"{p}hip_pitch_link", (0, 0, -0.3), Y, (0, 150), "shd32_100",
              (Solid("cylinder_y", (0.045, 0.09), (0, 0, 0), 0.8),
               Solid("box", (0.08, 0.08, 0.22), (-0.01, 0, -0.15), 1.8))),
        Joint(f"{p}ankle_pitch", f"{p}knee_link", (0, 0, -0.3), Y, (-75, 42), "shd25_100",
              (Solid("box", (0.07, 0.06, 0.06), (0, 0, 0), 0.7),)),
        Joint(f"{p}ankle_roll", f"{p}ankle_pitch_link", (0, 0, 0), X, roll, "shd20_100",
              (Solid("box", (0.08, 0.08, 0.04), (0, 0, -0.03), 0.6),)),
        Joint(f"{p}ankle_ft", f"{p}ankle_roll_link", (0, 0, -0.05)),
        Joint(f"{p}foot", f"{p}ankle_ft", (0, 0, 0), solids=(
            Solid("box", (0.08, 0.08, 0.025), (0, 0, -0.0125), 0.4),
            Solid("box", (0.24, 0.14, 0.03), (0.02, 0, -0.04), 0.8))),
    )


def arm_chain(prefix, side):
    p = prefix
    roll = (-10, 95) if side > 0 else (-95, 10)
    return (
        Joint(f"{p}shoulder_pitch", "chest_pitch_link", (0, 0.25 * side, 0.18), Y, (-180, 60), "shd20_100",
              (Solid("cylinder_y", (0.05, 0.09), (0, -0.04 * side, 0), 0.9),)),
        Joint(f"{p}shoulder_roll", f"{p}shoulder_pitch_link", (0, 0, 0), X, roll, "shd20_100",
              (Solid("box", (0.08, 0.08, 0.08), (0, 0, 0), 0.6),)),
        Joint(f"{p}shoulder_yaw", f"{p}shoulder_roll_link", (0, 0, 0), Z, (-92, 92), "shd17_100",
              (Solid("cylinder", (0.045, 0.20), (0, 0, -0.14), 1.3),)),
        Joint(f"{p}elbow", f"{p}shoulder_yaw_link", (0, 0, -0.25), Y, (-135, 2), "shd17_100",
              (Solid("cylinder_y", (0.04, 0.08), (0, 0, 0), 0.5),
               Solid("box", (0.06, 0.06, 0.10), (0, 0, -0.08), 0.3))),
        Joint(f"{p}wrist_yaw", f"{p}elbow_link", (0, 0, -0.13), Z, (-92, 92), "shd14_100",
              (Solid("cylinder", (0.035, 0.11), (0, 0, -0.055), 0.4),)),
        Joint(f"{p}wrist_pitch", f"{p}wrist_yaw_link", (0, 0, -0.12), Y, (-92, 92), "shd14_100",
              (Solid("box", (0.05, 0.05, 0.05), (0, 0, 0), 0.25),)),
        Joint(f"{p}wrist_roll", f"{p}wrist_pitch_link", (0, 0, 0), X, (-45, 45), "shd14_100",
              (Solid("box", (0.05, 0.06, 0.03), (0, 0, -0.02), 0.25),)),
        Joint(f"{p}wrist_ft", f"{p}wrist_roll_link", (0, 0, -0.04)),
        Joint(f"{p}hand", f"{p}wrist_ft", (0, 0, 0), solids=(
            Solid("box", (0.08, 0.03, 0.15), (0, 0, -0.075), 0.5),)),
    )


def names(joints):
    return [j.name for j in joints if j.axis and not j.mimic]


def leg():
    joints = leg_chain("", 0, "base_link", (0, 0, 0))
    base = (Solid("box", (0.16, 0.14, 0.04), (0, 0, 0.12), 3.0),)
    order = names(joints)
    messages = [state(0x101 + k, name, False) for k, name in enumerate(order)]
    messages += [
        triple(0x181, "ANKLE_FT_F", WRENCH[:3], 0.05, "N"),
        triple(0x182, "ANKLE_FT_T", WRENCH[3:], 0.003, "Nm"),
        control(0x1f1, "CONTROL_A", order[:3]),
        control(0x1f2, "CONTROL_B", order[3:]),
        command(0x201, "COMMAND_A", order[:3], 8, 21, 3e-6),
        command(0x202, "COMMAND_B", order[3:], 8, 21, 3e-6),
    ]
    return Robot("leg", base, joints, tuple(messages))


def hrp2_like():
    """The leg below a torso with an IMU, its encoders on the motors."""
    joints = (*leg_chain("", 0, "base_link", (0, 0, 0)), Joint("imu_link", "base_link", (-0.03, 0, 0.35)))
    base = (Solid("box", (0.16, 0.14, 0.04), (0, 0, 0.12), 3.0), Solid("box", (0.22, 0.32, 0.40), (-0.02, 0, 0.34), 17.0))
    order = names(joints)
    messages = [state_of_motor(0x101 + k, name) for k, name in enumerate(order)]
    messages += [
        triple(0x181, "ANKLE_FT_F", WRENCH[:3], 0.05, "N"),
        triple(0x182, "ANKLE_FT_T", WRENCH[3:], 0.003, "Nm"),
        triple(0x191, "IMU_GYRO", IMU[:3], 0.0005, "rad/s"),
        triple(0x192, "IMU_ACC", IMU[3:], 0.003, "m/s2"),
        control(0x1f1, "CONTROL_A", order[:3]),
        control(0x1f2, "CONTROL_B", order[3:]),
        command(0x201, "COMMAND_A", order[:3], 8, 21, 3e-6),
        command(0x202, "COMMAND_B", order[3:], 8, 21, 3e-6),
    ]
    return Robot("hrp2-like", base, joints, tuple(messages))


def humanoid():
    base = (
        Solid("box", (0.20, 0.20, 0.14), (-0.01, 0, 0.10), 4.5),
        Solid("box", (0.16, 0.16, 0.14), (-0.01, 0, 0.24), 2.0),
    )
    legs = [leg_chain(f"{n}_", s, "base_link", (0, 0.06 * s, 0)) for n, s in (("left", 1), ("right", -1))]
    trunk = (
        Joint("chest_yaw", "base_link", (0, 0, 0.35), Z, (-45, 45), "shd25_100",
              (Solid("cylinder", (0.06, 0.06), (0, 0, -0.01), 1.5),)),
        Joint("chest_pitch", "chest_yaw_link", (0, 0, 0), Y, (-5, 60), "shd25_100",
              (Solid("box", (0.20, 0.32, 0.26), (0, 0, 0.13), 9.0),
               Solid("box", (0.12, 0.28, 0.30), (-0.16, 0, 0.12), 5.0))),
        Joint("imu_link", "chest_pitch_link", (-0.03, 0, 0.10)),
        Joint("head_yaw", "chest_pitch_link", (0, 0, 0.30), Z, (-45, 45), "shd14_100",
              (Solid("cylinder", (0.03, 0.08), (0, 0, -0.015), 0.5),)),
        Joint("head_pitch", "head_yaw_link", (0, 0, 0), Y, (-30, 45), "shd14_100",
              (Solid("box", (0.18, 0.15, 0.16), (0.02, 0, 0.105), 1.7),)),
    )
    arms = [arm_chain("left_", 1), arm_chain("right_", -1)]
    left_leg, right_leg = (names(chain) for chain in legs)
    left_arm, right_arm = (names(chain) for chain in arms)
    buses = (
        left_leg + ["chest_yaw", "chest_pitch"],
        right_leg,
        left_arm + ["head_yaw", "head_pitch"],
        right_arm,
    )
    foot, hand = ((0.05, 0.003), (0.01, 0.0005)), ((0.01, 0.0005),)
    messages = []
    for b, joints in enumerate(buses):
        messages += [state(0x101 + 0x10 * b + k, name, True) for k, name in enumerate(joints)]
    for k, (name, scales) in enumerate((("LEFT_ANKLE", foot[0]), ("RIGHT_ANKLE", foot[0]),
                                        ("LEFT_WRIST", hand[0]), ("RIGHT_WRIST", hand[0]))):
        messages.append(sextuple(0x181 + k, f"{name}_FT", WRENCH, scales, ("N", "Nm")))
    messages.append(sextuple(0x191, "IMU", IMU, (0.0005, 0.003), ("rad/s", "m/s2")))
    for b, joints in enumerate(buses):
        messages.append(control(0x1f1 + b, f"CONTROL_{'ABCD'[b]}", joints))
        size = next(s for s in (24, 32, 48) if s >= 4 * len(joints))
        messages.append(command(0x201 + b, f"COMMAND_{'ABCD'[b]}", joints, size, 32, 1e-7))
    joints = (*legs[0], *legs[1], *trunk, *arms[0], *arms[1])
    return Robot("humanoid", base, joints, tuple(messages), fd=True)


def lift_gripper():
    """A torso on a vertical screw, a boom, and a gripper whose second finger follows the first."""
    base = (
        Solid("box", (0.50, 0.50, 0.20), (0, 0, 0.10), 40.0),
        Solid("box", (0.12, 0.12, 0.90), (-0.10, 0, 0.65), 12.0),
    )
    finger = Solid("box", (0.06, 0.03, 0.012), (0.03, 0, 0.012), 0.12)
    follower = Solid("box", (0.06, 0.03, 0.012), (0.03, 0, -0.012), 0.12)
    joints = (
        Joint("imu_link", "base_link", (0.10, 0, 0.20)),
        Joint("lift", "base_link", (0.05, 0, 0.70), Z, (-200, 200), "screw_5",
              (Solid("box", (0.16, 0.30, 0.30), (0.08, 0, 0.10), 9.0),), slides=True),
        Joint("boom", "lift_link", (0.15, 0, 0.10), Y, (-60, 60), "shd20_100",
              (Solid("box", (0.35, 0.06, 0.06), (0.175, 0, 0), 2.0),)),
        Joint("wrist_ft", "boom_link", (0.35, 0, 0)),
        Joint("gripper", "wrist_ft", (0, 0, 0), solids=(Solid("box", (0.06, 0.05, 0.12), (0.03, 0, 0), 0.8),)),
        Joint("finger", "gripper", (0.06, 0, 0), Z, (0, 40), "screw_2", (finger,), slides=True),
        Joint("finger_follower", "gripper", (0.06, 0, 0), (0, 0, -1), (0, 40), "screw_2", (follower,),
              slides=True, mimic="finger"),
    )
    set_points = command(0x201, "COMMAND", ["boom"], 12, 32, 1e-7)
    for k, joint in enumerate(("lift", "finger"), 1):
        set_points.signals.append(intel(f"{joint}_position", 32 * k, 32, "-", 1e-8, "m", "DRIVES"))
    messages = (
        state(0x101, "lift", True, "link_position"),
        state(0x102, "boom", True),
        state(0x103, "finger", True, "link_position"),
        sextuple(0x181, "WRIST_FT", WRENCH, (0.01, 0.0005), ("N", "Nm")),
        sextuple(0x191, "IMU", IMU, (0.0005, 0.003), ("rad/s", "m/s2")),
        control(0x1f1, "CONTROL", ["lift", "boom", "finger"]),
        set_points,
    )
    return Robot("lift-gripper", base, joints, messages, fd=True)


ROBOTS = (test_joint(), leg(), hrp2_like(), lift_gripper(), humanoid())


def main(folder):
    for robot in ROBOTS:
        target = folder / robot.name
        target.mkdir(parents=True, exist_ok=True)
        (target / "robot.urdf").write_text(urdf(robot), encoding="utf-8")
        (target / "drives.dbc").write_text(dbc(list(robot.messages), robot.fd), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
