"""`torquectl whole-body` against Pinocchio's full dynamics, on our humanoid: four F/T sensors, IMU in
the torso, unknown wrench on the chest. Pinocchio does not know the sensors: it is given base motion and
contact wrenches; the sensors' readings are taken from its joint wrenches.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

ROOT = Path(__file__).resolve().parents[2]
TORQUECTL = Path(os.environ.get("TORQUECTL", ROOT / "target" / "debug" / "torquectl"))
URDF = ROOT / "robot-models/humanoid/robot.urdf"
SENSORS = {"left_ankle": "left_ankle_ft", "right_ankle": "right_ankle_ft", "left_wrist": "left_wrist_ft", "right_wrist": "right_wrist_ft"}
IMU = "imu_link"
CONTACTS = [
    {"link": "left_foot", "type": "full_wrench"},
    {"link": "right_foot", "type": "pure_force", "point_m": [0.05, 0.02, -0.05]},
    {"link": "left_hand", "type": "known_direction", "point_m": [0.0, 0.01, -0.05], "direction": [0.0, 3.0, 4.0]},
    {"link": "right_hand", "type": "none"},
    {"link": "chest_pitch_link", "type": "full_wrench"},
]


class Humanoid:
    """The model with the sensors' fixed joints made movable, so that Pinocchio computes their wrenches."""

    def __init__(self):
        text = URDF.read_text()
        self.cut = pin.buildModelFromXML(self.movable(text), pin.JointModelFreeFlyer())
        self.data = self.cut.createData()
        self.joints = [n for n in list(self.cut.names)[2:] if n not in self.sensor_joints.values()]

    def movable(self, text):
        import xml.etree.ElementTree as ET

        root = ET.fromstring(text)
        self.sensor_joints = {}
        for joint in root.iter("joint"):
            child = joint.find("child")
            for name, link in SENSORS.items():
                if child is not None and child.get("link") == link:
                    assert joint.get("type") == "fixed"
                    self.sensor_joints[name] = joint.get("name")
                    joint.set("type", "revolute")
                    ET.SubElement(joint, "axis", xyz="1 0 0")
                    ET.SubElement(joint, "limit", lower="-1", upper="1", velocity="1", effort="1")
        assert len(self.sensor_joints) == 4
        return ET.tostring(root, encoding="unicode")

    def frame(self, link):
        return self.cut.frames[self.cut.getFrameId(link, pin.FrameType.BODY)]

    def random_case(self, rng):
        model, data = self.cut, self.data
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        q[:3], q[3:7] = rng.uniform(-1, 1, 3), rng.normal(size=4)
        q[3:7] /= np.linalg.norm(q[3:7])
        v[:6], a[:6] = rng.uniform(-1, 1, 6), rng.uniform(-3, 3, 6)
        motion = {"q": [], "dq": [], "ddq": []}
        for name in self.joints:
            joint = model.joints[model.getJointId(name)]
            q[joint.idx_q], v[joint.idx_v], a[joint.idx_v] = rng.uniform(-2, 2), rng.uniform(-3, 3), rng.uniform(-9, 9)
            for key, x in (("q", q[joint.idx_q]), ("dq", v[joint.idx_v]), ("ddq", a[joint.idx_v])):
                motion[key].append(x)
        wrenches = [self.wrench(rng, c) for c in CONTACTS]
        # The wrench that the root still lacks acts on the chest.
        forces = self.forces(wrenches[:-1])
        tau = pin.rnea(model, data, q, v, a, forces)
        pin.forwardKinematics(model, data, q, v, a)
        pin.updateFramePlacements(model, data)
        in_base = data.oMi[1].inverse() * data.oMf[self.cut.getFrameId("chest_pitch_link", pin.FrameType.BODY)]
        wrenches[-1] = in_base.actInv(pin.Force(tau[:6]))
        forces = self.forces(wrenches)
        tau = pin.rnea(model, data, q, v, a, forces)
        assert np.abs(tau[:6]).max() < 1e-9
        readings = {}
        for name, joint in self.sensor_joints.items():
            # data.f: wrench through the joint, on the child, in its frame.
            readings[name] = list(-data.f[model.getJointId(joint)].vector)
        case = {**motion, "ft": readings, **self.imu(q, v, a)}
        truth = [tau[model.joints[model.getJointId(n)].idx_v] for n in self.joints]
        return case, np.array(truth), [w.vector for w in wrenches]

    def wrench(self, rng, contact):
        f = rng.uniform(-100, 100, 3)
        torque = rng.uniform(-20, 20, 3) * (contact["type"] == "full_wrench")
        if contact["type"] == "known_direction":
            d = np.array(contact["direction"])
            f = d / np.linalg.norm(d) * 50
        return pin.Force(f * (contact["type"] != "none"), torque)

    def forces(self, wrenches):
        forces = [pin.Force.Zero() for _ in range(self.cut.njoints)]
        for contact, wrench in zip(CONTACTS, wrenches):
            frame = self.frame(contact["link"])
            at = frame.placement * pin.SE3(np.eye(3), np.array(contact.get("point_m", [0.0, 0, 0])))
            forces[frame.parentJoint] += at.act(wrench)
        return forces

    def imu(self, q, v, a):
        pin.forwardKinematics(self.cut, self.data, q, v, a)
        pin.updateFramePlacements(self.cut, self.data)
        index = self.cut.getFrameId(IMU, pin.FrameType.BODY)
        twist = pin.getFrameVelocity(self.cut, self.data, index, pin.LOCAL)
        acceleration = pin.getFrameClassicalAcceleration(self.cut, self.data, index, pin.LOCAL)
        gravity = self.data.oMf[index].rotation.T @ self.cut.gravity.linear
        return {
            "gyro": list(twist.angular),
            "accelerometer": list(acceleration.linear - gravity),
            "gyro_derivative": list(acceleration.angular),
        }


def evaluate(tmp_path, request, sensors=None):
    text = f'[imu]\nframe = "{IMU}"\n'
    for name, frame in SENSORS.items():
        text += f'[[ft_sensor]]\nname = "{name}"\nframe = "{frame}"\n'
    (tmp_path / "sensors.toml").write_text(sensors if isinstance(sensors, str) else text)
    (tmp_path / "cases.json").write_text(json.dumps(request))
    file = sensors if isinstance(sensors, Path) else tmp_path / "sensors.toml"
    command = [TORQUECTL, "whole-body", "--urdf", URDF, "--sensors", file, tmp_path / "cases.json"]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.parametrize("sensors", [None, ROOT / "config/humanoid/robot.toml"], ids=["sensors", "robot"])
def test_torques_and_contacts(tmp_path, sensors):
    humanoid, rng = Humanoid(), np.random.default_rng(1)
    cases = [humanoid.random_case(rng) for _ in range(20)]
    run = evaluate(tmp_path, {"joints": humanoid.joints, "contacts": CONTACTS, "cases": [c[0] for c in cases]}, sensors)
    assert run.returncode == 0, run.stderr
    for (_, tau, wrenches), answer in zip(cases, json.loads(run.stdout)["cases"], strict=True):
        assert np.abs(tau).max() > 20
        assert np.abs(tau - answer["tau"]).max() < 1e-9
        for truth, mine in zip(wrenches, answer["contacts"], strict=True):
            assert np.abs(truth - mine["wrench"]).max() < 1e-8, mine["link"]
        for part in answer["parts"]:
            assert np.abs(part["residual"]).max() < 1e-9, part["beyond"]


def test_a_push_that_no_contact_explains_is_a_residual(tmp_path):
    """Neither the torques of the other parts nor anything but that part's residual changes."""
    humanoid, rng = Humanoid(), np.random.default_rng(2)
    case, tau, _ = humanoid.random_case(rng)
    push = np.array([3.0, -4.0, 12.0, 1.0, 2.0, 0.5])
    case["ft"]["right_wrist"] = list(case["ft"]["right_wrist"] + push)
    sensors = 'sigma_ddq_rad_per_s2 = 0.1\n[imu]\nframe = "imu_link"\nsigma_m_per_s2 = 0.05\n'
    for name, frame in SENSORS.items():
        sensors += f'[[ft_sensor]]\nname = "{name}"\nframe = "{frame}"\nsigma_N = 0.1\nsigma_Nm = 0.005\n'
    run = evaluate(tmp_path, {"joints": humanoid.joints, "contacts": CONTACTS, "cases": [case]}, sensors)
    assert run.returncode == 0, run.stderr
    parts = {p["beyond"]: p for p in json.loads(run.stdout)["cases"][0]["parts"]}
    assert np.abs(np.array(parts["right_wrist"]["residual"]) - push).max() < 1e-8
    ratio = np.abs(parts["right_wrist"]["residual"]) / parts["right_wrist"]["residual_sigma"]
    assert ratio.max() > 20
    for name in ("left_ankle", "right_ankle", "left_wrist", None):
        assert np.abs(parts[name]["residual"]).max() < 1e-8


REFUSALS = [
    ({"contacts": CONTACTS[1:]}, ["no contact", "`left_ankle`", "`left_foot`"]),
    ({"contacts": [*CONTACTS, {"link": "left_hand", "type": "full_wrench"}]}, ["7 unknowns", "`left_wrist`", "at most 6"]),
    ({"contacts": [*CONTACTS, {"link": "right_hand", "type": "pure_force"}]}, ["nothing touches it", "`right_wrist`"]),
    ({"contacts": [*CONTACTS, {"link": "nose", "type": "pure_force"}]}, ["`nose`", "not in the robot model"]),
    ({"contacts": [*CONTACTS, {"link": "left_hand", "type": "sticky"}]}, ["sticky", "full_wrench"]),
    ({"contacts": [*CONTACTS[:4], {"link": "chest_pitch_link", "type": "known_direction"}]}, ["needs a direction"]),
    ({"ft": {"left_ankle": [0] * 6}}, ["reading of F/T sensor", "missing"]),
    ({"ft": {"left_knee": [0] * 6}}, ["left_knee"]),
    ({"q": [0.0]}, ["q: 1 numbers", "30"]),
    ({"gyro": None}, ["gyro is missing"]),
    ({"gyroscope": [0, 0, 0]}, ["gyroscope"]),
    ({"dq": [1e200] * 30}, ["too large", "not finite"]),
]


@pytest.mark.parametrize("change,expected", REFUSALS)
def test_bad_cases_are_refused(tmp_path, change, expected):
    humanoid = Humanoid()
    case = {**humanoid.random_case(np.random.default_rng(3))[0], "contacts": CONTACTS, **change}
    run = evaluate(tmp_path, {"joints": humanoid.joints, "cases": [case]})
    assert run.returncode == 2 and run.stdout == ""
    for part in ["cases.json", *expected]:
        assert part in run.stderr, run.stderr


def test_a_sensor_named_twice_in_a_case_is_refused(tmp_path):
    humanoid = Humanoid()
    case = {**humanoid.random_case(np.random.default_rng(3))[0], "contacts": CONTACTS}
    text = json.dumps({"joints": humanoid.joints, "cases": [case]}).replace('"right_ankle":', '"left_ankle":')
    (tmp_path / "twice.json").write_text(text)
    evaluate(tmp_path, {"cases": []})
    command = [TORQUECTL, "whole-body", "--urdf", URDF, "--sensors", tmp_path / "sensors.toml", tmp_path / "twice.json"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 2 and '"left_ankle" is named twice' in run.stderr


SENSOR_REFUSALS = [
    ('[[ft_sensor]]\nname = "a"\nframe = "left_ankle_ft"\n', ["neither [imu] nor [fixed_base]"]),
    ('[imu]\nframe = "nose"\n', ["IMU: link `nose`"]),
    ('[imu]\nframe = "imu_link"\ncolour = 1\n', ["sensors.toml:3", "colour"]),
    ('[imu]\nframe = "imu_link"\n[fixed_base]\nlink = "pelvis"\n', ["both given"]),
    ('[imu]\nframe = "imu_link"\n[[ft_sensor]]\nname = "a"\nframe = "left_ankle_ft"\nsign = 2\n', ["sensors.toml:6", "1 or -1"]),
    ('[imu]\nframe = "imu_link"\n[[ft_sensor]]\nname = "a"\nframe = "left_ankle_ft"\nxyz_m = [nan, 0, 0]\n', ["sensors.toml", "`a`", "finite"]),
    ('[imu]\nframe = "imu_link"\n[[ft_sensor]]\nname = "a"\nframe = "left_ankle_ft"\n[[ft_sensor]]\nname = "a"\nframe = "right_ankle_ft"\n', ["sensors.toml:7", "named twice"]),
    ('[imu]\nframe = "imu_link"\n\n[[contact]]\nlink = "toe"\ntype = "pure_force"\n', ["sensors.toml:4", "`toe`"]),
]


@pytest.mark.parametrize("text,expected", SENSOR_REFUSALS)
def test_bad_sensors_are_refused_without_cases(tmp_path, text, expected):
    run = evaluate(tmp_path, {"cases": []}, text)
    assert run.returncode == 2
    for part in ["sensors.toml", *expected]:
        assert part in run.stderr, run.stderr


@pytest.mark.parametrize("text,expected", SENSOR_REFUSALS)
def test_bad_sensors_are_refused(tmp_path, text, expected):
    case = {"q": [0] * 30, "gyro": [0] * 3, "accelerometer": [0] * 3, "gyro_derivative": [0] * 3, "contacts": CONTACTS}
    if 'name = "a"' in text:
        case["ft"] = {"a": [0] * 6}
    run = evaluate(tmp_path, {"cases": [case]}, text)
    assert run.returncode == 2
    for part in expected:
        assert part in run.stderr, run.stderr
