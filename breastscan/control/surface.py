"""The estimate of the skin under the probe: where it is, how fast it moves, how stiff it is.

An extended Kalman filter over the measured force [Bar-Shalom, Sec. 10.3]. Its state is

    x = (p, v, ln k):  position of the undeformed skin, its speed, its stiffness.

The skin moves along the probe axis at a speed that is a random walk, and so is the logarithm of its
stiffness along the path. With the period T, the process noise q of the speed and the drift d,

    x' = F x,    F = [1 T 0]    Q = [q^2 T^3/3  q^2 T^2/2    0  ]
                     [0 1 0]        [q^2 T^2/2  q^2 T        0  ]
                     [0 0 1]        [    0          0     d^2 T ]

    P' = F P F^T + Q.

The tissue's reaction to an indentation u is (k u)^(3/2), as an elastic body's to any blunt probe
[Johnson, Ch. 4]. With the tip at the depth z and the measured force f, of variance R,

    h(x) = (k (z - p))^(3/2),    H = dh/dx = [-3/2 k h^(1/3)   0   3/2 h]

    y = f - h(x')                the innovation
    S = H P' H^T + R             its variance
    K = P' H^T / S               the gain
    x = x' + K y,    P = P' - K S K^T.

The code below is this, written out: matrices of three by three cost NumPy more than a control
period has. Being a model of both, the filter does not mistake a moving skin for a soft one, as a
ratio of force to motion under a working controller would.
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
"""Force below which h is not linearised [N]: there H vanishes, and with it all that a force tells
of the skin."""


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
    """The filter's state x and its covariance P. Positions are along the probe axis from the
    planned skin, positive into the tissue.
    """

    position: float
    """Of the undeformed skin [m]."""
    speed: float
    """[m/s]"""
    log_stiffness: float
    """Of N^(2/3)/m."""
    covariance: tuple[float, float, float, float, float, float]
    """Of (position, speed, log_stiffness): upper triangle of P, row by row."""

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
        predicted = self._predicted(config, period)
        return predicted._updated(
            depth, force, max(config.noise_factor * noise, config.force_noise)
        )

    def _predicted(self, config: SurfaceConfig, period: float) -> "SkinEstimate":
        """X' = F x and P' = F P F^T + Q."""
        pp, pv, pk, vv, vk, kk = self.covariance
        q = config.process_noise**2 * period
        pp += period * (2.0 * pv + period * (vv + q / 3.0))
        pv += period * (vv + q / 2.0)
        pk += period * vk
        vv += q
        kk += config.stiffness_drift**2 * period
        position = self.position + period * self.speed
        return SkinEstimate(position, self.speed, self.log_stiffness, (pp, pv, pk, vv, vk, kk))

    def _updated(self, depth: float, force: float, deviation: float) -> "SkinEstimate":
        """X = x' + K y and P = P' - K S K^T, for a force [N] of this standard `deviation` [N]
        with the tip at `depth` [m].
        """
        stiffness = math.exp(self.log_stiffness)
        expected = (stiffness * max(depth - self.position, 0.0)) ** EXPONENT
        if max(expected, force) < MIN_FORCE:
            return self
        H_p = -EXPONENT * stiffness * max(expected, MIN_FORCE) ** (1 - 1 / EXPONENT)
        H_k = EXPONENT * expected
        pp, pv, pk, vv, vk, kk = self.covariance
        # P' H^T, whose quotient by S is the gain K
        PH_p = pp * H_p + pk * H_k
        PH_v = pv * H_p + vk * H_k
        PH_k = pk * H_p + kk * H_k
        S = H_p * PH_p + H_k * PH_k + deviation**2
        innovation = force - expected
        weighted = innovation / S
        return SkinEstimate(
            self.position + PH_p * weighted,
            self.speed + PH_v * weighted,
            self.log_stiffness + PH_k * weighted,
            (
                pp - PH_p * PH_p / S,
                pv - PH_p * PH_v / S,
                pk - PH_p * PH_k / S,
                vv - PH_v * PH_v / S,
                vk - PH_v * PH_k / S,
                kk - PH_k * PH_k / S,
            ),
        )
