"""`torquectl whole-body` against iDynTree's ExtWrenchesAndJointTorquesEstimator on iCub with six F/T
sensors: random states and readings, so that everything but the arithmetic is arbitrary.

The program's path is taken from TORQUECTL, or else it is the debug build's.
"""

import json
import os
import subprocess
from pathlib import Path

import icub_models
import idyntree.bindings as idyn
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
TORQUECTL = Path(os.environ.get("TORQUECTL", ROOT / "target" / "debug" / "torquectl"))
URDF = str(icub_models.get_model_file("iCubGazeboV2_5"))
TORQUE, WRENCH = 1e-9, 1e-8
CASES = 20

# Sensors of the URDF: the link just beyond each, in whose frame it measures, child on parent.
SENSORS = {
    "l_leg_ft": "l_hip_3",
    "r_leg_ft": "r_hip_3",
    "l_foot_ft": "l_foot",
    "r_foot_ft": "r_foot",
    "l_arm_ft": "l_upper_arm",
    "r_arm_ft": "r_upper_arm",
}
IMU = "head_imu_0"
# A link of every part: the root's, then beyond each sensor.
PARTS = ["root_link", "l_lower_leg", "r_upper_leg", "l_foot", "r_foot", "l_hand", "r_forearm"]
FULL = [{"link": link, "type": "full_wrench"} for link in PARTS]
TYPES = {"full_wrench": 6, "pure_force": 3, "known_direction": 1}


class ICub:
    def __init__(self):
        self.estimator = idyn.ExtWrenchesAndJointTorquesEstimator()
        loader = idyn.ModelLoader()
        assert loader.loadModelFromFile(URDF)
        assert self.estimator.setModel(loader.model())
        self.model = self.estimator.model()
        self.sensors = self.model.sensors()
        self.joints = [self.model.getJointName(j) for j in range(self.model.getNrOfJoints()) if self.model.getJoint(j).getNrOfDOFs() == 1]
        count = self.sensors.getNrOfSensors(idyn.SIX_AXIS_FORCE_TORQUE)
        self.sensor_names = [self.sensors.getSensor(idyn.SIX_AXIS_FORCE_TORQUE, s).getName() for s in range(count)]
        assert sorted(self.sensor_names) == sorted(SENSORS)

    def random_case(self, rng, contacts):
        n = len(self.joints)
        reading = lambda: [*rng.uniform(-200, 200, 3), *rng.uniform(-30, 30, 3)]  # noqa: E731
        return {
            "q": list(rng.uniform(-2, 2, n)),
            "dq": list(rng.uniform(-3, 3, n)),
            "ddq": list(rng.uniform(-9, 9, n)),
            "gyro": list(rng.uniform(-2, 2, 3)),
            "accelerometer": list(rng.uniform(-15, 15, 3)),
            "gyro_derivative": list(rng.uniform(-9, 9, 3)),
            "ft": {name: reading() for name in SENSORS},
            "contacts": contacts,
        }

    def evaluate(self, case, fixed_base=None):
        q, dq, ddq = (idyn.JointPosDoubleArray(self.model), *(idyn.JointDOFsDoubleArray(self.model) for _ in range(2)))
        for ours, theirs in ((case["q"], q), (case["dq"], dq), (case["ddq"], ddq)):
            for j, x in enumerate(ours):
                theirs.setVal(j, x)
        if fixed_base:
            frame = self.model.getFrameIndex(fixed_base["link"])
            assert self.estimator.updateKinematicsFromFixedBase(q, dq, ddq, frame, vector(fixed_base["gravity_m_per_s2"]))
        else:
            frame = self.model.getFrameIndex(IMU)
            motion = [vector(case[key]) for key in ("accelerometer", "gyro", "gyro_derivative")]
            assert self.estimator.updateKinematicsFromFloatingBase(q, dq, ddq, frame, *motion)
        readings = idyn.SensorsMeasurements(self.sensors)
        for s, name in enumerate(self.sensor_names):
            wrench = idyn.Wrench()
            for k, x in enumerate(case["ft"][name]):
                wrench.setVal(k, x)
            readings.setMeasurement(idyn.SIX_AXIS_FORCE_TORQUE, s, wrench)
        unknowns = idyn.LinkUnknownWrenchContacts(self.model)
        for c in case["contacts"]:
            point = idyn.Position(*c.get("point_m", (0, 0, 0)))
            types = {"full_wrench": idyn.FULL_WRENCH, "pure_force": idyn.PURE_FORCE, "known_direction": idyn.PURE_FORCE_WITH_KNOWN_DIRECTION}
            direction = c.get("direction", (0, 0, 1))
            unknown = idyn.UnknownWrenchContact(types[c["type"]], point)
            unknown.forceDirection = idyn.Direction(*direction)
            unknowns.addNewContactForLink(self.model.getLinkIndex(c["link"]), unknown)
        wrenches, tau = idyn.LinkContactWrenches(self.model), idyn.JointDOFsDoubleArray(self.model)
        assert self.estimator.estimateExtWrenchesAndJointTorques(unknowns, readings, wrenches, tau)
        found = []
        for c in case["contacts"]:
            w = wrenches.contactWrench(self.model.getLinkIndex(c["link"]), 0).contactWrench
            found.append(np.array([w.getVal(k) for k in range(6)]))
        return tau.toNumPy(), found


def vector(x):
    v = idyn.Vector3()
    for k in range(3):
        v.setVal(k, x[k])
    return v


@pytest.fixture(scope="module")
def icub():
    return ICub()


def ours(icub, tmp_path, cases, options="", fixed_base=None, sensors=SENSORS):
    text = options
    if fixed_base:
        text += f"[fixed_base]\nlink = \"{fixed_base['link']}\"\ngravity_m_per_s2 = {fixed_base['gravity_m_per_s2']}\n"
    else:
        text += f'[imu]\nframe = "{IMU}"\n'
    for name, frame in sensors.items():
        text += f'[[ft_sensor]]\nname = "{name}"\nframe = "{frame}"\n'
    (tmp_path / "sensors.toml").write_text(text)
    (tmp_path / "cases.json").write_text(json.dumps({"joints": icub.joints, "cases": cases}))
    command = [TORQUECTL, "whole-body", "--urdf", URDF, "--sensors", tmp_path / "sensors.toml", tmp_path / "cases.json"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["joints"] == icub.joints
    return answer["cases"]


def compare(icub, cases, answers, fixed_base=None):
    for case, answer in zip(cases, answers, strict=True):
        tau, wrenches = icub.evaluate(case, fixed_base)
        assert np.abs(tau).max() > 10
        assert np.abs(tau - answer["tau"]).max() < TORQUE
        for mine, theirs in zip(answer["contacts"], wrenches, strict=True):
            assert np.abs(theirs - mine["wrench"]).max() < WRENCH, mine["link"]


def test_full_wrenches(icub, tmp_path):
    rng = np.random.default_rng(1)
    cases = [icub.random_case(rng, FULL) for _ in range(CASES)]
    compare(icub, cases, ours(icub, tmp_path, cases))


def test_order_of_contacts_and_sensors(icub, tmp_path):
    """The result is identical, bit by bit, in any order."""
    rng = np.random.default_rng(2)
    case = icub.random_case(rng, random_contacts(rng))
    reference = ours(icub, tmp_path, [case])[0]
    for _ in range(4):
        order = rng.permutation(len(case["contacts"]))
        names = list(rng.permutation(list(SENSORS)))
        shuffled = {**case, "contacts": [case["contacts"][k] for k in order], "ft": {n: case["ft"][n] for n in names}}
        answer = ours(icub, tmp_path, [shuffled], sensors={n: SENSORS[n] for n in names})[0]
        assert answer["tau"] == reference["tau"]
        assert answer["contacts"] == [reference["contacts"][k] for k in order]


def random_contacts(rng):
    """One contact in every part, of any type at any point."""
    contacts = []
    for link in PARTS:
        contact = {"link": link, "type": str(rng.choice(list(TYPES))), "point_m": list(rng.uniform(-0.2, 0.2, 3))}
        if contact["type"] == "known_direction":
            d = rng.normal(size=3)
            contact["direction"] = list(d / np.linalg.norm(d))
        contacts.append(contact)
    return contacts


def test_pure_forces_and_known_directions(icub, tmp_path):
    """With fewer unknowns than equations iDynTree hands each residual on towards the root."""
    rng = np.random.default_rng(3)
    pure = [{"link": link, "type": "pure_force"} for link in PARTS]
    cases = [icub.random_case(rng, pure if k < 5 else random_contacts(rng)) for k in range(CASES)]
    compare(icub, cases, ours(icub, tmp_path, cases, '[least_squares]\nresidual = "handed_on"\n'))


def test_contacts_that_fill_a_part_together(icub, tmp_path):
    """A force at a point, and forces of known direction at others, in place of full wrenches."""
    rng = np.random.default_rng(4)
    contacts = [c for c in FULL if c["link"] not in ("l_hand", "root_link")]
    for link in ("l_hand", "l_forearm", "l_upper_arm"):
        kind = "pure_force" if link == "l_hand" else "known_direction"
        extra = {} if kind == "pure_force" else {"direction": [0.6, 0.0, 0.8]}
        contacts.append({"link": link, "type": kind, "point_m": list(rng.uniform(-0.1, 0.1, 3)), **extra})
    for link in ("root_link", "chest"):
        contacts.append({"link": link, "type": "pure_force" if link == "chest" else "known_direction", "point_m": [0.1, 0, 0.05]})
        if link == "root_link":
            contacts[-1]["direction"] = [0.0, 0.0, 1.0]
    cases = [icub.random_case(rng, contacts) for _ in range(CASES)]
    compare(icub, cases, ours(icub, tmp_path, cases, '[least_squares]\nresidual = "handed_on"\n'))


def test_consistent_readings(icub, tmp_path):
    """Pure forces that explain the readings: there are no residuals to distribute."""
    rng = np.random.default_rng(5)
    pure = [{"link": link, "type": "pure_force"} for link in PARTS[1:]] + [FULL[0]]
    cases = [icub.random_case(rng, pure) for _ in range(CASES)]
    for _ in range(12):
        # Each reading is corrected by its part's residual, which lies at the sensor.
        worst = 0.0
        for case, answer in zip(cases, ours(icub, tmp_path, cases), strict=True):
            for part in answer["parts"][1:]:
                name = part["beyond"]
                mended = np.array(case["ft"][name]) - part["residual"]
                worst = max(worst, np.abs(part["residual"]).max())
                case["ft"][name] = list(mended)
        if worst < 1e-11:
            break
    assert worst < 1e-10
    compare(icub, cases, ours(icub, tmp_path, cases))


def test_fixed_base(icub, tmp_path):
    rng = np.random.default_rng(6)
    base = {"link": "l_sole", "gravity_m_per_s2": [1.0, -2.0, -9.5]}
    cases = [icub.random_case(rng, FULL) for _ in range(CASES)]
    mine = [{k: v for k, v in c.items() if k not in ("gyro", "accelerometer", "gyro_derivative")} for c in cases]
    compare(icub, cases, ours(icub, tmp_path, mine, fixed_base=base), base)
