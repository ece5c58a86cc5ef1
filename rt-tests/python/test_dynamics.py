"""Every algorithm of crates/dynamics against Pinocchio: our robots and all of example-robot-data, on
a fixed and on a floating base, in random states, with random external wrenches and armatures."""

import json
import re

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robot import EXAMPLES, ROOT, Robot, close, torquectl
from test_dynamics_examples import REFUSED, URDFS, name

OUR_URDFS = sorted((ROOT / "robot-models").glob("*/robot.urdf"))
LOADED = [*OUR_URDFS, *(u for u in URDFS if name(u) not in REFUSED)]
# Pinocchio divides by zero, or crashes, for models without moving joints.
RIGID = [u for u in LOADED if not re.search('type="(revolute|continuous|prismatic)"', u.read_text(errors="replace"))]
MIMIC = [u for u in LOADED if "<mimic" in u.read_text(errors="replace")]
VARIANTS = [
    *((u, False, False) for u in LOADED if u not in RIGID),
    *((u, True, False) for u in LOADED),
    *((u, floating, True) for u in MIMIC for floating in (False, True)),
]
REFERENCES = {"local": pin.LOCAL, "world": pin.WORLD, "aligned": pin.LOCAL_WORLD_ALIGNED}


def label(variant):
    urdf, floating, mimic = variant
    path = urdf.relative_to(EXAMPLES if EXAMPLES in urdf.parents else ROOT)
    return f"{path}{'-floating' if floating else ''}{'-mimic' if mimic else ''}"


@pytest.fixture(scope="module", params=VARIANTS, ids=label)
def robot(request, tmp_path_factory):
    urdf, floating, mimic = request.param
    return Robot(urdf, floating, tmp_path_factory.mktemp("dynamics"), mimic)


def mass_matrix(robot, q):
    m = np.triu(pin.crba(robot.model, robot.data, q))
    return robot.map.T @ (m + np.triu(m, 1).T) @ robot.map


def test_inverse_dynamics(robot):
    for s in robot.states:
        tau = pin.rnea(robot.model, robot.data, s["q"], s["v"], s["a"], s["f_ext"])
        close(s["ours"]["tau"], tau @ robot.map)


def test_nonlinear_effects_and_gravity(robot):
    for s in robot.states:
        nle = pin.nonLinearEffects(robot.model, robot.data, s["q"], s["v"])
        close(s["ours"]["nle"], nle @ robot.map)
        g = pin.computeGeneralizedGravity(robot.model, robot.data, s["q"])
        close(s["ours"]["g"], g @ robot.map)


def test_mass_matrix(robot):
    for s in robot.states:
        close(s["ours"]["M"], mass_matrix(robot, s["q"]))


@pytest.mark.parametrize("key", ["ddq_of_tau", "ddq_of_M"])
def test_forward_dynamics(robot, key):
    """Accelerations agree, and the remaining difference of the torques is rounding."""
    for s in robot.states:
        model, data, state = robot.model, robot.data, (s["q"], s["v"])
        tau = pin.rnea(model, data, *state, s["a"], s["f_ext"])
        bias = pin.rnea(model, data, *state, 0 * s["v"], s["f_ext"])
        m = mass_matrix(robot, s["q"])
        ours = np.asarray(s["ours"][key], float)
        residual = m @ (ours - s["ours_a"])
        assert np.abs(residual).max() < 1e-10 * np.abs(tau @ robot.map).max()
        if robot.mimics:
            theirs = np.linalg.solve(m, (tau - bias) @ robot.map)
        else:
            theirs = pin.aba(model, data, *state, tau, s["f_ext"]) @ robot.map
        close(ours, theirs)


def test_center_of_mass(robot):
    for s in robot.states:
        close(s["ours"]["com"], pin.centerOfMass(robot.model, robot.data, s["q"]))
        if sum(i.mass for i in robot.model.inertias[1:]) > 0:
            jacobian = pin.jacobianCenterOfMass(robot.model, robot.data, s["q"])
            close(s["ours"]["J_com"], robot.columns(jacobian))


def test_centroidal_momentum(robot):
    for s in robot.states:
        close(s["ours"]["h"], pin.computeCentroidalMomentum(robot.model, robot.data, s["q"], s["v"]).vector)
        pin.ccrba(robot.model, robot.data, s["q"], s["v"])
        close(s["ours"]["A"], robot.columns(robot.data.Ag))


def test_energies(robot):
    """Pinocchio's kinetic energy lacks the armature of joints about oblique axes, its M does not."""
    rigid = robot.model.copy()
    rigid.armature = np.zeros(rigid.nv)
    for s in robot.states:
        of_motors = robot.model.armature @ s["v"] ** 2 / 2
        kinetic = pin.computeKineticEnergy(rigid, robot.data, s["q"], s["v"]) + of_motors
        close(s["ours"]["kinetic_energy"], kinetic)
        close(s["ours"]["potential_energy"], pin.computePotentialEnergy(robot.model, robot.data, s["q"]))


def test_joint_torque_regressor(robot):
    names = list(robot.model.names)[robot.first :]
    assert robot.answer["bodies"][robot.first - 1 :] == names
    for s in robot.states:
        regressor = pin.computeJointTorqueRegressor(robot.model, robot.data, s["q"], s["v"], s["a"])
        close(s["ours"]["regressor"], robot.map.T @ regressor.reshape(robot.model.nv, -1))


def test_frames(robot):
    model, data = robot.model, robot.data
    for s in robot.states:
        pin.computeJointJacobians(model, data, s["q"])
        pin.computeJointJacobiansTimeVariation(model, data, s["q"], s["v"])
        pin.forwardKinematics(model, data, s["q"], s["v"], s["a"])
        pin.updateFramePlacements(model, data)
        for link in robot.links:
            frame, ours = robot.frame(link), s["ours"]["frames"][link]
            close(ours["p"], data.oMf[frame].translation)
            close(ours["R"], data.oMf[frame].rotation)
            for key, reference in REFERENCES.items():
                motion = ours[key]
                close(motion["v"], pin.getFrameVelocity(model, data, frame, reference).vector)
                close(motion["a"], pin.getFrameAcceleration(model, data, frame, reference).vector)
                classical = pin.getFrameClassicalAcceleration(model, data, frame, reference)
                close(motion["a_classical"], classical.vector)
                close(motion["J"], robot.columns(pin.getFrameJacobian(model, data, frame, reference)))
                rate = pin.getFrameJacobianTimeVariation(model, data, frame, reference)
                close(motion["dJ_v"], rate.reshape(6, model.nv) @ s["v"])


@pytest.mark.parametrize("urdf", RIGID, ids=name)
def test_a_robot_without_moving_joints(urdf, tmp_path):
    run = torquectl(urdf, {"cases": [{"q": []}]}, tmp_path)
    nothing = {"tau": [], "M": [], "nle": [], "g": [], "ddq_of_tau": [], "com": [0, 0, 0]}
    assert json.loads(run.stdout) == {"joints": [], "cases": [nothing]}


@pytest.mark.parametrize("urdf", MIMIC, ids=name)
def test_mimic_joints_as_pinocchio_has_them(urdf, tmp_path):
    try:
        model = pin.buildModelFromUrdf(str(urdf), mimic=True)
    except ValueError as error:
        pytest.skip(f"Pinocchio: {error}")
    robot = Robot(urdf, False, tmp_path, mimic=True)
    data = model.createData()
    order = [model.idx_vs[model.getJointId(joint)] for joint in robot.joints]
    assert model.nv == len(order)
    model.armature = np.zeros(model.nv)
    model.armature[order] = [robot.model.armature[robot.component(joint)] for joint in robot.joints]
    for s in robot.states:
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for k, joint in enumerate(robot.joints):
            i, j = model.getJointId(joint), robot.model.getJointId(joint)
            full = robot.model.idx_qs[j]
            q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]] = s["q"][full : full + model.nqs[i]]
            v[order[k]], a[order[k]] = s["case"]["dq"][k], s["case"]["ddq"][k]
        tau = pin.rnea(model, data, q, v, a, s["f_ext"])
        close(s["ours"]["tau"], tau[order])
        m = np.triu(pin.crba(model, data, q))
        m = m + np.triu(m, 1).T
        close(s["ours"]["M"], m[np.ix_(order, order)])
