"""A humanoid in MuJoCo, in lock-step with a cycle of torqued that another process runs.

    python world.py config/humanoid/robot.toml --seed 1

Rigid bodies and contacts are MuJoCo's. Gears, friction and drives are written here, with nothing of `crates/plant`:
gears are a linear spring with a Bouc-Wen hysteresis, friction of the rotors is MuJoCo's friction loss (rigid, without
bristles) with a part that grows with the load, drives close a cascade of their own at 4 kHz on an encoder of 17 bits.
Every number is drawn around what the configuration says, as nobody's data sheet is true.

Each period reads `command` and writes `answer`, little-endian doubles without a header:

    command  set-points (rad, link side), control words, and a force on the pushed link (N, world axes)
    answer   motor angle (rad), link angle (rad), current (A), motor velocity (rad/s), status word: all joints each;
             wrenches on the F/T sensors, gyro and accelerometer; true torques of the gears (N·m), the base's
             orientation (w, x, y, z), its angular velocity (rad/s, own axes), and its height (m)
"""

import argparse
import math
import sys
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

SUBSTEP_S = 250e-6
SUBSTEPS = 4
#: Steps from a set-point's sending until the drive has it: a bus cycle.
LATE = 4
#: Radius of the spheres that a foot stands on, m.
SPHERE_M = 0.005
#: Bits of CiA 402's status word, low byte, by state.
DISABLED, READY, SWITCHED_ON, ENABLED = 0x50, 0x31, 0x33, 0x37
#: Periods from a control word to the state that it asks for; of the brake from enabled to open.
STEP, RELEASE = 2, 20
#: Counts per turn of the encoder that a drive's own loop runs on, motor side.
DRIVE_COUNTS = 2**17


def drawn(random, value, share):
    """The value times a factor, each direction as likely."""
    return value * np.exp(np.log1p(share) * random.uniform(-1, 1, np.shape(value)))


def build(root, settings, feet, names, kinds, random):
    """The model: each joint is a hinge of its rotor and one of its gear on the same axis."""
    options = ET.SubElement(root, "mujoco")
    ET.SubElement(options, "compiler", strippath="false", fusestatic="false", discardvisual="true")
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.option.timestep = SUBSTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for geom in list(spec.geoms):
        spec.delete(geom)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], friction=[0.7, 0.005, 0.0001],
        solref=[0.005, 1.0],
    )  # fmt: skip
    spec.worldbody.first_body().add_freejoint(name="base")
    stiffness = drawn(random, np.array([kind["compliance"]["K_fs0_Nm_per_rad"] for kind in kinds]), 0.07)
    for name, kind, gear in zip(names, kinds, stiffness):
        ratio = kind["gear_ratio"]
        rotor = spec.joint(name)
        rotor.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        rotor.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        rotor.armature = ratio**2 * drawn(random, kind["rotor_inertia_kg_m2"], 0.1)
        rotor.frictionloss = ratio * drawn(random, kind["friction"]["coulomb_Nm"], 1.0)
        rotor.damping[0] = ratio**2 * drawn(random, kind["friction"]["viscous_Nms_per_rad"], 1.0)
        spring = rotor.parent.add_joint(
            name=f"{name}/gear", type=mujoco.mjtJoint.mjJNT_HINGE, pos=rotor.pos, axis=rotor.axis
        )
        spring.stiffness[0] = gear
        spring.damping[0] = 0.03 * math.sqrt(gear * rotor.armature)
        spec.add_equality(
            name=f"{name}/brake", type=mujoco.mjtEq.mjEQ_JOINT, name1=name,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
        )  # fmt: skip
    for foot in feet:
        for corner in foot["corners_m"]:
            spec.body(foot["link"]).add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[SPHERE_M, 0, 0], mass=0.0,
                pos=np.add(corner, [0, 0, SPHERE_M]), friction=[0.7, 0.005, 0.0001], solref=[0.005, 1.0],
            )  # fmt: skip
    for sensor in settings["ft_sensor"]:
        spec.body(sensor["frame"]).add_site(name=sensor["name"])
        for kind in ("FORCE", "TORQUE"):
            spec.add_sensor(
                name=f"{sensor['name']}/{kind}", type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
                objtype=mujoco.mjtObj.mjOBJ_SITE, objname=sensor["name"],
            )  # fmt: skip
    spec.body(settings["imu"]["frame"]).add_site(name="imu")
    for kind in ("GYRO", "ACCELEROMETER"):
        spec.add_sensor(
            name=kind, type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"), objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname="imu",
        )  # fmt: skip
    # The robot touches nothing but the floor.
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = (1, 0) if geom.type == mujoco.mjtGeom.mjGEOM_PLANE else (0, 1)
    return spec.compile()


class World:
    """The robot between two periods."""

    def __init__(self, config, seed, pushed):
        settings = tomllib.loads(config.read_text())
        # Of the project's own simulation only what is no model: the pose, and where the soles are.
        placed = tomllib.loads((config.parent / "sim.toml").read_text())
        random = self.random = np.random.default_rng(seed)
        self.names = [joint["name"] for joint in settings["joint"]]
        kinds = [settings["drive"][joint["drive"]] for joint in settings["joint"]]
        root = ET.parse(config.parent / settings["robot"]["urdf"]).getroot()
        self.sensors = settings["ft_sensor"]
        self.model = model = build(root, settings, placed["foot"], self.names, kinds, random)
        self.data = data = mujoco.MjData(model)
        joints = [model.joint(name) for name in self.names]
        gears = [model.joint(f"{name}/gear") for name in self.names]
        self.rotor = np.array([joint.qposadr[0] for joint in joints])
        self.gear = np.array([joint.qposadr[0] for joint in gears])
        self.rotor_dof = np.array([joint.dofadr[0] for joint in joints])
        self.gear_dof = np.array([joint.dofadr[0] for joint in gears])
        self.brake = np.array([model.equality(f"{name}/brake").id for name in self.names])
        self.spring = model.jnt_stiffness[[joint.id for joint in gears]]
        self.pushed = model.body(pushed).id
        self.base = model.body(1).id
        self._draw(settings, kinds)
        for name, degrees in placed["start"]["joints_deg"].items():
            data.qpos[self.rotor[self.names.index(name)]] = math.radians(degrees)
        mujoco.mj_forward(model, data)
        spheres = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
        data.qpos[2] -= (data.geom_xpos[spheres, 2] - SPHERE_M).min()
        n = len(self.names)
        self.state, self.waits, self.open = np.full(n, DISABLED), np.zeros(n, int), np.zeros(n, int)
        self.on = np.zeros(n, bool)
        model.eq_data[self.brake, 0] = data.qpos[self.rotor]
        self.set_point = data.qpos[self.rotor].copy()
        self.late = [self.set_point.copy() for _ in range(LATE)]
        self.current, self.velocity, self.bend = np.zeros(n), np.zeros(n), np.zeros(n)
        self.angle = self._drive_angle()
        for _ in range(round(1.0 / SUBSTEP_S)):  # its brakes hold it while its feet come to stand
            self._step()

    def _draw(self, settings, kinds):
        """Drives, hysteresis and sensors."""
        random = self.random
        get = lambda *path: np.array([self._of(kind, path) for kind in kinds])  # noqa: E731
        self.ratio = get("gear_ratio")
        gear = get("compliance", "K_fs0_Nm_per_rad")
        k_d = 1 / (get("motor", "K_tau_rad_per_Nm") - 1 / gear)
        self.k_d = drawn(random, k_d, 0.1)
        self.d_d = drawn(random, get("motor", "K_v_s") * k_d, 0.1)
        self.dead_zone = get("motor", "dead_zone_rad")
        self.per_current = self.ratio * drawn(random, get("torque_constant_Nm_per_A"), 0.02)
        self.limit = np.array([joint["torque_limit_Nm"] for joint in settings["joint"]])
        # Bouc-Wen: a tenth of the spring beside it, up to 1.5 % of the limit.
        self.bouc_wen = 0.015 * self.limit, 0.1 * gear
        self.meshing = random.uniform(0.0, 0.06, len(kinds))
        self.offset = random.uniform(-1, 1, len(kinds)) * 0.005 * self.limit / self.per_current
        error = [joint.get("kinematic_error") for joint in settings["joint"]]
        pairs = lambda key, at: np.array([(e[key][at] if e and len(e[key]) > at else (0, 0)) for e in error])  # noqa: E731
        # What a calibration has found is 90 % of what there is.
        self.kinematic = [np.radians(pairs("link_deg", 0)) / 0.9, np.radians(pairs("motor_deg", 0)) / 0.9,
                          np.radians(pairs("motor_deg", 1)) / 0.9]  # fmt: skip
        self.counts = get("motor_counts_per_turn"), get("link_counts_per_turn")

    @staticmethod
    def _of(kind, path):
        for key in path:
            kind = kind.get(key, 0.0)
        return kind

    def _drive_angle(self):
        count = 2 * math.pi / DRIVE_COUNTS
        return np.round(self.ratio * self.data.qpos[self.rotor] / count) * count / self.ratio

    def _step(self):
        """A step of drives, gears and bodies."""
        data, h = self.data, SUBSTEP_S
        angle = self._drive_angle()
        self.velocity += h / (h + 400e-6) * ((angle - self.angle) / h - self.velocity)
        self.angle = angle
        error = self.late[0] - angle
        error -= np.clip(error, -self.dead_zone, self.dead_zone)
        # P on the angle asks for a velocity, P on its error for a current.
        wanted = self.d_d * (self.k_d / self.d_d * error - self.velocity)
        wanted = np.clip(wanted, -1.5 * self.limit, 1.5 * self.limit)
        self.current += h / (h + 100e-6) * (np.where(self.on, wanted, 0.0) / self.per_current - self.current)
        dq = data.qvel[self.gear_dof]
        most, stiff = self.bouc_wen
        bent = stiff * self.bend / most
        self.bend += h * (dq - np.abs(dq) * bent)
        carried = data.qfrc_passive[self.gear_dof]
        rotor = data.qvel[self.rotor_dof]
        data.qfrc_applied[self.gear_dof] = -stiff * self.bend
        data.qfrc_applied[self.rotor_dof] = self.per_current * self.current - self.meshing * np.abs(carried) * np.tanh(
            rotor / 0.005
        )
        mujoco.mj_step(self.model, data)

    def period(self, command):
        """One period with what was commanded at its beginning."""
        n = len(self.names)
        set_points, words, force = command[:n], command[n : 2 * n].astype(int), command[2 * n :]
        self._follow_words(words)
        self.data.xfrc_applied[self.pushed, :3] = force
        for _ in range(SUBSTEPS):
            self.late.append(np.where(self.on, set_points, self.angle))
            self.late.pop(0)
            self._step()
        mujoco.mj_forward(self.model, self.data)
        return self._answer()

    def _follow_words(self, words):
        """States by CiA 402, and the brake of a drive that is enabled for a while."""
        asked = np.full(len(words), DISABLED)
        asked[(words & 0x06) == 0x06] = READY
        asked[(words & 0x07) == 0x07] = SWITCHED_ON
        asked[(words & 0x0F) == 0x0F] = ENABLED
        order = [DISABLED, READY, SWITCHED_ON, ENABLED]
        for j in np.flatnonzero(asked != self.state):
            self.waits[j] += 1
            if self.waits[j] >= STEP:
                at, to = order.index(self.state[j]), order.index(asked[j])
                self.state[j] = order[at + 1] if to > at else asked[j]
                self.waits[j] = 0
        on = self.state == ENABLED
        self.set_point = np.where(on, self.set_point, self.angle)
        self.on = on
        self.open = np.where(on, self.open + 1, 0)
        released = self.open > RELEASE
        closes = ~released & (self.data.eq_active[self.brake] == 0)
        self.model.eq_data[self.brake[closes], 0] = self.data.qpos[self.rotor[closes]]
        self.data.eq_active[self.brake] = ~released

    def _answer(self):
        data, random = self.data, self.random
        rotor = data.qpos[self.rotor]
        theta, q = self.ratio * rotor, rotor + data.qpos[self.gear]
        (link, motor, twice), n = self.kinematic, len(self.names)
        waves = lambda pairs, x: pairs[:, 0] * np.cos(x) + pairs[:, 1] * np.sin(x)  # noqa: E731
        error = waves(link, q) + waves(motor, theta) + waves(twice, 2 * theta)
        noise = random.standard_normal((4, n))
        counts = [2 * math.pi / np.maximum(count, 1) for count in self.counts]
        current = self.current + self.offset + 0.002 * self.limit / self.per_current * noise[2]
        wrenches = [
            -np.concatenate([data.sensor(f"{s['name']}/{kind}").data for kind in ("FORCE", "TORQUE")])
            + np.repeat([0.3, 0.02], 3) * random.standard_normal(6)
            for s in self.sensors
        ]
        gyro = data.sensor("GYRO").data + 0.003 * random.standard_normal(3)
        accelerometer = data.sensor("ACCELEROMETER").data + 0.03 * random.standard_normal(3)
        torque = self.spring * data.qpos[self.gear] + self.bouc_wen[1] * self.bend
        return np.concatenate(
            [theta + 0.3 * counts[0] * noise[0], q - error + 0.5 * counts[1] * noise[1], current,
             self.ratio * self.velocity, self.state.astype(float), *wrenches, gyro, accelerometer,
             torque, data.qpos[3:7], data.qvel[3:6], data.qpos[2:3]]
        )  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("config", type=Path, help="robot.toml; sim.toml beside it has the pose and the soles")
    parser.add_argument("--seed", type=int, default=1, help="of all that is drawn")
    parser.add_argument("--pushed", default="chest_pitch_link", help="link that forces act on")
    arguments = parser.parse_args()
    world = World(arguments.config, arguments.seed, arguments.pushed)
    size = 8 * (2 * len(world.names) + 3)
    while len(data := sys.stdin.buffer.read(size)) == size:
        sys.stdout.buffer.write(world.period(np.frombuffer(data)).astype("<f8").tobytes())
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
