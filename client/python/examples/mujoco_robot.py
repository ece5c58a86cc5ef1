"""A robot in MuJoCo on the daemon's bus: the other end of `torqued run` where there is no CAN.

    python mujoco_robot.py config/ur5-mujoco/robot.toml [--seconds S] [--log TRUTH.csv]

Reads the daemon's own configuration, with its URDF and DBC files, and the true parameters of the
simulated robot from mujoco.toml beside it. Each joint has a rotor, a position drive with states by
CiA 402 and a brake, friction, a gear that is a spring, and encoders on both sides of it; F/T sensors are
MuJoCo's own. With every SYNC the robot answers and one period of its time passes, or as many as the daemon
left out: it waits for a daemon that is late, and the daemon's period is kept however slow this program is.
--log writes the true torques of every SYNC.

Needs PyPI's mujoco, python-can[multicast], cantools, numpy.
"""

import argparse
import enum
import json
import math
import os
import signal
import sys
import time
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import can
import cantools
import mujoco
import numpy as np

#: python-can's IPv4 group and port, as the daemon's.
GROUP, PORT = "239.74.163.2", 43113
#: Set-points missing for so many periods are a fault of a drive.
SET_POINT_PERIODS = 10
#: Periods that pass from one SYNC to the next at most: time stands still without a daemon.
MOST_PERIODS = 20
#: Interval at which the end is looked for, s.
LOOK_S = 0.1


class State(enum.IntEnum):
    """State of a drive, low byte of CiA 402's status word; bit 4: the motor has power."""

    SWITCH_ON_DISABLED = 0x50
    READY = 0x31
    SWITCHED_ON = 0x33
    ENABLED = 0x37
    FAULT = 0x18


class Drive:
    """The states of one drive."""

    def __init__(self):
        self.state = State.SWITCH_ON_DISABLED
        self.silent = 0
        self._word = 0

    def control(self, word):
        """Takes a control word."""
        reset, self._word = word & ~self._word & 0x80, word
        if self.state == State.FAULT:
            if reset:
                self.state = State.SWITCH_ON_DISABLED
        elif word & 0x06 != 0x06:
            self.state = State.SWITCH_ON_DISABLED  # voltage off, or quick stop
        elif word & 0x01 == 0:
            self.state = State.READY
        elif word & 0x08 == 0:
            if self.state != State.SWITCH_ON_DISABLED:
                self.state = State.SWITCHED_ON
        elif self.state == State.SWITCHED_ON:
            self.state, self.silent = State.ENABLED, 0

    def count_silence(self):
        """A period has passed; `set_point` ends the silence."""
        self.silent += 1
        if self.state == State.ENABLED and self.silent > SET_POINT_PERIODS:
            self.state = State.FAULT


class Signal:
    """A signal of the configuration: `quantity = direction * value + offset`, in SI units."""

    UNITS = {"rad": 1.0, "deg": math.pi / 180, "A": 1.0, "mA": 1e-3, "N": 1.0, "Nm": 1.0}

    def __init__(self, database, entry, counts_per_turn=None):
        entry = {"signal": entry} if isinstance(entry, str) else entry
        self.message, self.name = entry["signal"].split(".")
        self._signal = database.get_message_by_name(self.message).get_signal_by_name(self.name)
        unit = self._signal.unit or ""
        self._wraps = unit == "count"
        self._scale = 2 * math.pi / counts_per_turn if self._wraps else self.UNITS.get(unit, 1.0)
        self._direction = entry.get("direction", 1)
        self._offset = math.radians(entry.get("offset_deg", 0.0))

    def value(self, quantity):
        """The signal's value for a quantity: an encoder's count starts again at its range's end."""
        value = (quantity - self._offset) / (self._direction * self._scale)
        if self._wraps:
            least = self._signal.minimum
            return least + (round(value) - least) % (self._signal.maximum - least + 1)
        return value

    def quantity(self, value):
        """The quantity that a value stands for."""
        return self._direction * self._scale * value + self._offset


class Joint:
    """A joint of the configuration with its drive, and its true parameters."""

    def __init__(self, database, entry, kind, true, random):
        self.name, self.kind = entry["name"], kind
        self.gear = kind["gear_ratio"]
        counts = {key: kind.get(f"{key}_counts_per_turn") for key in ("motor", "link")}
        self.signals = {
            "motor_angle": Signal(database, entry["motor_angle"], counts["motor"]),
            "link_angle": Signal(database, entry["link_angle"], counts["link"]),
            "current": Signal(database, entry["current"]),
            "status": Signal(database, entry["status"]),
        }
        self.set_point = Signal(database, entry["set_point"], counts["link"])
        self.control = Signal(database, entry["control"])
        self.drive = Drive()

        def drawn(value, per_cent):
            return value * (1 + 0.01 * per_cent * random.uniform(-1, 1))

        self.stiffness = drawn(true["stiffness_Nm_per_rad"], true["stiffness_error_per_cent"])
        self.damping = true["damping_Nms_per_rad"]
        friction = true["friction_error_per_cent"]
        self.coulomb = self.gear * drawn(true["coulomb_Nm"], friction)
        self.viscous = self.gear**2 * drawn(true["viscous_Nms_per_rad"], friction)
        self.position_gain = true["position_gain_Nm_per_rad"]
        self.velocity_gain = true["velocity_gain_Nms_per_rad"]
        self.torque_per_ampere = self.gear * kind["torque_constant_Nm_per_A"]
        self.current_limit = true["current_limit_A"]
        self.current_noise = true["current_noise_A"]
        self.encoder_noise = true["encoder_noise_counts"]


def build(urdf, joints, sensors, substep_s):
    """The MuJoCo model of the URDF's robot. A joint is two hinges on one axis: the rotor against the link
    before, link side, and the gear's spring from rotor to link."""
    root = ET.parse(urdf).getroot()
    options = ET.SubElement(root, "mujoco")
    ET.SubElement(options, "compiler", strippath="false", fusestatic="false", discardvisual="true")
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.option.timestep = substep_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint in joints:
        rotor = spec.joint(joint.name)
        rotor.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        rotor.armature = joint.gear**2 * joint.kind["rotor_inertia_kg_m2"]
        rotor.frictionloss = joint.coulomb
        rotor.damping[0] = joint.viscous
        rotor.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        spring = rotor.parent.add_joint(
            name=f"{joint.name}/gear", type=mujoco.mjtJoint.mjJNT_HINGE, pos=rotor.pos, axis=rotor.axis
        )
        spring.stiffness[0] = joint.stiffness
        spring.damping[0] = joint.damping
        spec.add_equality(
            name=f"{joint.name}/brake", type=mujoco.mjtEq.mjEQ_JOINT, name1=joint.name,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
        )  # fmt: skip
        motor = spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        motor.gainprm[0] = joint.position_gain
        motor.biasprm[1], motor.biasprm[2] = -joint.position_gain, -joint.velocity_gain
        motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        most = joint.current_limit * joint.torque_per_ampere
        motor.forcerange = [-most, most]
    for sensor in sensors:
        body = spec.body(sensor["frame"])
        body.add_site(name=sensor["name"])
        for kind in ("FORCE", "TORQUE"):
            spec.add_sensor(
                name=f"{sensor['name']}/{kind}", type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
                objtype=mujoco.mjtObj.mjOBJ_SITE, objname=sensor["name"],
            )  # fmt: skip
    return spec.compile()


class Robot:
    """The simulated robot between two SYNCs."""

    def __init__(self, config):
        settings = tomllib.loads(config.read_text())
        true = tomllib.loads((config.parent / "mujoco.toml").read_text())
        (self.bus,) = settings["bus"]  # one bus carries all of it
        if self.bus.get("kind") != "udp_multicast":
            sys.exit(f'{config}: bus.kind: allowed: "udp_multicast"')
        self.database = cantools.database.load_file(config.parent / self.bus["dbc"])
        self.random = np.random.default_rng(true["seed"])
        kinds = settings["drive"]
        self.joints = [
            Joint(self.database, entry, kinds[entry["drive"]], true["drive"][entry["drive"]], self.random)
            for entry in settings["joint"]
        ]
        self.sensors = settings.get("ft_sensor", [])
        self.priority = settings["loop"].get("priority", 80)
        self.noise = true["ft_sensor"]
        self.pushes = true.get("push", [])
        self.substep_s = true["substep_us"] * 1e-6
        self.rate_hz = settings["loop"]["rate_hz"]
        self.substeps = round(1 / (self.rate_hz * self.substep_s))
        self.late_substeps = round(true["command_delay_us"] * 1e-6 / self.substep_s)
        urdf = config.parent / settings["robot"]["urdf"]
        self.model = build(urdf, self.joints, self.sensors, self.substep_s)
        self.data = mujoco.MjData(self.model)
        model, names = self.model, [joint.name for joint in self.joints]
        self.rotor = np.array([model.joint(name).qposadr[0] for name in names])
        self.gear = np.array([model.joint(f"{name}/gear").qposadr[0] for name in names])
        self.ratio = np.array([joint.gear for joint in self.joints])
        self.actuator = [model.actuator(name).id for name in names]
        self.brake = [model.equality(f"{name}/brake").id for name in names]
        self.gains = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()
        self.tool = model.nbody - 1
        for name, degrees in true["start"]["joints_deg"].items():
            self.data.qpos[self.rotor[names.index(name)]] = math.radians(degrees)
        self.set_points = self.data.qpos[self.rotor].copy()
        self.stamp_s = None
        self.syncs = self.taken = 0
        self.on = np.zeros(len(names), bool)
        for j in range(len(names)):
            self._switch(j, False)
        mujoco.mj_forward(model, self.data)
        self._prepare_answers()

    def _prepare_answers(self):
        """Messages of the bus: those that the robot sends, and what each of those it takes contains."""
        wanted = [signal.message for joint in self.joints for signal in joint.signals.values()]
        for sensor in self.sensors:
            sensor["signals"] = [Signal(self.database, name) for name in sensor["force"] + sensor["torque"]]
            wanted += [signal.message for signal in sensor["signals"]]
        self.answers = [self.database.get_message_by_name(name) for name in dict.fromkeys(wanted)]
        by_name = self.database.get_message_by_name
        self.sync = by_name(self.bus["sync"]).frame_id
        self.commands, self.controls = {}, {}
        for j, joint in enumerate(self.joints):
            for signal, taken in ((joint.set_point, self.commands), (joint.control, self.controls)):
                message = by_name(signal.message)
                taken.setdefault(message.frame_id, (message, []))[1].append((j, signal))

    def _switch(self, j, on):
        """The brake holds the rotor of a drive that is off."""
        model, data = self.model, self.data
        self.on[j] = on
        for array, gains in zip((model.actuator_gainprm, model.actuator_biasprm), self.gains):
            array[self.actuator[j]] = gains[self.actuator[j]] if on else 0.0
        data.eq_active[self.brake[j]] = not on
        model.eq_data[self.brake[j], 0] = data.qpos[self.rotor[j]]

    def take(self, message):
        """Takes a frame; true if it is SYNC."""
        if message.arbitration_id == self.sync:
            self.taken += 1
            return True
        if message.arbitration_id in self.commands:
            self.taken += 1
            layout, signals = self.commands[message.arbitration_id]
            values = layout.decode(bytes(message.data))
            for j, signal in signals:
                self.set_points[j] = signal.quantity(values[signal.name])
                self.joints[j].drive.silent = 0
        elif message.arbitration_id in self.controls:
            self.taken += 1
            layout, signals = self.controls[message.arbitration_id]
            values = layout.decode(bytes(message.data))
            for j, signal in signals:
                self.joints[j].drive.control(int(values[signal.name]))
        return False

    def advance(self, stamp_s):
        """The periods since the last SYNC pass; this one arrived at `stamp_s`, by the system's clock."""
        elapsed = 0 if self.stamp_s is None else round((stamp_s - self.stamp_s) * self.rate_hz)
        self.stamp_s = stamp_s
        for _ in range(min(max(elapsed, 1), MOST_PERIODS)):
            self._period()
        mujoco.mj_forward(self.model, self.data)  # forces of this instant
        self.syncs += 1

    def _period(self):
        """One period passes, with the commands of its beginning."""
        data = self.data
        for j, joint in enumerate(self.joints):
            joint.drive.count_silence()
            if (joint.drive.state == State.ENABLED) != self.on[j]:
                self._switch(j, not self.on[j])
        self._push()
        mujoco.mj_step(self.model, data, self.late_substeps)
        data.ctrl[self.actuator] = self.set_points
        mujoco.mj_step(self.model, data, self.substeps - self.late_substeps)

    def _push(self):
        """Wrenches on the tool's origin, as MuJoCo takes them: at its centre of mass."""
        now, data, tool = self.data.time, self.data, self.tool
        data.xfrc_applied[tool] = 0.0
        for push in self.pushes:
            phase = (now - push["start_s"]) / push["duration_s"]
            if 0 < phase < 1:
                force = math.sin(math.pi * phase) * np.array(push["force_N"])
                arm = data.xpos[tool] - data.xipos[tool]
                data.xfrc_applied[tool] += np.concatenate((force, np.cross(arm, force)))

    def truth(self):
        """Angles of the links and the gears' torques on them, rad, N·m."""
        data, model = self.data, self.model
        dof = model.jnt_dofadr[[model.joint(f"{joint.name}/gear").id for joint in self.joints]]
        return data.qpos[self.rotor] + data.qpos[self.gear], data.qfrc_passive[dof]

    def answer(self):
        """The frames of drives and sensors, of this instant."""
        data, random = self.data, self.random
        values = {message.name: {} for message in self.answers}
        rotor = data.qpos[self.rotor]
        link = rotor + data.qpos[self.gear]
        force = data.actuator_force[self.actuator]
        noise = random.standard_normal((3, len(self.joints)))
        for j, joint in enumerate(self.joints):
            count = [2 * math.pi * joint.encoder_noise / joint.kind[f"{side}_counts_per_turn"]
                     for side in ("motor", "link")]  # fmt: skip
            quantities = {
                "motor_angle": joint.gear * rotor[j] + count[0] * noise[0, j],
                "link_angle": link[j] + count[1] * noise[1, j],
                "current": force[j] / joint.torque_per_ampere + joint.current_noise * noise[2, j],
                "status": int(joint.drive.state),
            }
            for key, quantity in quantities.items():
                signal = joint.signals[key]
                values[signal.message][signal.name] = signal.value(quantity)
        for sensor in self.sensors:
            wrench = np.concatenate(
                [data.sensor(f"{sensor['name']}/{kind}").data for kind in ("FORCE", "TORQUE")]
            )
            sigma = [self.noise["noise_N"]] * 3 + [self.noise["noise_Nm"]] * 3
            # MuJoCo's is that of the body before on the one beyond; sign = 1 is the opposite.
            wrench = -sensor.get("sign", 1) * wrench + sigma * random.standard_normal(6)
            for signal, component in zip(sensor["signals"], wrench):
                values[signal.message][signal.name] = signal.value(component)
        for message in self.answers:
            yield can.Message(
                arbitration_id=message.frame_id,
                is_extended_id=message.is_extended_frame,
                is_fd=message.is_fd,
                bitrate_switch=message.is_fd,
                data=message.encode(values[message.name], strict=False),
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("config", type=Path, help="robot.toml; mujoco.toml stands beside it")
    parser.add_argument("--seconds", type=float, default=math.inf, help="end after so much time without SYNC")
    parser.add_argument("--log", type=Path, help="write angles and true torques of every SYNC here, CSV")
    arguments = parser.parse_args()
    robot = Robot(arguments.config)
    settings = robot.bus
    bus = can.Bus(
        interface="udp_multicast",
        channel=settings.get("group", GROUP),
        port=settings.get("port", PORT),
        hop_limit=settings.get("hop_limit", 0),
        fd=settings.get("fd", False),
    )
    log = arguments.log and arguments.log.open("w")
    names = [joint.name for joint in robot.joints]
    if log:
        print(*["t"] + [f"q_{n}" for n in names] + [f"tau_{n}" for n in names], sep=",", file=log)
    ended = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.append(True))
    try:  # as torqued-sim: one step below the loop, which must not wait for it
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(robot.priority - 1))
    except PermissionError:
        pass
    print(f"ready: {len(names)} joints wait for SYNC", file=sys.stderr, flush=True)
    heard = time.monotonic()
    sent, busy = 0, 0.0
    while not ended and time.monotonic() < heard + arguments.seconds:
        message = bus.recv(LOOK_S)
        if message is None or message.is_remote_frame or message.is_error_frame:
            continue
        if robot.take(message):
            heard = began = time.monotonic()
            robot.advance(message.timestamp)
            for answer in robot.answer():
                bus.send(answer)
                sent += 1
            if log:
                print(*[robot.data.time, *np.concatenate(robot.truth())], sep=",", file=log)
            busy += time.monotonic() - began
    bus.shutdown()
    if log:
        log.close()
    report = {
        "syncs": robot.syncs,
        "frames_sent": sent,
        "frames_taken": robot.taken,
        "ms_per_period": round(1e3 * busy / max(1, robot.syncs), 3),
    }
    print(json.dumps(report))


if __name__ == "__main__":
    main()
