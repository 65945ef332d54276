"""The supervisor's check of each measurement: is it plausible, and inside the limits of
`control.safety`?

Pure functions of (observation, memory) -> (fault, memory).
"""

import math
from dataclasses import dataclass, replace

from breastscan.control.safety import SafetyLimits
from breastscan.errors import BreastScanError, RobotError, SafetyError

MM_PER_M = 1e3


@dataclass(frozen=True)
class Observation:
    """One state of the robot, and what the controller was about."""

    time: float
    """Robot's clock [s]."""
    sample: int
    """Count of the sensor's samples."""
    wrench_P: tuple[float, ...]
    """Of the tissue on the probe, force first [N, N m]."""
    set_point: float
    """Set-point of the pressing force [N]."""
    depth: float
    """Of the tip along its axis, as commanded [m]."""
    period: float
    """Control period [s]."""


@dataclass(frozen=True)
class MonitorMemory:
    """What the supervisor remembers of the measurements."""

    time: float
    """Robot's clock at the last state [s]."""
    silent: int
    """Periods since then without a new state."""
    sample: int
    sampled: float
    """Robot's clock when the sample's count last rose [s]."""
    wrench_P: tuple[float, ...]
    changed: float
    """Robot's clock when the wrench last changed [s]."""
    changed_at: float
    """Depth of the tip then [m]."""
    depth: float
    """Depth of the tip at the last state [m]."""

    @staticmethod
    def beginning(now: Observation) -> "MonitorMemory":
        """With the first observation."""
        return MonitorMemory(
            now.time, 0, now.sample, now.time, now.wrench_P, now.time, now.depth, now.depth
        )


def check(
    now: Observation, before: MonitorMemory, limits: SafetyLimits
) -> tuple[BreastScanError | None, MonitorMemory]:
    """Check one state.

    Returns:
        Why the scan must end, or None; and the memory after it.
    """
    if now.time <= before.time:
        silent = before.silent + 1
        held = replace(before, silent=silent)
        return _silence(silent * now.period, limits), held
    fresh = now.sample != before.sample
    moved = now.wrench_P != before.wrench_P
    after = MonitorMemory(
        now.time,
        0,
        now.sample,
        now.time if fresh else before.sampled,
        now.wrench_P,
        now.time if moved else before.changed,
        now.depth if moved else before.changed_at,
        now.depth,
    )
    late = now.time - before.time - now.period
    return _lateness(late, limits) or _wrench(now, before, limits) or _standing(
        now, after, limits
    ), after


def _silence(time: float, limits: SafetyLimits) -> BreastScanError | None:
    if time <= limits.silence:
        return None
    return RobotError(
        f"no new state for {time * 1e3:.0f} ms, at most {limits.silence * 1e3:.0f} were expected: "
        "is the link to the robot up?",
        time,
    )


def _lateness(late: float, limits: SafetyLimits) -> BreastScanError | None:
    if late <= limits.lateness:
        return None
    return SafetyError(
        f"the controller missed its deadline by {late * 1e3:.0f} ms, at most "
        f"{limits.lateness * 1e3:.0f} are allowed: close other programs, or raise its priority",
        late,
    )


def _wrench(
    now: Observation, before: MonitorMemory, limits: SafetyLimits
) -> BreastScanError | None:
    """Check a wrench by itself and against the one before it."""
    fx, fy, fz, tx, ty, tz = now.wrench_P
    force, torque = math.sqrt(fx * fx + fy * fy + fz * fz), math.sqrt(tx * tx + ty * ty + tz * tz)
    if not (math.isfinite(force) and math.isfinite(torque)):
        return SafetyError(
            "the force sensor sent a number that is not finite: check its cable and power",
            now.wrench_P,
        )
    if force > limits.sensor_range:
        return SafetyError(
            f"the force sensor reads {force:.0f} N, beyond its range of {limits.sensor_range:.0f} "
            "N: is it overloaded or unplugged?",
            now.wrench_P,
        )
    if abs(fz - before.wrench_P[2]) > limits.force_step:
        return SafetyError(_jump(now, before, limits), now.wrench_P)
    highest = min(limits.force, now.set_point + limits.force_margin)
    if force > limits.force or -fz > highest:
        return SafetyError(
            f"contact force {max(-fz, force):.1f} N is above the limit of {highest:.1f} N",
            now.wrench_P,
        )
    if fz > limits.pull:
        return SafetyError(
            f"the sensor says that the tissue draws the probe in with {fz:.1f} N: tare it in the "
            "air again",
            now.wrench_P,
        )
    if torque > limits.torque:
        return SafetyError(
            f"contact torque {torque:.2f} N m is above the limit of {limits.torque:.2f} N m",
            now.wrench_P,
        )
    return None


def _jump(now: Observation, before: MonitorMemory, limits: SafetyLimits) -> str:
    """What a jump of the force tells: on its way down, a probe may have met something hard."""
    was, force = -before.wrench_P[2], -now.wrench_P[2]
    advance = now.depth - before.depth
    jumped = f"the measured force jumped from {was:.1f} to {force:.1f} N between two samples"
    if force < was or was > limits.force_step or advance <= 0.0:
        return f"{jumped}, no contact does that: check the sensor and its cable"
    stiffness = (force - was) / advance / MM_PER_M
    return (
        f"{jumped}, in which the probe came down by {advance * MM_PER_M:.2f} mm: what it met is as "
        f"stiff as {stiffness:.0f} N/mm, where tissue has about 1 and a rigid print 20. Look what "
        "lies there, and approach it more slowly (contact.phases.approach_speed); if nothing "
        "does, check the sensor and its cable"
    )


def _standing(
    now: Observation, after: MonitorMemory, limits: SafetyLimits
) -> BreastScanError | None:
    """Check whether the sensor still measures."""
    still = now.time - after.sampled
    if still > limits.frozen_time:
        return SafetyError(
            f"the force sensor has sent no new sample for {still * 1e3:.0f} ms: check its cable",
            still,
        )
    same, distance = now.time - after.changed, abs(now.depth - after.changed_at)
    if same > limits.stuck_time and distance > limits.stuck_distance:
        return SafetyError(
            f"the force sensor repeats the same wrench since {same * 1e3:.0f} ms, while the probe "
            f"moved by {distance * 1e3:.1f} mm: it is frozen",
            now.wrench_P,
        )
    return None
