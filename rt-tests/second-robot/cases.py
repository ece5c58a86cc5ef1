"""Faults, each with the mode in which it is set and the bounds of what the robot may truly move."""

import math
from dataclasses import dataclass, field

from second_robot import JOINTS

#: Bounds of the true motion: degrees, per cent of the velocity limit.
BOUND = (1.0, 10.0)
#: A drive that strays: nobody can see its first 5 ms.
STRAYING = (1.0, 35.0)
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
]
