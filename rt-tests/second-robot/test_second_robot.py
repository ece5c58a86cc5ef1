"""Faults of drives, encoders and sensors of a robot that shares no code with the project: what it truly moves."""

import functools
import itertools
import signal
import time

import pytest
from cases import BOUND, CASES
from processes import BINARIES, Process
from second_robot import (
    JOINTS,
    NAME,
    PAUSE_FAILED_MS,
    PAUSE_PASSED_MS,
    DisturbedError,
    Leg,
    by_current,
    configuration,
)
from torqued import RobotState

#: Attempts until the machine has not disturbed a run.
ATTEMPTS = 6


def attempt(program, folder, case, configure=None):
    """One run of a case; `configure`: another configuration than the case's."""
    power_on = case.mode == "power-on"
    configure = configure or functools.partial(configuration, changes=case.changes)
    with Leg(program, folder, configure, case.faults if power_on else ()) as leg:
        if power_on:
            mark, events = leg.mark(), 0
            refused = leg.enable()
            time.sleep(case.window_s)
            result = leg.judge(mark, events)
            result.told = refused
            return result
        leg.start()
        leg.begin(case.mode)
        time.sleep(case.after_s)
        before_s = 2.0 if case.mode == "motion" else 0.3
        result = leg.inject(*case.faults, window_s=case.window_s, before_s=before_s)
        if case.recover:
            told = [leg.acknowledge() if result.fault else ""]
            if leg.wait(RobotState.READY, limit_s=3.0):
                told.append(leg.enable())
            time.sleep(0.5)
            result = leg.judge(1, 0)
            result.told = "; ".join(told)
        return result


def undisturbed(run, holds, paused_ms=(PAUSE_FAILED_MS, PAUSE_PASSED_MS)):
    """The first run that the machine did not disturb; skips where there is none."""
    for index in range(ATTEMPTS):
        try:
            result = run(index)
        except DisturbedError as error:
            result = error
            print(f"attempt {index + 1}: {error}")
            continue
        print(f"attempt {index + 1}: {result}")
        if result.is_judged(bool(holds(result)), paused_ms):
            return result
    pytest.skip(f"the machine stalled in each of {ATTEMPTS} runs: {result}")


def reached(case, result):
    """What the case does not allow."""
    problems = []
    if result.degrees > case.bounds[0] or result.per_cent > case.bounds[1]:
        problems.append("moved")
    if result.fault in case.never:
        problems.append("wrong cause")
    if case.sound and result.fault:
        problems.append("fault")
    return problems


@pytest.mark.parametrize("case", CASES, ids=str)
def test_true_motion_is_bounded(robot_program, tmp_path, case):
    result = undisturbed(
        lambda index: attempt(robot_program, tmp_path / str(index), case), lambda result: not reached(case, result)
    )
    assert not reached(case, result), result


@pytest.mark.parametrize("mode", ["hold", "position", "motion", "torque", "passive", "feedback", "cartesian"])
def test_sound_robot_goes_on(robot_program, tmp_path, mode):
    def run(index):
        with Leg(robot_program, tmp_path / str(index)) as leg:
            leg.start()
            leg.begin(mode)
            return leg.inject(window_s=2.0, before_s=2.0 if mode in ("motion", "feedback") else 0.3)

    def sound(result):
        return not result.fault and not result.told and result.degrees < 0.5 and result.per_cent < 5

    result = undisturbed(run, sound)
    assert sound(result), result


def torquectl_move(*arguments):
    """`torquectl move`: exit code and text."""
    with Process(BINARIES / "torquectl", "move", "--robot", NAME, *arguments) as process:
        return process.wait(30.0), process.output()


def test_there_is_the_joints_own(robot_program, tmp_path):
    """A joint whose brake is shut does not arrive."""

    def run(index):
        with Leg(robot_program, tmp_path / str(index)) as leg:
            leg.start()
            leg.robot.set("brake_stuck knee 1")
            mark = leg.mark()
            code, text = torquectl_move("knee=65")
            result = leg.judge(mark, 0)
            result.told = f"exit code {code}: {text}"
            return result

    result = undisturbed(run, lambda result: "exit code 0" not in result.told)
    assert "exit code 0" not in result.told and "there after" not in result.told, result


def test_drives_stop_by_themselves_before_they_are_off(robot_program, tmp_path):
    """Reaction `off` in motion: each drive's own quick stop brings its joint to rest, then its brake shuts."""
    line = "late_per_cent = 100   # a simulated robot: late cycles do no harm"
    configure = functools.partial(
        configuration, changes={line: f'{line}\n[safety.reactions]\nsensor_stale = "off"\n'}
    )

    def run(index):
        with Leg(robot_program, tmp_path / str(index), configure) as leg:
            leg.start()
            leg.begin("motion")
            result = leg.inject("ft_fz - 1e7", window_s=1.0, before_s=2.0)
            states = leg.robot.truth()[:, 8::7]
            result.told = " ".join(
                name + "".join(f" {int(state)}" for state, _ in itertools.groupby(states[-750:, j]))
                for j, name in enumerate(JOINTS)
            )
            return result

    def holds(result):
        return all(f"{name} 4 5 1" in result.told for name in JOINTS) and result.degrees < 0.5

    result = undisturbed(run, holds)
    assert holds(result) and result.fault == 110, result


def test_pauses_of_the_daemon_are_no_fault(robot_program, tmp_path):
    """Pauses of 3 to 12 ms in motion are no implausible encoder."""

    def run(index):
        with Leg(robot_program, tmp_path / str(index)) as leg:
            leg.start()
            leg.begin("motion")
            mark = leg.mark()
            for pause_s in (0.003, 0.006, 0.009, 0.012) * 4:
                leg.daemon.send(signal.SIGSTOP)
                time.sleep(pause_s)
                leg.daemon.send(signal.SIGCONT)
                time.sleep(0.15)
            return leg.judge(mark, 0)

    result = undisturbed(run, lambda result: not result.fault, paused_ms=(16.0, 16.0))
    assert not result.fault, result


#: Stiffness of the joints whose drives take currents, Nm/rad.
SOFT = (600.0, 400.0, 60.0)


def test_a_hold_by_current_without_margins_is_not_started(tmp_path):
    """The default windows of the filters, in samples, and gains ten times too high."""
    config = by_current(tmp_path, [10 * stiffness for stiffness in SOFT])
    for command in ([BINARIES / "torqued", "run"], [BINARIES / "torquectl", "check"]):
        with Process(*command, config) as process:
            code = process.wait(30.0)
            text = "".join(process.lines)
        assert code == 2, text
        for joint in ("hip", "knee", "ankle"):
            assert f"joint {joint}: hold by K_s and K_d: margins of 0 degrees" in text, text


def test_a_hold_by_current_does_not_swing(robot_program, tmp_path):
    """A joint is moved by 5 degrees and held, with drives that take currents at 250 Hz. Its friction damps what the
    default windows of the filters, in samples, leave of the margins."""
    configure = functools.partial(by_current, stiffness=SOFT)

    def run(index):
        folder, options = tmp_path / str(index), ["--accept-margins"]
        with Leg(robot_program, folder, configure, ["by_current - 1"], 250.0, options) as leg:
            leg.start()
            code, text = torquectl_move("knee=62.3")
            result = leg.inject(window_s=3.0, before_s=0.2)
            result.told = f"exit code {code}: {text}"
            return result

    def holds(result):
        sound = not result.fault and "exit code 0" in result.told
        return result.degrees < BOUND[0] and result.per_cent < BOUND[1] and sound

    result = undisturbed(run, holds)
    assert holds(result), result
