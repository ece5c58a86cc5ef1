"""Faults of drives, encoders and sensors of a robot that shares no code with the project: what it truly moves."""

import functools
import math
import time
from dataclasses import dataclass, field

import pytest
import torqued
from second_robot import JOINTS, PAUSE_FAILED_MS, PAUSE_PASSED_MS, DisturbedError, Leg, configuration

#: Bounds of the true motion: degrees, per cent of the velocity limit.
BOUND = (1.0, 10.0)
#: A drive that strays: nobody can see its first 5 ms.
STRAYING = (1.0, 35.0)
#: Attempts until the machine has not disturbed a run.
ATTEMPTS = 6
DEG = math.pi / 180


@dataclass(frozen=True)
class Case:
    """Faults that are set while the robot is in a mode, or in mode "power-on" before it is enabled."""

    name: str
    mode: str
    faults: tuple
    bounds: tuple = BOUND
    window_s: float = 1.5
    #: Replaced words of the configuration.
    changes: dict = field(default_factory=dict, hash=False)
    #: No fault may be latched.
    sound: bool = False

    def __str__(self):
        return f"{self.name}, {self.mode}".replace(" ", "_")


def reversed_about(joint, q, ratio):
    """The configuration's words for both encoders of a joint, configured the wrong way round, but right where
    it stands."""
    words = {}
    for side, factor in (("link", 1), ("motor", ratio)):
        sign = f'{side}_angle = {{ signal = "{joint.upper()}.{side}_angle"'
        words[sign + " }"] = f"{sign}, direction = -1, offset_deg = {2 * factor * q / DEG:.6f} }}"
    return words


SET_POINT_REVERSED = {
    'set_point = { signal = "POSITIONS.knee_position" }': (
        'set_point = { signal = "POSITIONS.knee_position", direction = -1 }'
    )
}

CASES = [
    # A single drive that strays
    *(Case(f"{joint} goes to 0", "hold", (f"target_zero {joint} 1",), STRAYING) for joint in JOINTS),
    # A supply that all drives share
    Case("supply dips", "hold", ("supply_ms - 5",)),
    # What is wrong at the first power-on
    Case("both encoders reversed", "power-on", (), STRAYING, 2.0, reversed_about("hip", -0.5, 100)),
    Case("set-point reversed", "power-on", (), STRAYING, 2.0, SET_POINT_REVERSED),
    Case("loop reversed", "power-on", ("loop_reversed knee 1",), STRAYING, 2.0),
    # Set-points from before
    Case("target never set", "power-on", ("memory all 1",), sound=True),
    Case("target never set, window", "power-on", ("memory all 1", "window all 0.05"), sound=True),
]


def attempt(program, folder, case):
    """One run of a case."""
    power_on = case.mode == "power-on"
    configure = functools.partial(configuration, changes=case.changes)
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
        before_s = 2.0 if case.mode == "motion" else 0.3
        result = leg.inject(*case.faults, window_s=case.window_s, before_s=before_s)
        return result


def undisturbed(run, holds, most_ms=(PAUSE_FAILED_MS, PAUSE_PASSED_MS)):
    """The first run that the machine did not disturb; skips where there is none."""
    for index in range(ATTEMPTS):
        try:
            result = run(index)
        except (DisturbedError, torqued.NoDaemonError) as error:
            result = error
            print(f"attempt {index + 1}: {error}")
            continue
        print(f"attempt {index + 1}: {result}")
        if result.paused_ms < most_ms[bool(holds(result))]:
            return result
    pytest.skip(f"the machine stalled in each of {ATTEMPTS} runs: {result}")


def reached(case, result):
    """What the case does not allow."""
    problems = []
    if result.degrees > case.bounds[0] or result.per_cent > case.bounds[1]:
        problems.append("moved")
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
