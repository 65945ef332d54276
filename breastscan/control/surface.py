"""The estimate of the skin under the probe: where it is, how fast it moves, how stiff it is.

An extended Kalman filter over the measured force. The tissue's reaction to an indentation u is F =
(stiffness u)^(3/2), as an elastic body's to any blunt probe [Johnson, Ch. 4]; the skin moves
along the probe axis at a speed that changes by chance. Being a model of both, the filter does not
mistake a moving skin for a soft one, as a ratio of force to motion under a working controller
would.
"""

import math
from dataclasses import dataclass

EXPONENT = 1.5
"""Of the force over the indentation [-]. The twin's own tissue has 1.47 from .5 to 8 mm."""
FIRST_POSITION = 0.5e-3
"""How far the force at first contact may be from the law of the indentation [m]."""
FIRST_SPEED = 0.01
"""Speed that the skin may have then [m/s]: twice that of breathing."""
MIN_FORCE = 0.05
"""Force below which the filter does not linearise [N]: there its slope vanishes, and with it all
that it tells."""


@dataclass(frozen=True, kw_only=True)
class SurfaceConfig:
    """How the skin is expected to behave."""

    stiffness: float = 450.0
    """Stiffness with which a contact begins [N^(2/3)/m]: 5 N press 6.5 mm deep."""
    stiffness_spread: float = 1.5
    """Its uncertainty, as a logarithm [-]: a rigid print, sixteen times as stiff, lies within two
    sigma."""
    stiffness_drift: float = 0.01
    """How fast it may change along the path, as a logarithm [1/sqrt(s)]."""
    process_noise: float = 0.012
    """Process noise: how fast the skin's speed may change [m/s/sqrt(s)]."""
    force_noise: float = 0.1
    """Least error of a force sample against the model [N]."""
    noise_factor: float = 3.0
    """By how much that of a noisy sensor is greater than its noise [-]: its samples are not
    independent."""


@dataclass(frozen=True)
class SkinEstimate:
    """The filter's state. Positions are along the probe axis from the planned skin, positive
    into the tissue.
    """

    position: float
    """Of the undeformed skin [m]."""
    speed: float
    """[m/s]"""
    log_stiffness: float
    """Of N^(2/3)/m."""
    covariance: tuple[float, float, float, float, float, float]
    """Upper triangle, row by row."""

    @staticmethod
    def at_contact(
        depth: float, force: float, stiffness: float, config: SurfaceConfig
    ) -> "SkinEstimate":
        """At first contact, with the tip at `depth` [m] and a force [N]; about so stiff
        [N^(2/3)/m].
        """
        indentation = max(force, 0.0) ** (1 / EXPONENT) / stiffness
        spread = config.stiffness_spread
        # a stiffer tissue is indented less: both errors go together
        along = indentation * spread**2
        return SkinEstimate(
            depth - indentation,
            0.0,
            math.log(stiffness),
            (along * indentation + FIRST_POSITION**2, 0.0, along, FIRST_SPEED**2, 0.0, spread**2),
        )

    @property
    def stiffness(self) -> float:
        """[N^(2/3)/m]"""
        return math.exp(self.log_stiffness)

    def indentation(self, force: float) -> float:
        """How deep a force [N] presses [m]."""
        return max(force, 0.0) ** (1 / EXPONENT) / self.stiffness

    def slope(self, force: float) -> float:
        """Force per indentation [N/m] about a force [N]."""
        return EXPONENT * self.stiffness * max(force, MIN_FORCE) ** (1 - 1 / EXPONENT)

    def after(
        self, depth: float, force: float, noise: float, config: SurfaceConfig, period: float
    ) -> "SkinEstimate":
        """One period [s] later, with the tip at `depth` [m] and a measured force [N] of that
        `noise` [N].
        """
        ss, sv, sk, vv, vk, kk = self.covariance
        position = self.position + period * self.speed
        speed = self.speed
        log_stiffness = self.log_stiffness
        process_noise = config.process_noise**2 * period
        ss += period * (2.0 * sv + period * (vv + process_noise / 3.0))
        sv += period * (vv + process_noise / 2.0)
        sk += period * vk
        vv += process_noise
        kk += config.stiffness_drift**2 * period

        stiffness = math.exp(log_stiffness)
        expected = (stiffness * max(depth - position, 0.0)) ** EXPONENT
        if max(expected, force) < MIN_FORCE:
            return SkinEstimate(position, speed, log_stiffness, (ss, sv, sk, vv, vk, kk))
        by_position = -EXPONENT * stiffness * max(expected, MIN_FORCE) ** (1 - 1 / EXPONENT)
        by_stiffness = EXPONENT * expected
        s = ss * by_position + sk * by_stiffness
        v = sv * by_position + vk * by_stiffness
        k = sk * by_position + kk * by_stiffness
        variance = (
            by_position * s
            + by_stiffness * k
            + max(config.noise_factor * noise, config.force_noise) ** 2
        )
        innovation = (force - expected) / variance
        return SkinEstimate(
            position + s * innovation,
            speed + v * innovation,
            log_stiffness + k * innovation,
            (
                ss - s * s / variance,
                sv - s * v / variance,
                sk - s * k / variance,
                vv - v * v / variance,
                vk - v * k / variance,
                kk - k * k / variance,
            ),
        )
