"""Encodes a capture that is made of arrays, a ball under a lamp at the camera, and prints what comes back: made_capture.py [OUT.tsuya]"""

import sys

import numpy as np

import tsuya

SIDE = 96


def ball(rings=24, segments=48):
    """Positions and triangles of a unit ball; all normals are positions."""
    theta = np.linspace(0, np.pi, rings + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, segments, endpoint=False)[None]
    grid = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta) + 0 * phi, np.sin(theta) * np.sin(phi)], -1)
    index = np.arange((rings + 1) * segments).reshape(rings + 1, segments)
    a, b, c, d = index[:-1], np.roll(index[:-1], -1, 1), index[1:], np.roll(index[1:], -1, 1)
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])
    return grid.reshape(-1, 3), triangles


def photograph(camera, lamp):
    """What the camera sees of the ball, Lambertian with stripes, and where it is."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(x - camera.principal[0]) / camera.focal[0], (y - camera.principal[1]) / camera.focal[1], 0 * x + 1], -1)
    rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)) @ camera.rotation
    along = -(rays @ camera.centre)
    discriminant = along**2 - camera.centre @ camera.centre + 1
    mask = discriminant > 0
    point = camera.centre + (along - np.sqrt(np.maximum(discriminant, 0)))[..., None] * rays
    to_lamp = lamp.position - point
    squared = (to_lamp**2).sum(-1)
    cosine = np.maximum((point * to_lamp).sum(-1) / np.sqrt(squared), 0)
    albedo = np.where(np.sin(8 * point[..., 1:2]) > 0, [0.7, 0.4, 0.2], [0.2, 0.4, 0.7])
    return np.where(mask[..., None], albedo / np.pi * lamp.intensity * (cosine / squared)[..., None], 0), mask


def capture(views=12):
    """The ball from a ring of cameras."""
    made = tsuya.Capture(*ball(), name="ball", white=(1, 1, 1))
    for k in range(views):
        angle = 2 * np.pi * k / views
        camera = tsuya.Camera.look_at((4 * np.cos(angle), 1, 4 * np.sin(angle)), (0, 0, 0), width=SIDE, height=SIDE)
        lamp = tsuya.PointLight(camera.centre + [0, 1, 0], (40, 40, 40))
        radiance, mask = photograph(camera, lamp)
        made.add(f"{k:03}", camera, radiance, mask=mask, light=lamp)
    return made


if __name__ == "__main__":
    encoded = tsuya.encode(capture(), metadata={"title": "Ball"})
    print(encoded, *encoded.warnings, sep="\n")
    if len(sys.argv) > 1:
        with open(sys.argv[1], "wb") as file:
            file.write(encoded.data)
