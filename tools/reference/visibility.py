"""Section vISB, from spec/visibility.md."""

import struct

import numpy as np

from entropy import Damaged, Number, Range

single = np.float32


def places(positions, triangles, spacing):
    """Number of places, and for each the earlier ones beside it."""
    count, pieces = len(positions), []
    if spacing > 0:
        known, P = {}, [[float(x) for x in p] for p in positions]
        spacing = float(spacing)
        for t, corners in enumerate(triangles):
            lengths = []
            for k, m in ((0, 1), (1, 2), (2, 0)):
                d = [x - y for x, y in zip(P[corners[k]], P[corners[m]])]
                lengths.append(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            n = next((n for n in (1, 2, 4, 8, 16) if max(lengths) <= (spacing * n) * (spacing * n)), 32)
            names = {}
            for j in range(n + 1):
                for i in range(n + 1 - j):
                    key = place_name(corners, n, i, j)
                    if isinstance(key, tuple) and key not in known:
                        known[key] = count
                        count += 1
                    elif key is None:
                        key = (t, i, j, "inner")
                        known[key] = count
                        count += 1
                    names[i, j] = known[key] if isinstance(key, tuple) else key
            for j in range(n):
                for i in range(n - j):
                    pieces.append((names[i, j], names[i + 1, j], names[i, j + 1]))
                    if i + j + 1 < n:
                        pieces.append((names[i + 1, j + 1], names[i, j + 1], names[i + 1, j]))
    else:
        pieces = triangles
    earlier = [set() for _ in range(count)]
    for piece in pieces:
        for a in piece:
            earlier[a].update(b for b in piece if b < a)
    return earlier


def place_name(corners, n, i, j):
    """A vertex, or (vertex, vertex, 32nds) on an edge, or None within."""
    a, b, c = corners
    if (i, j) == (0, 0):
        return a
    if (i, j) == (n, 0):
        return b
    if (i, j) == (0, n):
        return c
    if j == 0:
        start, end, part = a, b, i
    elif i == 0:
        start, end, part = a, c, j
    elif i + j == n:
        start, end, part = b, c, j
    else:
        return None
    part = part * 32 // n
    return (start, end, part) if start <= end else (end, start, 32 - part)


def kind(a):
    return min(abs(a).bit_length(), 6)


def picture(coder, models, size):
    values, residuals = np.zeros((size, size), int).tolist(), np.zeros((size, size), int).tolist()
    for y in range(size):
        for x in range(size):
            w, rw = (values[y][x - 1], residuals[y][x - 1]) if x else (0, 0)
            n, rn = (values[y - 1][x], residuals[y - 1][x]) if y else (0, 0)
            if x and y:
                guess, activity = min(max(w + n - values[y - 1][x - 1], min(w, n)), max(w, n)), rw + rn
            else:
                guess, activity = w + n, 2 * (rw + rn)
            r = models[kind(activity)].signed(coder)
            values[y][x], residuals[y][x] = guess + r, min(abs(r), 1 << 20)
            if not -32768 <= values[y][x] <= 32768:
                raise Damaged("integer of vISB")
    return np.array(values)


def group(data, terms, size, earlier, with_mean):
    """Pictures and weights of one stream."""
    coder, models = Range(data), [Number() for _ in range(7)]
    pictures = [picture(coder, models, size) for _ in range(terms + with_mean)]
    numbers, activity = [[Number() for _ in range(7)] for _ in range(terms)], None
    weights = np.zeros((len(earlier), terms), int)
    for place, near in enumerate(earlier):
        activity = 8
        for k in range(terms):
            n, s = len(near), sum(int(weights[v, k]) for v in near)
            guess = (2 * s + n) // (2 * n) if n else 0
            r = numbers[k][kind(activity // 2)].signed(coder)
            activity = activity - activity // 4 + abs(r)
            weights[place, k] = guess + r
            if not -128 <= weights[place, k] <= 127:
                raise Damaged("weight of vISB")
    coder.end_mark()
    if not coder.ends_rightly():
        raise Damaged("end of vISB")
    return pictures, weights


def decode(data, positions, triangles):
    """For each cell the mean and the bases, in a row; for each place the weights."""
    _, _, size, t1, t2, count, spacing, _, _, length, mean = struct.unpack("<5BIfffIf", data[:29])
    if data[0] != 0:
        raise Damaged("version of vISB")
    at = 29
    steps = np.frombuffer(data[at : at + 8 * (t1 + t2)], "<f4").reshape(-1, 2).astype(float)
    at += 8 * (t1 + t2)
    earlier = places(positions, triangles, spacing)
    if len(earlier) != count:
        raise Damaged("places of vISB")
    pictures, weights = group(data[at : at + length], t1, size, earlier, 1)
    if t2:
        more, other = group(data[at + length :], t2, size, earlier, 0)
        pictures, weights = pictures + more, np.concatenate([weights, other], 1)
    bases = [pictures[0] * float(mean)] + [p * base * weight for p, (base, weight) in zip(pictures[1:], steps)]
    return np.stack(bases, -1).astype(single), weights
