import math

from experiments import bench_motion


def test_every_row_compares_two_times(monkeypatch):
    for name in ("CURVE_POINTS", "SLOW_CURVE_POINTS", "POSES", "SINGLE_CALLS"):
        monkeypatch.setattr(bench_motion, name, 20)
    for what, own, peer, ratio in bench_motion.rows():
        assert what
        assert own > 0.0
        assert peer > 0.0
        assert math.isclose(ratio, peer / own)
