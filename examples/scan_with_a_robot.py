"""The scan of `scan_the_twin.py` with a UR5e on the network, in the air: robot and cell are others,
the rest is the same. Before this, read docs/hardware.md; `breastscan twin` in another terminal
takes the robot's place.
"""

import sys
from pathlib import Path

from breastscan import Cell, ScanConfig, scan
from breastscan.camera.choice import open_camera
from breastscan.planning.pattern import PatternConfig
from breastscan.robot.ur import preflight
from breastscan.scan import PlanningConfig

SHORT_LOOP = ScanConfig(planning=PlanningConfig(pattern=PatternConfig(height_fraction=0.85)))


def main(host: str) -> None:
    """Look, plan, travel."""
    cell = Cell.load(Path("out/scan/cell.json"))
    print(f"software {preflight.examine(host).version}")
    with preflight.opened(cell.rtde(host)) as robot:
        camera = open_camera("folder:out/scan")
        result = scan(robot, camera, cell, SHORT_LOOP, in_air=True)

    length_mm, log = 1e3 * result.plan.motion.s[-1], result.trajectory
    print(f"{length_mm:.0f} mm in the air, {log.elapsed[-1]:.1f} s, touched: {log.contact.any()}")


if __name__ == "__main__":  # the link lives in a process of its own, which imports this file again
    main(sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1")
