"""Faults, each with the mode in which it is set and the bounds of what the robot may truly move. The numbers are
rows of a table of what robots of another make have shown."""

import math
from dataclasses import dataclass, field

from second_robot import JOINTS

#: Bounds of the true motion: degrees, per cent of the velocity limit.
BOUND = (1.0, 10.0)
#: A drive that strays: nobody can see its first 5 ms.
STRAYING = (1.0, 35.0)
#: A drive that presses with what its loop asked for last, until its encoder is found to be stuck.
PRESSING = (1.0, 16.0)
#: A drive that nothing but its brake or its own time-out of 20 ms can stop.
RUNNING = (5.0, 50.0)
#: What drifts so slowly that it looks like load.
SLOW = (3.0, 10.0)
#: A hand moves the joint.
PUSHED = (90.0, 50.0)
DEG = math.pi / 180


@dataclass(frozen=True)
class Case:
    """Faults that are set while the robot is in a mode, or in mode "power-on" before it is enabled."""

    name: str
    mode: str
    faults: tuple
    bounds: tuple = BOUND
    window_s: float = 1.5
    #: Further time in the mode before the faults; a motion turns after 0.7 s.
    after_s: float = 0.0
    #: Replaced words of the configuration.
    changes: dict = field(default_factory=dict, hash=False)
    #: Events that may not be latched.
    never: tuple = ()
    #: No fault may be latched.
    sound: bool = False
    #: An operator acknowledges and enables afterwards, which counts as well.
    recover: bool = False

    def __str__(self):
        return f"{self.name}, {self.mode}".replace(" ", "_")


def together(fault, joints):
    """The fault of these joints at once."""
    name, value = fault.split()
    return tuple(f"{name} {joint} {value}" for joint in joints)


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
TOGETHER = [["knee"], ["hip", "ankle"], JOINTS]

CASES = [
    # 1: a joint, and joints that stop following in the same cycle
    *(
        Case(f"{' and '.join(joints)} go to 0", mode, together("target_zero 1", joints), STRAYING)
        for joints in TOGETHER
        for mode in ("hold", "torque")
        if mode == "hold" or joints == JOINTS
    ),
    Case("all mirror", "hold", ("target_mirrored all 1",), STRAYING),
    Case("supply dips", "hold", ("supply_ms - 5",)),
    Case("knee and ankle 5 deg off", "power-on", together("target_shift 0.0873", ["knee", "ankle"]), STRAYING),
    Case("all mirror", "power-on", ("target_mirrored all 1",), STRAYING),
    # 2: a position drive whose own encoder errs
    *(
        Case(f"motor drifts {rate} deg-s", mode, (f"motor_rate knee {rate * DEG}",), BOUND, 2.5)
        for rate, mode in ((0.6, "hold"), (2, "torque"))
    ),
    Case("motor stuck", "torque", ("motor_stuck knee 1",), PRESSING, 2.0),
    Case("all motors stuck", "torque", ("motor_stuck all 1",), PRESSING, 2.0),
    Case("both stuck", "motion", ("motor_stuck knee 1", "link_stuck knee 1"), RUNNING, 2.0),
    Case("both stuck at a turn", "motion", ("motor_stuck knee 1", "link_stuck knee 1"), BOUND, 2.0, after_s=0.7),
    Case("all stuck at a turn", "motion", ("motor_stuck all 1", "link_stuck all 1"), BOUND, 2.0, after_s=0.7),
    # 3: directions that are wrong at the first power-on
    Case("both encoders reversed", "power-on", (), STRAYING, 2.0, reversed_about("hip", -0.5, 100)),
    Case("set-point reversed", "power-on", (), STRAYING, 2.0, SET_POINT_REVERSED),
    Case("loop reversed", "power-on", ("loop_reversed knee 1",), STRAYING, 2.0),
    # 4: slow drifts
    Case("link drifts 0.02 deg-s", "torque", (f"link_rate knee {0.02 * DEG}",), SLOW, 8.0),
    Case("motor drifts 0.04 deg-s", "torque", (f"motor_rate knee {0.04 * DEG}",), SLOW, 6.0),
    Case("link drifts 0.02 deg-s", "passive", (f"link_rate knee {0.02 * DEG}",), SLOW, 8.0),
    # 6: an F/T sensor that drifts
    Case("F-T drifts 20 N-s along z", "torque", ("ft_fz_rate - 20",), SLOW, 5.0),
    Case("F-T drifts 2 Nm-s about y", "torque", ("ft_ty_rate - 2",), SLOW, 5.0),
    # 7: a zero lost within the gear's wind-up while the drive was silent
    Case("zero lost by 3 mrad", "hold", ("restart_ms knee 5", "restart_shift knee 0.003"), recover=True),
    Case(
        "gear ratio 101 for 100",
        "power-on",
        (),
        changes={"100.0\ntorque_constant_Nm_per_A = 0.1": "101.0\ntorque_constant_Nm_per_A = 0.1"},
    ),
    # 8: a drive that does not hear control words strays
    Case("deaf and goes away at 1 rad-s", "hold", ("control_deaf knee 1", "target_rate knee 1"), RUNNING),
    # 11: set-points from before
    Case("target never set", "power-on", ("memory all 1",), sound=True),
    Case("target never set, window", "power-on", ("memory all 1", "window all 0.05"), sound=True),
    # 13: no fault, or one with another cause
    Case("one status word wrong", "motion", ("status_once knee 512",), never=(407,), sound=True),
    Case("SYNC echoed", "motion", ("sync_echo - 1",), never=(210,)),
    Case("foreign frames", "motion", ("foreign - 20",), never=(210,)),
    Case("answers 1 ms late", "motion", ("late_us knee 1200",), never=(210,), sound=True),
    Case("F-T steps by 200 N", "motion", ("ft_fz - 200",), never=(210,)),
    # a hand turns a motor whose friction is a hundred times the configured one
    *(
        Case(
            f"hand of {push} at the {joint}, much friction",
            mode,
            (f"viscous {joint} 80", f"hand {joint} {push}"),
            PUSHED,
            never=(210,),
            sound=True,
        )
        for joint, push, mode in (
            ("hip", -30, "torque"),
            ("hip", 50, "feedback"),
            ("knee", 30, "torque"),
            ("knee", 30, "cartesian"),
        )
    ),
]
