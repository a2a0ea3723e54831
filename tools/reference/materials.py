"""Sections mATl and bIND, from spec/materials.md: values of materials, and which triangles take them."""

import math
import struct

from entropy import Bit, Damaged, Number, Range

LEVELS = [
    ([0, 0, 0, 1, 2, 3, 3, 4, 5, 5, 6, 7, 9, 10, 12, 15], [0, 1, 2, 3, 4, 5, 6, 8, 10, 12], [0, 1, 2, 3, 4, 6, 7, 8]),
    ([0, 0, 2, 3, 4, 5, 6, 8, 8, 9, 10, 11, 12, 13, 14, 16], [0, 0, 3, 5, 7, 9, 11, 12, 14, 17], [0, 4, 9, 13, 17, 18, 20, 21]),
]  # fmt: skip
CONTINUE = [
    [2299, 1552, 1932, 4437, 34055, 58599, 60877, 61487, 61922, 62270, 62556, 62796],
    [3219, 2187, 2653, 3756, 16738, 52384, 60468, 61465, 61920, 62270, 62556, 62796],
    [4487, 3077, 3699, 4377, 8482, 34201, 57561, 61227, 61902, 62268, 62556, 62796],
    [6217, 4318, 5176, 5824, 7143, 15643, 43140, 58887, 61642, 62241, 62554, 62796],
    [8537, 6028, 7217, 8024, 8710, 10654, 20259, 43750, 58325, 61722, 62478, 62785],
    [11579, 8344, 9972, 11061, 11741, 12379, 14070, 20628, 37509, 54235, 60727, 62425],
    [15437, 11387, 13552, 15023, 15909, 16438, 16890, 17773, 20451, 28004, 41868, 54442],
    [20123, 15211, 17944, 19856, 21051, 21745, 22144, 22420, 22751, 23436, 25135, 29165],
    [25518, 19757, 22943, 25248, 26785, 27741, 28305, 28632, 28830, 28974, 29134, 29395],
    [31370, 24851, 28224, 30721, 32503, 33724, 34523, 35027, 35338, 35528, 35646, 35727],
    [37322, 30264, 33506, 35914, 37715, 39061, 40048, 40751, 41238, 41569, 41790, 41936],
    [42997, 35726, 38596, 40718, 42324, 43580, 44579, 45369, 45986, 46459, 46816, 47080],
    [48088, 40976, 43325, 45087, 46422, 47470, 48325, 49039, 49641, 50147, 50571, 50921],
    [52403, 45811, 47569, 48947, 50016, 50860, 51544, 52116, 52607, 53037, 53416, 53751],
    [55875, 50095, 51290, 52281, 53090, 53749, 54290, 54742, 55127, 55461, 55757, 56023],
    [58546, 53737, 54481, 55130, 55691, 56171, 56580, 56931, 57233, 57495, 57726, 57931],
]  # fmt: skip


def decode(data):
    """Materials by name, each a function of two directions."""
    if data[0] not in (1, 2):
        raise Damaged("version of mATl")
    count, at, materials = int.from_bytes(data[1:5], "little"), 5, {}
    for _ in range(count):
        form, length = data[at], data[at + 1]
        name = data[at + 2 : at + 2 + length].decode("utf-8")
        at += 2 + length
        size = int.from_bytes(data[at : at + 2], "little")
        if form > (1 if data[0] == 1 else 3):
            raise Damaged("form of a material")
        materials[name] = material(form, data[at + 2 : at + 2 + size])
        at += 2 + size
    if at != len(data):
        raise Damaged("end of mATl")
    return materials


def binding(data, triangles, names):
    """The number of each triangle's material among the names, and the names: section 6."""
    if data[0] != 0:
        raise Damaged("version of bIND")
    count, at, bound = int.from_bytes(data[1:3], "little"), 3, []
    for _ in range(count):
        bound.append(data[at + 1 : at + 1 + data[at]].decode("utf-8"))
        at += 1 + data[at]
    if not bound or len(set(bound)) < count or not all(name in names for name in bound):
        raise Damaged("names of bIND")
    coder, repeats, number = Range(data[at:]), [Bit(), Bit()], Number()
    found, before, same = [], 1, 1
    for _ in range(triangles):
        same = int(repeats[same].decode(coder))
        if not same:
            other = number.decode(coder)
            before = other + (other >= before)
            if before > count:
                raise Damaged("material of a triangle")
        found.append(before)
    coder.end_mark()
    if not coder.ends_rightly():
        raise Damaged("end of bIND")
    return found, bound


def material(form, coded):
    if form >= 2:
        return (Classical, Metallic)[form - 2](coded)
    coder = Range(coded)
    result = (Lobes, Compact)[form](coder)
    coder.end_mark()
    if not coder.ends_rightly():
        raise Damaged("end of a material")
    return result


def angles(i, o):
    """theta_h and theta_d."""
    h = [a + b for a, b in zip(i, o)]
    length = math.sqrt(sum(x * x for x in h))
    h = [x / length for x in h]
    return math.acos(min(h[2], 1.0)), math.acos(min(sum(a * b for a, b in zip(h, i)), 1.0))


class Lobes:
    """Form 0, section 2."""

    def __init__(self, coder):
        S, K, P = coder.raw(7), coder.raw(3), 2 + coder.raw(1)
        first, following = [Number(), Number()], [Number() for _ in range(3)]
        self.lobes, before = [], {}
        for colour in range(3):
            self.lobes.append([])
            for lobe in range(K):
                curves = []
                for p in range(P):
                    q = []
                    for s in range(S):
                        guess = q[-1] if s else 0
                        if colour:
                            r = before[lobe, p]
                            guess += r[s] - r[s - 1] if s else r[0]
                        model = following[p] if s else first[colour > 0]
                        q.append(guess + model.signed(coder))
                        if not -1024 <= q[-1] <= 1024:
                            raise Damaged("parameter of a lobe")
                    before[lobe, p] = q
                    curves.append([v / 64 for v in q])
                self.lobes[-1].append(curves)

    def evaluate(self, i, o):
        theta_h, theta_d = angles(i, o)
        values = []
        for lobes in self.lobes:
            total = 0.0
            for curves in lobes:
                kappa, gamma, *rest = [math.exp(spline(curve, theta_d)) for curve in curves]
                total += (rest[0] if rest else 1.0) * (math.exp(kappa * math.cos(theta_h) ** gamma) - 1)
            values.append(total)
        return values


def spline(q, theta_d):
    x = min(max(theta_d / (math.pi / 2) * len(q) - 0.5, 0.0), len(q) - 1.0)
    k = min(int(x), len(q) - 2)
    if k < 0:
        return q[0]

    def slope(n):
        if n in (0, len(q) - 1):
            return 0.0
        left, right = q[n] - q[n - 1], q[n + 1] - q[n]
        return 2 * left * right / (left + right) if left * right > 0 else 0.0

    t = x - k
    return ((2 * t**3 - 3 * t**2 + 1) * q[k] + (t**3 - 2 * t**2 + t) * slope(k)
            + (3 * t**2 - 2 * t**3) * q[k + 1] + (t**3 - t**2) * slope(k + 1))  # fmt: skip


class Compact:
    """Form 1, section 3."""

    def __init__(self, coder):
        reciprocal, n, self.floor, self.ceiling = coder.raw(1), coder.raw(6), coder.raw(5), coder.raw(7)
        gains = [coder.raw(5) for _ in range(3)]
        step = (8 + n % 8) * 2.0 ** (n // 8 - 13)
        self.degrees = [
            (a, b, m) for a in range(16) for b in range(10) for m in range(0, 8, 2 if reciprocal else 1)
            if 80 * a + 128 * b + 160 * m <= 1280
        ]  # fmt: skip
        q = [[coefficient(coder, gains[c], c, d) for d in self.degrees] for c in range(3)]
        self.colours = []
        for k in range(len(self.degrees)):
            u, v, w = (q[c][k] * (step * factor) for c, factor in enumerate((9 / 16, 11 / 16, 13 / 32)))
            self.colours.append((u + v + w, u - 2 * w, u - v + w))

    def evaluate(self, i, o):
        theta_h, theta_d = angles(i, o)
        x = chebyshev(2 * math.sqrt(theta_h / (math.pi / 2)) - 1)
        y, s = chebyshev(2 * theta_d / (math.pi / 2) - 1), chebyshev((i[2] - o[2]) / (i[2] + o[2]))
        terms = [x[a] * y[b] * s[m] for a, b, m in self.degrees]
        sums = [sum(t * c[k] for t, c in zip(terms, self.colours)) for k in range(3)]
        return [max(math.exp(min(v, self.ceiling / 4 - 8)) - 2.0**-self.floor, 0.0) for v in sums]


def chebyshev(x):
    t = [1.0, x]
    while len(t) < 16:
        t.append(2 * x * t[-1] - t[-2])
    return t


def coefficient(coder, gain, channel, degrees):
    tables = LEVELS[channel > 0]
    row, shift = max(gain - sum(t[d] for t, d in zip(tables, degrees)) + 10, 0), 0
    if row > 15:
        shift = (row - 14) // 2
        row -= 2 * shift
    quotient = 0
    while quotient < 12 and coder.bit(CONTINUE[row][quotient]):
        quotient += 1
    if quotient == 12:
        e = 0
        while e < 20 and coder.bit(32768):
            e += 1
        quotient += 2**e - 1 + coder.raw(e)
    magnitude = (quotient << shift) + coder.raw(shift)
    if magnitude >= 1 << 20:
        raise Damaged("coefficient of a material")
    return -magnitude if magnitude and coder.bit(32768) else magnitude


class Classical:
    """Form 2, section 4."""

    LENGTHS = (0, 1, 2, 2, 1, 2, 3, 3, 1, 27)

    def __init__(self, coded):
        self.model, colours = coded[0], 6 if coded[0] else 3
        if len(coded) != 1 + 8 * (colours + self.LENGTHS[self.model]):
            raise Damaged("numbers of a classical model")
        numbers = struct.unpack(f"<{(len(coded) - 1) // 8}d", coded[1:])
        self.diffuse, self.specular, self.parameters = numbers[:3], numbers[3:colours], numbers[colours:]
        if not all(0 <= x <= 1e6 for x in numbers[:colours]) or not all(abs(x) <= 1e300 for x in self.parameters):
            raise Damaged("range of a classical model")

    def evaluate(self, i, o):
        return [k / math.pi + (self.specular[c] * self.lobe(i, o, c) if self.model else 0) for c, k in enumerate(self.diffuse)]

    def lobe(self, i, o, colour):
        h = [a + b for a, b in zip(i, o)]
        length = math.sqrt(sum(x * x for x in h))
        x, y, c_h = (v / length for v in h)
        c_i, c_o, c_d = i[2], o[2], length / 2
        q, p = x * x + y * y, self.parameters
        t, pi = q / c_h**2, math.pi

        def fresnel(r):
            return r + (1 - r) * (1 - c_d) ** 5

        if self.model == 1:
            return (p[0] + 2) / (2 * pi) * c_h ** p[0]
        if self.model == 2:
            groove = min(1, 2 * c_h * min(c_i, c_o) / c_d)
            return fresnel(p[1]) * math.exp(-t / p[0] ** 2) / (pi * p[0] ** 2 * c_h**4) * groove / (4 * c_i * c_o)
        if self.model == 3:
            a = p[0] ** 2
            u = [2 / (c + math.sqrt(a + (1 - a) * c * c)) for c in (c_i, c_o)]
            return fresnel(p[1]) * a / (pi * (c_h**2 * a + q) ** 2) * u[0] * u[1] / 4
        if self.model == 4:
            return math.exp(-t / p[0] ** 2) / (4 * pi * p[0] ** 2 * math.sqrt(c_i * c_o))
        if self.model == 5:
            slope = ((x / p[0]) ** 2 + (y / p[1]) ** 2) / c_h**2
            return math.exp(-slope) / (4 * pi * p[0] * p[1] * math.sqrt(c_i * c_o))
        if self.model == 6:
            e = (p[0] * x * x + p[1] * y * y) / q if q > 1e-18 and p[0] != p[1] else p[0]
            norm = math.sqrt((p[0] + 1) * (p[1] + 1)) / (8 * pi)
            return norm * fresnel(p[2]) * c_h**e / (c_d * max(c_i, c_o))
        if self.model == 7:
            b = p[0] * (i[0] * o[0] + i[1] * o[1]) + p[1] * c_i * c_o
            return (p[2] + 2) / (2 * pi) * (max(b, 0) / max(abs(p[0]), abs(p[1]))) ** p[2]
        if self.model == 8:
            theta = math.atan2(math.sqrt(q), c_h)
            w = struct.unpack("<f", struct.pack("<f", 0.05))[0]
            return math.exp(-(theta**2) / (2 * p[0] ** 2)) / (max(c_o, w) * max(c_i, 0.001))
        alpha, power, f_0, f_1, scale, height, rate, exponent, first = p[colour::3]

        def unshadowed(cosine):
            beyond = math.acos(cosine) - first
            return 1 if beyond <= 0 else min(max(1 + height * (1 - math.exp(rate * beyond**exponent)), 0), 1)

        y = alpha + t / alpha
        distribution = scale * math.exp(-y) / y**power / (pi * c_h**4)
        masking = unshadowed(c_i) * unshadowed(c_o)
        return max(fresnel(f_0) - f_1 * c_d, 0) * distribution * masking / (pi * c_i * c_o)


class Metallic:
    """Form 3, section 5."""

    def __init__(self, coded):
        if len(coded) != 64:
            raise Damaged("numbers of a metallic-roughness material")
        numbers = struct.unpack("<8d", coded)
        if not all(0 <= x <= 1 for x in numbers[:5]) or not all(0 <= x <= 1e6 for x in numbers[5:]):
            raise Damaged("range of a metallic-roughness material")
        self.base, self.metalness, self.roughness, self.specular = numbers[:3], numbers[3], numbers[4], numbers[5:]

    def evaluate(self, i, o):
        h = [a + b for a, b in zip(i, o)]
        length = math.sqrt(sum(x * x for x in h))
        c_i, c_o, c_h, c_d = i[2], o[2], h[2] / length, length / 2
        a = max(self.roughness**2, 0.002) ** 2

        def fresnel(r):
            return r + (1 - r) * (1 - c_d) ** 5

        def v(x, y):
            return x * math.sqrt(y * y * (1 - a) + a)

        b = a / (math.pi * (c_h**2 * (a - 1) + 1) ** 2) / (2 * (v(c_i, c_o) + v(c_o, c_i)))
        dielectric = [fresnel(min(0.04 * s, 1)) for s in self.specular]
        values = []
        for k, d in zip(self.base, dielectric):
            plastic = k / math.pi * (1 - max(dielectric)) + b * d
            values.append(plastic + self.metalness * (b * fresnel(k) - plastic))
        return values
