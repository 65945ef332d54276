"""The rig of two cameras from pictures of a chessboard, which the twin takes here."""

from breastscan.vision.board import Board, find_shot
from breastscan.vision.calibration import calibrate
from sim.cameras.camera_errors import CameraConfig
from sim.cameras.shown_board import ShotConfig, ShownBoard

board = Board(columns=7, rows=5, square=0.025)
camera = CameraConfig(supersampling=2)
shown = ShownBoard(board, seed=0, config=ShotConfig(shots=18, camera=camera))
found = [find_shot(name, pair.left, pair.right, board) for name, pair in shown]
shots = [shot for shot in found if shot is not None]

result = calibrate(shots, (1280, 1024), board)
print(
    f"{len(result.shots)} of {len(found)} shots, corners missed by {result.reprojection_px:.3f} px"
)
print(f"baseline {1e3 * result.rig.baseline:.2f} mm")
for name, error in shown.scene.errors_of(result.rig).items():
    print(f"against the truth, {name}: {error:.4f}")
