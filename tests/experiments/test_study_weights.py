import json

from experiments import study_weights


def test_the_study_shows_that_weights_move_the_curve_but_interpolation_keeps_its_points(tmp_path):
    moved = study_weights.run(tmp_path, seed=0)
    assert moved[1.0] == 0.0
    assert moved[5.0] > 1e-3
    rows = json.loads((tmp_path / "study.json").read_text())["weights"]
    assert all(row["missed_mm"] < 1e-9 for row in rows)
    assert {path.name for path in tmp_path.iterdir()} == {"study.json", "study.md", "weights.png"}
