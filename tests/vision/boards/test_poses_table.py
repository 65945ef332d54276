"""Tables of poses as people write them: read right, or refused with what to do."""

from contextlib import suppress

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.vision.boards import poses_table

RNG = np.random.default_rng(0)
X_BF = se3.from_rotation_vector(
    np.array([0.1, 3.0, 0.2]) + RNG.uniform(-0.4, 0.4, (4, 3)),
    np.array([0.4, -0.1, 0.3]) + RNG.uniform(-0.1, 0.1, (4, 3)),
)
P, TURNS = X_BF[:, :3, 3], Rotation.from_matrix(X_BF[:, :3, :3])
R = X_BF[:, :3, :3].reshape(-1, 9)
CELLS = [f"{row}{column}" for row in "123" for column in "123"]
POSITION, VECTOR = "x_m,y_m,z_m", "rx_rad,ry_rad,rz_rad"


def table(header, *columns, separator=",", names="abcd"):
    """The text of a table; the header names its columns with commas between."""
    rows = [separator.join(header.split(","))]
    for name, values in zip(names, np.concatenate(columns, axis=1), strict=True):
        rows.append(separator.join([name, *map(repr, values.tolist())]))
    return "\n".join(rows) + "\n"


def read(text, folder, encoding="utf-8"):
    (folder / "poses.csv").write_text(text, encoding=encoding)
    return poses_table.read(folder)


PLAIN = table(f"name,{POSITION},{VECTOR}", P, TURNS.as_rotvec())
WAYS = {
    "as the help has it": f"name, {POSITION}, {VECTOR}\n" + PLAIN.split("\n", 1)[1],
    "millimetres, degrees": table(
        "shot,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg", 1e3 * P, np.degrees(TURNS.as_rotvec())
    ),
    "units in brackets": table(
        "Name,X [mm],Y [mm],Z [mm],RX [deg],RY [deg],RZ [deg]",
        1e3 * P, np.degrees(TURNS.as_rotvec()),
    ),
    "no units": table("name,x,y,z,rx,ry,rz", P, TURNS.as_rotvec()),
    "rotation first": table(f"name,{VECTOR},{POSITION}", TURNS.as_rotvec(), P),
    "quaternion, w last": table("name,tx,ty,tz,qx,qy,qz,qw", P, TURNS.as_quat()),
    "quaternion, w first": table(
        "name,x,y,z,qw,qx,qy,qz", P, TURNS.as_quat(scalar_first=True)
    ),
    "ros echo": table(
        "name,position.x,position.y,position.z,orientation.x,orientation.y,orientation.z,"
        "orientation.w", P, TURNS.as_quat(),
    ),
    "tum": "# " + table("name,tx,ty,tz,qx,qy,qz,qw", P, TURNS.as_quat(), separator=" "),
    "angles": table("name,x,y,z,roll_deg,pitch_deg,yaw_deg", P, TURNS.as_euler("xyz", True)),
    "matrix beside the position": table(
        "name,x_mm,y_mm,z_mm," + ",".join(f"r{cell}" for cell in CELLS), 1e3 * P, R
    ),
    "four by four": table(
        "name," + ",".join(f"m{r}{c}" for r in "0123" for c in "0123"), X_BF.reshape(-1, 16)
    ),
    "semicolons": PLAIN.replace(",", ";"),
    "semicolons and decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "tabs": PLAIN.replace(",", "\t"),
    "blank lines, comments, spaces": PLAIN.replace("\n", "\n\n# noted\n").replace(",", " , "),
    "lines of Windows": PLAIN.replace("\n", "\r\n"),
    "quoted": PLAIN.replace("a,", '"a",'),
    "files as names": PLAIN.replace("\nb,", "\nb_left.png,").replace("\nc,", "\nshots/C.PNG,"),
    "other columns": "\n".join(
        line + (",note" if line.startswith("name") else ",0") for line in PLAIN.splitlines()
    ),
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_a_pose_is_the_same_however_it_is_written(way, tmp_path):
    stated = read(WAYS[way], tmp_path)
    rows = [stated.row_of(name) for name in "abcd"]
    np.testing.assert_allclose(stated.X_BF[rows], X_BF, atol=1e-9)


def test_a_byte_order_mark_is_passed_over(tmp_path):
    assert read(PLAIN, tmp_path, encoding="utf-8-sig").row_of("a") == 0


@pytest.mark.parametrize(("asked", "row"), [("07", 0), ("7", 0), ("7_left.png", 0), ("70", 1)])
def test_shots_are_known_by_their_numbers(asked, row, tmp_path):
    text = PLAIN.replace("\na,", "\n007,").replace("\nb,", "\n70,")
    assert read(text, tmp_path).row_of(asked) == row


def test_other_readings_of_the_same_numbers_are_at_hand(tmp_path):
    text = table(f"name,{POSITION},{VECTOR}", P, TURNS.as_euler("xyz"))
    stated = read(text, tmp_path)
    right = stated.readings["angles about fixed axes, roll pitch yaw"]
    np.testing.assert_allclose(right, X_BF, atol=1e-9)
    wrong_order = read(
        table("name,x,y,z,qx,qy,qz,qw", P, TURNS.as_quat(scalar_first=True)), tmp_path
    )
    np.testing.assert_allclose(wrong_order.readings["qw qx qy qz"], X_BF, atol=1e-9)


BROKEN = {
    "nothing": ("", "it is empty"),
    "a header alone": (PLAIN.split("\n", 1)[0], "holds no row"),
    "no header": (PLAIN.split("\n", 1)[1], "names no column `name`"),
    "a column missing": (table("name,x_m,y_m,rx,ry,rz", P[:, :2], TURNS.as_rotvec()), "columns"),
    "a word": (PLAIN.replace("\nb,", "\nb,x").replace("xx", "x"), "line 3 holds"),
    "no number": (PLAIN.replace("\nb,", "\nb,nan,"), "line 3 has 8 fields"),
    "nan": (table(f"name,{POSITION},{VECTOR}", P * np.nan, TURNS.as_rotvec()), "line 2 holds"),
    "a name twice": (PLAIN.replace("\nc,", "\na,"), "lines 2 and 4 are both of shot a"),
    "millimetres": (table("name,x,y,z,rx,ry,rz", 1e3 * P, TURNS.as_rotvec()), "x_mm, y_mm, z_mm"),
    "metres": (table("name,x_mm,y_mm,z_mm,rx,ry,rz", P, TURNS.as_rotvec()), "x_m, y_m, z_m"),
    "degrees": (table("name,x,y,z,rx,ry,rz", P, np.degrees(TURNS.as_rotvec())), "rx_deg"),
    "radians": (table("name,x,y,z,rx_deg,ry_deg,rz_deg", P, TURNS.as_rotvec()), "rx_rad"),
    "no rotation": (table("name,x,y,z,qx,qy,qz,qw", P, 2 * TURNS.as_quat()), "holds no rotation"),
    "a mirror": (
        table("name,x,y,z," + ",".join(f"r{cell}" for cell in CELLS), P, -R), "holds no rotation",
    ),
    "a column twice": (PLAIN.replace("y_m", "x_m", 1), "names x twice"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_no_table_of_poses_is_refused_by_name(kind, tmp_path):
    text, cause = BROKEN[kind]
    with pytest.raises(CalibrationError, match=cause) as refused:
        read(text, tmp_path)
    assert "poses.csv" in str(refused.value)


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "poses.csv").write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(CalibrationError, match="cannot be read"):
        poses_table.read(tmp_path)


def test_damaged_bytes_end_in_an_error_of_ours(tmp_path):
    rng, path = np.random.default_rng(1), tmp_path / "poses.csv"
    texts = [text.encode() for text in WAYS.values()]
    for number in range(600):
        raw = bytearray(texts[number % len(texts)])
        for at in rng.integers(0, len(raw), rng.integers(1, 6)):
            raw[at] = rng.integers(256)
        path.write_bytes(raw[: rng.integers(1, len(raw))] if number % 3 == 0 else raw)
        with suppress(CalibrationError):
            assert np.isfinite(poses_table.read(tmp_path).X_BF).all()
