"""Robot models and configurations as independent libraries read them.

Run with the test environment's pytest. cantools reads the DBC files, Pinocchio the URDFs.
"""

import math
import subprocess
import sys
import tomllib
from pathlib import Path

import cantools
import numpy as np
import pinocchio as pin
import pytest

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "robot-models"
LEG = ["hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll"]
ARM = ["shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_yaw", "wrist_pitch", "wrist_roll"]
TRUNK = ["chest_yaw", "chest_pitch", "head_yaw", "head_pitch"]
JOINTS = {
    "test-joint": ["joint"],
    "leg": LEG,
    "hrp2-like": LEG,
    "lift-gripper": ["lift", "boom", "finger"],
    "humanoid": [
        *(f"{side}_{name}" for side in ("left", "right") for name in LEG),
        *TRUNK,
        *(f"{side}_{name}" for side in ("left", "right") for name in ARM),
    ],
}
# Moving mass, kg: the base counts where it floats. 58 kg is HRP-2's.
MASS = {"test-joint": 2.482, "leg": 11.9, "hrp2-like": 31.9, "lift-gripper": 64.04, "humanoid": 58.0}
# Joints that follow others: no drive, no encoder.
FOLLOWERS = {"lift-gripper": ["finger_follower"]}
CYCLE_US = 1000.0

robots = pytest.mark.parametrize("robot", sorted(JOINTS))


def model(robot):
    urdf = str(MODELS / robot / "robot.urdf")
    floating = config(robot)["robot"]["base"] == "floating"
    return pin.buildModelFromUrdf(urdf, pin.JointModelFreeFlyer()) if floating else pin.buildModelFromUrdf(urdf)


def database(robot):
    return cantools.database.load_file(MODELS / robot / "drives.dbc", strict=True)


def config(robot):
    return tomllib.loads((ROOT / "config" / robot / "robot.toml").read_text(encoding="utf-8"))


def is_prismatic(robot, joint):
    robot_model = model(robot)
    return "JointModelP" in robot_model.joints[robot_model.getJointId(joint["name"])].shortname()


def in_units(robot, joint, key):
    """A key of a revolute joint with the units of this joint."""
    if not is_prismatic(robot, joint):
        return key
    units = {"Nm": "N", "rad": "m", "deg": "mm", "Nms": "Ns"}
    return "_".join(units.get(part, part) for part in key.split("_"))


def gear_ratio(drive):
    """Motor's angle for a way of the joint: 1, or rad/m."""
    return drive.get("gear_ratio") or 2 * math.pi / (1e-3 * drive["lead_mm_per_turn"])


def bus_signals(robot):
    """(bus, "MESSAGE.signal") of every signal that the configuration maps."""
    settings = config(robot)
    for joint in settings["joint"]:
        for key in ("motor_angle", "link_angle", "current", "velocity", "status", "control", "set_point"):
            if key in joint:
                yield joint["bus"], joint[key]["signal"]
    for sensor in settings.get("ft_sensor", []):
        for name in sensor["force"] + sensor["torque"]:
            yield sensor["bus"], name
    for name in settings.get("imu", {}).get("gyro", []) + settings.get("imu", {}).get("accelerometer", []):
        yield settings["imu"]["bus"], name


def test_generated_files_are_up_to_date(tmp_path):
    subprocess.run([sys.executable, MODELS / "generate.py", tmp_path], check=True)
    written = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.*"))
    assert len(written) == 2 * len(JOINTS)
    for path in written:
        assert (tmp_path / path).read_text() == (MODELS / path).read_text(), path


@robots
def test_joints_and_mass(robot):
    robot_model = model(robot)
    names = [name for name in robot_model.names if name not in ("universe", "root_joint")]
    assert sorted(names) == sorted(JOINTS[robot] + FOLLOWERS.get(robot, []))
    assert pin.computeTotalMass(robot_model) == pytest.approx(MASS[robot], abs=1e-9)
    assert [joint["name"] for joint in config(robot)["joint"]] == JOINTS[robot]


@robots
def test_inertias_belong_to_real_bodies(robot):
    for inertia in model(robot).inertias[1:]:
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert inertia.mass > 0 and moments[0] > 0
        assert moments[0] + moments[1] >= moments[2] * (1 - 1e-9)


def test_sizes_of_the_humanoid():
    """HRP-2 stands 1.54 m tall; in its published half-sitting pose the waist is at 0.6487 m."""
    robot_model = model("humanoid")
    data = robot_model.createData()
    q = pin.neutral(robot_model)
    pin.framesForwardKinematics(robot_model, data, q)

    def frame(name):
        return data.oMf[robot_model.getFrameId(name)].translation.copy()

    sole = frame("left_foot")[2] - 0.055
    assert frame("head_pitch_link")[2] + 0.185 - sole == pytest.approx(1.54, abs=1e-9)
    assert frame("left_foot") * [1, -1, 1] == pytest.approx(frame("right_foot"), abs=1e-12)
    assert frame("left_hand") * [1, -1, 1] == pytest.approx(frame("right_hand"), abs=1e-12)
    for name, angle in (("hip_pitch", -26), ("knee", 50), ("ankle_pitch", -24)):
        q[robot_model.joints[robot_model.getJointId(f"left_{name}")].idx_q] = math.radians(angle)
    pin.framesForwardKinematics(robot_model, data, q)
    assert 0.055 - frame("left_foot")[2] == pytest.approx(0.6487, abs=1e-4)
    assert data.oMf[robot_model.getFrameId("left_foot")].rotation == pytest.approx(np.eye(3), abs=1e-12)


@robots
def test_sensor_frames_are_fixed_links(robot):
    robot_model, settings = model(robot), config(robot)
    frames = [sensor["frame"] for sensor in settings.get("ft_sensor", [])]
    frames += [settings["imu"]["frame"]] if "imu" in settings else []
    assert len(frames) == {"test-joint": 0, "leg": 1, "hrp2-like": 2, "lift-gripper": 2, "humanoid": 5}[robot]
    for name in frames:
        assert robot_model.existFrame(name, pin.FrameType.BODY), name
        assert robot_model.existFrame(f"{name}_mount", pin.FrameType.FIXED_JOINT), name


@robots
def test_every_mapped_signal_exists_once_and_on_one_bus(robot):
    messages = {message.name: message for message in database(robot).messages}
    bus_of = {}
    mapped = list(bus_signals(robot))
    assert len({name for _, name in mapped}) == len(mapped)
    for bus, name in mapped:
        message, signal = name.split(".")
        messages[message].get_signal_by_name(signal)
        assert bus_of.setdefault(message, bus) == bus
    assert set(bus_of) | {"SYNC"} == set(messages), "a message that nothing uses"


@robots
def test_one_cycle_fits_on_the_bus_at_worst_stuffing(robot):
    bus_of = {name.split(".")[0]: bus for bus, name in bus_signals(robot)}
    settings = config(robot)
    for bus in settings["bus"]:
        answers = sum(frame_us(m) for m in database(robot).messages
                      if bus_of.get(m.name, bus["name"]) == bus["name"] and not is_sent(m))
        commands = sum(frame_us(m) for m in database(robot).messages
                       if bus_of.get(m.name) == bus["name"] and is_sent(m))
        assert answers < settings["loop"]["gather_deadline_us"]
        assert settings["loop"]["gather_deadline_us"] + commands < CYCLE_US
        assert all(m.is_fd == bus["fd"] for m in database(robot).messages if m.name != "SYNC")


def is_sent(message):
    """Set-points or control words: sent after the answers have been gathered."""
    return message.name.startswith(("COMMAND", "CONTROL"))


def frame_us(message):
    """Longest duration of a frame at 1 Mbit/s, data of CAN FD at 5 Mbit/s."""
    bits = 8 * message.length
    if not message.is_fd:
        return 47 + bits + (34 + bits - 1) // 4
    check = 17 if message.length <= 16 else 21
    data_phase = 5 + bits + (5 + bits) // 4 + 4 + check + check // 4 + 2
    return 17 + 16 // 4 + 13 + data_phase / 5


@robots
def test_limits_of_configuration_and_model_agree(robot):
    robot_model, settings = model(robot), config(robot)
    for joint in settings["joint"]:
        index = robot_model.joints[robot_model.getJointId(joint["name"])].idx_v
        position = robot_model.joints[robot_model.getJointId(joint["name"])].idx_q
        drive = settings["drive"][joint["drive"]]
        def key(name):
            return in_units(robot, joint, name)

        assert joint[key("torque_limit_Nm")] == robot_model.upperEffortLimit[index]
        assert drive[key("max_velocity_rad_per_s")] == robot_model.upperVelocityLimit[index]
        prismatic = is_prismatic(robot, joint)
        # The absolute encoder may not wrap inside the joint's range.
        lower, upper = (1e3 * limit[position] if prismatic else math.degrees(limit[position])
                        for limit in (robot_model.lowerPositionLimit, robot_model.upperPositionLimit))
        if "link_angle" not in joint:
            angle = database(robot).get_message_by_name(f"{joint['name'].upper()}_STATE")
            angle = angle.get_signal_by_name("motor_angle")
            turns = 360 / drive["motor_counts_per_turn"] / drive["gear_ratio"]
            assert angle.minimum * turns < lower and upper < angle.maximum * turns
            continue
        direction, offset = joint["link_angle"]["direction"], joint["link_angle"][key("offset_deg")]
        way = 360
        if prismatic:
            message, signal = joint["link_angle"]["signal"].split(".")
            signal = database(robot).get_message_by_name(message).get_signal_by_name(signal)
            way = (signal.maximum - signal.minimum + 1) / drive["link_counts_per_mm"]
        start = offset if direction == 1 else offset - way
        assert start <= lower + 1e-6 and upper - 1e-6 <= start + way


@robots
def test_drive_numbers_fit_together(robot):
    settings = config(robot)
    for joint in settings["joint"]:
        drive, gains = settings["drive"][joint["drive"]], joint["gains"]

        def key(name):
            return in_units(robot, joint, name)

        limit, motor, gear = joint[key("torque_limit_Nm")], drive["motor"], drive["compliance"]
        assert limit / gear_ratio(drive) / drive["torque_constant_Nm_per_A"] < 32.767, "current signal's range"
        # Over the motor's angle, where there is no other, K_tau contains no gear.
        if "link_angle" in joint:
            assert motor[key("K_tau_rad_per_Nm")] > 1 / gear[key("K_fs0_Nm_per_rad")], "stiffer than its gear"
        k6 = gains.get("K6")
        if k6 is None:
            k_tau, k_s = motor[key("K_tau_rad_per_Nm")], gains[key("K_s_Nm_per_rad")]
            k6 = k_tau * (1 + gains.get("K_p", 0.0)) * k_s
        assert 0 < k6 < 1.001, "stiffer than the drive's own position loop"


def test_the_ur5_is_that_of_example_robot_data():
    """Joints and links; the tool is ours."""
    ours = pin.buildModelFromUrdf(str(MODELS / "ur5-mujoco" / "robot.urdf"))
    shared = Path(sys.prefix) / "lib" / f"python3.{sys.version_info.minor}" / "site-packages" / "cmeel.prefix" / "share"
    theirs = shared / "example-robot-data" / "robots" / "ur_description" / "urdf" / "ur5_robot.urdf"
    theirs = pin.buildModelFromUrdf(str(theirs))
    assert list(ours.names) == list(theirs.names)
    for name in ("upperEffortLimit", "upperVelocityLimit", "upperPositionLimit", "lowerPositionLimit"):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=1e-9)
    for joint in range(1, ours.njoints):
        assert ours.jointPlacements[joint].isApprox(theirs.jointPlacements[joint], 1e-9)
        if joint < ours.njoints - 1:
            assert ours.inertias[joint].isApprox(theirs.inertias[joint], 1e-9)
    assert ours.inertias[6].mass == pytest.approx(theirs.inertias[6].mass + 1.5, abs=1e-9)
