"""Every format of clouds and meshes, written by hand or by trimesh, is read as it was meant."""

import struct

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from breastscan.errors import ConfigError
from breastscan.run.clouds import KNOWN, READERS, is_path, read_cloud

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-1, 1, (40, 3)).astype("f4").astype(float)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
COLOURS = RNG.integers(0, 255, (40, 3))
SPHERE = trimesh.creation.icosphere(1)


def ply(form: str, number: str, *, newline: str = "\n", more: str = "", first: str = "") -> bytes:
    """A cloud in one of PLY's forms: normals before points, a colour between, perhaps more."""
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    kind = {"float": "f4", "double": "f8"}[number]
    header = [
        "ply", f"format {form} 1.0", "comment x y z", "obj_info none", *([first] if first else []),
        "element vertex 40", *(f"property {number} n{axis}" for axis in "xyz"),
        "property uchar red", *(f"property {number} {axis}" for axis in "xyz"),
        *([more] if more else []), "end_header",
    ]  # fmt: skip
    body = b""
    for normal, colour, point in zip(NORMALS, COLOURS, POINTS, strict=True):
        ragged = list(range(colour[1] % 4))
        if order:
            body += np.array(normal, order + kind).tobytes() + bytes([colour[0]])
            body += np.array(point, order + kind).tobytes()
            body += bytes([len(ragged), *ragged]) if more else b""
        else:
            row = [*normal, colour[0], *point, *([len(ragged), *ragged] if more else [])]
            body += (" ".join(map(repr, map(float, row))) + newline).encode()
    before = b"3 0 1 2" + newline.encode() if first else b""
    return (newline.join(header) + newline).encode() + before + body


def lzf(data: bytes) -> bytes:
    """Packed by LZF, greedily."""
    out, literal, seen, i = bytearray(), bytearray(), {}, 0

    def flush() -> None:
        for k in range(0, len(literal), 32):
            out.extend([len(literal[k : k + 32]) - 1, *literal[k : k + 32]])
        literal.clear()

    while i < len(data):
        start = seen.get(data[i : i + 3], -1) if i + 3 <= len(data) else -1
        seen[data[i : i + 3]] = i
        back = i - start - 1
        if start < 0 or back > 8191:
            literal.append(data[i])
            i += 1
            continue
        length = 3
        while i + length < len(data) and length < 264 and data[start + length] == data[i + length]:
            length += 1
        flush()
        out.extend([min(length - 2, 7) << 5 | back >> 8])
        out.extend([length - 9] if length - 2 >= 7 else [])
        out.append(back & 255)
        i += length
    flush()
    return bytes(out)


def pcd(form: str) -> bytes:
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb normal_x normal_y normal_z\n"
        "SIZE 4 4 4 4 4 4 4\n"
        "TYPE F F F U F F F\nCOUNT 1 1 1 1 1 1 1\nWIDTH 40\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS 40\nDATA {form}\n"
    ).encode()
    columns = [*POINTS.T.astype("<f4"), COLOURS[:, 0].astype("<u4"), *NORMALS.T.astype("<f4")]
    if form == "ascii":
        rows = [" ".join(map(str, row)) for row in zip(*columns, strict=True)]
        return header + "\n".join(rows).encode()
    if form == "binary":
        return header + b"".join(n.tobytes() for row in zip(*columns, strict=True) for n in row)
    whole = b"".join(column.tobytes() for column in columns)
    packed = lzf(whole)
    return header + struct.pack("<II", len(packed), len(whole)) + packed


def text(
    columns: list[np.ndarray], separator: str = " ", *, head: str = "", point: str = "."
) -> bytes:
    rows = (
        separator.join(repr(float(n)).replace(".", point) for n in row)
        for row in np.hstack(columns)
    )
    return (head + "\n".join(rows) + "\n").encode()


def mesh(kind: str) -> bytes:
    data = (
        trimesh.Scene(SPHERE).export(file_type=kind)
        if kind == "glb"
        else SPHERE.export(file_type=kind)
    )
    return data.encode() if isinstance(data, str) else data


CLOUDS = {
    **{
        f"{form} {number}.ply": ply(form, number)
        for form in ("ascii", "binary_little_endian", "binary_big_endian")
        for number in ("float", "double")
    },
    "crlf.ply": ply("ascii", "float", newline="\r\n"),
    "crlf binary.ply": ply("binary_little_endian", "float", newline="\r\n"),
    "lists.PLY": ply("ascii", "double", more="property list uchar uchar tags"),
    "binary lists.ply": ply("binary_big_endian", "float", more="property list uchar uchar tags"),
    "faces before.ply": ply(
        "ascii", "float", first="element thing 1\nproperty list uchar int of"
    ),
    **{f"{form}.pcd": pcd(form) for form in ("ascii", "binary", "binary_compressed")},
    "normals.xyz": text([POINTS, NORMALS]),
    "tabs.txt": text([POINTS, COLOURS, NORMALS], "\t", head="# exported\n"),
    "commas.csv": text([POINTS, NORMALS], ", "),
    "decimal commas.txt": text([POINTS, NORMALS], ";", point=","),
    "named.csv": text([COLOURS, POINTS, NORMALS], ",", head="r,g,b,x,y,z,nx,ny,nz\n"),
    "CloudCompare.asc": text([POINTS, COLOURS, NORMALS], head="//X Y Z R G B Nx Ny Nz\n"),
    "counted.pts": text([POINTS, COLOURS[:, :1], COLOURS, NORMALS], head="40\n"),
}  # fmt: skip
WITHOUT_NORMALS = {
    "places.xyz": text([POINTS]),
    "colours.txt": text([POINTS, COLOURS]),
    "points.ply": trimesh.PointCloud(POINTS).export(file_type="ply"),
    "points.obj": "\n".join(f"v {x!r} {y!r} {z!r}" for x, y, z in POINTS.tolist()).encode(),
}
MESHES = {
    "mesh.ply": mesh("ply"), "mesh ascii.ply": SPHERE.export(file_type="ply", encoding="ascii"),
    "mesh.obj": mesh("obj"), "mesh.stl": mesh("stl"), "mesh ascii.stl": mesh("stl_ascii"),
    "mesh.glb": mesh("glb"),
}  # fmt: skip


def read(folder, name, data):
    (folder / name).write_bytes(data)
    return read_cloud(folder / name)


@pytest.mark.parametrize("name", CLOUDS)
def test_a_cloud_keeps_its_points_and_normals(tmp_path, name):
    found = read(tmp_path, name, CLOUDS[name])
    assert found.triangles is None
    np.testing.assert_allclose(found.points, POINTS, atol=1e-6)
    np.testing.assert_allclose(found.normals, NORMALS, atol=1e-6)


@pytest.mark.parametrize("name", WITHOUT_NORMALS)
def test_a_cloud_without_normals_or_a_mesh_without_faces_is_points(tmp_path, name):
    found = read(tmp_path, name, WITHOUT_NORMALS[name])
    assert found.triangles is None
    assert found.normals is None
    np.testing.assert_allclose(found.points, POINTS, atol=1e-6)


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_keeps_its_corners_and_faces(tmp_path, name):
    found = read(tmp_path, name, MESHES[name])
    assert KDTree(SPHERE.vertices).query(found.points)[0].max() < 1e-6
    again = trimesh.Trimesh(found.points, found.triangles)
    assert len(again.faces) == len(SPHERE.faces)
    np.testing.assert_allclose(again.volume, SPHERE.volume, rtol=1e-5)


def test_faces_of_several_corners_are_cut_into_triangles(tmp_path):
    box = trimesh.creation.box()
    rows = ["ply", "format ascii 1.0", "element vertex 8"]
    rows += [*(f"property float {axis}" for axis in "xyz"), "element face 7"]
    rows += ["property list uchar int vertex_index", "end_header"]
    rows += [" ".join(map(str, corner)) for corner in box.vertices]
    rows += ["4 0 1 3 2", "4 4 6 7 5", "4 0 4 5 1", "4 2 3 7 6", "4 0 2 6 4", "3 1 5 7", "3 1 7 3"]
    found = read(tmp_path, "box.ply", "\n".join(rows).encode())
    assert abs(trimesh.Trimesh(found.points, found.triangles).volume) == pytest.approx(1.0)


def test_a_viewpoint_is_told_and_not_applied(tmp_path):
    moved = pcd("binary").replace(b"VIEWPOINT 0 0 0", b"VIEWPOINT 0 0 1")
    found = read(tmp_path, "seen.pcd", moved)
    np.testing.assert_allclose(found.points, POINTS, atol=1e-6)
    assert "VIEWPOINT" in found.told[0]


WHOLE = {**CLOUDS, **WITHOUT_NORMALS, **MESHES}
ROWS_ONLY = (".xyz", ".txt", ".csv", ".asc", ".pts", ".obj")
"""What ends with a whole row cannot be told from a whole file of these."""


@pytest.mark.parametrize("name", WHOLE)
def test_what_was_cut_off_is_refused_or_a_part_of_the_whole(tmp_path, name):
    corners = SPHERE.vertices if name in MESHES else POINTS
    refused = 0
    for share in (0.0, 0.02, 0.5, 0.97):
        try:
            found = read(tmp_path, name, WHOLE[name][: int(share * len(WHOLE[name]))])
        except ConfigError:
            refused += 1
            continue
        off = KDTree(corners).query(found.points)[0]
        assert np.count_nonzero(off > 1e-6) <= 1, "the last number alone may be cut"
    assert refused == 4 or (refused and name.endswith(ROWS_ONLY))


@pytest.mark.parametrize("suffix", READERS)
def test_junk_and_nothing_are_refused_by_name(tmp_path, suffix):
    junk = {
        "junk": b"\x00\x01 nothing of the kind \xff" * 9,
        "none": b"",
        "words": b"a b c\nd e f\n",
    }
    for name, data in junk.items():
        with pytest.raises(ConfigError, match=name + suffix):
            read(tmp_path, name + suffix, data)


@pytest.mark.parametrize(
    ("name", "why"),
    [("cloud.las", KNOWN), ("cloud", KNOWN), ("nowhere.ply", "no such file"), (".", "is a folder")],
)
def test_what_is_no_known_file_says_what_would_be(tmp_path, name, why):
    (tmp_path / "cloud.las").write_bytes(b"LASF")
    (tmp_path / "cloud").write_bytes(b"ply")
    with pytest.raises(ConfigError, match=why):
        read_cloud(tmp_path / name)


ONE = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n"
WHOLE_PLY = ply("ascii", "float")


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (ONE, "no points x y z"),
        (ONE.replace(b"vertex 1", b"vertex -1"), "element vertex -1"),
        (WHOLE_PLY.replace(b"property uchar red\n", b""), "more numbers than"),
        (WHOLE_PLY.replace(b"float nx", b"half nx"), "a type 'half'"),
        (WHOLE_PLY.replace(b"vertex 40", b"vertex 41"), "before the last of 41"),
    ],
)
def test_a_ply_that_contradicts_itself_says_how(tmp_path, data, why):
    with pytest.raises(ConfigError, match=why):
        read(tmp_path, "cloud.ply", data)


def test_rows_of_different_lengths_are_refused_with_the_row(tmp_path):
    with pytest.raises(ConfigError, match="row 3"):
        read(tmp_path, "cloud.xyz", b"1 2 3\n4 5 6\n7 8\n")


def test_a_csv_is_a_path_unless_it_holds_a_cloud(tmp_path):
    for name, data in CLOUDS.items():
        (tmp_path / name).write_bytes(data)
        assert not is_path(tmp_path / name)
    (tmp_path / "path.csv").write_text("x_m,y_m,z_m,nx,ny,nz\n0,0,0,0,0,1\n")
    assert is_path(tmp_path / "path.csv")


def test_many_faces_are_those_that_trimesh_wrote(tmp_path):
    fine = trimesh.creation.icosphere(4)
    found = read(tmp_path, "fine.ply", fine.export(file_type="ply"))
    np.testing.assert_array_equal(found.triangles, fine.faces)
