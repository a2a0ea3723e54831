"""Section tCOR, from spec/coordinates.md: texture coordinates."""

import struct

import numpy as np

from entropy import Bit, Damaged, Number, Range


def decode(data, vertices, triangles):
    """For each triangle three pairs of singles."""
    if data[0] != 0:
        raise Damaged("version of tCOR")
    bits, u, v, step = struct.unpack("<Bfff", data[1:14])
    limit = (1 << bits) - 1
    far = [abs(o + x * step) for o in (u, v) for x in (0, limit)]
    if not 1 <= bits <= 24 or not step > 0 or not all(x <= 4e6 for x in far):
        raise Damaged("lattice of tCOR")
    coder, same = Range(data[14:]), [Bit(), Bit()]
    numbers = [[Number(), Number()] for _ in range(2)]
    opposite, last, points, before = {}, {}, [], (0, 0)

    def corner(kind, expected, predicted):
        if expected is not None and same[kind].decode(coder):
            return expected
        point = tuple(predicted[axis] + numbers[kind][axis].signed(coder) for axis in range(2))
        if not all(0 <= x <= limit for x in point):
            raise Damaged("point of tCOR")
        return point

    for number, triangle in enumerate(triangles):
        triangle = [int(x) for x in triangle]
        found, own = None, [None] * 3
        for k in range(3):
            found = opposite.get((triangle[(k + 2) % 3], triangle[(k + 1) % 3]))
            if found:
                break
        if found:
            other, at = points[found[0]], found[1]
            q, r = other[(at + 2) % 3], other[(at + 1) % 3]
            a = own[(k + 1) % 3] = corner(0, q, q)
            b = own[(k + 2) % 3] = corner(0, r, r)
            expected = last.get(triangle[k])
            if (a, b) == (q, r):
                along = tuple(min(max(a[c] + b[c] - other[at][c], 0), limit) for c in range(2))
                own[k] = corner(1, expected, along)
            else:
                own[k] = corner(0, expected, a)
        else:
            for k in range(3):
                before = own[k] = corner(0, last.get(triangle[k]), before)
        before = own[2]
        points.append(own)
        for k in range(3):
            last[triangle[k]] = own[k]
            opposite[triangle[(k + 1) % 3], triangle[(k + 2) % 3]] = (number, k)
    coder.end_mark()
    if not coder.ends_rightly():
        raise Damaged("end of tCOR")
    return np.array([[[u + x * step, v + y * step] for x, y in own] for own in points]).astype(np.float32)
