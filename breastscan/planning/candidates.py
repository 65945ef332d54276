"""The joint angles that a path's poses may have, roll by roll and branch by branch, and which limit
each of them would break.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from breastscan.geometry import kinematics, se3
from breastscan.planning.clearance import Clearance
from breastscan.planning.joint_limits import (
    VIOLATIONS,
    Corrections,
    JointPathConfig,
    correction_gains,
    elbow_down,
    violations,
)
from breastscan.planning.probe_poses import retreated
from breastscan.planning.roll_graph import ROLL_STEP, ROLLS, BlockedError, rolled

STRICTER = 1.05
"""Factor on the margins that the candidates keep, so that what is smoothed among them keeps the
margins themselves."""
ELBOW_DOWN_COST = 1e3
"""Added at each pose with the elbow down, in the graph's unit of rad^2/s: any path with the elbow
up costs less."""
WAY_COST = 1e2
"""Of the way from where the path is begun, in the graph's unit over its square [1/s]."""
ROLL = "of another roll than joints.roll_tolerance allows"
BODY = "nearer to the body than joints.body_margin with the probe or what holds it"
LIFT = "unable to lift the probe by joints.clearance"
ROOM = "nearer to itself or its surroundings than joints.collision_margin"
ARM = "nearer to the body than joints.body_margin with the arm"
CORRECTION = "too near a singularity for the fastest retreat inside the supervisor's limits"
FIRST = (*VIOLATIONS, ROLL, BODY, LIFT)
"""Why a candidate is barred, as far as all of them are looked at."""
LATER = (ROOM, ARM, CORRECTION)
"""The same, looked at only where the arm would go."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Everything that a pose is held against."""

    X_FP: Float[np.ndarray, "4 4"]
    """Probe tip in the flange."""
    config: JointPathConfig
    clearance: Clearance | None
    """What is kept clear of; None leaves that out."""
    corrections: Corrections | None
    """What is added to the plan as it is followed; None leaves that out."""

    @property
    def stricter(self) -> "Limits":
        """With greater margins."""
        config = self.config
        wider = replace(
            config,
            position_margin=STRICTER * config.position_margin,
            singularity_margin=STRICTER * config.singularity_margin,
            floor=config.floor + (STRICTER - 1.0) * abs(config.floor),
            collision_margin=STRICTER * config.collision_margin,
            body_margin=STRICTER * config.body_margin,
        )
        return replace(self, config=wider)

    def angles(self, X_BP: Float[np.ndarray, "*n 4 4"]) -> Float[np.ndarray, "*n 8 6"]:
        """Joint angles of probe poses on every branch [rad]."""
        return kinematics.inverse_branches(X_BP @ se3.inverse(self.X_FP))

    def lifted(self, X_BP: Float[np.ndarray, "*n 4 4"]) -> Float[np.ndarray, "*n 8 6"]:
        """The same with the probe lifted [rad]."""
        return self.angles(retreated(X_BP, self.config.clearance))

    def near_body(self, X_BP: Float[np.ndarray, "n 4 4"]) -> np.ndarray:
        """Where the tool comes too near to the body as the probe presses."""
        if self.clearance is None:
            return np.zeros(len(X_BP), bool)
        X_BF = retreated(X_BP, -self.config.pressed_depth) @ se3.inverse(self.X_FP)
        touched_B = np.ascontiguousarray(X_BP[:, :3, 3])
        gaps = self.clearance.tool_to_body(X_BF, touched_B, self.config.yielding)
        return np.asarray(gaps < self.config.body_margin)

    def later(
        self, q: Float[np.ndarray, "n 6"], q_lifted: Float[np.ndarray, "n 6"]
    ) -> Bool[np.ndarray, "reasons n"]:
        """Which of `LATER` each row of joint angles breaks, pressing or lifted [rad]."""
        against = np.zeros((len(LATER), len(q)), bool)
        if self.clearance is not None:
            against[0] = self.clearance(q) < self.config.collision_margin
            against[0] |= self.clearance(q_lifted) < self.config.collision_margin
            # the arm goes along as the probe presses
            margin = self.config.body_margin + self.config.pressed_depth
            against[1] = self.clearance.arm_to_body(q) < margin
        if self.corrections is not None:
            gains = correction_gains(q, self.X_FP)
            against[2] = ~self.corrections.fit(gains)
        return against

    def faults(self, X_BP: Float[np.ndarray, "n 4 4"], branch: int) -> list[str]:
        """What each pose breaks on a branch, empty where nothing."""
        q, q_lifted = self.angles(X_BP)[:, branch], self.lifted(X_BP)[:, branch]
        unable_to_lift = np.any(violations(q_lifted, self.config), axis=0)
        against = np.vstack([violations(q, self.config), self.near_body(X_BP), unable_to_lift])
        reachable = ~np.isnan(q[:, 0]) & ~np.isnan(q_lifted[:, 0])
        later = np.zeros((len(LATER), len(q)), bool)
        later[:, reachable] = self.later(q[reachable], q_lifted[reachable])
        names = (*VIOLATIONS, BODY, LIFT, *LATER)
        broken = np.vstack([against, later])
        return [next((n for n, b in zip(names, row, strict=True) if b), "") for row in broken.T]


class Candidates:
    """All rolls and branches of the poses at a path's nodes, and why each is barred."""

    def __init__(
        self,
        X_BQ: Float[np.ndarray, "n 4 4"],
        limits: Limits,
        q_before: Float[np.ndarray, "6"] | None = None,
    ) -> None:
        """Hold them against `FIRST`.

        Args:
            X_BQ: Poses at roll 0.
            limits: What they must keep, with some reserve.
            q_before: Joint angles that the path is begun from [rad]; None for wherever.
        """
        rolls = ROLL_STEP * np.arange(ROLLS)
        shape = (len(X_BQ), ROLLS)
        self.X_BP = rolled(np.repeat(X_BQ[:, None], ROLLS, axis=1), np.broadcast_to(rolls, shape))
        self.q = limits.angles(self.X_BP)
        self.q_lifted = limits.lifted(self.X_BP)
        self._limits, self._q_before = limits, q_before
        self._against = np.zeros((len(FIRST) + len(LATER), *self.q.shape[:-1]), bool)
        self._against[: len(VIOLATIONS)] = violations(self.q, limits.config)
        # half a rotation leaves the array across the path
        across = np.abs(np.angle(np.exp(2j * rolls))) / 2.0
        wrong = across > limits.config.roll_tolerance + 1e-9
        near = limits.near_body(self.X_BP.reshape(-1, 4, 4)).reshape(shape)
        self._against[FIRST.index(ROLL)] = wrong[:, None]
        self._against[FIRST.index(BODY)] = near[..., None]
        self._against[FIRST.index(LIFT)] = violations(self.q_lifted, limits.config).any(axis=0)

    @property
    def allowed(self) -> Bool[np.ndarray, "n 72 8"]:
        """Which are not barred."""
        return np.asarray(~self._against.any(axis=0))

    @property
    def cost(self) -> Float[np.ndarray, "n 72 8"]:
        """What the graph pays for each; infinite where it is barred."""
        cost = np.where(self.allowed, ELBOW_DOWN_COST * elbow_down(self.q), np.inf)
        if self._q_before is not None:
            away = np.angle(np.exp(1j * (self.q[0] - self._q_before)))
            cost[0] += np.where(self.allowed[0], WAY_COST * np.sum(away**2, axis=-1), 0.0)
        return cost

    def look_closer(self, rolls: Int[np.ndarray, "n"], branch: int) -> bool:
        """Hold what was chosen at each pose against `LATER` too; where it breaks that, all at this
        pose. Whether all that was chosen stays.
        """
        chosen = np.arange(len(self.q)), rolls, branch
        broken = self._limits.later(self.q[chosen], self.q_lifted[chosen]).any(axis=0)
        allowed = self.allowed
        for pose in np.flatnonzero(broken).tolist():
            open_ones = allowed[pose]
            self._against[len(FIRST) :, pose, open_ones] = self._limits.later(
                self.q[pose][open_ones], self.q_lifted[pose][open_ones]
            )
        return not broken.any()

    def require_open(self) -> None:
        """Every pose must have a candidate left.

        Raises:
            BlockedError: One has none; the limit that binds is named.
        """
        shut = np.flatnonzero(~self.allowed.any(axis=(1, 2)))
        if not len(shut):
            return
        X_BF = self.X_BP[shut] @ se3.inverse(self._limits.X_FP)
        excess = kinematics.reach_excess(X_BF).min(axis=1)
        worst = int(shut[np.argmax(excess)])
        where = self.where(worst)
        if excess.max() > 0.0:
            raise BlockedError(
                f"{where} is {excess.max() * 1e3:.0f} mm out of the arm's reach", shut
            )
        raise BlockedError(f"{where} has no allowed joint angles: {self._why(worst)}", shut)

    def where(self, pose: int) -> str:
        """A pose in words."""
        point_mm = np.round(self.X_BP[pose, 0, :3, 3] * 1e3).astype(int)
        return f"point {pose + 1} of {len(self.X_BP)} along the path, at {point_mm} mm in B,"

    def _why(self, pose: int) -> str:
        """Which limits bar a pose's candidates: those that do so alone come first."""
        against = self._against[:, pose].reshape(len(self._against), -1)
        alone = against & (against.sum(axis=0) == 1)
        counts = zip((*FIRST, *LATER), against.sum(axis=1), alone.sum(axis=1), strict=True)
        told = sorted(((a, n, name) for name, n, a in counts if n), reverse=True)
        first, *others = [
            f"{n} are {name}" + (f" ({a} of them that alone)" if a else "") for a, n, name in told
        ]
        return f"of {against.shape[1]} candidates {', '.join([first, *others])}"
