"""Section lIGt, from spec/lighting.md."""

import math
import struct

import numpy as np

from coefficients import Models
from coefficients import decode as decode_coefficients
from entropy import Damaged, Range
from geometry import Transform

single = np.float32


def roots():
    """2^(f / 64)."""
    root, table = [2.0], []
    for _ in range(6):
        root.append(math.sqrt(root[-1]))
    for f in range(64):
        value = 1.0
        for bit in range(6):
            if f >> (5 - bit) & 1:
                value *= root[bit + 1]
        table.append(value)
    return table


def decode(data):
    """Lobes (axis, sharpness, amplitude in a row) and levels (sharpness, cells)."""
    if data[0] != 0 or data[1] > 64 or data[2] > 16:
        raise Damaged("head of lIGt")
    at, lobes, heads, levels = 3, [], [], []
    for _ in range(data[1]):
        x, y, z, *rest = struct.unpack("<7f", data[at : at + 28])
        length = math.sqrt(x * x + y * y + z * z)
        if not abs(length - 1) < 1e-3:
            raise Damaged("axis of a lobe")
        lobes.append([x / length, y / length, z / length, *rest])
        at += 28
    for _ in range(data[2]):
        heads.append(struct.unpack("<H3f", data[at : at + 14]))
        at += 14
    coder, t, shrink = Range(data[at:]), roots(), [single(0.08), single(0.02)]
    for size, sharpness, floor, step in heads:
        transform = Transform(np.ones((size, size), bool))
        bands, _ = decode_coefficients(coder, Models(), transform.bands, single(step), shrink, None)
        v = np.floor(transform.inverse(bands) + single(0.5)).astype(np.int64)
        a, b, c = v[..., 0], v[..., 1], v[..., 2]
        integers = np.stack([a + b, a, a + c], -1).clip(0, 3072)
        table = np.array([floor * (2.0 ** (i // 64) * t[i % 64] - 1) for i in range(3073)]).astype(single)
        levels.append((sharpness, table[integers]))
    coder.end_mark()
    if not coder.ends_rightly():
        raise Damaged("end of lIGt")
    return np.array(lobes), levels
