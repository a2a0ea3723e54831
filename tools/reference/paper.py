"""Section PAPR, from spec/wavelet-texture.md."""

import heapq
import math
import struct

import numpy as np

from entropy import Bit, Damaged, Number, Range
from functions import exponential, squared_angle
from geometry import Geometry, centre, vertex_normals

single = np.float32
H = [single(x) for x in (0.4829629, 0.8365163, 0.22414386, -0.12940952)]
NEAR = [0, 1, 2, 3, 4, 5, 5, 6, 6, 6, 7, 7, 7]


def squared(p, q):
    total = 0.0
    for a, b in zip(p, q):
        total += (a - b) * (a - b)
    return total


def neighbours(triangles):
    """For each triangle and edge the one other triangle."""
    edges = {}
    for t, corners in enumerate(triangles):
        for e in range(3):
            a, b = corners[e], corners[(e + 1) % 3]
            if a != b:
                edges.setdefault((min(a, b), max(a, b)), []).append((t, e))
    result = [[None] * 3 for _ in triangles]
    for users in edges.values():
        if len(users) == 2 and users[0][0] != users[1][0]:
            (t, e), (u, f) = users
            result[t][e], result[u][f] = u, t
    return result


def patches(positions, triangles):
    """Section 1: (first, second or None, corners)."""
    positions = [[float(x) for x in p] for p in positions]
    near = neighbours(triangles)
    perimeter = []
    for a, b, c in triangles:
        pa, pb, pc = positions[a], positions[b], positions[c]
        perimeter.append(squared(pa, pb) + squared(pb, pc) + squared(pc, pa))
    degree = [sum(other is not None for other in edges) for edges in near]
    free, queued, result = [True] * len(triangles), set(range(len(triangles))), []
    heap = [(d, t) for t, d in enumerate(degree)]
    heapq.heapify(heap)
    while heap:
        d, t = heapq.heappop(heap)
        if t not in queued or d != degree[t]:
            continue
        queued.remove(t)
        free[t] = False
        best = None
        for e, other in enumerate(near[t]):
            if other is None or not free[other]:
                continue
            v = triangles[t]
            common = squared(positions[v[e]], positions[v[(e + 1) % 3]])
            rest = (perimeter[t] + perimeter[other]) - 2 * common
            score = common / rest if rest > 0 else 0.0
            if best is None or score > best[0]:
                best = (score, e, other)
        taken = [t]
        v = triangles[t]
        if best is None:
            result.append((t, None, (v[0], v[1], v[2], v[0])))
        else:
            _, e, other = best
            free[other] = False
            queued.discard(other)
            taken.append(other)
            a, b, c = v[(e + 2) % 3], v[e], v[(e + 1) % 3]
            far = [x for x in triangles[other] if x != b and x != c]
            result.append((t, other, (a, b, c, far[0] if far else a)))
        for k in taken:
            for n in near[k]:
                if n is not None and n in queued:
                    degree[n] = max(degree[n] - 1, 0)
                    heapq.heappush(heap, (degree[n], n))
    return sorted(result, key=lambda patch: patch[0])


class Models:
    """Models of one kind of volume."""

    def __init__(self):
        self.bits, self.magnitude = {}, {}

    def bit(self, *key):
        return self.bits.setdefault(key, Bit())

    def number(self, *key):
        if key not in self.magnitude:
            self.magnitude[key] = Number()
        return self.magnitude[key]


def volume(coder, models, components, levels, slices, n):
    """Section 3.4: levels of all components, `[component][axis, slice, row, column]`; `n` the side's binary logarithm."""
    side = 1 << n
    result = [np.zeros((3, slices, side, side), np.int64) for _ in range(components)]
    flags = {}
    low = slices >> levels
    for component, q in enumerate(result):
        for b in range(levels + 1):
            first, last = (0, low) if b == 0 else (low << (b - 1), low << b)
            for p in range(n + 1):
                x = p > 0 and flags[component, b, p - 1]
                y = b > 0 and flags[component, b - 1, p]
                z = component > 0 and flags[0, b, p]
                some = models.bit("band", component, b, p, x + 2 * y + 4 * z).decode(coder)
                flags[component, b, p] = some
                if not some:
                    continue
                inner, outer = (0, 1) if p == 0 else (1 << (p - 1), 1 << p)
                for i in range(first, last):
                    for row in range(outer):
                        for column in range(inner if row < inner else 0, outer):
                            position(coder, models, component, q, (b, p, first, inner), (i, row, column))
    return result


def position(coder, models, component, q, band, at):
    b, p, first, inner = band
    i, row, column = at
    across, down = column >= inner, row >= inner
    orientation = 0 if p == 0 or (across and down) else 1 if across else 2
    left = column > (inner if across else 0)
    up = row > (inner if down else 0)
    parent_slice = None if b == 0 else i - first if b == 1 else first // 2 + (i - first) // 2
    for axis in range(3):
        grid = q[axis]

        def m(slice_, y, x, present=True):
            return min(abs(int(grid[slice_, y, x])), 2) if present else 0

        near = (2 * m(i, row, column - 1, left) + 2 * m(i, row - 1, column, up)
                + m(i - 1, row, column, i > first) + m(i, row - 1, column - 1, left and up))  # fmt: skip
        near = NEAR[near]
        earlier = [int(q[k, i, row, column]) if k < axis else 0 for k in (0, 1)]
        colours = 3 * min(abs(earlier[0]), 2) + min(abs(earlier[1]), 2)
        parents = 3 * m(i, row // 2, column // 2, p > 0) + (0 if parent_slice is None else m(parent_slice, row, column))
        one = models.bit("near", component, axis, near, colours, orientation)
        two = models.bit("parents", component, b, p, orientation, axis, parents)
        bit = coder.bit((one.p() + two.p()) // 2)
        one.update(bit)
        two.update(bit)
        if not bit:
            continue
        s = [1 if v > 0 else 2 if v < 0 else 0 for v in earlier]
        negative = models.bit("sign", component, 3 * s[0] + s[1]).decode(coder)
        kind = min(5, near // 2 + (colours > 0) + (parents > 0))
        size = min(models.number(component, kind).decode(coder) + 1, 1 << 24)
        grid[i, row, column] = -size if negative else size


def step(x, axis):
    """One step of the inverse transform along an axis."""
    x = np.moveaxis(x, axis, 0)
    half = x.shape[0] // 2
    a, d = x[:half], x[half:]
    a1, d1 = np.roll(a, 1, 0), np.roll(d, 1, 0)
    out = np.empty_like(x)
    out[0::2] = H[0] * a + H[3] * d + H[2] * a1 + H[1] * d1
    out[1::2] = H[1] * a - H[2] * d + H[3] * a1 - H[0] * d1
    return np.moveaxis(out, 0, axis)


def restore(q, levels, threshold, width, rotation):
    """Section 4, from levels to colours: `[slice, row, column, colour]`."""
    size = threshold + (np.abs(q).astype(single) - single(0.5)) * width
    x = np.where(q > 0, size, np.where(q < 0, -size, single(0)))
    if q.any():
        c = 2
        while c <= x.shape[2]:
            x[:, :, :c, :c] = step(x[:, :, :c, :c], 2)
            x[:, :, :c, :c] = step(x[:, :, :c, :c], 3)
            c *= 2
        for level in reversed(range(levels)):
            c = x.shape[1] >> level
            x[:, :c] = step(x[:, :c], 1)
    colours = [rotation[0][c] * x[0] + rotation[1][c] * x[1] + rotation[2][c] * x[2] for c in range(3)]
    return np.stack(colours, -1)


class Paper:
    """The section, decoded; `view` gives photographs."""

    def __init__(self, data, views, positions, triangles):
        if len(data) < 140 or data[0] != 0:
            raise Damaged("version of PAPR")
        flags, self.count, self.levels = data[1], data[2], data[3]
        view_count, patch_count = struct.unpack("<II", data[4:12])
        threshold, width, diffuse_scale, diffuse_step, specular_scale = np.frombuffer(data[12:32], "<f4")
        rotations = np.frombuffer(data[32:140], "<f4").reshape(3, 3, 3)
        self.modelled, self.relightable, lobes = flags & 1, flags & 2, flags & 4
        self.views, self.triangles = views, triangles
        self.positions = np.array([[float(x) for x in p] for p in positions])
        self.normals = vertex_normals(self.positions, triangles)
        self.patches = patches(positions, triangles)
        if (self.count, view_count, patch_count) != (len(views.components), len(views.views), len(self.patches)):
            raise Damaged("components, views or patches of PAPR")
        self.patch_of = {t: k for k, patch in enumerate(self.patches) for t in patch[:2] if t is not None}
        coder = Range(data[140:])
        self.sides = self.read_sides(coder)
        if self.modelled:
            models, step_ = Models(), diffuse_step
            grids = [volume(coder, models, 1, 0, 1, n)[0] for n in self.sides]
            grids = [restore(q, 0, single(0.5) * step_, step_, rotations[0])[0] for q in grids]
            grids = [np.maximum(x, single(0)) for x in grids]
            self.diffuse = [x * x * diffuse_scale for x in grids]
            self.lobes = self.read_lobes(coder, specular_scale) if lobes else None
        models, padded = Models(), -(-view_count >> self.levels) << self.levels
        self.residual = []
        for n in self.sides:
            volumes = volume(coder, models, self.count, self.levels, padded, n)
            restored = [restore(q, self.levels, threshold, width, r) for q, r in zip(volumes, rotations[1:])]
            self.residual.append([x[:view_count] for x in restored])
        if not coder.ends_rightly():
            raise Damaged("end of PAPR")

    def read_sides(self, coder):
        models, sides, before = {}, [], 0
        for _ in self.patches:
            n = 1
            while n < 4 and models.setdefault((before, n), Bit()).decode(coder):
                n += 1
            sides.append(n)
            before = n
        return sides

    def read_lobes(self, coder, scale):
        """For each vertex K_s and ln sigma."""
        edges = set()
        for t in self.triangles:
            edges.update((min(a, b), max(a, b)) for a, b in zip(t, t[1:] + t[:1]))
        earlier = [[] for _ in self.positions]
        for low, high in edges:
            if low != high:
                earlier[high].append(low)
        numbers, levels, before = [Number() for _ in range(4)], [], [0] * 4
        for near in earlier:
            here = []
            for k in range(4):
                c, s = len(near), sum(levels[v][k] for v in near)
                guess = (s + c // 2) // c if c else before[k]
                here.append(min(max(guess + numbers[k].signed(coder), 0), 255))
            levels.append(here)
            before = here
        q = np.array(levels).astype(single)
        root = q[:, :3] / single(255)
        log_sigma = single(-3.912023) + single(0.058553644) * np.minimum(q[:, 3], single(63))
        return np.concatenate([root * root * scale, log_sigma[:, None]], 1)

    def view(self, index):
        """Mask and images of a view."""
        view = self.views.views[index]
        geometry = Geometry(view.camera, view.light, self.positions, self.triangles, self.normals)
        mask = geometry.triangle >= 0
        images = [np.zeros(mask.shape + (3,), single) for _ in self.views.components]
        eye = centre(view.camera)
        for y, x in zip(*np.nonzero(mask)):
            triangle = int(geometry.triangle[y, x])
            point = self.point(triangle, *(float(w) for w in geometry.barycentric[y, x]))
            for component, image in enumerate(images):
                image[y, x] = self.radiance(component, index, view, eye, *point)
        return mask, images

    def point(self, triangle, b, c):
        """Patch, position on its square, weights of its corners."""
        k = self.patch_of[triangle]
        first, _, corners = self.patches[k]
        weights, vertices = [1 - b - c, b, c], list(self.triangles[triangle])
        beta, gamma = (weights[vertices.index(v)] if v in vertices else 0.0 for v in corners[1:3])
        if triangle == first:
            u, v = beta, gamma
            return k, u, v, (1 - u - v, u, v, 0.0)
        u, v = 1 - gamma, 1 - beta
        return k, u, v, (0.0, 1 - v, 1 - u, u + v - 1)

    def mean(self, k, weights, values):
        total = values.dtype.type(0) * values[0]
        for corner, weight in zip(self.patches[k][2], weights):
            total = total + values.dtype.type(weight) * values[corner]
        return total

    def radiance(self, component, index, view, eye, k, u, v, weights):
        residual = read_grid(self.residual[k][component][index], u, v)
        if not self.modelled:
            return residual
        P, N = self.mean(k, weights, self.positions), self.mean(k, weights, self.normals)
        length = math.sqrt(dot(N, N))
        N = N / length if length > 0 else N
        if self.views.components[component] == 1:
            return self.specular(view, eye, k, weights, P, N) + residual
        diffuse = np.maximum(read_grid(self.diffuse[k], u, v), single(0))
        if self.relightable:
            model = np.zeros(3, single)
            if view.light is not None:
                L, r2 = direction(P, view.light[0])
                if dot(N, L) > 0:
                    model = (diffuse.astype(float) * (np.array(view.light[1]) / r2) * dot(N, L)).astype(single)
            diffuse = model
        return diffuse + residual

    def specular(self, view, eye, k, weights, P, N):
        if self.lobes is None or view.light is None:
            return np.zeros(3, single)
        (L, r2), (V, _) = direction(P, view.light[0]), direction(P, eye)
        if not (dot(N, L) > 0 and dot(N, V) > 0):
            return np.zeros(3, single)
        Hh = L + V
        a2 = squared_angle(dot(N, Hh) / math.sqrt(dot(Hh, Hh)))
        *specular, log_sigma = (float(x) for x in self.mean(k, weights, self.lobes))
        shape = exponential(-0.5 * a2 * exponential(-2 * log_sigma)) / max(dot(N, V), 0.05)
        return np.array([K * (I / r2) * shape for K, I in zip(specular, view.light[1])]).astype(single)


def dot(u, v):
    return float(u[0] * v[0] + u[1] * v[1] + u[2] * v[2])


def direction(start, end):
    d = np.array(end) - start
    r2 = dot(d, d)
    return d * (1 / math.sqrt(r2) if r2 > 0 else 0.0), r2


def taps(x, side):
    """Samples along an axis and their weights."""
    x = x * side - 0.5
    i = min(max(math.floor(x), 0), side - 2)
    t = single(x - i)
    half, one, two = single(0.5), single(1), single(2)
    if not 0 <= t <= 1:
        return [(i, one - t), (i + 1, t)]
    s = one - t
    w = [-half * t * s * s, one - t * t * (single(2.5) - single(1.5) * t),
         one - s * s * (single(2.5) - single(1.5) * s), -half * s * t * t]  # fmt: skip
    if i == 0:
        w[1], w[2], w[0] = w[1] + two * w[0], w[2] - w[0], None
    if i == side - 2:
        w[2], w[1], w[3] = w[2] + two * w[3], w[1] - w[3], None
    return [(i - 1 + k, weight) for k, weight in enumerate(w) if weight is not None]


def read_grid(grid, u, v):
    total = np.zeros(3, single)
    columns = taps(u, len(grid))
    for row, wy in taps(v, len(grid)):
        for column, wx in columns:
            total = total + wx * wy * grid[row, column]
    return total
