import math

from experiments import bench_cloud


def test_every_row_compares_two_times(monkeypatch):
    monkeypatch.setattr(bench_cloud, "POINTS", 2000)
    monkeypatch.setattr(bench_cloud, "SAMPLES", 20)
    found = bench_cloud.rows()
    assert len(found) >= 2
    for what, own, peer, ratio in found:
        assert what
        assert own > 0.0
        assert peer > 0.0
        assert math.isclose(ratio, peer / own)
