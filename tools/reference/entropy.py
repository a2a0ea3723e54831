"""Entropy decoding, from spec/entropy.md."""

import struct

import numpy as np

single = np.float32


class Damaged(Exception):
    """The file breaks a rule of the specification."""


class States:
    """Symbol decoder, section 7."""

    def __init__(self, data):
        self.data, self.position, self.x = bytes(data), 0, 1 << 32
        if data:
            low = self.word()
            self.x = low | self.word() << 32

    def word(self):
        word = self.data[self.position : self.position + 4]
        self.position += 4
        return int.from_bytes(word, "little") if len(word) == 4 else 0

    def take(self, start, size):
        self.x = size * (self.x >> 16) + self.x % 65536 - start
        if self.x < 1 << 32:
            self.x = self.x << 32 | self.word()

    def ends_rightly(self):
        return self.x == 1 << 32 and self.position == len(self.data)

    def bit(self, p):
        bit = self.x % 65536 < p
        self.take(*((0, p) if bit else (p, 65536 - p)))
        return int(bit)

    def equiprobable(self, count):
        value = self.x % 65536 >> 16 - count
        self.take(value << 16 - count, 1 << 16 - count)
        return value


class Range:
    """Range decoder, section 1."""

    def __init__(self, data):
        self.data, self.position, self.low, self.high, self.code = bytes(data), 0, 0, 0xFFFFFFFF, 0
        for _ in range(4):
            self.code = self.code << 8 | self.next_byte()

    def next_byte(self):
        byte = self.data[self.position] if self.position < len(self.data) else 0
        self.position += 1
        return byte

    def bit(self, p):
        middle = self.low + ((self.high - self.low) * p >> 16)
        bit = self.code <= middle
        if bit:
            self.high = middle
        else:
            self.low = middle + 1
        while (self.low ^ self.high) < 1 << 24:
            self.low = self.low << 8 & 0xFFFFFFFF
            self.high = (self.high << 8 | 255) & 0xFFFFFFFF
            self.code = (self.code << 8 | self.next_byte()) & 0xFFFFFFFF
        return int(bit)

    def raw(self, count):
        value = 0
        for _ in range(count):
            value = value << 1 | self.bit(32768)
        return value

    def float(self):
        return struct.unpack("<f", struct.pack("<I", self.raw(32)))[0]

    def end_mark(self):
        if self.raw(16) != 0x5AA5:
            raise Damaged("wrong end mark")

    def ends_rightly(self, least=0):
        for count in range(5):
            unit = 1 << (32 - 8 * count)
            value = (self.low + unit - 1) // unit * unit
            if value <= self.high:
                break
        written = self.position - 4 + count
        filled = len(self.data) == least and not any(self.data[written:])
        return self.code == value and (written == len(self.data) or written < len(self.data) and filled)


class Bit:
    """Bit model, section 3."""

    __slots__ = ("probability", "count")

    def __init__(self, probability=32768, count=0):
        self.probability, self.count = probability, count

    def p(self):
        return min(max(self.probability, 32), 65504)

    def update(self, bit):
        change = ((65535 if bit else 0) - self.probability) * 2
        divisor = 2 * self.count + 3
        self.probability += change // divisor if change >= 0 else -(-change // divisor)
        self.count = min(self.count + 1, 40)

    def decode(self, coder):
        bit = coder.bit(self.p())
        self.update(bit)
        return bit

    def copy(self):
        return Bit(self.probability, self.count)


class Number:
    """Number model, section 4."""

    def __init__(self):
        self.length = [Bit() for _ in range(32)]
        self.bits = [[Bit() for _ in range(3)] for _ in range(32)]

    def decode(self, coder):
        n = 0
        while n < 31 and self.length[n].decode(coder):
            n += 1
        r = 1
        for k in range(n):
            if k == 0:
                bit = self.bits[n][0].decode(coder)
            elif k == 1:
                bit = self.bits[n][1 + (r & 1)].decode(coder)
            else:
                bit = coder.bit(32768)
            r = 2 * r + bit
        return r - 1

    def signed(self, coder):
        f = self.decode(coder)
        return f >> 1 if f % 2 == 0 else -(f >> 1) - 1

    def copy(self):
        other = Number.__new__(Number)
        other.length = [b.copy() for b in self.length]
        other.bits = [[b.copy() for b in row] for row in self.bits]
        return other


LOGISTIC = [
    524288, 589485, 652696, 712170, 766570, 815058, 857289, 893337, 923583, 948595, 969033, 985571, 998846, 1009436,
    1017840, 1024482, 1029716, 1033829, 1037055, 1039582, 1041558, 1043102, 1044308, 1045249, 1045983, 1046556,
    1047002, 1047350, 1047621, 1047832, 1047996, 1048125, 1048224, 1048302, 1048363, 1048410, 1048447, 1048475,
    1048498, 1048515, 1048528, 1048539, 1048547, 1048554, 1048558, 1048562, 1048565, 1048568, 1048570,
]  # fmt: skip


def _squash(x):
    if x >= 0:
        k, r = divmod(x, 64)
        value = LOGISTIC[k] * (64 - r) + LOGISTIC[min(k + 1, 48)] * r >> 10
    else:
        k, r = divmod(-x, 64)
        value = 65536 - (LOGISTIC[k] * (64 - r) + LOGISTIC[min(k + 1, 48)] * r >> 10)
    return min(max(value, 2), 65534)


SQUASH = [_squash(x) for x in range(-3071, 3072)]
STRETCH = np.array([(np.searchsorted(SQUASH, 16 * i + 8).clip(0, 6142) - 3071) / 256 for i in range(4096)], single)
RECIPROCAL = [131072 // (2 * n + 3) for n in range(256)]


def _squash_odds(odds):
    return SQUASH[min(max(int(odds * single(256)), -3071), 3071) + 3071]


class Mixer:
    """Mixer, section 5."""

    def __init__(self, slots, selectors):
        self.p = [[1 << 21] * n for n in slots]
        self.n = [[0] * n for n in slots]
        self.weights = [np.full((n, 8), 0.3, single) for n in selectors]
        self.rates = [np.full(n, 0.02, single) for n in selectors]

    def copy(self):
        other = Mixer.__new__(Mixer)
        other.p, other.n = [list(x) for x in self.p], [list(x) for x in self.n]
        other.weights, other.rates = [x.copy() for x in self.weights], [x.copy() for x in self.rates]
        return other

    def decode(self, coder, contexts, selectors):
        v = STRETCH[[self.p[k][contexts[k]] >> 10 for k in range(8)]]
        odds, each = [], []
        for s in (0, 1):
            a = self.weights[s][selectors[s]] * v
            a = a[:4] + a[4:]
            odds.append((a[0] + a[2]) + (a[1] + a[3]))
            each.append(_squash_odds(odds[s]))
        bit = coder.bit(_squash_odds((odds[0] + odds[1]) * single(0.5)))
        target = 65536 if bit else 0
        for s in (0, 1):
            rate = self.rates[s][selectors[s]]
            d = rate * single((target - each[s]) / 65536)
            self.rates[s][selectors[s]] = rate + single(0.01) * (single(0.002) - rate)
            self.weights[s][selectors[s]] += d * v
        top = (1 << 22) - 1 if bit else 0
        for k in range(8):
            c = contexts[k]
            p, n = self.p[k][c], self.n[k][c]
            self.p[k][c] = p + ((top - p) * RECIPROCAL[n] >> 16)
            self.n[k][c] = min(n + 1, 250)
        return bit


class Symbols:
    """Symbols, section 8."""

    BOUNDS = (1, 4, 9, 19, 39, 79)

    def __init__(self, counts):
        self.starts = [[[2048 * i for i in range(16)] for _ in range(n)] for n in counts]
        self.n = [[0] * n for n in counts]

    def copy(self):
        other = Symbols.__new__(Symbols)
        # Starts are never changed in place.
        other.starts, other.n = [list(x) for x in self.starts], [list(x) for x in self.n]
        return other

    def decode(self, coder, contexts):
        a, b = (self.starts[k][c] for k, c in enumerate(contexts))
        total = [x + y for x, y in zip(a, b)] + [65536]
        place = coder.x % 65536
        value = max(v for v in range(16) if total[v] <= place)
        coder.take(total[value], total[value + 1] - total[value])
        targets = [2 * i if i <= value else 32768 - 2 * (16 - i) for i in range(16)]
        for k, c in enumerate(contexts):
            rate = 1 + sum(self.n[k][c] >= bound for bound in self.BOUNDS)
            self.starts[k][c] = [s + (t - s >> rate) for s, t in zip(self.starts[k][c], targets)]
            self.n[k][c] += 1
        return value


class Average:
    """Average, section 6."""

    def __init__(self, slots):
        self.p = [[1 << 21] * n for n in slots]
        self.n = [[0] * n for n in slots]

    def copy(self):
        other = Average.__new__(Average)
        other.p, other.n = [list(x) for x in self.p], [list(x) for x in self.n]
        return other

    def decode(self, coder, contexts):
        total = sum(self.p[k][c] for k, c in enumerate(contexts))
        bit = coder.bit(min(max(total >> 7, 16), 65520))
        top = (1 << 22) - 1 if bit else 0
        for k, c in enumerate(contexts):
            p, n = self.p[k][c], self.n[k][c]
            self.p[k][c] = p + ((top - p) * RECIPROCAL[n] >> 16)
            self.n[k][c] = min(n + 1, 120)
        return bit
