"""Objects and their photographs: meshes, cameras, and a ray caster with point light, shadows and a microfacet gloss.

The mesh that a capture holds is the one that is photographed, so photographs, mesh and cameras agree exactly.
"""
from dataclasses import dataclass, field

import numpy as np

# Samples of a pixel each way; odd, so that one lies in its middle, where masks and coverage look.
SAMPLES = 3
# Ray and triangle pairs that are worked on at once.
PAIRS = 4_000_000


@dataclass
class Mesh:
    """Positions (as 32-bit floats, which the file holds), triangles, unit normals of the vertices."""

    positions: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray = field(init=False)

    def __post_init__(self):
        self.positions = self.positions.astype(np.float32).astype(float)
        a, b, c = self.positions[self.triangles].transpose(1, 0, 2)
        across = np.cross(b - a, c - a)
        normals = np.zeros_like(self.positions)
        for corner in range(3):
            np.add.at(normals, self.triangles[:, corner], across)
        self.normals = unit(normals)


@dataclass
class Camera:
    """Intrinsics in pixels, camera to world with OpenGL's axes, and a lens by its name and coefficients."""

    size: tuple
    focal: tuple
    principal: tuple
    pose: np.ndarray
    lens: str = "PINHOLE"
    coefficients: dict = field(default_factory=dict)

    @property
    def centre(self):
        return self.pose[:3, 3]

    def directions(self, pixels):
        """Unit directions in the world of positions in the photograph (centres at +0.5)."""
        ideal = undistort(self, (pixels - np.array(self.principal)) / np.array(self.focal))
        inside = np.concatenate([ideal[:, :1], -ideal[:, 1:], -np.ones((len(ideal), 1))], 1)
        return unit(inside @ self.pose[:3, :3].T)


def unit(vectors):
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def distort(camera, ideal):
    """Where the lens puts ideal image positions, both in focal lengths from the principal point (OpenCV's models)."""
    k = [camera.coefficients.get(name, 0.0) for name in ("k1", "k2", "k3", "k4")]
    p1, p2 = (camera.coefficients.get(name, 0.0) for name in ("p1", "p2"))
    x, y = ideal[:, 0], ideal[:, 1]
    square = x * x + y * y
    if camera.lens == "OPENCV_FISHEYE":
        radius = np.sqrt(square)
        theta = np.arctan(radius)
        s = theta * theta
        bent = theta * (1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))))
        return ideal * np.where(radius > 1e-12, bent / np.maximum(radius, 1e-12), 1.0)[:, None]
    scale = 1 + square * (k[0] + square * (k[1] + square * (k[2] + square * k[3])))
    return np.stack([x * scale + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                     y * scale + p1 * (square + 2 * y * y) + 2 * p2 * x * y], 1)


def undistort(camera, bent):
    """The inverse of `distort`, by Newton's method."""
    ideal, h = bent.copy(), 1e-6
    if camera.lens == "PINHOLE":
        return ideal
    for _ in range(30):
        miss = bent - distort(camera, ideal)
        dx, dy = np.array([[h, 0.0]]), np.array([[0.0, h]])
        u = (distort(camera, ideal + dx) - distort(camera, ideal - dx)) / (2 * h)
        v = (distort(camera, ideal + dy) - distort(camera, ideal - dy)) / (2 * h)
        determinant = u[:, 0] * v[:, 1] - v[:, 0] * u[:, 1]
        ideal[:, 0] += (v[:, 1] * miss[:, 0] - v[:, 0] * miss[:, 1]) / determinant
        ideal[:, 1] += (u[:, 0] * miss[:, 1] - u[:, 1] * miss[:, 0]) / determinant
    assert np.abs(bent - distort(camera, ideal)).max() < 1e-9, "the lens can't be undone"
    return ideal


def look_at(eye, target):
    """Camera to world, OpenGL's axes, y up."""
    eye = np.asarray(eye, float)
    z = unit(eye - np.asarray(target, float))
    x = unit(np.cross([0.0, 1.0, 0.0], z))
    pose = np.eye(4)
    pose[:3, :4] = np.stack([x, np.cross(z, x), z, eye], 1)
    return np.round(pose, 10)


def on_sphere(distance, azimuth, elevation):
    """A place at a distance from the origin, by angles in degrees."""
    a, e = np.radians([azimuth, elevation])
    return distance * np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])


def ball(rings, sectors, centre=(0, 0, 0), radius=1.0, bumps=0.0):
    """A sphere with bumps."""
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(sectors) / sectors
    t, p = (grid.ravel() for grid in np.meshgrid(theta, phi, indexing="ij"))
    around = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], 1)
    points = np.concatenate([around, [[0, 1, 0], [0, -1, 0]]])
    relief = np.sin(5 * points[:, 0] + 1) * np.sin(4 * points[:, 1]) * np.sin(6 * points[:, 2] + 2)
    points = np.array(centre) + radius * points * (1 + bumps * relief)[:, None]
    triangles, north = [], (rings - 1) * sectors
    for s in range(sectors):
        n = (s + 1) % sectors
        triangles += [[north, s, n], [north + 1, (rings - 2) * sectors + n, (rings - 2) * sectors + s]]
        for r in range(rings - 2):
            a, b, c, d = r * sectors + s, r * sectors + n, (r + 1) * sectors + s, (r + 1) * sectors + n
            triangles += [[a, c, b], [b, c, d]]
    return points, np.array(triangles)


def torus(around, through, radius, thickness, bumps):
    """A lying torus whose tube swells and shrinks."""
    u = 2 * np.pi * np.arange(around) / around
    v = 2 * np.pi * np.arange(through) / through
    a, b = (grid.ravel() for grid in np.meshgrid(u, v, indexing="ij"))
    tube = thickness * (1 + bumps * np.sin(5 * a) * np.cos(2 * b))
    ring = radius + tube * np.cos(b)
    points = np.stack([ring * np.sin(a), tube * np.sin(b), ring * np.cos(a)], 1)
    triangles = []
    for i in range(around):
        for j in range(through):
            p, q = i * through, (i + 1) % around * through
            n = (j + 1) % through
            triangles += [[p + j, q + j, p + n], [p + n, q + j, q + n]]
    return points, np.array(triangles)


def joined(*bodies):
    """Several bodies as one mesh."""
    points, triangles, first = [], [], 0
    for body_points, body_triangles in bodies:
        points.append(body_points)
        triangles.append(body_triangles + first)
        first += len(body_points)
    return Mesh(np.concatenate(points), np.concatenate(triangles))


def cast(mesh, origins, directions):
    """Distance, triangle (-1: none) and barycentrics of each ray's nearest hit (Moeller and Trumbore 1997)."""
    a, b, c = mesh.positions[mesh.triangles].transpose(1, 0, 2)
    ab, ac = b - a, c - a
    across = np.cross(ab, ac)
    # What depends on the triangle alone, so that all pairs are matrix products.
    to_a, u_turn, v_turn = (a * across).sum(1), np.cross(ac, a).T, np.cross(a, ab).T
    count = len(directions)
    distance, triangle = np.full(count, np.inf), np.full(count, -1)
    weights = np.zeros((count, 2))
    step = max(1, PAIRS // len(a))
    for start in range(0, count, step):
        part = slice(start, start + step)
        o, d = origins[part], directions[part]
        moment = np.cross(o, d)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = -1.0 / (d @ across.T)
            u = (moment @ ac.T - d @ u_turn) * inverse
            v = (-(moment @ ab.T) - d @ v_turn) * inverse
            t = (o @ across.T - to_a) * inverse
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
        t = np.where(hit, t, np.inf)
        nearest = t.argmin(1)
        rows = np.arange(len(nearest))
        found = np.isfinite(t[rows, nearest])
        distance[part] = t[rows, nearest]
        triangle[part] = np.where(found, nearest, -1)
        weights[part] = np.where(found[:, None], np.stack([u, v], 2)[rows, nearest], 0.0)
    return distance, triangle, weights


def paint(points):
    """Albedo: broad patches of colour under fine stripes."""
    x, y, z = points.T
    wave = np.stack([np.sin(3 * x + 1) * np.cos(2 * z), np.sin(4 * y + 2 * x), np.cos(3 * z - y)], 1)
    stripes = 1 - 0.45 * (np.sin(11 * y + 5 * np.sin(3 * x) + 2 * z) > 0.4)[:, None]
    return np.clip((0.42 + 0.28 * wave) * stripes, 0.03, 0.9)


def gloss(normals, to_light, to_eye, roughness, reflectance):
    """Specular reflection of a GGX surface (Walter et al. 2007), Schlick's Fresnel term."""
    half = unit(to_light + to_eye)
    nl, nv = ((normals * v).sum(1).clip(1e-4) for v in (to_light, to_eye))
    nh, vh = (normals * half).sum(1).clip(0), (to_eye * half).sum(1).clip(0)
    square = roughness * roughness
    lobe = square / (np.pi * (nh * nh * (square - 1) + 1) ** 2)
    shadowing = [2 * n / (n + np.sqrt(square + (1 - square) * n * n)) for n in (nl, nv)]
    fresnel = reflectance + (1 - reflectance) * (1 - vh) ** 5
    return lobe * fresnel * shadowing[0] * shadowing[1] / (4 * nl * nv)


def backdrop(directions):
    """Radiance of what stands behind the object."""
    x, y, z = directions.T
    glow = 0.06 + 0.04 * np.sin(5 * x + 2 * y) * np.cos(4 * z)
    return glow[:, None] * np.array([[1.0, 0.8, 0.6]])


def photograph(mesh, camera, light, intensity):
    """Diffuse and specular radiance of a view, and the pixels whose middle shows the mesh."""
    width, height = camera.size
    fine = np.stack(np.meshgrid((np.arange(width * SAMPLES) + 0.5) / SAMPLES,
                                (np.arange(height * SAMPLES) + 0.5) / SAMPLES), 2).reshape(-1, 2)
    directions = camera.directions(fine)
    origins = np.broadcast_to(camera.centre, directions.shape)
    distance, triangle, weights = cast(mesh, origins, directions)
    hit = triangle >= 0
    diffuse, specular = backdrop(directions), np.zeros((len(directions), 3))
    if hit.any():
        diffuse[hit], specular[hit] = shade(mesh, origins[hit] + distance[hit, None] * directions[hit],
                                            triangle[hit], weights[hit], -directions[hit], light, intensity)
    blocks = (height, SAMPLES, width, SAMPLES)
    middle = SAMPLES // 2
    coverage = hit.reshape(blocks)[:, middle, :, middle]
    return *(part.reshape(*blocks, 3).mean((1, 3)) for part in (diffuse, specular)), coverage


def shade(mesh, points, triangle, weights, to_eye, light, intensity):
    """Diffuse and specular radiance of points on the mesh under a point light."""
    corners = mesh.triangles[triangle]
    u, v = weights.T
    normals = unit(np.einsum("nk,nkd->nd", np.stack([1 - u - v, u, v], 1), mesh.normals[corners]))
    a, b, c = mesh.positions[corners].transpose(1, 0, 2)
    flat = unit(np.cross(b - a, c - a))
    away = np.asarray(light) - points
    square = (away * away).sum(1)
    to_light = away / np.sqrt(square)[:, None]
    cosine = np.where((flat * to_light).sum(1) > 0, (normals * to_light).sum(1).clip(0), 0.0)
    lit = cosine > 0
    blocked, _, _ = cast(mesh, (points + 1e-3 * flat)[lit], to_light[lit])
    cosine[np.flatnonzero(lit)[blocked < np.sqrt(square[lit])]] = 0.0
    irradiance = cosine[:, None] * np.asarray(intensity) / square[:, None]
    roughness = 0.22 + 0.1 * np.sin(3 * points[:, 0] + 2 * points[:, 1])
    lobe = gloss(normals, to_light, to_eye, roughness, 0.06)
    return paint(points) / np.pi * irradiance, lobe[:, None] * irradiance
