"""What the reflectance says of a view, from spec/planes.md section 12."""

import math

import numpy as np

import geometry
import reflectance
from entropy import Damaged

single = np.float32


def direction(points, place):
    """Unit vectors from points to a place, and the squared distance."""
    v = [end - start for start, end in zip(points, place)]
    squared = geometry.dot(v, v)
    scale = np.where(squared > 0, 1.0 / np.sqrt(np.where(squared > 0, squared, 1.0)), 0.0)
    return [x * scale for x in v], squared


def limited(x, low, high):
    return np.where(x < low, low, np.where(x > high, high, x))


def passing(cosine):
    """Share of the light that passes the surface above the diffuse layer."""
    x = single(1) - limited(cosine, single(0), single(1))
    return single(0.96) - single(0.96) * (x * x * (x * x) * x)


class Light:
    """Cosines and irradiance of surface points under a view's light."""

    def __init__(self, points, normals, eye, light):
        position, intensity = light
        to_light, squared = direction(points, position)
        to_view, _ = direction(points, eye)
        half = [a + b for a, b in zip(to_light, to_view)]
        length = np.sqrt(geometry.dot(half, half))
        lit = squared > 0
        self.E = [np.where(lit, i / np.where(lit, squared, 1.0), 0.0).astype(single) for i in intensity]
        self.light = geometry.dot(normals, to_light).astype(single)
        self.view = geometry.dot(normals, to_view).astype(single)
        some = length > 0
        cos_half = np.where(some, geometry.dot(normals, half) / np.where(some, length, 1.0), 0.0)
        self.half = limited(cos_half.astype(single), single(-1), single(1))
        self.difference = limited((0.5 * length).astype(single), single(0), single(1))

    def diffuse(self, colour):
        factor = passing(self.light) * passing(self.view)
        cosine = np.where(self.light > 0, self.light, single(0))
        return [colour[:, c] * factor * self.E[c] * cosine for c in range(3)]

    def specular(self, weights):
        """Of lobes with these weights, an array of colours each."""
        seen = (self.light > 0) & (self.view > 0)
        one = single(1)
        i, r, h = (np.where(seen, x, one) for x in (self.light, self.view, self.half))
        r = np.where(r > single(0.05), r, single(0.05))
        values = []
        for roughness in reflectance.ROUGHNESS:
            a = single(roughness * roughness)
            rest = one - a
            t = one - h * h * rest
            light_root, view_root = np.sqrt(a + rest * i * i), np.sqrt(a + rest * r * r)
            values.append(a / (single(math.pi) * t * t) * (i / (i + light_root)) / (r + view_root))
        x = one - self.difference
        share = x * x * (x * x) * x
        result = []
        for c in range(3):
            height = normal = single(0)
            for weight, value in zip(weights, values):
                height, normal = height + weight[:, c] * value, normal + weight[:, c]
            normal = np.where(normal > single(0.04), normal, single(0.04))
            gain = np.where(normal < one, one / normal - one, single(0))
            result.append(np.where(seen, height * (one + gain * share) * self.E[c], single(0)))
        return result


class Model:
    """Surface and reflectance that the views of a file are predicted from."""

    def __init__(self, sections, views, positions, triangles):
        self.charts = reflectance.Charts(sections["CHRT"], positions, triangles)
        self.positions, self.triangles = np.array(positions, float), np.array(triangles)
        moved, finer = reflectance.surface(sections["DISP"], self.charts)
        moved, levels = moved.astype(float), sections["DISP"][1]
        # Drawn without the last subdivisions: of the children the one at each corner.
        missing = min(levels, 1)
        children = 4**missing
        corner = (children - 1) // 3
        self.drawn = [
            (finer[t][0], finer[t + corner][1], finer[t + 2 * corner][2]) for t in range(0, len(finer), children)
        ]
        self.vertices = moved[: max(v for corners in self.drawn for v in corners) + 1]
        self.lattice(np.array(finer), geometry.vertex_normals(moved, finer), missing)
        self.corners = [self.corner_places(len(self.drawn), levels - missing), self.corner_places(len(triangles), 0)]
        self.maps, relightable = reflectance.decode(sections["RFLC"], self.charts)
        if not relightable or "lobe-0" not in self.maps:
            raise Damaged("views are predicted from lobes, which RFLC does not have")
        self.components, self.white = views.components, [single(w) for w in views.white]

    def corner_places(self, count, levels):
        """Atlas positions of the corners of triangles that come from those of the mesh by subdivisions."""
        places = np.zeros((count, 3, 2), single)
        for k in range(3):
            triangle, (a, b, c) = np.arange(count), [np.full(count, float(i == k)) for i in range(3)]
            for _ in range(levels):
                child = triangle % 4
                halves = (
                    (a + 0.5 * (b + c), 0.5 * b, 0.5 * c),
                    (0.5 * a, b + 0.5 * (a + c), 0.5 * c),
                    (0.5 * a, 0.5 * b, c + 0.5 * (a + b)),
                    (0.5 * (a + c), 0.5 * (a + b), 0.5 * (b + c)),
                )
                a, b, c = (np.select([child == n for n in range(4)], [half[i] for half in halves]) for i in range(3))
                triangle = triangle // 4
            x, y = self.places(triangle, (a, b, c))
            places[:, k, 0], places[:, k, 1] = x, y
        return places

    def lattice(self, finer, normals, missing):
        """Normals of the finest vertices on each drawn triangle, by their steps from the first corner to the second and to the third."""
        self.parts = parts = 2**missing
        count = len(self.drawn)
        self.lattices = np.zeros((count, parts + 1, parts + 1, 3), single)
        for i in range(parts + 1):
            for j in range(parts + 1 - i):
                a, b, c = ((parts - i - j) / parts, i / parts, j / parts)
                triangle = np.arange(count)
                for _ in range(missing):
                    if a >= 0.5:
                        a, b, c, child = 2.0 * a - 1.0, 2.0 * b, 2.0 * c, 0
                    elif b >= 0.5:
                        a, b, c, child = 2.0 * a, 2.0 * b - 1.0, 2.0 * c, 1
                    elif c >= 0.5:
                        a, b, c, child = 2.0 * a, 2.0 * b, 2.0 * c - 1.0, 2
                    else:
                        a, b, c, child = 1.0 - 2.0 * c, 1.0 - 2.0 * a, 1.0 - 2.0 * b, 3
                    triangle = 4 * triangle + child
                self.lattices[:, i, j] = normals[finer[triangle, (a, b, c).index(1.0)]]

    def surface_normals(self, triangle, b, c):
        """Normals, of any length, at places of drawn triangles."""
        m = self.parts
        x, y = b * m, c * m
        i = np.minimum(x.astype(int), m - 1)
        j = np.minimum(y.astype(int), m - 1 - i)
        u, v = x - i, y - j
        far = (u + v > 1.0) & (i + j + 1 < m)
        weights = np.where(far, [u + v - 1.0, 1.0 - u, 1.0 - v], [1.0 - u - v, u, v])
        rows = np.where(far, [i + 1, i, i + 1], [i, i + 1, i])
        columns = np.where(far, [j + 1, j + 1, j], [j, j, j + 1])
        of = [self.lattices[triangle, row, column].astype(float) for row, column in zip(rows, columns)]
        return [weights[0] * of[0][:, k] + weights[1] * of[1][:, k] + weights[2] * of[2][:, k] for k in range(3)]

    def places(self, triangle, weights):
        """Atlas positions of places on triangles of the mesh."""
        a, b, c = weights
        corners = self.positions[self.triangles[triangle]]
        p = [a * corners[:, 0, i] + b * corners[:, 1, i] + c * corners[:, 2, i] for i in range(3)]
        chart = np.array(self.charts.chart)[triangle]
        facing = np.array(self.charts.facings)[chart]
        offset = np.array(self.charts.offsets, float)[chart]
        axis = facing // 2
        u = np.select([axis == 0, axis == 1, axis == 2], [p[1], p[2], p[0]])
        v = np.select([axis == 0, axis == 1, axis == 2], [p[2], p[0], p[1]])
        u = np.where(facing % 2 == 1, -u, u)
        return u * self.charts.density + offset[:, 0], v * self.charts.density + offset[:, 1]

    def read(self, name, at):
        """A map's colours at atlas positions."""
        image, (width, height) = self.maps[name], (self.charts.width, self.charts.height)
        x, y = limited(at[0] - 0.5, 0.0, width - 1.0), limited(at[1] - 0.5, 0.0, height - 1.0)
        x0 = np.minimum(x.astype(int), max(width - 2, 0))
        y0 = np.minimum(y.astype(int), max(height - 2, 0))
        x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
        s, t, one, total = (x - x0).astype(single), (y - y0).astype(single), single(1), single(0)
        for row, column, weight in (
            (y0, x0, (one - s) * (one - t)),
            (y0, x1, s * (one - t)),
            (y1, x0, (one - s) * t),
            (y1, x1, s * t),
        ):
            total = total + weight[:, None] * image[row, column]
        return total

    def signals(self, mesh, low, components, level):
        """The signal of each component at the mask `low` of the predicted image; `mesh` is what is seen there of the mesh."""
        signals = [np.zeros(low.shape + (3,), single) for _ in components]
        camera, light = mesh.camera, mesh.light
        if not light or not low.any():
            return signals
        drawn = geometry.Geometry(camera, light, self.vertices, self.drawn, None, True)
        # Beside the surface the mesh.
        use = low & (drawn.coverage | mesh.coverage)
        fine = drawn.coverage[use]

        def pick(a, b):
            return np.where(fine if a.ndim == 2 else fine[:, None], a[use], b[use])

        ys, xs = np.nonzero(use)
        depth, triangle = pick(drawn.depth, mesh.depth), pick(drawn.triangle, mesh.triangle)
        barycentric = pick(drawn.barycentric, mesh.barycentric).astype(float)
        eye, r = geometry.centre(camera), camera.rotation
        q = [(xs + 0.5 - camera.principal[0]) / camera.focal[0], (ys + 0.5 - camera.principal[1]) / camera.focal[1], 1.0]
        points = [eye[i] + depth * (r[0][i] * q[0] + r[1][i] * q[1] + r[2][i] * q[2]) for i in range(3)]
        b, c = barycentric.T
        a = 1.0 - b - c
        on_surface = self.surface_normals(np.where(fine, triangle, 0), np.where(fine, b, 0.0), np.where(fine, c, 0.0))
        on_mesh = mesh.normals[use].astype(float).T
        normals = [np.where(fine, surface, base) for surface, base in zip(on_surface, on_mesh)]
        squared = geometry.dot(normals, normals)
        inverse = np.where(squared > 0, 1.0 / np.sqrt(np.where(squared > 0, squared, 1.0)), 0.0)
        normals = [n * inverse for n in normals]
        corners = np.where(
            fine[:, None, None],
            self.corners[0][np.where(fine, triangle, 0)],
            self.corners[1][np.where(fine, 0, triangle)],
        ).astype(float)
        at = [a * corners[:, 0, k] + b * corners[:, 1, k] + c * corners[:, 2, k] for k in range(2)]
        lit = Light(points, normals, eye, light)
        diffuse = lit.diffuse(self.read("diffuse", at))
        specular = lit.specular([self.read(name, at) for name in reflectance.LOBES])
        both = [a + b for a, b in zip(diffuse, specular)]
        for signal, component, kind in zip(signals, components, self.components):
            radiance = [x / w for x, w in zip((diffuse, specular, both)[kind], self.white)]
            most = np.sqrt(single(1e12))
            s = [np.where(x > single(1e12), most, np.sqrt(np.where(x > 0, x, single(0)))) for x in radiance]
            m = component.rotation
            y = np.stack([m[k, 0] * s[0] + m[k, 1] * s[1] + m[k, 2] * s[2] for k in range(3)], -1)
            signal[use] = y * single(1 << level)
            known = use.copy()
            geometry.fill(known, signal, 64, low)
        return signals
