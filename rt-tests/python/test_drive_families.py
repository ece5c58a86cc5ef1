"""Frames of drives, byte by byte, beside those of masters that other people wrote: what these send is what ours
sends (crates/drives/tests/masters.txt), and what our simulated drives answer is what these understand
(answers.txt there). The crate's own tests read both files."""

import math
from pathlib import Path

import can
import cantools
import moteus
import odrive_can
import pytest
import robstride
from damiao_motor.core.motor import MOTOR_TYPE_PRESETS, DaMiaoMotor
from processes import ROOT

TESTS = ROOT / "crates" / "drives" / "tests"
NODE, MASTER = 3, 0x13
#: Half a count, which a range about zero may just reach, and rounding.
HALF = 1.001
#: position, velocity, torque, kp, kd
COMMANDS = [
    (0.0, 0.0, 0.0, 0.0, 0.0),
    (1.0, -2.0, 3.0, 50.0, 1.5),
    (-12.0, 9.0, -9.5, 400.0, 4.0),
    (99.0, 99.0, 99.0, 999.0, 9.0),
]
ODRIVE = Path(odrive_can.__file__).parent / "dbc" / "odrive-cansimple-0.6.10.dbc"
#: Models by their makers' and by our names.
DAMIAO = {"4310": "DM4310", "4310P": "DM4310P", "4340": "DM4340", "8009": "DM8009", "10010L": "DM10010L"}


class Bus:
    """Keeps what is sent, and answers with what it was given."""

    def __init__(self, answer=None):
        self.sent, self.answer = [], answer

    def send(self, message, *_):
        self.sent.append(message)

    def recv(self, *_):
        return self.answer


def line(family, model, what, identifier, data, values=()):
    numbers = " ".join(f"{value:g}" for value in values)
    return f"{family} {model} {what} {identifier:x} {bytes(data).hex()} {numbers}".rstrip()


def damiao():
    for name, ours in DAMIAO.items():
        motor = DaMiaoMotor(NODE, MASTER, Bus(), motor_type=name)
        for p, v, t, kp, kd in COMMANDS:
            yield line("damiao", ours, "command", NODE, motor.encode_cmd_msg(p, v, t, kp, kd), (p, v, t, kp, kd))
        yield line("damiao", ours, "enable", NODE, motor.encode_enable_msg())
        yield line("damiao", ours, "disable", NODE, motor.encode_disable_msg())
        yield line("damiao", ours, "clear", NODE, motor.encode_clear_error_msg())


def odrive():
    dbc = cantools.database.load_file(ODRIVE)
    base = NODE << 5
    for p, v, t, kp, kd in COMMANDS[:3]:
        turns = {"Input_Pos": p / math.tau, "Vel_FF": v / math.tau, "Torque_FF": t}
        data = dbc.encode_message("Axis0_Set_Input_Pos", turns)
        yield line("odrive", "ODrive", "command", base | 0x0C, data, (p, v, t, kp, kd))
    # Of a motor with 1 N·m/rad and 0.03 N·m·s/rad.
    gains = {"Vel_Gain": 0.03 * math.tau, "Vel_Integrator_Gain": 0.0}
    for what, command, name, values in (
        ("mode", 0x0B, "Controller_Mode", {"Control_Mode": 3, "Input_Mode": 1}),
        ("position_gain", 0x1A, "Pos_Gain", {"Pos_Gain": 1 / 0.03}),
        ("velocity_gains", 0x1B, "Vel_Gains", gains),
    ):
        yield line("odrive", "ODrive", what, base | command, dbc.encode_message(f"Axis0_Set_{name}", values))
    for what, state in (("enable", 8), ("disable", 1)):
        data = dbc.encode_message("Axis0_Set_Axis_State", {"Axis_Requested_State": state})
        yield line("odrive", "ODrive", what, base | 0x07, data)


def robstride_lines():
    for name in ("RS02", "RS04"):
        for what, call in (("enable", "enable"), ("disable", "disable")):
            bus = Bus()
            client = robstride.Client(bus, host_can_id=MASTER)
            with pytest.raises(Exception, match="No response"):
                getattr(client, call)(NODE)
            yield line("robstride", name, what, bus.sent[0].arbitration_id | 1 << 31, bus.sent[0].data)
        bus = Bus()
        with pytest.raises(Exception, match="No response"):
            robstride.Client(bus, host_can_id=MASTER).read_param(NODE, "mechpos")
        yield line("robstride", name, "poll", bus.sent[0].arbitration_id | 1 << 31, bus.sent[0].data)


def moteus_controller():
    """A controller of PyPI moteus that sends and asks for the registers that ours do, in floats."""
    from moteus import multiplex

    position, query = moteus.PositionResolution(), moteus.QueryResolution()
    for name in ("position", "velocity", "feedforward_torque", "kp_scale", "kd_scale"):
        setattr(position, name, multiplex.F32)
    for name in ("position", "velocity", "torque", "q_current"):
        setattr(query, name, multiplex.F32)
    for name in ("mode", "voltage", "temperature", "fault"):
        setattr(query, name, multiplex.INT8)
    return moteus.Controller(NODE, transport=Bus(), position_resolution=position, query_resolution=query)


def moteus_lines():
    controller = moteus_controller()

    def made(what, command, values=()):
        sizes = [*range(9), 12, 16, 20, 24, 32, 48, 64]
        size = next(size for size in sizes if size >= len(command.data))
        # The transport sets who sends.
        identifier = MASTER << 8 | 0x8000 * command.reply_required | command.destination
        return line("moteus", "moteus", what, identifier | 1 << 31, command.data.ljust(size, b"\x50"), values)

    for p, v, t, kp, kd in COMMANDS:
        turns = {"position": p / math.tau, "velocity": v / math.tau, "feedforward_torque": t}
        shares = {"kp_scale": float(kp != 0), "kd_scale": float(kd != 0)}
        yield made("command", controller.make_position(**turns, **shares, query=True), (p, v, t, kp, kd))
    still = {"velocity": 0.0, "feedforward_torque": 0.0, "kp_scale": 0.0, "kd_scale": 0.0}
    yield made("enable", controller.make_position(position=math.nan, **still, query=True))
    yield made("disable", controller.make_stop(query=True))
    yield made("clear", controller.make_stop(query=True))
    yield made("poll", controller.make_query())


def lines():
    return [*damiao(), *odrive(), *robstride_lines(), *moteus_lines()]


def test_other_masters_still_make_the_recorded_frames():
    assert (TESTS / "masters.txt").read_text().splitlines() == lines()


def answers():
    """What our simulated drives send: family, model, identifier, data, position, velocity, torque, current,
    temperature, voltage, state, error."""
    for text in (TESTS / "answers.txt").read_text().splitlines():
        family, model, identifier, data, *numbers, state, error = text.split()
        values = [float(number) for number in numbers]
        yield family, model, int(identifier, 16), bytes.fromhex(data), values, state, int(error)


OTHERS = ("damiao", "moteus", "odrive", "robstride")


@pytest.mark.parametrize("answer", [a for a in answers() if a[0] in OTHERS], ids=lambda answer: "-".join(map(str, answer[:3])))
def test_other_masters_understand_our_answers(answer):
    family, model, identifier, data, numbers, state, error = answer
    position, velocity, torque, current, temperature, voltage = numbers
    if family == "damiao":
        name = next(name for name, ours in DAMIAO.items() if ours == model)
        limits = MOTOR_TYPE_PRESETS[name]
        read = DaMiaoMotor(NODE, MASTER, Bus(), motor_type=name).decode_sensor_feedback(data)
        assert identifier == MASTER and read["can_id"] == NODE
        assert read["pos"] == pytest.approx(position, abs=HALF * limits["p_max"] / 65535)
        assert read["vel"] == pytest.approx(velocity, abs=HALF * limits["v_max"] / 4095)
        assert read["torq"] == pytest.approx(torque, abs=HALF * limits["t_max"] / 4095)
        assert read["t_rotor"] == temperature
        assert read["status_code"] == {"off": 0, "enabled": 1, "fault": error}[state]
    elif family == "robstride":
        message = can.Message(arbitration_id=identifier & ~(1 << 31), data=data, is_extended_id=True)
        client = robstride.Client(Bus(message), host_can_id=MASTER)
        ranges = {"RS02": (1, 44.0, 17.0), "RS04": (2, 15.0, 120.0)}
        number, v_max, t_max = ranges[model]
        read = client.enable(NODE, number)
        assert read.angle == pytest.approx(position, abs=HALF * 4 * math.pi / 65535)
        assert read.velocity == pytest.approx(velocity, abs=HALF * v_max / 65535)
        assert read.torque == pytest.approx(torque, abs=HALF * t_max / 65535)
        assert read.temp == pytest.approx(temperature, abs=0.06)
        assert sum(flag.value for flag in read.errors) == error
    elif family == "moteus":
        message = can.Message(arbitration_id=identifier & ~(1 << 31), data=data, is_extended_id=True, is_fd=True)
        read = moteus_controller().make_query().parse(message)
        assert (read.arbitration_id, read.id) == (NODE << 8 | MASTER, NODE)
        values = read.values
        register = moteus.Register
        assert values[register.MODE] == {"off": 0, "enabled": 10, "fault": 1}[state]
        assert values[register.POSITION] * math.tau == pytest.approx(position, abs=1e-5)
        assert values[register.VELOCITY] * math.tau == pytest.approx(velocity, abs=1e-3)
        assert values[register.TORQUE] == pytest.approx(torque)
        assert values[register.Q_CURRENT] == pytest.approx(current)
        assert (values[register.VOLTAGE], values[register.TEMPERATURE]) == (voltage, temperature)
        assert values[register.FAULT] == error
    elif family == "odrive":
        dbc = cantools.database.load_file(ODRIVE)
        assert identifier >> 5 == NODE
        read = dbc.decode_message(identifier & 0x1F, data, decode_choices=False)
        meant = {
            0x09: {"Pos_Estimate": position / math.tau, "Vel_Estimate": velocity / math.tau},
            0x14: {"Iq_Measured": current},
            0x15: {"Motor_Temperature": temperature},
            0x17: {"Bus_Voltage": voltage},
            0x01: {"Axis_Error": error, "Axis_State": 8 if state == "enabled" else 1},
        }
        for name, value in meant[identifier & 0x1F].items():
            assert read[name] == pytest.approx(value, rel=1e-6)
