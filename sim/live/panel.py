# pyright: reportAttributeAccessIssue=false, reportArgumentType=false
# (MuJoCo's compiled modules carry no types)
"""The panel beside the live scene: pace, force, depth, path and pictures. It runs on the
viewer's thread.
"""

import mujoco
import numpy as np
from jaxtyping import Float, UInt8
from mujoco.studio import ux
from mujoco.studio.dear_imgui import dear_imgui as imgui
from mujoco.studio.implot import implot
from mujoco.studio.messages import BuildGuiEvent, PostModelEvent, UpdateEvent, handler
from mujoco.studio.plugin import ViewerInitEvent, ViewerPlugin

from sim.cameras.video import Viewpoint
from sim.live.messages import START, PaceSnapshot, PicturesSnapshot, PlanEvent, ScanSnapshot
from sim.room.describe import COLLISION_GROUP

WIDTH_PX = 380
FORCE_TOP, DEPTH_TOP = 8.0, 10.0
"""Top of the plots [N, mm]: where a scan would be ended, and where the tissue's linear elasticity
is left."""
PLOTTED_TIME = 15.0
"""The latest part of a scan that the plots show [s]."""
SLOWEST, FASTEST = 0.1, 10.0
MARGIN_MM, PLOT_ASPECT = 10.0, 2.6
"""Around the path in its plot, which is so much wider than high."""
OUTLOOK = Viewpoint(
    target_B=(0.55, 0.12, 0.22), distance=1.25, azimuth_deg=140.0, elevation_deg=-24.0
)
"""Where the user looks from at first: the breast, left of the panel."""
LOOP_RADIUS, ARROW_RADIUS = 0.0008, 0.004
ARROW_LENGTH = 0.02
"""Length of the arrow along the probe for each newton [m]."""
ARROW_OFFSET = 0.035
"""Of the arrow from the probe's axis, so that it is not hidden inside [m]."""
LOOP_COLOUR, ARROW_COLOUR = (0.10, 0.45, 0.85, 1.0), (0.90, 0.25, 0.15, 1.0)


class Panel(ViewerPlugin):
    """Shows what the scan tells, and tells the scan how fast the user wants it."""

    def __init__(self, force: float) -> None:
        """Show an empty panel.

        Args:
            force: Set-point of the contact force, drawn beside the measured one [N].
        """
        self._force = force
        self._pace = START
        self._scan: ScanSnapshot | None = None
        self._loop_B: Float[np.ndarray, "n 3"] = np.zeros((0, 3))
        self._loop_geoms: list[mujoco.MjvGeom] = []
        self._textures = {"left": 0, "right": 0}
        self._sizes = {"left": (1, 1), "right": (1, 1)}

    @handler
    def on_viewer_init(self, _: ViewerInitEvent) -> None:
        """Light colours, on which the plots are easy to read."""
        ux.setup_theme(ux.GuiTheme.LIGHT)

    @handler
    def on_post_model(self, _: PostModelEvent) -> None:
        """Hide what is not to be seen, and look at the breast."""
        options = self.viewer.vis_options
        options.geomgroup[COLLISION_GROUP] = 0
        options.sitegroup[:] = 0
        options.flags[mujoco.mjtVisFlag.mjVIS_FLEXSKIN] = 1
        start, camera = OUTLOOK.camera(), self.viewer.camera
        camera.type, camera.lookat[:] = start.type, start.lookat
        camera.distance = start.distance
        camera.azimuth = start.azimuth
        camera.elevation = start.elevation

    @handler
    def on_scan(self, scan: ScanSnapshot) -> None:
        """Keep the latest."""
        self._scan = scan

    @handler
    def on_plan(self, plan: PlanEvent) -> None:
        """Lay the path over the scene."""
        self._loop_B = plan.loop_B
        ends = zip(plan.loop_B, np.roll(plan.loop_B, -1, axis=0), strict=True)
        self._loop_geoms = [
            _rod(mujoco.mjtGeom.mjGEOM_CAPSULE, LOOP_RADIUS, *pair, LOOP_COLOUR) for pair in ends
        ]

    @handler
    def on_pictures(self, pictures: PicturesSnapshot) -> None:
        """Hand the cameras' pictures to the graphics."""
        for side in self._textures:
            self._upload(side, getattr(pictures, side))

    def _upload(self, side: str, grey: UInt8[np.ndarray, "h w"]) -> None:
        height, width = grey.shape
        self._sizes[side] = (width, height)
        rgba = np.dstack([grey, grey, grey, np.full_like(grey, 255)]).tobytes()
        self._textures[side] = self.viewer.upload_image(
            self._textures[side], rgba, width, height, 4
        )

    @handler
    def on_update(self, _: UpdateEvent) -> None:
        """Before every picture: the mouse, the pace, path and force over the scene."""
        io = imgui.GetIO()
        # a browser moves the camera itself
        if self.viewer.client_camera is None and not io.WantCaptureMouse:
            ux.move_camera_with_mouse(self.viewer.model, self.viewer.camera, False)
        pause = self._pace.paused
        if not io.WantCaptureKeyboard and imgui.IsKeyPressed(imgui.Key.Space):
            pause = not pause
        self._set_pace(PaceSnapshot(paused=pause, speed=self._pace.speed))
        arrow = [] if self._scan is None or len(self._scan.force) == 0 else _arrow(self._scan)
        self.viewer.extra_geoms[:] = self._loop_geoms + arrow

    def _set_pace(self, pace: PaceSnapshot) -> None:
        if pace != self._pace:
            self._pace = pace
            self.viewer.send_to_sim(pace)

    @handler
    def on_build_gui(self, _: BuildGuiEvent) -> None:
        """The panel along the right edge."""
        display = imgui.GetIO().DisplaySize
        imgui.SetNextWindowPos(imgui.Vec2(display.x - WIDTH_PX, 0.0))
        imgui.SetNextWindowSize(imgui.Vec2(WIDTH_PX, display.y))
        flags = imgui.WindowFlags
        fixed = (
            int(flags.NoMove)
            | int(flags.NoResize)
            | int(flags.NoTitleBar)
            | int(flags.NoSavedSettings)
        )
        if imgui.Begin("Scan", flags=fixed)[0]:
            self._build_pace_gui()
            if self._scan is not None:
                self._build_progress_gui(self._scan)
                self._build_history_gui(self._scan)
                self._build_path_gui(self._scan)
                self._build_pictures_gui()
                self._build_results_gui(self._scan)
        imgui.End()

    def _build_pace_gui(self) -> None:
        paused, speed = self._pace.paused, self._pace.speed
        if imgui.Button("Run###Pause" if paused else "Pause###Pause", imgui.Vec2(70, 0)):
            paused = not paused
        imgui.SetItemTooltip("Space does the same.")
        imgui.SameLine()
        imgui.SetNextItemWidth(-1)
        logarithmic = int(imgui.SliderFlags.Logarithmic)
        _, speed = imgui.SliderFloat(
            "##speed", speed, SLOWEST, FASTEST, "%.1f x real time", logarithmic
        )
        self._set_pace(PaceSnapshot(paused=paused, speed=speed))

    def _build_progress_gui(self, scan: ScanSnapshot) -> None:
        clock = f"{scan.time[-1]:.1f} s" if len(scan.time) else ""
        imgui.ProgressBar(scan.fraction, imgui.Vec2(-1, 0), f"{scan.stage}  {clock}")

    def _build_history_gui(self, scan: ScanSnapshot) -> None:
        now = float(scan.time[-1]) if len(scan.time) else 0.0
        recent = scan.time > now - PLOTTED_TIME
        time = scan.time[recent]
        span = (now - PLOTTED_TIME, now)
        set_point = ((span[0], span[1]), (self._force, self._force))
        if _begin_plot("contact force [N]", 110, span, (-0.5, FORCE_TOP)):
            implot.PlotLine("set-point", *set_point)
            implot.PlotLine("measured", time, scan.force[recent])
            implot.EndPlot()
        if _begin_plot("depth [mm]", 95, span, (-0.5, DEPTH_TOP)):
            implot.PlotLine("indentation", time, scan.depth_mm[recent])
            implot.EndPlot()

    def _build_path_gui(self, scan: ScanSnapshot) -> None:
        """The path from above, and where the probe is."""
        if len(self._loop_B) == 0:
            return
        if not implot.BeginPlot("path from above [mm]", imgui.Vec2(-1, 170), _plain()):
            return
        closed = np.vstack([self._loop_B, self._loop_B[:1]])[:, :2] * 1e3
        half = np.ptp(closed, axis=0).max() / 2 + MARGIN_MM
        (left, low), (right, high) = (
            closed.mean(axis=0) + side * half * np.array([PLOT_ASPECT, 1]) for side in (-1, 1)
        )
        implot.SetupAxes("", "", 0, 0)
        implot.SetupAxisLimits(int(implot.Axis.X1), left, right, int(implot.Cond.Always))
        implot.SetupAxisLimits(int(implot.Axis.Y1), low, high, int(implot.Cond.Always))
        implot.PlotLine("planned", closed[:, 0], closed[:, 1])
        x, y, _ = scan.X_BP[:3, 3] * 1e3
        implot.PlotScatter("probe", [x], [y])
        implot.EndPlot()

    def _build_pictures_gui(self) -> None:
        """Both cameras side by side."""
        width = (imgui.GetContentRegionAvail().x - 8) / 2
        for side, texture in self._textures.items():
            if texture == 0:
                continue
            across, down = self._sizes[side]
            imgui.Image(texture, imgui.Vec2(width, width * down / across))
            if side == "left":
                imgui.SameLine()

    def _build_results_gui(self, scan: ScanSnapshot) -> None:
        for name, value in scan.results:
            imgui.TextUnformatted(f"{name}: {value}")


def _begin_plot(title: str, height: float, x: tuple[float, float], y: tuple[float, float]) -> bool:
    if not implot.BeginPlot(title, imgui.Vec2(-1, height), _plain()):
        return False
    implot.SetupAxes("", "", int(implot.AxisFlags.NoTickLabels), 0)
    always = int(implot.Cond.Always)
    implot.SetupAxisLimits(int(implot.Axis.X1), *x, always)
    implot.SetupAxisLimits(int(implot.Axis.Y1), *y, always)
    return True


def _plain() -> int:
    return int(implot.Flags.NoLegend) | int(implot.Flags.NoInputs) | int(implot.Flags.NoMouseText)


def _rod(
    shape: mujoco.mjtGeom,
    radius: float,
    start: Float[np.ndarray, "3"],
    end: Float[np.ndarray, "3"],
    colour: tuple[float, float, float, float],
) -> mujoco.MjvGeom:
    """A shape from `start` to `end` [m] that is only seen."""
    geom = mujoco.MjvGeom()
    rgba = np.array(colour, np.float32)
    mujoco.mjv_initGeom(geom, int(shape), np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
    mujoco.mjv_connector(geom, int(shape), radius, start, end)
    return geom


def _arrow(scan: ScanSnapshot) -> list[mujoco.MjvGeom]:
    """The contact force on the probe, beside its tip so that both are seen; none where nothing
    touches.
    """
    force = float(scan.force[-1])
    if force < 0.2:
        return []
    across_B = scan.X_BP[:3, 1]
    axis_B = scan.X_BP[:3, 2]
    tip_B = scan.X_BP[:3, 3]
    start_B = tip_B + ARROW_OFFSET * across_B
    end_B = start_B - ARROW_LENGTH * force * axis_B
    return [_rod(mujoco.mjtGeom.mjGEOM_ARROW, ARROW_RADIUS, start_B, end_B, ARROW_COLOUR)]
