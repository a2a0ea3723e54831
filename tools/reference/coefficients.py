"""Wavelet coefficients, from spec/planes.md section 7."""

import numpy as np

from entropy import Bit, Mixer, Number

single = np.float32
LEVEL_STEPS = np.array([0x3F8A3D71, 0x3F733333, 0x3F666666, 0x3F59999A, 0x3F59999A], np.uint32).view(single)


class Models:
    def __init__(self):
        self.magnitude = Mixer([7776, 6912, 1296, 4608, 5184, 9216, 1152, 2304], [144, 48])
        self.sign = [Bit() for _ in range(504)]
        self.large = Number()
        self.last = [[[16 if g == 10 else 8] * 3 for _ in range(3)] for g in range(11)]
        self.gain = [Number() for _ in range(3)]

    def copy(self):
        other = Models.__new__(Models)
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


class BandDecoder:
    def __init__(self, coder, models, bands, index, step, shrink, predicted, magnitudes):
        self.coder, self.models, self.band = coder, models, bands[index]
        band = self.band
        self.low = band.kind == "low"
        self.T = step * LEVEL_STEPS[4 if self.low else band.level - 1]
        self.shrink = shrink
        self.B, self.l = context_class(band), 0 if self.low else band.level
        height, width = band.mask.shape
        self.M, self.hints, self.negative = padded(height, width), padded(height, width), padded(height, width)
        self.out = np.zeros((height, width, 3), single)
        self.gains = models.last[gain_class(band)]
        self.predicted = None if predicted is None else predicted[index]
        if predicted is not None:
            inverse = single(4) / self.T
            hints = np.minimum(np.abs(self.predicted) * inverse, 32767).astype(int)
            for c in range(3):
                for y in range(height):
                    self.hints[c][y + 2][2 : width + 2] = hints[y, :, c].tolist()
        self.parent = magnitudes[index - 3] if not self.low and index > 3 else None
        count = {"vertical": 1, "diagonal": 2}.get(band.kind, 0)
        self.siblings = [magnitudes[index - 1 - k] for k in range(count)]

    def decode(self):
        mask = self.band.mask
        for y, x in zip(*np.nonzero(mask)):
            for c in range(3):
                self.coefficient(int(x), int(y), c)
        return self.out

    def prediction(self, x, y, c):
        if self.predicted is not None:
            p = self.predicted[y, x, c]
            return p * single(self.gains[c][bucket(abs(p) / self.T)] / 16)
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

    def coefficient(self, x, y, c):
        P = self.prediction(x, y, c)
        magnitude = self.magnitude(x, y, c)
        self.M[c][y + 2][x + 2] = min(magnitude, 255)
        if magnitude == 0:
            self.out[y, x, c] = P
            return
        b = 1 + bucket(abs(P) / self.T * single(2))
        z = 3 + b if P > 0 else 3 - b if P < 0 else 3
        q = [0, 0]
        for k in range(min(c, 2)):
            if self.M[k][y + 2][x + 2]:
                q[k] = 1 + self.negative[k][y + 2][x + 2]
        negative = self.models.sign[(7 * self.B + z) * 9 + 3 * q[0] + q[1]].decode(self.coder)
        self.negative[c][y + 2][x + 2] = negative
        if magnitude == 1:
            m = self.T * (single(1) - self.shrink[0])
        else:
            m = (single(magnitude) - self.shrink[1]) * self.T
        self.out[y, x, c] = P - m if negative else P + m

    def magnitude(self, x, y, c):
        M, B, C = self.M[c], self.B, c
        above, row = M[y + 1], M[y + 2]
        W, N, NW, NE, WW, NN = row[x + 1], above[x + 2], above[x + 1], above[x + 3], row[x], M[y][x + 2]
        near = 2 * (W + N) + NW + NE
        colours = sum(self.M[k][y + 2][x + 2] for k in range(c))
        others = sum(self.M[k][y + 2][x + 1] + self.M[k][y + 1][x + 2] for k in range(3) if k != c)
        H = self.hints[c]
        hint = H[y + 2][x + 2]
        hints = H[y + 2][x + 1] + H[y + 2][x + 3] + H[y + 1][x + 2] + (H[y + 3][x + 2])
        parent = self.parent[c][y // 2 + 2][x // 2 + 2] if self.parent else 0
        siblings = sum(s[c][y + 2][x + 2] for s in self.siblings)
        wide = 3 * near + 2 * (WW + NN) + 3 * parent + 2 * siblings
        total = wide + 4 * colours + hint
        g = c8(hint // 2)
        h, a = (8, 0) if self.predicted is None else (g, 1)
        K = 3 * B + C
        tight = 64 * min(W, 3) + 16 * min(N, 3) + 4 * min(NE, 3) + min(NW, 3)
        near12, second = c12(near), c8(2 * colours + others // 2)
        fourth = c8(2 * parent) * 8 + c8(2 * siblings + WW + NN)
        for i in range(14):
            kind = min(i, 2)
            contexts = [
                ((K * 3 + kind) * 12 + near12) * 9 + h,
                ((K * 3 + kind) * 12 + near12) * 8 + second,
                ((6 * C + self.l) * 3 + kind) * 24 + log(wide, 23),
                (K * 3 + kind) * 64 + fourth,
                ((K * 3 + kind) * 9 + h) * 8 + c8(hints // 4),
                ((C * 3 + kind) * 256 + tight) * 4 + min(g, 6) // 2,
                ((C * 3 + kind) * 32 + log(2 * total, 31)) * 4 + B // 2,
                (((C * 3 + kind) * 8 + c8(2 * colours)) * 8 + c8(others)) * 4 + min(c8(near // 2), 6) // 2,
            ]
            selectors = [(24 * a + K) * 3 + kind, 16 * kind + log(total, 15)]
            if not self.models.magnitude.decode(self.coder, contexts, selectors):
                return i
        return min(14 + self.models.large.decode(self.coder), 1 << 20)
