"""Writes robots as text that pinocchio_model.hpp reads: usage models.py FOLDER URDF...

Only Python links Pinocchio's own libraries; the timed C++ stays header-only, so that it may be
compiled for this processor.
"""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin


def numbers(*parts):
    return " ".join(f"{x:.17g}" for part in parts for x in np.ravel(part))


def write(path, urdf):
    model = pin.buildModelFromUrdf(urdf, pin.JointModelFreeFlyer())
    data = model.createData()
    q = pin.neutral(model)
    pin.computeJointJacobians(model, data, q)
    lines = [f"{model.njoints - 1} {model.nq} {model.nv}"]
    for i in range(1, model.njoints):
        joint, inertia, placement = model.joints[i], model.inertias[i], model.jointPlacements[i]
        kind = joint.shortname().removeprefix("JointModel")
        axis = np.zeros(3)
        if joint.nv == 1:
            jacobian = pin.getJointJacobian(model, data, i, pin.LOCAL)[:, model.idx_vs[i]]
            axis = jacobian[:3] + jacobian[3:]
        fields = numbers(axis, placement.rotation, placement.translation, inertia.mass, inertia.lever, inertia.inertia)
        lines.append(f"{model.names[i]} {model.parents[i]} {kind} {fields}")
    path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    for urdf in sys.argv[2:]:
        write(Path(sys.argv[1]) / (Path(urdf).stem + ".txt"), urdf)
