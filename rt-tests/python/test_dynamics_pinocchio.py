"""`torquectl dynamics` against Pinocchio, on our robots and on other people's.

The program's path is taken from TORQUECTL, or else it is the debug build's.
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
EXAMPLES = Path(pin.__file__).resolve().parents[4] / "share" / "example-robot-data" / "robots"
# |ours - Pinocchio's| may be this share of the quantity's largest component.
TOLERANCE = 1e-10
CASES = 8

ROBOTS = {
    "test-joint": (ROOT / "robot-models/test-joint/robot.urdf", False),
    "leg": (ROOT / "robot-models/leg/robot.urdf", False),
    "humanoid": (ROOT / "robot-models/humanoid/robot.urdf", True),
    "talos": (EXAMPLES / "talos_data/robots/talos_reduced.urdf", True),
    "talos_full": (EXAMPLES / "talos_data/robots/talos_full_v2.urdf", True),
    "panda": (EXAMPLES / "panda_description/urdf/panda.urdf", False),
    "solo12": (EXAMPLES / "solo_description/robots/solo12.urdf", True),
}


def pinocchio_model(urdf, floating):
    root = (pin.JointModelFreeFlyer(),) if floating else ()
    return pin.buildModelFromUrdf(str(urdf), *root)


class Robot:
    """A robot in Pinocchio, random states for both, and our answers."""

    def __init__(self, urdf, floating, tmp_path, seed=1):
        self.model = pinocchio_model(urdf, floating)
        self.data = self.model.createData()
        self.floating = floating
        # Pinocchio takes mimic joints as independent; naming them makes ours do the same.
        self.joints = list(self.model.names)[2 if floating else 1 :]
        links = [f.name for f in self.model.frames if f.type == pin.FrameType.BODY and f.name != "universe"]
        # The end of each limb, where all errors add up, and a few links on the way.
        rng = np.random.default_rng(seed)
        self.links = sorted(rng.choice(links, min(6, len(links)), replace=False))
        self.states = [self.random_state(rng) for _ in range(CASES)]
        request = tmp_path / "cases.json"
        request.write_text(json.dumps({"joints": self.joints, "frames": self.links, "cases": [s["case"] for s in self.states]}))
        command = [TORQUECTL, "dynamics", "--urdf", urdf, *(["--floating"] if floating else []), request]
        run = subprocess.run(command, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        answer = json.loads(run.stdout)
        assert answer["joints"] == self.joints
        for state, case in zip(self.states, answer["cases"], strict=True):
            state["ours"] = case

    def random_state(self, rng):
        n, base = len(self.joints), 6 if self.floating else 0
        joint_q, dq, ddq = rng.uniform(-np.pi, np.pi, n), rng.uniform(-3, 3, n), rng.uniform(-9, 9, n)
        first = self.model.njoints - n
        q = np.array([x for i, angle in enumerate(joint_q) for x in self.components(first + i, angle)])
        case = {"q": list(joint_q), "dq": list(dq), "ddq": list(ddq)}
        v, a = dq, ddq
        if self.floating:
            p, quaternion = rng.uniform(-1, 1, 3), rng.normal(size=4)
            quaternion /= np.linalg.norm(quaternion)
            base_v, base_a = rng.uniform(-2, 2, 6), rng.uniform(-5, 5, 6)
            case["base"] = {"p": list(p), "quat_xyzw": list(quaternion), "v": list(base_v), "a": list(base_a)}
            q = np.concatenate([p, quaternion, q])
            v, a = np.concatenate([base_v, v]), np.concatenate([base_a, a])
        wrenches = {link: rng.uniform(-20, 20, 6) for link in self.links[:3]}
        case["f_ext"] = {link: list(f) for link, f in wrenches.items()}
        return {"q": q, "v": v, "a": a, "case": case, "f_ext": self.on_joints(wrenches), "base": base}

    def components(self, joint, angle):
        """Pinocchio's configuration of a joint: a continuous joint has cosine and sine."""
        return [np.cos(angle), np.sin(angle)] if self.model.joints[joint].nq == 2 else [angle]

    def on_joints(self, wrenches):
        forces = [pin.Force.Zero() for _ in range(self.model.njoints)]
        for link, wrench in wrenches.items():
            frame = self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]
            forces[frame.parentJoint] += frame.placement.act(pin.Force(wrench))
        return forces


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request, tmp_path_factory):
    return Robot(*ROBOTS[request.param], tmp_path_factory.mktemp("dynamics"))


def close(ours, theirs):
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    assert ours.shape == theirs.shape
    scale = max(np.abs(theirs).max(initial=0), 1e-3)
    error = np.abs(ours - theirs).max(initial=0) / scale
    assert error < TOLERANCE, f"relative error {error:.1e}"


def test_inverse_dynamics(robot):
    for s in robot.states:
        close(s["ours"]["tau"], pin.rnea(robot.model, robot.data, s["q"], s["v"], s["a"], s["f_ext"]))


def test_nonlinear_effects_and_gravity(robot):
    for s in robot.states:
        close(s["ours"]["nle"], pin.nonLinearEffects(robot.model, robot.data, s["q"], s["v"]))
        close(s["ours"]["g"], pin.computeGeneralizedGravity(robot.model, robot.data, s["q"]))


def test_mass_matrix(robot):
    for s in robot.states:
        m = np.triu(pin.crba(robot.model, robot.data, s["q"]))
        close(s["ours"]["M"], m + np.triu(m, 1).T)


def test_forward_dynamics_inverts_inverse_dynamics(robot):
    """The condition of M decides how far: Pinocchio's own answer is the measure."""
    for s in robot.states:
        tau = np.asarray(s["ours"]["tau"])
        theirs = pin.aba(robot.model, robot.data, s["q"], s["v"], tau, s["f_ext"])
        scale = np.abs(s["a"]).max()
        allowed = max(TOLERANCE * scale, 30 * np.abs(theirs - s["a"]).max())
        assert np.abs(s["ours"]["ddq_of_tau"] - s["a"]).max() < allowed


def test_center_of_mass(robot):
    for s in robot.states:
        close(s["ours"]["com"], pin.centerOfMass(robot.model, robot.data, s["q"]))


def test_frames(robot):
    kinds = {"J_local": pin.LOCAL, "J_world": pin.WORLD, "J_aligned": pin.LOCAL_WORLD_ALIGNED}
    for s in robot.states:
        pin.forwardKinematics(robot.model, robot.data, s["q"], s["v"], s["a"])
        pin.computeJointJacobians(robot.model, robot.data, s["q"])
        pin.updateFramePlacements(robot.model, robot.data)
        for link in robot.links:
            frame, ours = robot.model.getFrameId(link, pin.FrameType.BODY), s["ours"]["frames"][link]
            close(ours["p"], robot.data.oMf[frame].translation)
            close(ours["R"], robot.data.oMf[frame].rotation)
            close(ours["v"], pin.getFrameVelocity(robot.model, robot.data, frame, pin.LOCAL).vector)
            close(ours["a"], pin.getFrameAcceleration(robot.model, robot.data, frame, pin.LOCAL).vector)
            classical = pin.getFrameClassicalAcceleration(robot.model, robot.data, frame, pin.LOCAL)
            close(ours["a_classical"], classical.vector)
            for key, reference in kinds.items():
                theirs = pin.getFrameJacobian(robot.model, robot.data, frame, reference)
                close(ours[key], theirs.reshape(6, robot.model.nv))
