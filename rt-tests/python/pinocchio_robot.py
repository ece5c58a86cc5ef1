"""A robot in Pinocchio, random states for it, and the answers of `torquectl dynamics` to them.

The program's path is taken from TORQUECTL, or else it is the debug build's.
"""

import json
import os
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

ROOT = Path(__file__).resolve().parents[2]
TORQUECTL = Path(os.environ.get("TORQUECTL", ROOT / "target" / "debug" / "torquectl"))
EXAMPLES = Path(pin.__file__).resolve().parents[4] / "share" / "example-robot-data" / "robots"
STATES = 3


def torquectl(urdf, request, tmp_path, floating=False):
    """Runs `torquectl dynamics` on a request."""
    cases = tmp_path / "cases.json"
    cases.write_text(request if isinstance(request, str) else json.dumps(request))
    command = [TORQUECTL, "dynamics", "--urdf", urdf, *(["--floating"] if floating else []), cases]
    return subprocess.run(command, capture_output=True, text=True)


def mimics(urdf):
    """For each mimic joint: the joint at the end of its chain, ratio and offset of
    `q = ratio q_driver + offset`."""
    joints = {j.get("name"): j for j in ElementTree.parse(urdf).getroot().findall("joint")}
    moving = {name for name, j in joints.items() if j.get("type") != "fixed"}

    def resolve(name):
        mimic = joints[name].find("mimic")
        if mimic is None or mimic.get("joint") not in moving:
            return name, 1.0, 0.0
        driver, ratio, offset = resolve(mimic.get("joint"))
        multiplier = float(mimic.get("multiplier", 1))
        return driver, multiplier * ratio, multiplier * offset + float(mimic.get("offset", 0))

    resolved = {name: resolve(name) for name in moving}
    return {name: r for name, r in resolved.items() if r[0] != name}


class Robot:
    """For Pinocchio every joint is independent. `v = map v_ours` leads from our components, whose
    joints come in a shuffled order, to Pinocchio's: each is one of ours, or follows one if `mimic`."""

    def __init__(self, urdf, floating, tmp_path, mimic=False, seed=1):
        root = (pin.JointModelFreeFlyer(),) if floating else ()
        self.model = pin.buildModelFromUrdf(str(urdf), *root)
        self.data = self.model.createData()
        self.rng = np.random.default_rng(seed)
        self.base = 6 if floating else 0
        self.first = 2 if floating else 1
        self.mimics = mimics(urdf) if mimic else {}
        self.joints = [name for name in list(self.model.names)[self.first :] if name not in self.mimics]
        self.rng.shuffle(self.joints)
        self.map = self.make_map()
        self.model.armature = np.zeros(self.model.nv)
        armature = self.random_armature()
        for name, x in armature.items():
            self.model.armature[self.component(name)] = x
        links = [f.name for f in self.model.frames if f.type == pin.FrameType.BODY and f.name != "universe"]
        self.links = sorted(self.rng.choice(links, min(5, len(links)), replace=False))
        self.states = [self.random_state() for _ in range(STATES)]
        request = {
            "joints": self.joints,
            "frames": self.links,
            "armature": armature,
            "more": True,
            "cases": [s["case"] for s in self.states],
        }
        run = torquectl(urdf, request, tmp_path, floating)
        assert run.returncode == 0, run.stderr
        self.answer = json.loads(run.stdout)
        assert self.answer["joints"] == self.joints
        for state, case in zip(self.states, self.answer["cases"], strict=True):
            state["ours"] = case

    def random_armature(self):
        """Armatures of half the joints and of all that move no mass: else M is singular."""
        m = pin.crba(self.model, self.data, pin.neutral(self.model)).diagonal()
        motors = {name for name in self.joints if self.rng.random() < 0.5}
        massless = {name for name in self.joints if m[self.component(name)] < 1e-12}
        return {name: self.rng.uniform(0.01, 0.1) for name in sorted(motors | massless)}

    def component(self, joint):
        return self.model.idx_vs[self.model.getJointId(joint)]

    def make_map(self):
        columns = {name: self.base + k for k, name in enumerate(self.joints)}
        found = np.zeros((self.model.nv, self.base + len(self.joints)))
        found[: self.base, : self.base] = np.eye(self.base)
        for name in list(self.model.names)[self.first :]:
            driver, ratio, _ = self.mimics.get(name, (name, 1.0, 0.0))
            found[self.component(name), columns[driver]] = ratio
        return found

    def random_state(self):
        rng, model, n = self.rng, self.model, len(self.joints)
        angles, dq, ddq = rng.uniform(-np.pi, np.pi, n), rng.uniform(-3, 3, n), rng.uniform(-9, 9, n)
        case = {"q": list(angles), "dq": list(dq), "ddq": list(ddq)}
        base = [np.zeros(self.base) for _ in range(3)]
        q = pin.neutral(model)
        if self.base:
            quaternion = rng.normal(size=4)
            q[:3], q[3:7] = rng.uniform(-1, 1, 3), quaternion / np.linalg.norm(quaternion)
            base = [np.zeros(6), rng.uniform(-2, 2, 6), rng.uniform(-5, 5, 6)]
            case["base"] = {"p": list(q[:3]), "quat_xyzw": list(q[3:7]), "v": list(base[1]), "a": list(base[2])}
        turned, v, a = (self.map @ np.concatenate(x) for x in zip(base, (angles, dq, ddq), strict=True))
        for j in range(self.first, model.njoints):
            angle = turned[model.idx_vs[j]] + self.mimics.get(model.names[j], (None, 1.0, 0.0))[2]
            # Pinocchio represents a continuous joint by cosine and sine.
            angle = [np.cos(angle), np.sin(angle)] if model.nqs[j] == 2 else [angle]
            q[model.idx_qs[j] : model.idx_qs[j] + len(angle)] = angle
        wrenches = {link: rng.uniform(-20, 20, 6) for link in self.links[:3]}
        case["f_ext"] = {link: list(f) for link, f in wrenches.items()}
        forces = [pin.Force.Zero() for _ in range(model.njoints)]
        for link, wrench in wrenches.items():
            frame = model.frames[self.frame(link)]
            forces[frame.parentJoint] += frame.placement.act(pin.Force(wrench))
        ours_a = np.concatenate([base[2], ddq])
        return {"q": q, "v": v, "a": a, "ours_a": ours_a, "f_ext": forces, "case": case}

    def frame(self, link):
        return self.model.getFrameId(link, pin.FrameType.BODY)

    def columns(self, matrix):
        """The matrix in our components; Pinocchio returns one column as a vector."""
        return np.reshape(matrix, (-1, self.model.nv)) @ self.map


def close(ours, theirs, tolerance=1e-10):
    """True if equal within this fraction of the largest component."""
    ours, theirs = np.asarray(ours, float), np.asarray(theirs, float)
    assert ours.shape == theirs.shape
    scale = max(np.abs(theirs).max(initial=0), 1e-3)
    error = np.abs(ours - theirs).max(initial=0) / scale
    assert error < tolerance, f"relative error {error:.1e}"
