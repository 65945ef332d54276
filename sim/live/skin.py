"""The skin for viewers that draw from MuJoCo's state alone: every vertex hangs on a mocap body
of its own.
"""

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from sim.room.describe import Element
from sim.tissue.hemisphere import coarser_rows, hemisphere
from sim.tissue.phantom import SKIN_RINGS, SkinMesh

COARSENING = 4
"""Rings of the fine skin to one of the live skin: 1027 vertices 6 mm apart. All of the fine one's
would be 13 MB a picture for a browser to fetch."""
PREFIX = "skin_"
"""Names of the mocap bodies begin with this."""


def live_vertices(vertices: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k 3"]:
    """Those of the fine skin's vertices that the live skin has, in the order of the mocap bodies
    behind the chest's.
    """
    return vertices[coarser_rows(SKIN_RINGS, COARSENING)]


def hang_skin(root: Element, X_BS: Float[np.ndarray, "4 4"], skin: SkinMesh) -> None:
    """Add a flex `skin`, coarser than that of pictures, whose vertices mocap bodies carry."""
    rows = coarser_rows(SKIN_RINGS, COARSENING)
    _, triangles = hemisphere(SKIN_RINGS // COARSENING)
    names = [f"{PREFIX}{row}" for row in range(len(rows))]
    for name, p_B in zip(names, se3.transform(X_BS, skin.vertices_S[rows]), strict=True):
        root.worldbody.add("body", name=name, mocap=True, pos=p_B)
    flex = root.deformable.add(
        "flex",
        name="skin",
        dim=2,
        radius=1e-5,
        material="skin",
        body=" ".join(names),
        element=triangles.ravel(),
        texcoord=skin.uv[rows].ravel(),
        elemtexcoord=triangles.ravel(),
    )
    flex.contact.set_attributes(contype=0, conaffinity=0, selfcollide="none")
