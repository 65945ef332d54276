"""Conjugate gradients for quadratic finite elements, with the linear elements as their coarse
level.
"""

from typing import Any

import numpy as np
import scipy.sparse
from jaxtyping import Float
from scipy.sparse.linalg import LinearOperator, cg, splu

REDUCTION = 1e-3
"""Fraction of the right-hand side that is left: an inexact Newton step needs no more [-]."""
SMOOTHING = 4
"""Degree of the Chebyshev polynomial before and after the coarse level."""
SPECTRUM = 8.0
"""Ratio of the largest to the smallest eigenvalue that is smoothed [-]."""
POWER_STEPS = 8


class TwoLevel:
    """Solves symmetric systems of 3x3 blocks, one block row a node."""

    def __init__(self, prolongation: scipy.sparse.csr_array) -> None:
        """Keep the map from the coarse nodes' values to the fine nodes'."""
        self._P = scipy.sparse.kron(prolongation, scipy.sparse.eye_array(3), format="csr")

    def solve(
        self, A: scipy.sparse.bsr_array, right: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """The solution of `A x = right` to `REDUCTION`."""
        rows = np.repeat(np.arange(len(right)), np.diff(A.indptr))
        inverses = np.linalg.inv(A.data[rows == A.indices])
        A_csr = A.tocsr()
        coarse = splu(
            (self._P.T @ A_csr @ self._P).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True},
        )
        smoother = _Chebyshev(A_csr, inverses)

        def precondition(r: np.ndarray) -> np.ndarray:
            x = smoother(r.ravel(), np.zeros(r.size))
            x += self._P @ coarse.solve(self._P.T @ (r.ravel() - A_csr @ x))
            return smoother(r.ravel(), x)

        operator: Any = LinearOperator
        preconditioner = operator(A.shape, matvec=precondition, dtype=float)
        x, failed = cg(A_csr, right.ravel(), rtol=REDUCTION, M=preconditioner, maxiter=400)
        if failed:
            raise ArithmeticError("the finite elements' conjugate gradients do not converge")
        return x.reshape(-1, 3)


class _Chebyshev:
    """A polynomial smoother over the inverted diagonal blocks."""

    def __init__(self, A: scipy.sparse.csr_array, inverses: Float[np.ndarray, "n 3 3"]) -> None:
        self._A, self._inverses = A, inverses
        x, largest = np.random.default_rng(0).standard_normal(len(A.indptr) - 1), 1.0
        for _ in range(POWER_STEPS):
            x = self._scaled(A @ x)
            largest = float(np.linalg.norm(x))
            x /= largest
        largest *= 1.1
        self._centre = largest * (1 + 1 / SPECTRUM) / 2
        self._half = largest * (1 - 1 / SPECTRUM) / 2

    def __call__(self, right: np.ndarray, x: np.ndarray) -> np.ndarray:
        residual = right - self._A @ x
        rho = self._half / self._centre
        step = self._scaled(residual) / self._centre
        for _ in range(SMOOTHING):
            x = x + step
            residual = residual - self._A @ step
            following = 1 / (2 * self._centre / self._half - rho)
            step = following * rho * step + 2 * following / self._half * self._scaled(residual)
            rho = following
        return x

    def _scaled(self, r: np.ndarray) -> np.ndarray:
        return np.einsum("nij,nj->ni", self._inverses, r.reshape(-1, 3)).ravel()
