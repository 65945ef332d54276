"""PCD files, as the Point Cloud Library writes them: ASCII, binary, or binary and compressed."""

import re

import numpy as np

from breastscan.geometry.compiled import kernel

DATA = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE)
NEEDED = ("FIELDS", "SIZE", "TYPE", "POINTS")
KINDS = {"F": "<f", "I": "<i", "U": "<u"}
IDENTITY = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
"""VIEWPOINT of a cloud that was seen from its frame's origin: position, then rotation (wxyz)."""


def fields_in(data: bytes) -> tuple[dict[str, np.ndarray], bool]:
    """The fields of one number a point, by name, and whether a viewpoint other than the frame's
    origin is told.

    Raises:
        ValueError: The bytes are no PCD file, or not a whole one.
    """
    found = DATA.search(data)
    if found is None:
        raise ValueError("it has no header that ends with DATA")
    lines = data[: found.start()].decode("ascii", "replace").splitlines()
    header = {words[0]: words[1:] for line in lines if (words := line.split())}
    missing = [name for name in NEEDED if not header.get(name)]
    if missing:
        raise ValueError(f"its header lacks {', '.join(missing)}")
    names, points = header["FIELDS"], int(header["POINTS"][0])
    counts = list(map(int, header.get("COUNT", ["1"] * len(names))))
    kinds = [KINDS[t] + size for t, size in zip(header["TYPE"], header["SIZE"], strict=True)]
    form, body = found[1].decode(), data[found.end() :]
    if form == "ascii":  # then it is read as if it were binary, all numbers alike
        body, kinds = np.array(body.split()).astype("<f8").tobytes(), ["<f8"] * len(names)
    dtype = [
        (f"{name} {k}", kind, (count,))
        for k, (name, kind, count) in enumerate(zip(names, kinds, counts, strict=True))
    ]
    if form == "binary_compressed":
        body = _rows_of(_decompressed(body), dtype, points)
    if not 0 <= np.dtype(dtype).itemsize * points <= len(body):
        raise ValueError(f"it ends before the last of {points} points")
    table = np.frombuffer(body, dtype, points)
    values = {
        name: table[key][:, 0]
        for name, count, (key, _, _) in zip(names, counts, dtype, strict=True)
        if count == 1
    }
    viewpoint = list(map(float, header.get("VIEWPOINT", IDENTITY)))
    return values, viewpoint != IDENTITY


def _rows_of(columns: bytes, dtype: list[tuple], points: int) -> bytes:
    """Compressed files hold field after field; the same point after point."""
    table, start = np.zeros(points, dtype), 0
    for key, kind, shape in dtype:
        numbers = points * shape[0]
        if start + np.dtype(kind).itemsize * numbers > len(columns):
            raise ValueError(f"it ends before the last of {points} points")
        table[key] = np.frombuffer(columns, kind, numbers, start).reshape(points, *shape)
        start += np.dtype(kind).itemsize * numbers
    return table.tobytes()


def _decompressed(body: bytes) -> bytes:
    """What LZF packed, two lengths before it [Lehmann]."""
    if len(body) < 8:
        raise ValueError("it ends before its compressed points")
    packed, whole = np.frombuffer(body, "<u4", 2).tolist()
    out = np.zeros(whole, np.uint8)
    source = np.frombuffer(body[8 : 8 + packed], np.uint8)
    if len(source) < packed or _lzf(source, out) != whole:
        raise ValueError("its compressed points are damaged, or some are missing")
    return out.tobytes()


@kernel
def _lzf(source, out):
    """Unpack, and give the number of bytes that came; -1 where the source is damaged."""
    i, o = 0, 0
    while i < source.size:
        control = np.int64(source[i])
        i += 1
        if control < 32:  # so many bytes and one more as they are
            count = control + 1
            if i + count > source.size or o + count > out.size:
                return -1
            out[o : o + count] = source[i : i + count]
            i += count
            o += count
            continue
        count = control >> 5
        if count == 7 and i < source.size:
            count += np.int64(source[i])
            i += 1
        if i >= source.size:
            return -1
        start = o - ((control & 31) << 8) - np.int64(source[i]) - 1
        i += 1
        count += 2
        if start < 0 or o + count > out.size:
            return -1
        for k in range(count):  # may run into what it writes
            out[o + k] = out[start + k]
        o += count
    return o
