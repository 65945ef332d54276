import numpy as np

from experiments.paper import execution
from sim.tissue.printed import STIFFNESS
from tests.run.synthetic_run import synthetic_log


def test_the_silicones_share_lies_along_the_probe_and_bears_the_true_force():
    log = synthetic_log(np.random.default_rng(0))
    loop = log.take(np.flatnonzero(log.in_loop)[::50])
    share_mm = execution.silicone_mm(loop)
    along_mm = np.sum(share_mm * loop.X_BP_plan[:, :3, 2], axis=1)
    assert loop.true_force is not None
    np.testing.assert_allclose(STIFFNESS * (1e-3 * along_mm) ** 1.5, loop.true_force, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(share_mm, axis=1), along_mm, rtol=1e-9)
