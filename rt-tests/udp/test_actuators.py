"""From power-on to holding with actuators that answer only when asked, by frames of their makers' own."""

import signal
import time

import pytest
import torqued
from actuators import Damiao, Line, Robstride
from processes import daemon
from test_canopen import configuration, to_holding

KP, KD = 100.0, 3.0
NODES = {3: 0.5, 4: -0.3}


def changes(family, model):
    actuator = (
        f'profile = "{family}"\n[drive.joint.actuator]\nmodel = "{model}"\n'
        f"kp_Nm_per_rad = {KP}\nkd_Nms_per_rad = {KD}\n"
    )
    return [
        (r'profile = "cia402"\n\[drive\.joint\.canopen\]\n(?:.+ = .*\n)+', actuator),
        (r'law = "predictive"\ntorque_feedback = "torsion"', 'law = "proportional_integral"\ntorque_feedback = "whole_body"'),
        (r"gear_ratio = .*", "gear_ratio = 10.0"),
        (r"K_tau_rad_per_Nm = .*", f"K_tau_rad_per_Nm = {1 / KP}"),
        (r"dead_zone_rad = .*", "dead_zone_rad = 0.002"),
        (r"torque_limit_Nm = .*", "torque_limit_Nm = 8.0"),
        (r"gains = .*", "gains = { K_p = 0.0, K_i_per_s = 0.0, K_s_Nm_per_rad = 20.0, K_d_Nms_per_rad = 2.0 }"),
    ]


FAMILIES = {"damiao": (Damiao, "DM4310"), "robstride": (Robstride, "RS02")}


@pytest.fixture(params=FAMILIES)
def robot(request, tmp_path):
    kind, model = FAMILIES[request.param]
    line = Line(kind, NODES)
    yield configuration(tmp_path, changes(request.param, model)), line.actuators
    line.end()


def test_from_power_on_to_holding(robot):
    config, actuators = robot
    starts = [actuator.q for actuator in actuators]
    with daemon(config, "--accept-margins") as process:
        to_holding()
        time.sleep(1.0)
        assert all(actuator.enabled for actuator in actuators)
        report = process.terminate()
    assert report["fault"] == 0
    for actuator, start in zip(actuators, starts):
        assert not actuator.enabled and "enable" in actuator.words and actuator.words[-1] == "disable"
        # Nothing but questions and physical zero before it was enabled.
        assert not actuator.while_off
        position, target = actuator.first
        assert abs(target - position) < 2e-3
        assert abs(actuator.q - start) < 5e-3
        if isinstance(actuator, Damiao):
            # What PyPI damiao-motor reads in its answers.
            assert abs(actuator.read["pos"] - actuator.q) < 2e-3


def test_they_stop_when_the_daemon_is_killed(robot):
    config, actuators = robot
    with daemon(config, "--accept-margins") as process:
        to_holding()
        process.send(signal.SIGKILL)
        time.sleep(1.0)
        assert all(a.stopped_after is not None and not a.enabled for a in actuators)
