"""Wavelet coefficients, from spec/planes.md section 7."""

import numpy as np

from entropy import Average, Bit, Mixer, Number, Symbols

single = np.float32
LEVEL_STEPS = np.array([0x3F8A3D71, 0x3F733333, 0x3F666666, 0x3F59999A, 0x3F59999A], np.uint32).view(single)


class Models:
    def __init__(self, direct=False):
        if direct:
            self.kind = DirectBand
            self.pattern, self.more, self.block = Symbols([864, 1024]), Symbols([2304, 3072]), Average([144, 384])
        else:
            self.kind = MixedBand
            self.any = Mixer([864, 1152, 144, 512, 576, 1024, 128, 648], [16, 16])
            self.magnitude = Mixer([7776, 6912, 1296, 4608, 5184, 9216, 1152, 2304], [144, 48])
            self.sign = [Bit() for _ in range(504)]
        self.large = Number()
        self.gains, self.corrections = Gains(), Gains()

    def copy(self):
        other = Models.__new__(Models)
        for name, model in vars(self).items():
            if name != "kind":
                setattr(other, name, [m.copy() for m in model] if isinstance(model, list) else model.copy())
        other.kind = self.kind
        return other


class Gains:
    """Gains of one part of the prediction: by gain class, channel and bucket."""

    def __init__(self):
        self.last = [[[16 if g == 10 else 8] * 3 for _ in range(3)] for g in range(11)]
        self.numbers = [Number() for _ in range(3)]

    def copy(self):
        other = Gains.__new__(Gains)
        other.last = [[list(row) for row in g] for g in self.last]
        other.numbers = [number.copy() for number in self.numbers]
        return other

    def decode(self, coder, classes):
        for g in classes:
            for row in self.last[g]:
                for k in range(3):
                    row[k] = min(max(row[k] + self.numbers[k].signed(coder), 0), 24)

    def scaled(self, part, band, step):
        """Coefficients of a band times their gains."""
        steps = np.abs(part) * (single(1) / band_step(band, step))
        buckets = (steps > single(0.75)).astype(int) + (steps > single(2.5))
        gains = (np.array(self.last[gain_class(band)]) / 16).astype(single)
        return np.stack([part[..., c] * gains[c][buckets[..., c]] for c in range(3)], -1)


def band_step(band, step):
    return step * LEVEL_STEPS[4 if band.kind == "low" else band.level - 1]


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


def padded(height, width, count=3):
    """Three channels, or more, with two more columns each side and two more rows above, one below."""
    return [[[0] * (width + 4) for _ in range(height + 3)] for _ in range(count)]


def decode(coder, models, bands, step, shrink, predicted=None, correction=None):
    """Coefficients of these bands, and their magnitudes. `predicted` are those of the prediction by views and `correction` those of the
    model's, for all bands or the first ones, or None."""
    predicted_bands = len(predicted or correction or ())
    used = sorted({gain_class(band) for band in bands[:predicted_bands]})
    if predicted is not None:
        models.gains.decode(coder, used)
    if correction is not None:
        models.corrections.decode(coder, used)
    results, magnitudes = [], []
    for index in range(len(bands)):
        prediction = None
        if index < predicted_bands and correction is None:
            prediction = predicted[index], models.gains.last[gain_class(bands[index])]
        elif index < predicted_bands:
            total = models.corrections.scaled(correction[index], bands[index], step)
            if predicted is not None:
                total = models.gains.scaled(predicted[index], bands[index], step) + total
            prediction = total, [[16] * 3] * 3
        band = bands[index]
        parent = (magnitudes[index - 3], 0, 0) if band.kind != "low" and index > 3 else None
        count = {"vertical": 1, "diagonal": 2}.get(band.kind, 0)
        siblings = [magnitudes[index - 1 - k] for k in range(count)]
        decoder = models.kind(coder, models, band, step, shrink, prediction, parent, siblings)
        results.append(decoder.decode())
        magnitudes.append(decoder.M)
    return results, magnitudes


class Part:
    """What a tile holds of a band."""

    def __init__(self, band, x, y, side):
        self.kind, self.level, self.mask = band.kind, band.level, band.mask[y : y + side, x : x + side]


def decode_tile(coder, bands, results, place, above, step, shrink):
    """A tile at (x, y) of a side: three bands into `results`. `above` and what is returned are models, magnitudes of the three bands (none
    if there are none) and where these begin."""
    x, y, side = place
    models, coarser, (left, top) = above
    models = models.copy()
    if not any(Part(band, x, y, side).mask.any() for band in bands):
        return models, [], (x, y)
    magnitudes = []
    for k, band in enumerate(bands):
        parent = (coarser[k], x // 2 - left, y // 2 - top) if len(coarser) == 3 else None
        part = Part(band, x, y, side)
        decoder = models.kind(coder, models, part, step, shrink, None, parent, magnitudes[::-1])
        results[k][y : y + side, x : x + side] = decoder.decode()
        magnitudes.append(decoder.M)
    return models, magnitudes, (x, y)


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
        self.parent = band.coarse(c, x // 2, y // 2)
        self.siblings = sum(s[c][y + 2][x + 2] for s in band.siblings)
        self.wide = 3 * self.near + 2 * self.far + 3 * self.parent + 2 * self.siblings


class BandDecoder:
    """What both modellings have in common; `values` gives the signed values of a place."""

    fields = 3

    def __init__(self, coder, models, band, step, shrink, prediction, parent, siblings):
        self.coder, self.models, self.band = coder, models, band
        self.low = band.kind == "low"
        self.T = band_step(band, step)
        self.u = single(1) / self.T
        self.shrink = shrink
        self.B, self.l = context_class(band), 0 if self.low else band.level
        height, width = band.mask.shape
        self.M, self.hints = padded(height, width, self.fields), padded(height, width, self.fields)
        self.out = np.zeros((height, width, 3), single)
        self.predicted, self.gains = prediction or (None, None)
        if prediction is not None:
            self.set_hints()
        self.parent, self.siblings = parent, siblings

    def coarse(self, field, x, y):
        """Magnitude in the coarser band, counted from what lies above the first place; 0 beyond the band and without one."""
        if self.parent is None:
            return 0
        magnitudes, left, top = self.parent
        rows = magnitudes[field]
        x, y = x + left + 2, y + top + 2
        return rows[y][x] if y < len(rows) and x < len(rows[y]) else 0

    def decode(self):
        for y, row in enumerate(self.band.mask):
            self.begin_row(y)
            for x in np.flatnonzero(row).tolist():
                self.place(x, y)
        return self.out

    def begin_row(self, y):
        pass

    def place(self, x, y):
        predictions = [self.prediction(x, y, c) for c in range(3)]
        for c, (P, value) in enumerate(zip(predictions, self.values(x, y, predictions))):
            self.M[c][y + 2][x + 2] = min(abs(value), 255)
            if value:
                m = (single(abs(value)) - self.shrink[0 if abs(value) == 1 else 1]) * self.T
                P = P - m if value < 0 else P + m
            self.out[y, x, c] = P

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

    def h(self, v):
        return 8 if self.predicted is None else c8(v)


class MixedBand(BandDecoder):
    """Mixed modelling."""

    def set_hints(self):
        hints = np.minimum(np.abs(self.predicted) * (single(4) / self.T), 8191).astype(int)
        height, width = self.band.mask.shape
        for c in range(3):
            for y in range(height):
                self.hints[c][y + 2][2 : width + 2] = hints[y, :, c].tolist()

    def values(self, x, y, predictions):
        around = [Around(self, x, y, c) for c in range(3)]
        values = [0, 0, 0]
        if not self.some(around):
            return values
        for c, P in enumerate(predictions):
            colours = sum(min(abs(v), 255) for v in values[:c])
            magnitude = self.magnitude(c, around, colours, 1 if c == 2 and values[:2] == [0, 0] else 0)
            if magnitude:
                b = 1 + bucket(abs(P) * self.u * single(2))
                z = 3 + b if P > 0 else 3 - b if P < 0 else 3
                q = [1 if v > 0 else 2 if v < 0 else 0 for v in values]
                negative = self.models.sign[(7 * self.B + z) * 9 + 3 * q[0] + q[1]].decode(self.coder)
                values[c] = -magnitude if negative else magnitude
        return values

    def magnitude(self, c, around, colours, first):
        contexts = self.magnitude_contexts(c, around, colours)
        for i in range(first, 14):
            if not self.models.magnitude.decode(self.coder, *contexts(min(i, 2))):
                return i
        return min(14 + self.models.large.decode(self.coder), 1 << 20)

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

    def magnitude_contexts(self, c, around, colours):
        here, B, C = around[c], self.B, c
        others = sum(a.W + a.N for k, a in enumerate(around) if k != c)
        total = here.wide + 4 * colours + here.hint
        a = 0 if self.predicted is None else 1
        K = 3 * B + C
        tight = 64 * min(here.W, 3) + 16 * min(here.N, 3) + 4 * min(here.NE, 3) + min(here.NW, 3)
        near12, second = c12(here.near), c8(2 * colours + others // 2)
        fourth = c8(2 * here.parent) * 8 + c8(2 * here.siblings + here.far)
        hint = self.h(here.hint // 2)

        def contexts(kind):
            slots = [
                ((K * 3 + kind) * 12 + near12) * 9 + hint,
                ((K * 3 + kind) * 12 + near12) * 8 + second,
                ((6 * C + self.l) * 3 + kind) * 24 + log(here.wide, 23),
                (K * 3 + kind) * 64 + fourth,
                ((K * 3 + kind) * 9 + hint) * 8 + c8(here.hints // 4),
                ((C * 3 + kind) * 256 + tight) * 4 + few(here.hint // 2),
                ((C * 3 + kind) * 32 + log(2 * total, 31)) * 4 + B // 2,
                (((C * 3 + kind) * 8 + c8(2 * colours)) * 8 + c8(others)) * 4 + few(here.near // 2),
            ]
            return slots, [(24 * a + K) * 3 + kind, 16 * kind + log(total, 15)]

        return contexts


class Near:
    """Neighbourhood of one field at a place: that of a channel, or of their sum."""

    def __init__(self, band, x, y, field):
        M = band.M[field]
        above, row = M[y + 1], M[y + 2]
        self.near = 2 * (row[x + 1] + above[x + 2]) + above[x + 1] + above[x + 3]
        self.far = row[x] + M[y][x + 2]
        self.hint = band.hints[field][y + 2][x + 2]
        self.parent = band.coarse(field, x // 2, y // 2)


def square(grid, side, x, y):
    """Sum over a square of places, x and y counted in squares."""
    rows = grid[side * y + 2 : side * (y + 1) + 2]
    return sum(sum(row[side * x + 2 : side * (x + 1) + 2]) for row in rows)


class DirectBand(BandDecoder):
    """Direct modelling. Fields are the three channels and their sum."""

    fields = 4

    def set_hints(self):
        hints = np.minimum(np.abs(self.predicted) * (single(2) / self.T), 255).astype(int)
        hints = np.concatenate([hints, np.minimum(hints.sum(-1, keepdims=True), 255)], -1)
        height, width = self.band.mask.shape
        for field in range(4):
            for y in range(height):
                self.hints[field][y + 2][2 : width + 2] = hints[y, :, field].tolist()

    def decode(self):
        self.has_blocks = not self.low and self.band.level == 1
        self.coded = [0] * -(-self.band.mask.shape[1] // 4)
        return super().decode()

    def begin_row(self, y):
        """The blocks that begin in a row."""
        if not self.has_blocks or y % 4:
            return
        before = 0
        for block, above in enumerate(self.coded):
            some = self.band.mask[y : y + 4, 4 * block : 4 * block + 4].any()
            before = self.block(block, y // 4, before + 2 * above) if some else 0
            self.coded[block] = before

    def block(self, x, y, beside):
        parent = sum(self.coarse(3, 2 * x + i, 2 * y + j) for i in range(2) for j in range(2))
        siblings = sum(square(s[3], 4, x, y) for s in self.siblings)
        o = len(self.siblings)
        contexts = [(4 * o + beside) * 12 + c12(parent), ((3 * beside + o) * 8 + c8(siblings)) * 4 + few(parent)]
        return self.models.block.decode(self.coder, contexts)

    def values(self, x, y, predictions):
        if self.has_blocks and not self.coded[x // 4]:
            return [0, 0, 0]
        around = [Near(self, x, y, field) for field in range(4)]
        total = around[3]
        siblings = sum(s[3][y + 2][x + 2] for s in self.siblings)
        wide = 3 * total.near + 2 * total.far + 3 * total.parent + 2 * siblings
        contexts = [
            (12 * self.B + c12(total.near)) * 9 + self.h(total.hint),
            (32 * self.B + log(2 * (wide + 4 * total.hint), 31)) * 4 + few(around[1].near + around[2].near),
        ]
        pattern = self.models.pattern.decode(self.coder, contexts)
        magnitudes = [pattern % 4, pattern // 4 % 2, pattern // 8]
        for c, most in enumerate([3, 1, 1]):
            if magnitudes[c] == most:
                magnitudes[c] += self.more(c, around[c], sum(min(m, 255) for m in magnitudes[:c]), wide)
        self.M[3][y + 2][x + 2] = min(sum(min(m, 255) for m in magnitudes), 255)
        signs = self.coder.equiprobable(sum(m > 0 for m in magnitudes))
        values = [0, 0, 0]
        for c in (2, 1, 0):
            if magnitudes[c]:
                values[c] = -magnitudes[c] if signs % 2 else magnitudes[c]
                signs //= 2
        return values

    def more(self, c, here, colours, wide):
        K = 3 * self.B + c
        total = 3 * here.near + 3 * here.parent + 4 * colours + 2 * here.hint + wide // 4
        contexts = [(12 * K + c12(here.near)) * 8 + c8(here.hint), (8 * K + c8(2 * colours)) * 16 + log(total, 15)]
        value = self.models.more.decode(self.coder, contexts)
        return min(15 + self.models.large.decode(self.coder), 1 << 20) if value == 15 else value
