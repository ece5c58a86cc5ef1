"""`torquectl calibrate inertia` on arms of other people's URDFs, with torques that Pinocchio computes and one
contradiction in the columns: nothing is written in which a mass is off by more than a factor of three."""

import os
import re

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robot import EXAMPLES
from test_calibrate_inertia import friction, motion, other_inertias, run, torques, write

ARMS = {
    "panda_description/urdf/panda.urdf": 7,
    "ur_description/urdf/ur5_robot.urdf": 6,
    "z1_description/urdf/z1.urdf": 6,
    "xarm_description/urdf/xarm7.urdf": 7,
}
FACTOR = 3


def some(rng, joints):
    """A joint that carries a load: neither the first nor the last two."""
    return int(rng.integers(1, max(2, joints - 2)))


def wrapped(q, tau, rng, joints):
    middle = q.mean(axis=0)
    q[:] = (q - middle) % (2 * np.pi) + middle


def zeros(q, tau, rng, joints):
    for _ in range(6):
        q[rng.integers(len(q)), some(rng, joints)] = 0
        tau[rng.integers(len(q)), some(rng, joints)] = 0


def alphabetical(q, tau, rng, joints):
    order = rng.permutation(joints)
    q[:, :joints], tau[:, :joints] = q[:, order], tau[:, order]


def reversed_joint(q, tau, rng, joints):
    q[:, some(rng, joints)] *= -1


def milli(q, tau, rng, joints):
    tau[:, some(rng, joints)] *= 1000


def constant(q, tau, rng, joints):
    q[:, some(rng, joints)] = 0.3


def degrees(q, tau, rng, joints):
    k = some(rng, joints)
    q[:, k] = np.degrees(q[:, k])


def exchanged_torques(q, tau, rng, joints):
    tau[:, [1, 2]] = tau[:, [2, 1]]


def reversed_torque(q, tau, rng, joints):
    tau[:, some(rng, joints)] *= -1


def quarter_turn(q, tau, rng, joints):
    q[:, some(rng, joints)] += np.pi / 2


def late(q, tau, rng, joints):
    tau[:] = np.roll(tau, 30, axis=0)


def early(q, tau, rng, joints):
    tau[:] = np.roll(tau, -5, axis=0)


def low_passed(q, tau, rng, joints):
    for k in range(joints):
        tau[:, k] = np.convolve(tau[:, k], np.ones(61) / 61, "same")


CONTRADICTIONS = [
    wrapped,
    zeros,
    alphabetical,
    reversed_joint,
    milli,
    constant,
    degrees,
    exchanged_torques,
    reversed_torque,
    quarter_turn,
    late,
    early,
    low_passed,
]
# Every arm with every contradiction takes minutes: `TORQUED_LONG=yes`. Else each contradiction once, on arms in turn.
LONG = os.environ.get("TORQUED_LONG") == "yes"
CASES = [
    (arm, change, seed)
    for k, change in enumerate(CONTRADICTIONS)
    for a, arm in enumerate(ARMS)
    for seed in range(3 if LONG else 1)
    if LONG or k % len(ARMS) == a
]


def masses(text):
    links = re.findall(r'<link\s+name="([^"]+)"\s*>(.*?)</link>', text, re.S)
    found = {name: re.search(r'<mass\s+value="([^"]+)"', body) for name, body in links}
    return {name: float(mass[1]) for name, mass in found.items() if mass}


@pytest.mark.parametrize(("arm", "change", "seed"), CASES, ids=lambda x: getattr(x, "__name__", str(x).split("/")[-1]))
def test_no_mass_is_off_by_more_than_a_factor_of_three(arm, change, seed, tmp_path):
    rng = np.random.default_rng([seed, CONTRADICTIONS.index(change), list(ARMS).index(arm)])
    urdf, joints = EXAMPLES / arm, ARMS[arm]
    model = pin.buildModelFromUrdf(str(urdf))
    truth = other_inertias(model, rng)
    t, *states = motion(truth, joints, rng)
    scale = np.abs(torques(truth, states)).max(axis=0)
    tau = torques(truth, states) + friction(states[1], scale)
    tau += 0.005 * scale * rng.standard_normal(tau.shape)
    q = states[0] + 1e-5 * rng.standard_normal(tau.shape)
    change(q, tau, rng, joints)
    write(tmp_path / "log.csv", t, q, states[1], tau, joints, with_dq=False)
    named = list(model.names)[1 : joints + 1]
    # Limits would give many of them away.
    text = re.sub(r'\b(lower|upper)="[^"]*"', lambda m: m[1] + ("=\"-90\"" if m[1] == "lower" else "=\"90\""), urdf.read_text())
    urdf = tmp_path / urdf.name
    urdf.write_text(text)
    done = run("--urdf", urdf, "--log", tmp_path / "log.csv", "--joints", ",".join(named), "-o", tmp_path / "out")
    assert done.returncode in (0, 2), done.stderr
    written = tmp_path / "out" / urdf.name
    assert written.exists() == (done.returncode == 0), done.stderr
    print(change.__name__, arm, done.returncode, done.stderr)
    if not written.exists():
        return
    before, after = masses(urdf.read_text()), masses(written.read_text())
    assert before.keys() == after.keys()
    # Points of calibration and frames have no mass worth a ratio.
    off = {n: (before[n], m) for n, m in after.items() if before[n] > 0.01 and not 1 / FACTOR < m / before[n] < FACTOR}
    assert not off, (change.__name__, off)
