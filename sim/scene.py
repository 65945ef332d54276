# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The whole scene: one description, compiled once for physics and once for pictures.

The soft skin is a textured mesh whose vertices are overwritten with the deformed surface before
every picture; physics does not need it, and runs faster without it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import resources
from pathlib import Path

import cv2
import mujoco
import numpy as np
from jaxtyping import Float

from breastscan.checks import require_seed
from breastscan.errors import CalibrationError, ConfigError
from breastscan.geometry import se3
from breastscan.robot.ur.ur5e import PERIOD
from breastscan.vision.camera import StereoRig
from sim.arm.deviations import ArmConfig, calibration, true_arm
from sim.arm.servo import ServoConfig
from sim.arm.ur5e import add_arm
from sim.cameras.camera_errors import CameraConfig
from sim.cameras.lens import canvases, mujoco_camera
from sim.live.skin import hang_skin
from sim.room.chest import CHEST, add_chest
from sim.room.describe import Element, add_material, compiled, mjcf, specification
from sim.room.surroundings import (
    LIT_CENTRE,
    LIT_RADIUS,
    STANDING_ROOM_X,
    STANDING_ROOM_Y,
    add_room,
    add_stand,
)
from sim.tissue.breathing import BreathingConfig, rise
from sim.tissue.chest import ChestConfig
from sim.tissue.phantom import Phantom, PhantomConfig
from sim.wrist.probe import add_tool, tip_pose
from sim.wrist.probe_face import ProbeFace
from sim.wrist.wrench_errors import WrenchSensorConfig
from sim.wrist.wrench_sensor import GRAVITY_W

SHADOW_MAP_PX = 2048
KEPT_ASSETS = 30_000_000
"""What is kept for the next scene of this process, the latest skin among it [byte]."""
HOME_Q = np.deg2rad([180.0, -135.0, 120.0, -75.0, -90.0, 0.0])
"""Joint angles [rad] with the arm parked over its base, out of both cameras' view of the
phantom."""
LOOKED_AT = 60
"""Points of the half-height loop that must lie in both pictures."""
SEEDED = ("phantom", "arm", "camera", "wrist")
"""Parts of a scene that are drawn."""
LARGEST_MOUNT_ANGLE = np.deg2rad(90.0)


@dataclass(frozen=True, kw_only=True)
class SceneConfig:
    """What stands where, and how well the sensors see it."""

    phantom: PhantomConfig = field(default_factory=PhantomConfig)
    p_BS: tuple[float, float, float] = (0.50, 0.0, 0.08)
    """Centre of the breast's base in the robot's base frame, at the end of an exhalation [m]."""
    chest: ChestConfig = field(default_factory=ChestConfig)
    breathing: BreathingConfig = field(default_factory=BreathingConfig)
    rig: Path | None = None
    """Rig file with `X_BL`; None for the one that comes with the package."""
    mount_angle: float = np.pi / 4
    """Angle between the probe's axis and the flange's [rad]."""
    arm: ArmConfig = field(default_factory=ArmConfig)
    servo: ServoConfig = field(default_factory=ServoConfig)
    wrist: WrenchSensorConfig = field(default_factory=WrenchSensorConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)

    def __post_init__(self) -> None:
        for name in SEEDED:
            require_seed(getattr(self, name).seed, f"scene.{name}.seed")
        p = np.array(self.p_BS, float)
        if p.shape != (3,) or not np.isfinite(p).all():
            raise ConfigError(
                f"p_BS must be three finite lengths in metres, got {self.p_BS}", self.p_BS
            )
        (left, right), (near, far) = STANDING_ROOM_X, STANDING_ROOM_Y
        if not (left <= p[0] <= right and near <= p[1] <= far):
            raise ConfigError(
                f"the phantom must stand on the table beside robot and stand, x in {left} .. "
                f"{right} m and y in {near} .. {far} m, got {self.p_BS}: the default (0.50, 0, "
                "0.08) suits the arm best",
                self.p_BS,
            )
        if p[2] <= 0:
            raise ConfigError(
                f"the chest plate must lie above the table (z > 0), got z = {p[2]} m", self.p_BS
            )
        if not 0 <= self.mount_angle <= LARGEST_MOUNT_ANGLE:
            raise ConfigError(
                f"mount_angle must lie in 0 .. pi/2 rad, got {self.mount_angle}", self.mount_angle
            )

    def seeded(self, seed: int) -> "SceneConfig":
        """The scene with what has no seed of its own drawn from one: phantom, arm, cameras, sensor.

        Raises:
            ConfigError: The seed is negative.
        """
        require_seed(seed)
        parts = {name: getattr(self, name) for name in SEEDED}
        unset = {
            name: replace(part, seed=seed) for name, part in parts.items() if part.seed is None
        }
        return replace(self, **unset)


class Scene:
    """The described scene and its two compiled models; each is compiled when first asked for."""

    def __init__(self, config: SceneConfig | None = None) -> None:
        """Place everything; nothing is built yet.

        Raises:
            ConfigError: The phantom's shape is impossible, or the cameras do not see it.
            CalibrationError: The rig's file cannot be used.
        """
        self.config = config or SceneConfig()
        self.phantom = Phantom(self.config.phantom, self.config.chest.curvature)
        self.rig, self.X_BL = _load_rig(self.config.rig)
        """The rig as it was built, and where it stands: the truth that calibration looks for."""
        self.X_BR = self.X_BL @ se3.inverse(self.rig.X_RL)
        self.X_BS = se3.pose(self.config.chest.R_BS, np.array(self.config.p_BS, float))
        """The phantom at the end of an exhalation."""
        self._require_visible()
        self.X_FP = tip_pose(self.config.mount_angle)
        self.arm = true_arm(self.config.arm)
        """Where the simulated arm's axes lie."""
        self.calibration = calibration(self.config.arm)
        """And where the robot says that they lie."""

    def X_BS_at(self, time: float) -> Float[np.ndarray, "4 4"]:
        """The phantom at `time` [s] of the robot's clock."""
        X_BS = self.X_BS.copy()
        X_BS[:3, 3] += rise(self.config.breathing, time) * X_BS[:3, 2]
        return X_BS

    def _require_visible(self) -> None:
        """Refuse a phantom whose half-height loop, which a scan follows, lies outside of a
        picture.
        """
        loop_B = se3.transform(
            self.X_BS, self.phantom.level_loop(self.phantom.height / 2, LOOKED_AT)
        )
        for name, camera, X_BC in (
            ("left", self.rig.left, self.X_BL),
            ("right", self.rig.right, self.X_BR),
        ):
            loop_C = se3.transform(se3.inverse(X_BC), loop_B)
            image = cv2.projectPoints(
                loop_C, np.zeros(3), np.zeros(3), camera.K, camera.distortion
            )[0][:, 0]
            inside = (
                (loop_C[:, 2] > 0)
                & (image > 0).all(axis=1)
                & (image < (camera.width, camera.height)).all(axis=1)
            )
            if not inside.all():
                raise ConfigError(
                    f"the {name} camera sees {100 * inside.mean():.0f} % of the breast's "
                    "half-height loop, and a scan needs all of it: move the phantom (p_BS = "
                    f"{self.config.p_BS}), make it smaller, or give a rig that looks at it",
                    self.config.p_BS,
                )

    @cached_property
    def physics(self) -> mujoco.MjModel:
        """The model that is simulated."""
        return compiled(self._describe(with_skin=False))

    @cached_property
    def pictures(self) -> mujoco.MjModel:
        """The model that is drawn: with the skin as flex `skin` and the rig's cameras `left` and
        `right`.
        """
        root = self._describe(with_skin=True)
        drawn = canvases(self.rig, self.config.camera.supersampling)
        for side, X_BC in (("left", self.X_BL), ("right", self.X_BR)):
            root.worldbody.add("camera", name=side, **mujoco_camera(drawn[side], X_BC))
        # MuJoCo keeps what it has read, for which the arm's meshes are grateful; the skins of all
        # breasts would be half a gigabyte
        mujoco.mj_setCacheCapacity(mujoco.mj_getCache(), KEPT_ASSETS)
        spec = specification(root)
        self._add_skin(spec)
        return spec.compile()

    @cached_property
    def live(self) -> mujoco.MjModel:
        """The model that a viewer shows: a viewer gets the state alone, so the skin hangs on
        mocap bodies.
        """
        root = self._describe(with_skin=True)
        hang_skin(root, self.X_BS, self.phantom.skin)
        return compiled(root)

    def _describe(self, *, with_skin: bool) -> Element:
        root: Element = mjcf.RootElement(model="breastscan")
        root.compiler.angle = "radian"
        # Explicit damping: the speeds then change as the accelerations say that the wrist sensor's
        # forces come from.
        root.option.set_attributes(timestep=PERIOD, gravity=GRAVITY_W, integrator="Euler")
        root.option.flag.set_attributes(autoreset="disable", eulerdamp="disable")
        root.statistic.set_attributes(extent=LIT_RADIUS, center=LIT_CENTRE)
        root.visual.map.set_attributes(znear=0.02, zfar=20)
        root.visual.quality.shadowsize = SHADOW_MAP_PX
        root.visual.headlight.set_attributes(
            ambient=(0.32, 0.32, 0.33), diffuse=(0.08, 0.08, 0.08), specular=(0, 0, 0)
        )
        add_room(root)
        add_stand(root, self.X_BL, self.X_BR)
        add_tool(add_arm(root, self.arm), self.config.mount_angle, ProbeFace())
        add_chest(
            root,
            self.X_BS,
            self.phantom.curvature,
            self.phantom.plate_texture() if with_skin else None,
        )
        if with_skin:
            add_material(root, "skin", image=self.phantom.texture_image())
        return root

    def _add_skin(self, spec: mujoco.MjSpec) -> None:
        """The skin as a thin, massless, matt surface that touches nothing; as numbers, since to
        write and read them as text would take longer than all the rest.
        """
        skin = self.phantom.skin
        spec.add_flex(
            name="skin", dim=2, radius=1e-5, material=["skin"], vertbody=[CHEST],
            vert=skin.vertices_S.ravel(), elem=skin.triangles.ravel(),
            texcoord=skin.uv.ravel(), elemtexcoord=skin.triangles.ravel(),
            contype=0, conaffinity=0, selfcollide=mujoco.mjtFlexSelf.mjFLEXSELF_NONE,
        )  # fmt: skip


def _load_rig(path: Path | None) -> tuple[StereoRig, Float[np.ndarray, "4 4"]]:
    rig = StereoRig.load(path or Path(str(resources.files("assets") / "rig.yaml")))
    if rig.X_BL is None:
        raise CalibrationError(
            f"{path} holds no X_BL: the twin must know where its cameras stand", path
        )
    return rig, rig.X_BL
