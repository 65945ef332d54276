"""All joint angles that bring the flange to one pose, and how sensitive the flange is there."""

import numpy as np

from breastscan.geometry import kinematics

q = np.deg2rad([0.0, -100.0, 110.0, -100.0, -90.0, 0.0])
X_BF = kinematics.forward(q)
print(f"flange at {np.round(1e3 * X_BF[:3, 3], 1)} mm")

for solution in kinematics.inverse(X_BF):
    miss = np.linalg.norm(kinematics.forward(solution)[:3, 3] - X_BF[:3, 3])
    print(f"{np.round(np.rad2deg(solution), 1)} deg, off by {1e3 * miss:.1e} mm")

step = kinematics.jacobian(q) @ np.deg2rad([0.01, 0, 0, 0, 0, 0])
print(f"an error of .01 deg in joint 1 moves the flange by {1e3 * np.linalg.norm(step[:3]):.3f} mm")
