"""`torquectl calibrate inertia` on torques that Pinocchio computes: of robots whose inertias differ from
their URDF's, with friction that is no term of the fit, noise, and columns as users have them."""

import json
import subprocess

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robot import EXAMPLES, TORQUECTL

ROBOTS = {
    "panda_description/urdf/panda.urdf": 7,
    "ur_description/urdf/ur10_robot.urdf": 6,
}
RATE, SECONDS = 100, 30


def other_inertias(model, rng):
    """The same robot with masses and centres of its own: up to a quarter and 2 cm."""
    other = model.copy()
    # By index: a slice holds copies.
    for k in range(1, len(other.inertias)):
        inertia = other.inertias[k]
        factor = 1 + rng.uniform(-0.25, 0.25)
        inertia.mass *= factor
        inertia.inertia = inertia.inertia * factor
        inertia.lever += rng.uniform(-0.02, 0.02, 3)
    assert other.inertias[1].mass != model.inertias[1].mass
    return other


def motion(model, joints, rng, pace=1.0):
    """A sum of sines within the limits: t, q, dq, ddq of all joints of the model."""
    t = np.arange(RATE * SECONDS) / RATE
    q, dq, ddq = (np.zeros((len(t), model.nq)) for _ in range(3))
    for j in range(joints):
        low = max(model.lowerPositionLimit[j], -2.5)
        high = min(model.upperPositionLimit[j], 2.5)
        q[:, j] = (low + high) / 2
        for k in (1, 2, 3, 5):
            w = 2 * np.pi * pace * 0.1 * k * (1 + 0.15 * rng.uniform())
            a, p = (high - low) / 2 * 0.35 / np.sqrt(k), rng.uniform(0, 6.28)
            q[:, j] += a * np.sin(w * t + p)
            dq[:, j] += a * w * np.cos(w * t + p)
            ddq[:, j] -= a * w * w * np.sin(w * t + p)
    return t, q, dq, ddq


def torques(model, states):
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)])


def friction(dq, scale):
    """Coulomb with Stribeck's excess, and a viscous part that grows slower than the speed."""
    stribeck = 1 + 0.3 * np.exp(-((dq / 0.08) ** 2))
    return scale * (0.05 * np.tanh(dq / 0.004) * stribeck + 0.06 * np.sign(dq) * np.abs(dq) ** 0.7)


def write(path, t, q, dq, tau, joints, names=None, with_dq=True):
    names = names or [str(k + 1) for k in range(joints)]
    link = "" if names[0].isdigit() else "_"
    signals = {"q": q, "dq": dq, "tau": tau} if with_dq else {"q": q, "tau": tau}
    header = ["t", *(f"{s}{link}{n}" for s in signals for n in names)]
    table = np.column_stack([t, *(x[:, :joints] for x in signals.values())])
    np.savetxt(path, table, delimiter=",", header=",".join(header), comments="", fmt="%.9g")


def run(*arguments):
    return subprocess.run([TORQUECTL, "calibrate", "inertia", *map(str, arguments)], capture_output=True, text=True)


@pytest.mark.parametrize("urdf", ROBOTS)
def test_a_robot_unlike_its_urdf_is_found(urdf, tmp_path):
    rng = np.random.default_rng(3)
    joints = ROBOTS[urdf]
    model = pin.buildModelFromUrdf(str(EXAMPLES / urdf))
    truth = other_inertias(model, rng)
    scale = np.abs(torques(truth, motion(truth, joints, rng)[1:])).max(axis=0)
    logs = []
    for k, pace in enumerate((1.0, 1.3)):
        t, *states = motion(truth, joints, rng, pace)
        tau = torques(truth, states) + friction(states[1], scale)
        tau += 0.005 * scale * rng.standard_normal(tau.shape)
        q = states[0] + 1e-5 * rng.standard_normal(tau.shape)
        logs.append(tmp_path / f"log{k}.csv")
        names = list(model.names)[1 : joints + 1] if k else None
        write(logs[-1], t + 1e-3 * rng.uniform(size=t.shape), q, states[1], tau, joints, names, with_dq=k == 1)
    # The second log carries names.
    out = tmp_path / "out"
    done = run("--urdf", EXAMPLES / urdf, "--log", logs[0], "-o", out, "--report", tmp_path / "page.html", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert [j["joint"] for j in result["joints"]] == list(model.names)[1 : joints + 1]
    for joint in result["joints"]:
        held_out, largest = joint["held_out"], joint["held_out"]["torque_largest"]
        identified = held_out["identified"]["rms"]
        assert identified < 0.02 * largest, joint
        assert identified < 1.02 * held_out["urdf"]["rms"] and identified < held_out["plain_least_squares"]["rms"], joint
        assert 0.6 < held_out["rms_over_sigma"] < 1.6, joint
    # The corrected URDF, read by Pinocchio, on another motion without friction.
    corrected = pin.buildModelFromUrdf(str(out / (EXAMPLES / urdf).name))
    for inertia in corrected.inertias[1 : joints + 1]:
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert inertia.mass > 0 and moments[0] > 0 and moments[0] + moments[1] > moments[2]
    states = motion(truth, joints, rng, 1.3)[1:]
    right, before, ours = (torques(m, states)[:, :joints] for m in (truth, model, corrected))
    error, was = (np.sqrt(np.mean((x - right) ** 2, axis=0)) for x in (ours, before))
    assert np.all(error < 0.03 * np.abs(right).max(axis=0)), error
    assert np.all((error < 0.5 * was) | (error < 0.005 * scale[:joints])), (error, was)
    assert (tmp_path / "page.html").read_text().count("<svg") == joints
    named = run("--urdf", EXAMPLES / urdf, "--log", logs[1], "--judge", logs[1], "--json")
    assert named.returncode == 0, named.stderr
    for joint in json.loads(named.stdout)["joints"]:
        assert joint["other_logs"]["identified"]["rms"] < 0.02 * joint["other_logs"]["torque_largest"]


PANDA = EXAMPLES / "panda_description/urdf/panda.urdf"
UR5 = EXAMPLES / "ur_description/urdf/ur5_robot.urdf"


def refused(*arguments):
    done = run(*arguments)
    assert done.returncode == 2 and done.stdout == "", done.stdout
    return done.stderr


def test_columns_that_are_not_those_of_the_robot(tmp_path):
    """Each with file and line, and nothing written."""
    log = tmp_path / "log.csv"
    t = np.arange(3000) / 100
    wave = np.column_stack([np.sin((1 + 0.2 * k) * t) for k in range(8)])
    names = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "tool"]

    def on(urdf, text=None, joints=6, names=None, more=()):
        write(log, t, wave, wave, wave, joints, names)
        if text is not None:
            log.write_text(text)
        return refused("--urdf", urdf, "--log", log, "-o", tmp_path / "out", *more)

    assert "log.csv:1: the log has tau columns of 5 joints" in on(UR5, joints=5)
    assert "log.csv:1: the log has tau columns of 8 joints" in on(UR5, joints=8)
    assert "--joints names 2 joints" in on(UR5, more=["--joints", "elbow_joint,wrist_1_joint"])
    assert 'no joint "elbo" that moves; allowed: shoulder_pan_joint' in on(UR5, more=["--joints", "elbo"])
    assert 'no joint "tool" that moves' in on(UR5, names=names)
    assert "no columns tau1, tau2, .. or tau_NAME" in on(UR5, "t,q1,q2\n0,1,2\n")
    assert "no tau2" in on(UR5, "t,q1,q3,tau1,tau3\n0,1,2,3,4\n")
    assert "log.csv:1: column `t` is missing" in on(UR5, "T,q1,tau1\n0,1,2\n", more=["--joints", "elbow_joint"])
    assert "log.csv:3: `tau1` is `x`" in on(UR5, "t,q1,tau1\n0,1,2\n1,1,x\n", more=["--joints", "elbow_joint"])
    # Read like any other: its one row is what is wrong.
    assert "the log has 0 rows" in refused("--urdf", UR5, "--log", utf16(tmp_path), "-o", tmp_path / "out", "--joints", "elbow_joint")
    assert "cannot be read" in refused("--urdf", UR5, "--log", tmp_path / "none.csv")
    assert "--gravity: 2 numbers" in on(UR5, more=["--gravity", "0,9.81"])
    assert not (tmp_path / "out").exists()


def utf16(folder):
    path = folder / "wide.csv"
    path.write_bytes("t,q1,tau1\n".encode("utf-16"))
    return path


def test_the_urdf_that_was_read_is_never_replaced(tmp_path):
    urdf = tmp_path / UR5.name
    urdf.write_bytes(UR5.read_bytes())
    model = pin.buildModelFromUrdf(str(UR5))
    rng = np.random.default_rng(1)
    t, *states = motion(model, 6, rng)
    write(tmp_path / "log.csv", t, *states[:2], -torques(model, states), 6)
    same = refused("--urdf", urdf, "--log", tmp_path / "log.csv", "-o", tmp_path)
    assert "its sign is opposite" in same
    same = refused("--urdf", urdf, "--log", tmp_path / "log.csv", "-o", tmp_path, "--negate-torque", "--accept")
    assert "would replace the URDF that was read" in same
    assert urdf.read_bytes() == UR5.read_bytes()
