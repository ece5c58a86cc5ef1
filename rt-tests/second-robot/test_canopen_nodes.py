"""The same robot with drives that are nodes of CANopen, from power-on: what faults truly move."""

import pytest
from cases import RUNNING, STRAYING, Case
from second_robot import by_canopen
from test_second_robot import attempt, reached, undisturbed

CASES = [
    Case("sound", "motion", (), sound=True),
    Case("knee goes to 0", "hold", ("target_zero knee 1",), STRAYING),
    Case("all mirror", "motion", ("target_mirrored all 1",), STRAYING),
    Case("knee's motor encoder slips", "hold", ("motor_offset knee 0.02",), STRAYING),
    Case("knee's link encoder slips", "hold", ("link_offset knee 0.02",)),
    # Only the reset of its node stops it.
    Case("knee is reversed and deaf", "hold", ("loop_reversed knee 1", "control_deaf knee 1"), RUNNING),
    Case("knee is mute", "motion", ("mute knee 1",)),
    # Set up anew by the daemon, then enabled.
    Case("knee restarts", "hold", ("restart_ms knee 5",), recover=True),
    Case("supply dips", "hold", ("supply_ms - 5",), recover=True),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_true_motion_is_bounded(robot_program, tmp_path, case):
    result = undisturbed(
        lambda index: attempt(robot_program, tmp_path / str(index), case, by_canopen),
        lambda result: not reached(case, result),
    )
    assert not reached(case, result), result
    assert not case.recover or not result.told.strip("; "), result

