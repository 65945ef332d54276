# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""Do the drawn cameras see points where OpenCV's camera model projects them?

A tilted board of soft dots is drawn as the twin draws everything. The detector is the dots' centre
of gravity; where it should lie follows from `cv2.projectPoints` alone, integrated over each dot.
Soft dots leave no jagged edges to measure.
"""

from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from jaxtyping import Float, Float32, UInt8

from breastscan.geometry import se3
from breastscan.vision.camera import Intrinsics, StereoRig
from sim.cameras.camera_errors import CameraErrors
from sim.cameras.lens import Lens, canvases, mujoco_camera
from sim.cameras.picture import open_renderer
from sim.room.describe import Element, add_material, mjcf

X_WC = se3.from_rotation_vector(np.array([2.9, 0.1, -0.2]), np.array([0.1, 0.2, 0.7]))
"""Some camera, aligned with nothing."""
X_CBoard = se3.from_rotation_vector(np.array([0.15, 0.25, 0.0]), np.array([0.0, 0.0, 0.55]))
BOARD_SIDE = 1.8
"""[m]"""
TEXTURE_PX = 4096
DOT_SIGMA = 2.2e-3
"""Width of a dot [m]: 2.7 px in the centre of the image."""
DOT_REACH = 4.5
"""Where a dot ends [sigmas]."""
SPACING_PX = 40
MARGIN_PX = 18
JITTER_PX = 2.0
"""Of the dots in the image: the outermost are just whole. The jitter puts them on all fractions of
a pixel."""
WINDOW_PX = 13
"""Half the side of what the detector sees."""
CORNER_FRACTION = 0.85
"""Fraction of the outermost dot's radius beyond which a dot is in a corner."""


@dataclass(frozen=True, kw_only=True)
class ProjectionErrors:
    """Where the dots were seen."""

    error_px: Float[np.ndarray, "n 2"]
    """Seen minus expected."""
    corner: np.ndarray
    """Whether a dot lies in a corner of the image."""

    @property
    def mean_px(self) -> float:
        """Length of the mean error [px]."""
        return float(np.linalg.norm(self.error_px.mean(axis=0)))

    @property
    def corner_rms_px(self) -> float:
        """RMS error in the corners [px]."""
        return float(np.sqrt((self.error_px[self.corner] ** 2).sum(axis=1).mean()))


def measure(rig: StereoRig, side: str, *, supersampling: int, seed: int) -> ProjectionErrors:
    """Draw the board for the camera `side` of a rig and look for its dots."""
    camera: Intrinsics = getattr(rig, side)
    dots = _dots(camera, np.random.default_rng(seed))
    expected = np.array([_expected(dot, camera) for dot in dots])
    image = _image(rig, side, _texture(dots), supersampling)
    error = np.array([_centre(image, around) for around in expected]) - expected
    radius = np.linalg.norm(expected - camera.K[:2, 2], axis=1)
    return ProjectionErrors(error_px=error, corner=radius > CORNER_FRACTION * radius.max())


def _dots(camera: Intrinsics, rng: np.random.Generator) -> Float[np.ndarray, "n 2"]:
    """Places on the board [m] that lie on a grid over the image, as far as the lens lets whole
    dots in.
    """
    axes = (
        np.linspace(MARGIN_PX, size - 1 - MARGIN_PX, round(size / SPACING_PX))
        for size in (camera.width, camera.height)
    )
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    pixels = grid + rng.uniform(-JITTER_PX, JITTER_PX, grid.shape)
    rays = np.column_stack(
        [
            cv2.undistortPoints(pixels[:, None], camera.K, camera.distortion)[:, 0],
            np.ones(len(grid)),
        ]
    )
    X_BoardC = se3.inverse(X_CBoard)
    origin, towards = X_BoardC[:3, 3], se3.rotate(X_BoardC, rays)
    places = (origin - origin[2] / towards[:, 2:] * towards)[:, :2]
    returned = np.array([_expected(place, camera) for place in places])
    # beyond the lens' field no ray comes back
    seen = np.linalg.norm(returned - pixels, axis=1) < 1.0
    inside = np.abs(places).max(axis=1) < BOARD_SIDE / 2 - DOT_REACH * DOT_SIGMA
    rim = np.linalg.norm((pixels - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]], axis=1)
    return places[seen & inside & (rim < rim[seen].max() - MARGIN_PX / camera.K[0, 0])]


def _expected(dot: Float[np.ndarray, "2"], camera: Intrinsics) -> Float[np.ndarray, "2"]:
    """Centre of gravity [px] of a dot's image: its brightness and the area that it covers,
    summed over the dot.
    """
    steps = np.linspace(-DOT_REACH, DOT_REACH, 31) * DOT_SIGMA
    x, y = np.meshgrid(steps, steps)
    board = np.stack([x + dot[0], y + dot[1], np.zeros_like(x)], axis=-1).reshape(-1, 3)
    pixels = cv2.projectPoints(
        se3.transform(X_CBoard, board), np.zeros(3), np.zeros(3), camera.K, camera.distortion
    )[0].reshape(*x.shape, 2)  # fmt: skip
    (down, across) = np.gradient(pixels, axis=(0, 1))
    area = np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0])
    weight = np.exp(-0.5 * (x**2 + y**2) / DOT_SIGMA**2) * area
    return (pixels * weight[..., None]).sum(axis=(0, 1)) / weight.sum()


def _texture(dots: Float[np.ndarray, "n 2"]) -> UInt8[np.ndarray, "t t 3"]:
    """The board's picture; row 0 is the edge of smallest y."""
    pitch = BOARD_SIDE / TEXTURE_PX
    reach = int(DOT_REACH * DOT_SIGMA / pitch)
    grey = np.zeros((TEXTURE_PX, TEXTURE_PX), np.float32)
    for place in (dots + BOARD_SIDE / 2) / pitch - 0.5:
        column, row = np.rint(place).astype(int)
        y, x = np.mgrid[row - reach : row + reach + 1, column - reach : column + reach + 1]
        squared = ((x - place[0]) ** 2 + (y - place[1]) ** 2) * pitch**2
        grey[y, x] += np.exp(-0.5 * squared / DOT_SIGMA**2)
    return np.repeat(np.rint(255 * np.clip(grey, 0, 1)).astype(np.uint8)[..., None], 3, axis=2)


def _image(
    rig: StereoRig, side: str, texture: UInt8[np.ndarray, "t t 3"], supersampling: int
) -> Float32[np.ndarray, "h w"]:
    """The glowing board as the twin's camera sees it, without any other error."""
    root: Element = mjcf.RootElement()
    root.visual.map.znear = 0.01
    root.visual.headlight.set_attributes(ambient=(0, 0, 0), diffuse=(0, 0, 0), specular=(0, 0, 0))
    add_material(root, "board", image=texture).emission = 0.9
    half = BOARD_SIDE / 2
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    box_W = se3.transform(X_WC @ X_CBoard, np.vstack([corners, corners + np.array([0, 0, 0.01])]))
    root.asset.add(
        "mesh",
        name="board",
        inertia="shell",
        vertex=box_W.ravel(),
        face=[0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7],
        texcoord=np.tile(corners[:, :2] / BOARD_SIDE + 0.5, (2, 1)).ravel(),
    )
    root.worldbody.add("geom", type="mesh", mesh="board", material="board")
    canvas = canvases(rig, supersampling)[side]
    root.worldbody.add("camera", name="camera", **mujoco_camera(canvas, X_WC))
    model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with open_renderer(model, canvas.width, canvas.height) as renderer:
        renderer.update_scene(data, "camera")
        return Lens(getattr(rig, side), canvas, supersampling, CameraErrors()).bend(
            renderer.render()
        )


def _centre(
    image: Float32[np.ndarray, "h w"], around: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "2"]:
    """Centre of gravity [px] of what is bright about a pixel."""
    column, row = np.rint(around).astype(int)
    top, left = max(row - WINDOW_PX, 0), max(column - WINDOW_PX, 0)
    patch = image[top : row + WINDOW_PX + 1, left : column + WINDOW_PX + 1].astype(float)
    patch = np.clip(patch - 1, 0, None)
    y, x = np.indices(patch.shape)
    return np.array([left + (patch * x).sum() / patch.sum(), top + (patch * y).sum() / patch.sum()])
