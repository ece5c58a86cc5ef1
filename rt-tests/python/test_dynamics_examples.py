"""Every URDF of example-robot-data: loaded and equal to Pinocchio, or refused for a reason."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from test_dynamics_pinocchio import EXAMPLES, TORQUECTL, Robot, close

URDFS = sorted(EXAMPLES.rglob("*.urdf"))
# What is physically unusable: the line and what the message says.
REFUSED = {
    "romeo_description/urdf/romeo_laas_small.urdf": (596, "principal moments of inertia"),
    "ur_description/urdf/ur3.urdf": (6, "the robot has no <link>"),
}


def name(urdf):
    return str(urdf.relative_to(EXAMPLES))


def test_all_of_them_are_here():
    assert len(URDFS) == 69
    assert REFUSED.keys() <= {name(u) for u in URDFS}


@pytest.mark.parametrize("urdf", [u for u in URDFS if name(u) in REFUSED], ids=name)
def test_refused_with_line_and_reason(urdf, tmp_path):
    cases = tmp_path / "cases.json"
    cases.write_text(json.dumps({"cases": []}))
    run = subprocess.run([TORQUECTL, "dynamics", "--urdf", urdf, cases], capture_output=True, text=True)
    line, reason = REFUSED[name(urdf)]
    assert run.returncode == 2
    assert f"{urdf}:{line}: " in run.stderr and reason in run.stderr
    assert run.stdout == ""


@pytest.mark.parametrize("urdf", [u for u in URDFS if name(u) not in REFUSED], ids=name)
def test_loaded_and_equal(urdf, tmp_path):
    robot = Robot(urdf, True, tmp_path, seed=7)
    for s in robot.states[:3]:
        ours = s["ours"]
        close(ours["tau"], pin.rnea(robot.model, robot.data, s["q"], s["v"], s["a"], s["f_ext"]))
        close(ours["nle"], pin.nonLinearEffects(robot.model, robot.data, s["q"], s["v"]))
        close(ours["g"], pin.computeGeneralizedGravity(robot.model, robot.data, s["q"]))
        close(ours["com"], pin.centerOfMass(robot.model, robot.data, s["q"]))
        m = np.triu(pin.crba(robot.model, robot.data, s["q"]))
        m = m + np.triu(m, 1).T
        close(ours["M"], m)
        if np.linalg.eigvalsh(m)[0] > 1e-9:
            residual = m @ (np.asarray(ours["ddq_of_tau"]) - s["a"])
            assert np.abs(residual).max() < 1e-9 * max(np.abs(ours["tau"]).max(), 1)
