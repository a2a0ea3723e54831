"""Geometry, prediction and transform of section PLAN, from spec/planes.md sections 3 to 6. Pictures are arrays [y, x] or [y, x, channel]."""

import copy
import math

import numpy as np

single = np.float32


def neighbour_sums(known, values):
    """Sums over the known ones of the 8 neighbours, row by row, and their number."""
    height, width = known.shape
    total, count = np.zeros_like(values), np.zeros(known.shape, values.dtype)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if dy == dx == 0:
                continue
            to = (slice(max(-dy, 0), height - max(dy, 0)), slice(max(-dx, 0), width - max(dx, 0)))
            of = (slice(max(dy, 0), height - max(-dy, 0)), slice(max(dx, 0), width - max(-dx, 0)))
            here = known[of]
            total[to] += np.where(here[..., None] if values.ndim == 3 else here, values[of], 0)
            count[to] += here
    return total, count


def fill(known, values, times, allowed=None):
    """Gives pixels that are not known the mean of their known neighbours, some times. Changes its arguments."""
    for _ in range(times):
        total, count = neighbour_sums(known, values)
        ring = ~known & (count > 0)
        if allowed is not None:
            ring &= allowed
        if not ring.any():
            break
        values[ring] = total[ring] / count[ring][:, None]
        known |= ring


def vertex_normals(positions, triangles):
    normals = np.zeros((len(positions), 3))
    for corners in triangles:
        a, b, c = (positions[v] for v in corners)
        u, v = b - a, c - a
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        for vertex in corners:
            normals[vertex] += n
    length = np.sqrt(normals[:, 0] * normals[:, 0] + normals[:, 1] * normals[:, 1] + normals[:, 2] * normals[:, 2])
    normals[length > 0] /= length[length > 0][:, None]
    return normals


def to_camera(camera, p):
    """Rows of points in camera axes."""
    r, t = camera.rotation, camera.translation
    return [r[i][0] * p[0] + r[i][1] * p[1] + r[i][2] * p[2] + t[i] for i in range(3)]


def centre(camera):
    r, t = camera.rotation, camera.translation
    return [-(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]) for i in range(3)]


def dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def low_camera(camera, level):
    """Camera of the low band after some levels."""
    if level == 0:
        return camera
    scale, low = 0.5**level, copy.copy(camera)
    low.width, low.height = -(-camera.width >> level), -(-camera.height >> level)
    low.focal = [f * scale for f in camera.focal]
    low.principal = [(c - 0.5) * scale + 0.5 for c in camera.principal]
    return low


def enlarged(low, width, height, level):
    """A mask of the low band's size at the picture's."""
    return low[np.arange(height)[:, None] >> level, np.arange(width)[None, :] >> level]


def first_pixel(position):
    """The first pixel whose centre is not before a position."""
    return math.ceil(max(position - 0.5, 0))


def interpolated_normals(corners, weights, normals):
    """Unit normals, singles, at places of triangles."""
    (a, b, c), N = weights, normals[corners]
    n = [a * N[:, 0, k] + b * N[:, 1, k] + c * N[:, 2, k] for k in range(3)]
    length = np.sqrt(dot(n, n))
    return np.stack([np.where(length > 0, x / np.where(length > 0, length, 1), 0) for x in n], -1).astype(single)


class Geometry:
    """What a view sees of a mesh, or of its triangles that face the camera; without normals where none are given."""

    def __init__(self, camera, light, positions, triangles, normals, facing=False):
        self.camera, self.light = camera, light
        self.width, self.height = camera.width, camera.height
        q = to_camera(camera, positions.T)
        with np.errstate(all="ignore"):
            s = 1.0 / q[2]
            x = camera.focal[0] * q[0] * s + camera.principal[0]
            y = camera.focal[1] * q[1] * s + camera.principal[1]
        near = 1e-6 * max(0.0, q[2].max())
        inverse = np.zeros((self.height, self.width))
        self.triangle = np.full((self.height, self.width), -1)
        barycentric = self.barycentric = np.zeros((self.height, self.width, 2), single)
        for index, corners in enumerate(triangles):
            i, j, k = corners
            turned = facing and (x[j] - x[i]) * (y[k] - y[i]) - (x[k] - x[i]) * (y[j] - y[i]) >= 0
            if all(q[2][v] > near for v in corners) and not turned:
                self.draw(index, corners, x, y, q[2], inverse, barycentric)
        self.coverage = self.triangle >= 0
        self.depth = np.zeros_like(inverse)
        self.depth[self.coverage] = 1.0 / inverse[self.coverage]
        if normals is None:
            return
        self.normals = np.zeros((self.height, self.width, 3), single)
        b, c = (barycentric[self.coverage][:, k].astype(np.float64) for k in (0, 1))
        corners = np.array(triangles)[self.triangle[self.coverage]]
        self.normals[self.coverage] = interpolated_normals(corners, (1.0 - b - c, b, c), normals)

    def draw(self, index, corners, x, y, z, inverse, barycentric):
        cx, cy, cz = ([float(v[i]) for i in corners] for v in (x, y, z))
        low, high = first_pixel(min(cx)), min(int(max(max(cx) + 0.5, 0)), self.width)
        top, bottom = first_pixel(min(cy)), min(int(max(max(cy) + 0.5, 0)), self.height)
        if low >= high or top >= bottom:
            return
        px, py = np.arange(low, high)[None, :] + 0.5, np.arange(top, bottom)[:, None] + 0.5
        e = []
        for k in range(3):
            i, j, sign = (k + 1) % 3, (k + 2) % 3, 1.0
            if corners[i] > corners[j]:
                i, j, sign = j, i, -1.0
            dx, dy = cx[j] - cx[i], cy[j] - cy[i]
            e.append(sign * (dx * (py - cy[i]) - dy * (px - cx[i])))
        area = e[0] + e[1] + e[2]
        inside = ((e[0] >= 0) & (e[1] >= 0) & (e[2] >= 0)) | ((e[0] <= 0) & (e[1] <= 0) & (e[2] <= 0))
        inside &= area != 0
        w = [e[k] * (1.0 / cz[k]) for k in range(3)]
        total = w[0] + w[1] + w[2]
        here = np.divide(total, area, out=np.zeros_like(total), where=inside)
        block = (slice(top, bottom), slice(low, high))
        nearer = inside & (here > inverse[block])
        inverse[block][nearer] = here[nearer]
        self.triangle[block][nearer] = index
        for k in (0, 1):
            barycentric[block][..., k][nearer] = w[k + 1][nearer] / total[nearer]

    def extend(self, mask):
        missing = mask & (self.depth == 0)
        for _ in range(8):
            known = self.depth > 0
            depth, count = neighbour_sums(known, self.depth)
            normals, singles = neighbour_sums(known, self.normals)
            ring = missing & (count > 0)
            if not ring.any():
                break
            self.depth[ring] = depth[ring] / count[ring]
            self.normals[ring] = normals[ring] / singles[ring][:, None]
            missing &= ~ring


def find(target, reference, mask):
    """Section 4: position (x, y), weight and shading of each mask pixel."""
    ys, xs = np.nonzero(mask)
    camera, other = target.camera, reference.camera
    depth = target.depth[mask]
    q = [(xs + 0.5 - camera.principal[0]) / camera.focal[0], (ys + 0.5 - camera.principal[1]) / camera.focal[1], 1.0]
    r, eye = camera.rotation, centre(camera)
    P = [eye[i] + depth * (r[0][i] * q[0] + r[1][i] * q[1] + r[2][i] * q[2]) for i in range(3)]
    q = to_camera(other, P)
    seen = (depth != 0) & (q[2] > 0)
    q2 = np.where(seen, q[2], 1.0)
    X = other.focal[0] * q[0] / q2 + other.principal[0]
    Y = other.focal[1] * q[1] / q2 + other.principal[1]
    seen &= (X >= 0) & (Y >= 0) & (X < reference.width) & (Y < reference.height)
    padded = np.pad(reference.depth, 1)
    column, row = np.where(seen, X, 0).astype(int), np.where(seen, Y, 0).astype(int)
    far = np.max([padded[row + j, column + i] for i in range(3) for j in range(3)], axis=0)
    seen &= q[2] <= far * 1.004
    N = [target.normals[mask][:, k].astype(np.float64) for k in range(3)]
    V = [e - p for e, p in zip(centre(other), P)]
    cosine = dot(N, V) / np.sqrt(dot(V, V))
    cosine = np.where(cosine > 0.05, cosine, 0.05)
    weight = np.where(seen, (cosine * cosine).astype(single), single(0))
    shading = np.ones(len(xs), single)
    if target.light and reference.light:

        def irradiance(position):
            L = [v - p for v, p in zip(position, P)]
            s = dot(L, L)
            cosine = dot(N, L) / np.sqrt(s)
            return np.where(cosine > 0.05, cosine, 0.05) / s

        (here, I), (there, J) = target.light, reference.light
        brightness = ((I[0] + I[1] + I[2]) / 3) / ((J[0] + J[1] + J[2]) / 3)
        ratio = irradiance(here) / irradiance(there)
        shading = np.sqrt(ratio * brightness).clip(0.25, 4).astype(single)
    return X.astype(single), Y.astype(single), weight, shading


def catmull_rom(t):
    t2 = t * t
    t3 = t2 * t
    h = single(0.5)
    return [
        -h * t + t2 - h * t3,
        single(1) - single(2.5) * t2 + single(1.5) * t3,
        h * t + single(2) * t2 - single(1.5) * t3,
        h * t3 - h * t2,
    ]


def read(pixels, X, Y):
    height, width = pixels.shape[:2]
    x, y = X - single(0.5), Y - single(0.5)
    i, j = np.floor(x), np.floor(y)
    wx, wy = catmull_rom(x - i), catmull_rom(y - j)
    i, j = i.astype(int), j.astype(int)
    total = np.zeros((len(x), 3), single)
    for b in range(4):
        line = np.zeros((len(x), 3), single)
        for a in range(4):
            pixel = pixels[(j - 1 + b).clip(0, height - 1), (i - 1 + a).clip(0, width - 1)]
            line += wx[a][:, None] * pixel
        total += wy[b][:, None] * line
    return total


def predict(mask, references, shaded):
    """Section 5. References: (filled signal, what find gave, share)."""
    count = int(mask.sum())
    total, weights = np.zeros((count, 3), single), np.zeros(count, single)
    for pixels, (X, Y, weight, shading), share in references:
        w = single(share) * weight
        use = w > 0
        value = read(pixels, X[use], Y[use])
        f = w[use] * shading[use] if shaded else w[use]
        total[use] += f[:, None] * value
        weights[use] += w[use]
    out, known = np.zeros(mask.shape + (3,), single), np.zeros(mask.shape, bool)
    found = weights > 0
    total[found] /= weights[found][:, None]
    total[~found] = 0
    out[mask], known[mask] = total, found
    fill(known, out, 64, mask)
    return out


LIFT = np.array([0xBFCB0673, 0xBD5901AF, 0x3F620676, 0x3EE31354], np.uint32).view(single)
LOW, HIGH, INVERSE_LOW, INVERSE_HIGH, ONE, INVERSE_ONE = np.array(
    [0x3F93263D, 0x3F5EAF70, 0x3F5EAF6F, 0x3F93263D, 0x3FB504F3, 0x3F3504F3], np.uint32
).view(single)


def lift(line, first, factor):
    """One lifting step on the places first, first + 2, ... of a run (axis 0)."""
    n = len(line)
    at = np.arange(first, n, 2)
    before, after = np.where(at > 0, at - 1, 1), np.where(at + 1 < n, at + 1, at - 1)
    line[at] += factor * (line[before] + line[after])


def forward_run(line, start):
    if len(line) == 1:
        return line * ONE
    even, odd = start % 2, 1 - start % 2
    for k, first in enumerate((odd, even, odd, even)):
        lift(line, first, LIFT[k])
    line[even::2] *= LOW
    line[odd::2] *= HIGH
    return line


def inverse_run(line, start):
    if len(line) == 1:
        return line * INVERSE_ONE
    even, odd = start % 2, 1 - start % 2
    line[even::2] *= INVERSE_LOW
    line[odd::2] *= INVERSE_HIGH
    for k, first in ((3, even), (2, odd), (1, even), (0, odd)):
        lift(line, first, -LIFT[k])
    return line


def runs(line):
    edges = np.flatnonzero(np.diff(np.concatenate(([0], line.astype(np.int8), [0]))))
    return list(zip(edges[::2], edges[1::2]))


def split_mask(mask):
    """Masks of the two halves along axis 1."""
    halves = [np.zeros((mask.shape[0], -(-mask.shape[1] // 2)), bool) for _ in range(2)]
    for y, line in enumerate(mask):
        for start, end in runs(line):
            for x in range(start, end):
                halves[0 if end - start == 1 else x % 2][y, x // 2] = True
    return halves


def split(pixels, mask):
    half = -(-mask.shape[1] // 2)
    halves = [np.zeros((mask.shape[0], half, 3), single) for _ in range(2)]
    for y, line in enumerate(mask):
        for start, end in runs(line):
            values = forward_run(pixels[y, start:end].copy(), start)
            for x, value in zip(range(start, end), values):
                halves[0 if end - start == 1 else x % 2][y, x // 2] = value
    return halves


def join(halves, mask):
    pixels = np.zeros(mask.shape + (3,), single)
    for y, line in enumerate(mask):
        for start, end in runs(line):
            one = end - start == 1
            values = np.array([halves[0 if one else x % 2][y, x // 2] for x in range(start, end)])
            pixels[y, start:end] = inverse_run(values, start)
    return pixels


def turn(a):
    return np.swapaxes(a, 0, 1)


def level_count(width, height):
    side, levels = min(width, height), 0
    while levels < 5 and side >> (levels + 1) >= 4:
        levels += 1
    return levels


class Band:
    def __init__(self, level, kind, mask):
        self.level, self.kind, self.mask = level, kind, mask


class Transform:
    """Section 6, for one mask. `bands` in coding order; `masks` of the picture and of the low band after each level."""

    def __init__(self, mask):
        levels = level_count(*mask.shape)
        self.levels, self.bands, self.masks = [], [], [mask]
        for level in range(1, levels + 1):
            left, right = split_mask(mask)
            quarters = [turn(m) for half in (left, right) for m in split_mask(turn(half))]
            self.levels.append((mask, left, right))
            low, vertical, horizontal, diagonal = quarters
            self.bands = [Band(level, "horizontal", horizontal), Band(level, "vertical", vertical),
                          Band(level, "diagonal", diagonal)] + self.bands  # fmt: skip
            mask = low
            self.masks.append(mask)
        self.bands.insert(0, Band(levels, "low", mask))

    def forward(self, pixels, level=0):
        """The bands of a picture, or those of a low band after some levels."""
        bands = []
        for mask, left, right in self.levels[level:]:
            halves = split(pixels, mask)
            low, vertical = (turn(q) for q in split(turn(halves[0]), turn(left)))
            horizontal, diagonal = (turn(q) for q in split(turn(halves[1]), turn(right)))
            bands = [horizontal, vertical, diagonal] + bands
            pixels = low
        return [pixels] + bands

    def inverse(self, bands):
        return self.lows(bands)[0]

    def lows(self, bands):
        """The picture, and the low band after each level."""
        low, bands = bands[0], bands[1:]
        lows = [low]
        for mask, left, right in reversed(self.levels):
            (horizontal, vertical, diagonal), bands = bands[:3], bands[3:]
            halves = [turn(join([turn(low), turn(vertical)], turn(left))),
                      turn(join([turn(horizontal), turn(diagonal)], turn(right)))]  # fmt: skip
            low = join(halves, mask)
            lows.insert(0, low)
        return lows
