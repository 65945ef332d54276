"""Scan the phantom with the twin: see it, plan a loop, follow it at constant force, and hold
everything against the truth. The run folder that it leaves, other examples read.
"""

from pathlib import Path

from breastscan import ScanConfig, scan
from breastscan.report import write
from sim import SceneConfig, Twin

with Twin(SceneConfig(), seed=0) as twin:
    result = scan(twin.robot, twin.camera, twin.cell, ScanConfig())
    result = twin.measured(result)

print(f"reconstructed points: {len(result.plan.points_B)}")
print(f"loop: {1e3 * result.plan.motion.s[-1]:.0f} mm in {result.metrics['scan_time_s']:.1f} s")
print(f"whole chain's error: {result.metrics['executed_truth_rms_mm']:.2f} mm RMS")
print(f"force: {result.trajectory.pressing_force[result.trajectory.in_loop].mean():.2f} N")

result.save(Path("out/scan"), seed=0, scene=twin.scene.config)
write(Path("out/scan"))
