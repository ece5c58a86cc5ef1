"""Every URDF of example-robot-data is loaded (test_dynamics.py compares it), or refused for a reason."""

import json

import pytest
from pinocchio_robot import EXAMPLES, torquectl

URDFS = sorted(EXAMPLES.rglob("*.urdf"))
# Physically unusable URDFs: line and part of the message.
REFUSED = {
    "romeo_description/urdf/romeo_laas_small.urdf": (331, "principal moments of inertia"),
    "ur_description/urdf/ur3.urdf": (6, "the robot has no <link>"),
}


def name(urdf):
    """Path in example-robot-data, or robot and file of one of the project's own."""
    own = not urdf.is_relative_to(EXAMPLES)
    return str(urdf.relative_to(urdf.parent.parent if own else EXAMPLES))


def test_all_of_them_are_here():
    assert len(URDFS) == 69
    assert REFUSED.keys() <= {name(u) for u in URDFS}


@pytest.mark.parametrize("urdf", [u for u in URDFS if name(u) in REFUSED], ids=name)
def test_refused_with_line_and_reason(urdf, tmp_path):
    run = torquectl(urdf, {"cases": []}, tmp_path)
    line, reason = REFUSED[name(urdf)]
    assert run.returncode == 2
    assert f"{urdf}:{line}: " in run.stderr and reason in run.stderr
    assert run.stdout == ""


def test_joints_that_move_no_mass_are_a_warning(tmp_path):
    """Romeo's fingers: inverse dynamics is defined, their acceleration is not."""
    urdf = EXAMPLES / "romeo_description/urdf/romeo.urdf"
    run = torquectl(urdf, {"cases": [{"q": [0] * 33}]}, tmp_path)
    assert run.returncode == 0
    assert f'{urdf}:1451: joint "RHand" moves no mass' in run.stderr
    case = json.loads(run.stdout)["cases"][0]
    assert None not in case["tau"] and None in case["ddq_of_tau"]
