"""Sections CHRT and RFLC, from spec/charts.md and spec/reflectance.md."""

import copy
import math
import struct

import numpy as np

from coefficients import Models
from coefficients import decode as decode_coefficients
from entropy import Bit, Damaged, Number, Range
from functions import exponential
from geometry import Transform, vertex_normals

single = np.float32
BOUNDS = [0.06, 0.16, 0.3, 0.42, 0.54, 0.7]


def along(n, facing):
    return -n[facing // 2] if facing % 2 else n[facing // 2]


def total_order(value):
    """Sorts -0 before +0."""
    return value, math.copysign(1.0, value)


def slope(n, facing):
    c = along(n, facing)
    if c <= 0:
        return 0
    square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
    return 1 + sum(c * c > bound * square for bound in BOUNDS)


def neighbours(triangles):
    edges = []
    for t, corners in enumerate(triangles):
        for side in range(3):
            a, b = corners[side], corners[(side + 1) % 3]
            edges.append((min(a, b), max(a, b), 3 * t + side))
    edges.sort()
    result, k = [[None] * 3 for _ in triangles], 0
    while k + 1 < len(edges):
        (a, b, one), (c, d, two) = edges[k], edges[k + 1]
        if (a, b) == (c, d) and one // 3 != two // 3:
            result[one // 3][one % 3] = two // 3
            result[two // 3][two % 3] = one // 3
            k += 2
        else:
            k += 1
    return result


def visiting_order(near):
    order, seen, at = [], [False] * len(near), 0
    for start in range(len(near)):
        if seen[start]:
            continue
        seen[start] = True
        order.append(start)
        while at < len(order):
            for other in near[order[at]]:
                if other is not None and not seen[other]:
                    seen[other] = True
                    order.append(other)
            at += 1
    return order


class Charts:
    """Atlas size, density, and each triangle's chart: (facing, offset)."""

    def __init__(self, data, positions, triangles):
        self.density = struct.unpack("<f", data[:4])[0]
        self.positions, self.triangles = positions, triangles
        coder = self.coder = Range(data[4:])
        size = Number()
        self.width, self.height = size.decode(coder), size.decode(coder)
        self.near = neighbours(triangles)
        self.chart, self.facings = [None] * len(triangles), []
        self.keeps, self.others = {}, {}
        self.fresh, self.dominant, self.facing, self.index = Bit(), Bit(), [Bit() for _ in range(8)], Number()
        for t in visiting_order(self.near):
            self.chart[t] = self.triangle(t)
        x, y = Number(), Number()
        self.offsets = [(x.signed(coder), y.signed(coder)) for _ in self.facings]
        if not coder.ends_rightly():
            raise Damaged("bytes left over in CHRT")

    def triangle(self, t):
        a, b, c = (self.positions[v] for v in self.triangles[t])
        e, f = [y - x for x, y in zip(a, b)], [y - x for x, y in zip(a, c)]
        n = (e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0])
        visited = [self.chart[o] for o in self.near[t] if o is not None and self.chart[o] is not None]
        candidates = sorted(dict.fromkeys(visited), key=lambda chart: total_order(-along(n, self.facings[chart])))
        best = max(range(6), key=lambda facing: (along(n, facing), -facing))
        coder = self.coder
        if candidates:
            facing = self.facings[candidates[0]]
            situation = {1: len(visited) - 1, 2: len(visited) + 1, 3: 5}[len(candidates)]
            key = (slope(n, facing), facing == best, situation)
            if self.keeps.setdefault(key, Bit()).decode(coder):
                return candidates[0]
            for k, other in enumerate(candidates[1:]):
                key = (k, slope(n, self.facings[other]) // 2)
                if self.others.setdefault(key, Bit()).decode(coder):
                    return other
        if self.facings and not self.fresh.decode(coder):
            back = self.index.decode(coder)
            if back >= len(self.facings):
                raise Damaged("a chart that does not exist")
            return len(self.facings) - 1 - back
        facing = best
        if not self.dominant.decode(coder):
            node = 1
            for _ in range(3):
                node = node << 1 | self.facing[node].decode(coder)
            facing = node & 7
            if facing > 5:
                raise Damaged("facing")
        self.facings.append(facing)
        return len(self.facings) - 1

    def corners(self, t):
        facing, (a, b) = self.facings[self.chart[t]], self.offsets[self.chart[t]]
        result = []
        for vertex in self.triangles[t]:
            p = self.positions[vertex]
            u, v = ((p[1], p[2]), (p[2], p[0]), (p[0], p[1]))[facing // 2]
            u = -u if facing % 2 else u
            result.append((u * self.density + a, v * self.density + b))
        return result

    def mask(self):
        """Texels in use, spec/reflectance.md section 2."""
        mask = np.zeros((self.height, self.width), bool)
        columns = np.arange(self.width) + 0.5
        for t in range(len(self.triangles)):
            corners = self.corners(t)
            first = max(math.floor(min(v for _, v in corners) - 1.5), 0)
            last = min(math.ceil(max(v for _, v in corners) + 0.5), self.height)
            for y in range(first, last):
                low, high = y + 0.5 - 1, y + 0.5 + 1
                ends = []
                for k in range(3):
                    (u, v), (u2, v2) = corners[k], corners[(k + 1) % 3]
                    if low < v < high:
                        ends.append(u)
                    for bound in (low, high):
                        if (v < bound) != (v2 < bound):
                            ends.append(u + ((bound - v) / (v2 - v)) * (u2 - u))
                if ends:
                    mask[y] |= (columns > min(ends) - 1) & (columns < max(ends) + 1)
        return mask


def middles(triangles, positions, normals):
    """A mesh subdivided once, spec/displacement.md section 3."""
    ends, finer = {}, []
    for a, b, c in triangles:
        new = []
        for edge in ((a, b), (b, c), (c, a)):
            edge = min(edge), max(edge)
            new.append(ends.setdefault(edge, len(positions) + len(ends)))
        ab, bc, ca = new
        finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    one, two = np.array(list(ends), int).reshape(-1, 2).T
    between = (0.5 * (positions[one] + positions[two])).astype(single).astype(float)
    return finer, np.concatenate([positions, between]), np.concatenate([normals, 0.5 * (normals[one] + normals[two])])


def surface(data, charts):
    """Positions and triangles of the surface of DISP."""
    version, levels, density, step = struct.unpack("<3Bf", data[:7])
    if version != 0 or levels > 6 or not 1 <= density <= 8 or not 1e-12 <= step <= 1e6:
        raise Damaged("head of DISP")
    atlas = copy.copy(charts)
    atlas.width, atlas.height, atlas.density = charts.width * density, charts.height * density, charts.density * density
    atlas.offsets = [(a * density, b * density) for a, b in charts.offsets]
    transform, coder = Transform(atlas.mask()), Range(data[7:])
    shrink = [single(0.08), single(0.02)]
    bands, _ = decode_coefficients(coder, Models(), transform.bands, single(1), shrink, None)
    image = (transform.inverse(bands)[..., 0].astype(single) * single(step)).astype(float)
    image[~atlas.mask()] = 0
    triangles = [tuple(int(v) for v in t) for t in charts.triangles]
    positions = np.array(charts.positions, float)
    normals = vertex_normals(positions, triangles)
    for _ in range(levels):
        triangles, positions, normals = middles(triangles, positions, normals)
    x, y, z = normals.T
    length = np.sqrt(x * x + y * y + z * z)
    normals[length > 0] /= length[length > 0][:, None]
    first = {}
    for t, corners in enumerate(triangles):
        for vertex in corners:
            first.setdefault(vertex, t >> (2 * levels))
    moved = positions.astype(single)
    for vertex, t in first.items():
        facing, (a, b) = atlas.facings[atlas.chart[t]], atlas.offsets[atlas.chart[t]]
        p = positions[vertex]
        u, v = ((p[1], p[2]), (p[2], p[0]), (p[0], p[1]))[facing // 2]
        u = -u if facing % 2 else u
        x = min(max(u * atlas.density + a - 0.5, 0.0), atlas.width - 1.0)
        y = min(max(v * atlas.density + b - 0.5, 0.0), atlas.height - 1.0)
        x0, y0 = min(int(x), max(atlas.width - 2, 0)), min(int(y), max(atlas.height - 2, 0))
        x1, y1, s, t = min(x0 + 1, atlas.width - 1), min(y0 + 1, atlas.height - 1), x - x0, y - y0
        taps = ((y0, x0, (1 - s) * (1 - t)), (y0, x1, s * (1 - t)), (y1, x0, (1 - s) * t), (y1, x1, s * t))
        value = 0.0
        for row, column, weight in taps:
            value += weight * image[row, column]
        moved[vertex] = (p + value * normals[vertex]).astype(single)
    return moved, triangles


LOBES = ("lobe-0", "lobe-1", "lobe-2", "lobe-3", "lobe-4")
ROUGHNESS = (0.05, 0.09, 0.16, 0.28, 0.5)


def single_lobe(weights):
    """The nearest lobe of Torrance and Sparrow, spec/reflectance.md section 4."""
    energy = [w[..., 0] + w[..., 1] + w[..., 2] for w in weights]
    total, width, colour = 0.0, 0.0, 0.0
    for k in range(5):
        total, width, colour = total + energy[k], width + energy[k] * 0.5466 * ROUGHNESS[k], colour + weights[k]
    dark = total <= 0
    sigma = np.where(dark, 0.5466 * ROUGHNESS[2], width / np.where(dark, 1.0, total))
    scale = 1.0 / (8.0 * math.pi * sigma * sigma)
    return np.where(dark[..., None], 0.0, colour * scale[..., None]).astype(single), sigma.astype(single)


def decode(data, charts):
    """Maps by name: diffuse, lobe-0 to lobe-4 if there are lobes, specular (three channels), sigma. And whether the object can be relit."""
    lobes = bool(data[1] & 4)
    if data[0] != 0 or data[1] > 5 or data[2] not in ((18,) if lobes else (3, 7)):
        raise Damaged("head of RFLC")
    begin, names = 23, ("diffuse", "specular", "sigma")[: data[2] // 2]
    if data[1] & 2:
        # The shapes of highlights don't change the maps.
        entries, begin = data[23], 24
        for _ in range(entries):
            begin += 3 + int.from_bytes(data[begin + 1 : begin + 3], "little")
    scales, steps = struct.unpack("<2f", data[3:11]), struct.unpack("<3f", data[11:23])
    scales = dict(zip(("diffuse", "specular"), scales))
    if lobes:
        names, steps = ("diffuse",) + LOBES, (steps[0],) + 5 * (steps[1],)
        scales.update(zip(LOBES, struct.unpack("<5f", data[23:43])))
        begin = 43
    mask = charts.mask()
    transform, coder, maps = Transform(mask), Range(data[begin:]), {}
    shrink = [single(0.08), single(0.02)]
    for name, step in zip(names, steps):
        bands, _ = decode_coefficients(coder, Models(), transform.bands, single(step), shrink, None)
        levels = np.floor(transform.inverse(bands) + single(0.5))
        levels[~mask] = 0
        if name == "sigma":
            exponents = np.arange(256).astype(single) / single(255) * single(3.6888795)
            sigmas = single(0.02) * np.array([exponential(float(x)) for x in exponents]).astype(single)
            maps[name] = sigmas[levels[..., 0].clip(0, 255).astype(int)]
        else:
            share = levels.clip(0, 1023) / single(1023)
            maps[name] = share * share * single(scales[name])
    if lobes:
        maps["specular"], maps["sigma"] = single_lobe([maps[name].astype(float) for name in LOBES])
    return maps, bool(data[1] & 1)
