"""What a rig file says, in its tool's own words brought to one."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

LENGTHS = (4, 5, 8, 12, 14)
"""How many coefficients the lens of Brown and Conrady has in OpenCV: k1, k2, p1, p2, and up to k3;
k4, k5, k6; s1 to s4; tau_x, tau_y."""

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Of each unit that lengths are given in."""


@dataclass(frozen=True, kw_only=True)
class FoundCamera:
    """One camera."""

    K: Float[np.ndarray, "3 3"]
    """[px]"""
    distortion: Float[np.ndarray, "k"]
    """In OpenCV's order."""
    size: tuple[int, int] | None = None
    """Width and height [px]; None where the file does not say."""
    fisheye: bool = False
    """Whether the lens is OpenCV's equidistant one, with four coefficients."""


@dataclass(frozen=True, kw_only=True)
class FoundRig:
    """Both cameras, and the left one's place in the right."""

    tool: str
    """That writes such files."""
    left: FoundCamera
    right: FoundCamera
    R_RL: Float[np.ndarray, "3 3"]
    p_RL: Float[np.ndarray, "3"]
    """In `unit`."""
    unit: float | None = None
    """Metres; None where the file does not say."""
    X_BL: Float[np.ndarray, "4 4"] | None = None
    """Place of the left camera in the robot's base [m], where it is known."""


def array(value: Any, shape: tuple[int, ...] | None, name: str) -> np.ndarray:
    """A value as finite numbers of a shape.

    Args:
        value: From a file.
        shape: None for so many numbers in a row.
        name: What the file calls it.

    Raises:
        ValueError: It is not.
    """
    try:
        found = np.array(value, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} holds no numbers") from error
    if shape is None:
        found = found.ravel()
    elif found.size == np.prod(shape) and found.squeeze().ndim <= 1:  # a row, or a column
        found = found.reshape(shape)
    if shape is not None and found.shape != shape:
        raise ValueError(f"{name} of shape {shape} is missing: it has {found.shape}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name} holds a number that is not finite")
    return found


def coefficients(value: Any, name: str) -> np.ndarray:
    """A lens's distortion, of as many coefficients as OpenCV knows.

    Raises:
        ValueError: It has another number of them.
    """
    found = array(value, None, name)
    if len(found) not in LENGTHS:
        raise ValueError(
            f"{name} has {len(found)} coefficients, and lenses have {', '.join(map(str, LENGTHS))}"
        )
    return np.pad(found, (0, 1)) if len(found) == 4 else found


def size(width: Any, height: Any, name: str) -> tuple[int, int]:
    """Width and height of a picture [px].

    Raises:
        ValueError: They are no positive whole numbers.
    """
    try:
        found = int(width), int(height)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} is no size of a picture") from error
    if min(found) < 1 or found != (width, height):
        raise ValueError(f"{name} is missing or not a positive whole number")
    return found
