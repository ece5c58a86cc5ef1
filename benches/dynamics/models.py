"""Writes robots as text that pinocchio_model.hpp reads: usage models.py FOLDER NAME=BASE=URDF...

Only Python links Pinocchio's own libraries; the timed C++ stays header-only, so that it may be
compiled for this processor. BASE is fixed or floating. Continuous joints get an angle, as ours have,
instead of its cosine and sine, and mimic joints are independent.
"""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin


def numbers(*parts):
    return " ".join(f"{x:.17g}" for part in parts for x in np.ravel(part))


def write(path, base, urdf):
    root = [pin.JointModelFreeFlyer()] if base == "floating" else []
    model = pin.buildModelFromUrdf(urdf, *root)
    data = model.createData()
    q = pin.neutral(model)
    pin.computeJointJacobians(model, data, q)
    nq = model.nv + (1 if root else 0)
    lines = [f"{model.njoints - 1} {nq} {model.nv}"]
    for i in range(1, model.njoints):
        joint, inertia, placement = model.joints[i], model.inertias[i], model.jointPlacements[i]
        kind = joint.shortname().removeprefix("JointModel")
        kind = kind.replace("RUB", "R").replace("RevoluteUnboundedUnaligned", "RevoluteUnaligned")
        axis = np.zeros(3)
        if joint.nv == 1:
            jacobian = pin.getJointJacobian(model, data, i, pin.LOCAL)[:, model.idx_vs[i]]
            axis = jacobian[:3] + jacobian[3:]
        fields = numbers(axis, placement.rotation, placement.translation, inertia.mass, inertia.lever, inertia.inertia)
        lines.append(f"{model.names[i]} {model.parents[i]} {kind} {fields}")
    path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    for robot in sys.argv[2:]:
        name, base, urdf = robot.split("=", 2)
        write(Path(sys.argv[1]) / f"{name}.txt", base, urdf)
