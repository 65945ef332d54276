"""What pinocchio, a rigid-body library that shares no code with MuJoCo, makes of the arm's numbers.

    python -m tests.sim.arm.pinocchio_arm

writes tests/data/ur5e_dynamics.json anew (needs the extra `bench`), after a change of masses,
tensors or DH parameters.
"""

import json
from pathlib import Path

import numpy as np

from breastscan.geometry.kinematics import DH_A, DH_ALPHA, DH_D
from sim.arm.ur5e import JOINTS
from sim.wrist.wrench_sensor import GRAVITY_W

FILE = Path(__file__).parents[2] / "data" / "ur5e_dynamics.json"
SAMPLES = 12


def main() -> None:
    """Sample the arm at random postures and speeds."""
    import pinocchio

    model = _model(pinocchio)
    data = model.createData()
    flange = model.getFrameId("flange")
    rows = []
    rng = np.random.default_rng(0)
    for _ in range(SAMPLES):
        q, qd = rng.uniform(-np.pi, np.pi, 6), rng.uniform(-2.0, 2.0, 6)
        upper = np.triu(pinocchio.crba(model, data, q))
        rows.append({
            "q": q,
            "qd": qd,
            "mass_matrix": upper + np.triu(upper, 1).T,
            "gravity": pinocchio.computeGeneralizedGravity(model, data, q),
            "bias": pinocchio.nonLinearEffects(model, data, q, qd),
            "jacobian": pinocchio.computeFrameJacobian(
                model, data, q, flange, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
            ),
        })  # fmt: skip
    content = {"pinocchio": pinocchio.__version__, "samples": rows}
    FILE.write_text(json.dumps(content, default=np.ndarray.tolist) + "\n", encoding="utf-8")


def _model(pinocchio):
    """The arm from its DH parameters: a joint about z, then along z by d, along x by a, about x
    by alpha.
    """
    model = pinocchio.Model()
    model.gravity.linear = GRAVITY_W
    parent, placement = 0, pinocchio.SE3.Identity()
    for number, joint in enumerate(JOINTS):
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"joint{number + 1}")
        twist = pinocchio.utils.rotate("x", DH_ALPHA[number])
        placement = pinocchio.SE3(twist, np.array([DH_A[number], 0.0, DH_D[number]]))
        xx, yy, zz, xy, xz, yz = joint.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        model.appendBodyToJoint(
            parent, pinocchio.Inertia(joint.mass, np.array(joint.centre), tensor), placement
        )
    model.armature = np.array([joint.armature for joint in JOINTS])
    model.addFrame(pinocchio.Frame("flange", parent, placement, pinocchio.FrameType.OP_FRAME))
    return model


if __name__ == "__main__":
    main()
