"""Wavelet coefficients, from spec/planes.md section 7."""

import numpy as np

from entropy import Bit, Mixer, Number

single = np.float32
LEVEL_STEPS = np.array([0x3F8A3D71, 0x3F733333, 0x3F666666, 0x3F59999A, 0x3F59999A], np.uint32).view(single)


class Models:
    def __init__(self):
        self.any = Mixer([864, 1152, 144, 512, 576, 1024, 128, 648], [16, 16])
        self.magnitude = Mixer([7776, 6912, 1296, 4608, 5184, 9216, 1152, 2304], [144, 48])
        self.sign = [Bit() for _ in range(504)]
        self.large = Number()
        self.last = [[[16 if g == 10 else 8] * 3 for _ in range(3)] for g in range(11)]
        self.gain = [Number() for _ in range(3)]

    def copy(self):
        other = Models.__new__(Models)
        other.any = self.any.copy()
        other.magnitude, other.large = self.magnitude.copy(), self.large.copy()
        other.sign, other.gain = [b.copy() for b in self.sign], [n.copy() for n in self.gain]
        other.last = [[list(row) for row in g] for g in self.last]
        return other


def classes(bounds):
    """Table of the class of each number: how many of the bounds it reaches."""
    table = [sum(v >= b for b in bounds) for v in range(bounds[-1] + 1)]
    return lambda v: table[min(v, bounds[-1])]


c12 = classes([1, 2, 3, 4, 5, 7, 9, 12, 16, 23, 37])
c8 = classes([1, 2, 3, 5, 8, 13, 25])


def few(v):
    return min(c8(v), 6) // 2


def log(v, most):
    if v < 2:
        return v
    k = v.bit_length() - 1
    return min(2 * k + ((v >> (k - 1)) & 1), most)


def bucket(steps):
    return int(steps > single(0.75)) + int(steps > single(2.5))


def gain_class(band):
    return 10 if band.kind == "low" else 2 * (band.level - 1) + (band.kind == "diagonal")


def context_class(band):
    return 6 if band.kind == "low" else 2 * min(band.level - 1, 2) + (band.kind == "diagonal")


def padded(height, width):
    """Three channels with two more columns each side and two more rows above, one below."""
    return [[[0] * (width + 4) for _ in range(height + 3)] for _ in range(3)]


def decode(coder, models, bands, step, shrink, predicted):
    """Coefficients of all bands. `predicted` are those of the prediction, or None."""
    if predicted is not None:
        for g in sorted({gain_class(b) for b in bands}):
            for row in models.last[g]:
                for k in range(3):
                    row[k] = min(max(row[k] + models.gain[k].signed(coder), 0), 24)
    results, magnitudes = [], []
    for index, band in enumerate(bands):
        decoder = BandDecoder(coder, models, bands, index, step, shrink, predicted, magnitudes)
        results.append(decoder.decode())
        magnitudes.append(decoder.M)
    return results


class Around:
    """Neighbourhood of one channel at a place."""

    __slots__ = ("W", "N", "NW", "NE", "far", "near", "hint", "hints", "parent", "siblings", "wide")

    def __init__(self, band, x, y, c):
        M, H = band.M[c], band.hints[c]
        above, row = M[y + 1], M[y + 2]
        self.W, self.N, self.NW, self.NE = row[x + 1], above[x + 2], above[x + 1], above[x + 3]
        self.far = row[x] + M[y][x + 2]
        self.near = 2 * (self.W + self.N) + self.NW + self.NE
        self.hint = H[y + 2][x + 2]
        self.hints = H[y + 2][x + 1] + H[y + 2][x + 3] + H[y + 1][x + 2] + H[y + 3][x + 2]
        self.parent = band.parent[c][y // 2 + 2][x // 2 + 2] if band.parent else 0
        self.siblings = sum(s[c][y + 2][x + 2] for s in band.siblings)
        self.wide = 3 * self.near + 2 * self.far + 3 * self.parent + 2 * self.siblings


class BandDecoder:
    def __init__(self, coder, models, bands, index, step, shrink, predicted, magnitudes):
        self.coder, self.models, self.band = coder, models, bands[index]
        band = self.band
        self.low = band.kind == "low"
        self.T = step * LEVEL_STEPS[4 if self.low else band.level - 1]
        self.u = single(1) / self.T
        self.shrink = shrink
        self.B, self.l = context_class(band), 0 if self.low else band.level
        height, width = band.mask.shape
        self.M, self.hints, self.negative = padded(height, width), padded(height, width), padded(height, width)
        self.out = np.zeros((height, width, 3), single)
        self.gains = models.last[gain_class(band)]
        self.predicted = None if predicted is None else predicted[index]
        if predicted is not None:
            inverse = single(4) / self.T
            hints = np.minimum(np.abs(self.predicted) * inverse, 8191).astype(int)
            for c in range(3):
                for y in range(height):
                    self.hints[c][y + 2][2 : width + 2] = hints[y, :, c].tolist()
        self.parent = magnitudes[index - 3] if not self.low and index > 3 else None
        count = {"vertical": 1, "diagonal": 2}.get(band.kind, 0)
        self.siblings = [magnitudes[index - 1 - k] for k in range(count)]

    def decode(self):
        mask = self.band.mask
        for y, x in zip(*np.nonzero(mask)):
            self.place(int(x), int(y))
        return self.out

    def place(self, x, y):
        around = [Around(self, x, y, c) for c in range(3)]
        some = self.some(around)
        for c in range(3):
            P = self.prediction(x, y, c)
            self.out[y, x, c] = self.coefficient(x, y, c, P, around) if some else P

    def prediction(self, x, y, c):
        if self.predicted is not None:
            p = self.predicted[y, x, c]
            return p * single(self.gains[c][bucket(abs(p) * self.u)] / 16)
        if not self.low:
            return single(0)
        mask = self.band.mask
        near = []
        if x > 0 and mask[y, x - 1]:
            near.append(self.out[y, x - 1, c])
        if y > 0 and mask[y - 1, x]:
            near.append(self.out[y - 1, x, c])
        if len(near) == 2:
            return (near[0] + near[1]) * single(0.5)
        return near[0] if near else single(0)

    def coefficient(self, x, y, c, P, around):
        here = [self.M[k][y + 2][x + 2] for k in range(c)]
        magnitude = self.magnitude(c, around, sum(here), 1 if c == 2 and here == [0, 0] else 0)
        if magnitude == 0:
            return P
        self.M[c][y + 2][x + 2] = min(magnitude, 255)
        b = 1 + bucket(abs(P) * self.u * single(2))
        z = 3 + b if P > 0 else 3 - b if P < 0 else 3
        q = [1 + self.negative[k][y + 2][x + 2] if m else 0 for k, m in enumerate(here)] + [0, 0]
        negative = self.models.sign[(7 * self.B + z) * 9 + 3 * q[0] + q[1]].decode(self.coder)
        self.negative[c][y + 2][x + 2] = negative
        if magnitude == 1:
            m = self.T * (single(1) - self.shrink[0])
        else:
            m = (single(magnitude) - self.shrink[1]) * self.T
        return P - m if negative else P + m

    def h(self, v):
        return 8 if self.predicted is None else c8(v)

    def some(self, around):
        """Whether any of the three channels is not 0."""
        total = {name: sum(getattr(a, name) for a in around) for name in Around.__slots__}
        near, wide, hint, B = total["near"], total["wide"], total["hint"], self.B
        first = around[0]
        tight = 64 * min(total["W"], 3) + 16 * min(total["N"], 3) + 4 * min(total["NE"], 3) + min(total["NW"], 3)
        contexts = [
            (12 * B + c12(near)) * 9 + self.h(hint // 2),
            (12 * B + c12(first.near)) * 12 + c12(near - first.near),
            24 * self.l + log(wide, 23),
            (8 * B + c8(2 * total["parent"])) * 8 + c8(2 * total["siblings"] + total["far"]),
            (9 * B + self.h(first.hint // 2)) * 8 + c8(total["hints"] // 4),
            4 * tight + few(hint // 2),
            4 * log(2 * (wide + 2 * hint), 31) + B // 2,
            (9 * self.h(first.hint) + self.h(hint - first.hint)) * 8 + c8(near // 2),
        ]
        selectors = [(0 if self.predicted is None else 8) + B, log(wide + 2 * hint, 15)]
        return self.models.any.decode(self.coder, contexts, selectors)

    def magnitude(self, c, around, colours, first):
        here, B, C = around[c], self.B, c
        others = sum(a.W + a.N for k, a in enumerate(around) if k != c)
        total = here.wide + 4 * colours + here.hint
        a = 0 if self.predicted is None else 1
        K = 3 * B + C
        tight = 64 * min(here.W, 3) + 16 * min(here.N, 3) + 4 * min(here.NE, 3) + min(here.NW, 3)
        near12, second = c12(here.near), c8(2 * colours + others // 2)
        fourth = c8(2 * here.parent) * 8 + c8(2 * here.siblings + here.far)
        hint = self.h(here.hint // 2)
        for i in range(first, 14):
            kind = min(i, 2)
            contexts = [
                ((K * 3 + kind) * 12 + near12) * 9 + hint,
                ((K * 3 + kind) * 12 + near12) * 8 + second,
                ((6 * C + self.l) * 3 + kind) * 24 + log(here.wide, 23),
                (K * 3 + kind) * 64 + fourth,
                ((K * 3 + kind) * 9 + hint) * 8 + c8(here.hints // 4),
                ((C * 3 + kind) * 256 + tight) * 4 + few(here.hint // 2),
                ((C * 3 + kind) * 32 + log(2 * total, 31)) * 4 + B // 2,
                (((C * 3 + kind) * 8 + c8(2 * colours)) * 8 + c8(others)) * 4 + few(here.near // 2),
            ]
            selectors = [(24 * a + K) * 3 + kind, 16 * kind + log(total, 15)]
            if not self.models.magnitude.decode(self.coder, contexts, selectors):
                return i
        return min(14 + self.models.large.decode(self.coder), 1 << 20)
