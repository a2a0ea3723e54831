#!/usr/bin/env python3
"""Makes the captures of tests/data but sample-spot: `tools/captures/make.py [NAME ...]`, all without a name. Needs NumPy.

Each stands for a kind of capture that the others leave out and is as small as it can be for that:

- dome: two rings, two lights, photographs through polarisers, masks that are not what the mesh covers, views of nothing;
- unpolarised: one photograph a view, 8-bit PNG, half of them with alpha, no masks;
- lens: every camera bent by another lens, photographs and masks taken through it;
- sizes: a COLMAP model with photographs of many sizes, one of 5 x 4 pixels; lights unknown.

The same pixels come out whenever and wherever it runs, as far as NumPy's sines do.
"""
import shutil
import sys
from pathlib import Path

import numpy as np

import files
import scene
from files import rounded
from scene import Camera, ball, joined, look_at, on_sphere, torus

DATA = Path(__file__).resolve().parents[2] / "tests" / "data"
LIGHT = [52.0, 49.0, 45.0]
# What the crossed polarisers leave of diffuse light.
BETA = np.array([0.46, 0.48, 0.5])


def pinhole(size, focal, eye, target=(0, 0, 0), off_centre=(0.0, 0.0)):
    """A camera whose principal point lies beside the picture's middle."""
    middle = tuple(0.5 * side + shift for side, shift in zip(size, off_centre))
    return Camera(size, (focal, focal), middle, look_at(eye, target))


def frame(camera, light, name):
    """A frame of transforms.json."""
    return {"file_path": name, "transform_matrix": rounded(camera.pose), "light_position": rounded(light)}


def intrinsics(camera):
    """Keys of a camera's own intrinsics."""
    keys = dict(zip(("w", "h"), camera.size)) | dict(zip(("fl_x", "fl_y"), camera.focal))
    return keys | dict(zip(("cx", "cy"), camera.principal)) | {"camera_model": camera.lens} | camera.coefficients


def description(camera, color_space):
    """What all frames of a transforms.json share."""
    return intrinsics(camera) | {"mesh_file": "scan.ply", "color_space": color_space,
                                 "light": {"type": "point", "intensity": LIGHT}}


def grown(mask, pixels):
    """A mask with all pixels at most so far (each way) from it; shrunk where `pixels` is negative."""
    if pixels < 0:
        return ~grown(~mask, -pixels)
    padded = np.pad(mask, pixels)
    height, width = mask.shape
    reach = range(2 * pixels + 1)
    wide = np.any([padded[:, dx:dx + width] for dx in reach], axis=0)
    return np.any([wide[dy:dy + height] for dy in reach], axis=0)


def dome_masks(coverage):
    """Masks of the dome's views, in turn: what a view shows of the mesh and what its mask says are not the same."""
    height, width = coverage.shape
    y, x = np.mgrid[:height, :width]
    islands = ((x // 7) % 2 == 0) & ((y // 6) % 2 == 0)
    holes = np.any([(x - a) ** 2 + (y - b) ** 2 < 30 for a, b in ((20, 18), (31, 30), (42, 20))], axis=0)
    return {
        "everything": np.ones_like(coverage),
        "left half": coverage & (x < 22),
        "grown": grown(coverage, 5),
        "spot": (x - 30) ** 2 + (y - 24) ** 2 < 26,
        "islands": coverage & islands,
        "coverage": coverage,
        "shrunk": grown(coverage, -3),
        "holes": grown(coverage, 2) & ~holes,
        "lower right": coverage & (x > 33) & (y > 22),
    }


def dome(folder):
    """Each pose under two lights; odd sides; of the last three views one mask is empty and two cameras look away."""
    mesh = joined(torus(20, 9, 0.78, 0.34, 0.25), ball(7, 10, (0.1, 0.32, 0.0), 0.42, 0.15))
    size, focal, distance = (61, 47), 88.0, 4.0
    poses = [on_sphere(distance, azimuth, 14) for azimuth in (0, 38, 76, 114)]
    poses += [on_sphere(distance, azimuth, 50) for azimuth in (16, 60, 104)]
    kinds = ["everything", "coverage", "coverage", "shrunk", "left half", "everything", "grown", "spot", "lower right",
             "coverage", "holes", "grown", "islands", "everything"]
    white = 0.95 / np.pi * np.array(LIGHT) / distance**2
    views = []
    for index, eye in enumerate(poses):
        above = eye + np.array([0.12, 0.1, 0.0])
        aside = on_sphere(distance, 30 + 35 * (index % 3), 62 - 24 * (index % 2))
        views += [(eye, (0, 0.05, 0), light) for light in (above, aside)]
    # From below, under lights far apart: no view is predicted from these two, which are decoded early.
    below = on_sphere(distance, 236, -52)
    views += [(below, (0, 0, 0), on_sphere(distance, azimuth, -20)) for azimuth in (160, 310)]
    kinds += ["everything", "everything"]
    nothing = on_sphere(distance, 57, 30)
    views += [(poses[1], (0, 0, 0), nothing), (nothing, 2 * nothing, nothing), (poses[3], 2 * poses[3], nothing)]
    kinds += ["empty", "none", "beside"]
    frames = []
    for index, ((eye, target, light), kind) in enumerate(zip(views, kinds)):
        camera = pinhole(size, focal, eye, target, (1.5, -0.5))
        diffuse, specular, coverage = scene.photograph(mesh, camera, light, LIGHT)
        names = {key: f"{place}/{index:02}.exr" for key, place in (("file_path", "off"), ("cross_file_path", "cross"))}
        files.write_exr(folder / names["file_path"], diffuse + specular)
        files.write_exr(folder / names["cross_file_path"], BETA * diffuse)
        frames.append(frame(camera, light, names["file_path"]) | names)
        masks = dome_masks(coverage)
        masks |= {"empty": np.zeros_like(coverage), "beside": masks["spot"]}
        if kind in masks:
            frames[-1]["mask_path"] = f"mask/{index:02}.png"
            files.write_mask(folder / frames[-1]["mask_path"], masks[kind])
    for name, factor in (("white_off.exr", 1.0), ("white_cross.exr", BETA)):
        files.write_exr(folder / name, np.broadcast_to(factor * white, (8, 8, 3)))
    files.write_ply(folder / "scan.ply", mesh)
    top = description(camera, "linear-rec709")
    top["white_reference"] = {"file_path": "white_off.exr", "cross_file_path": "white_cross.exr"}
    files.write_transforms(folder, top, frames)


def unpolarised(folder):
    """A pebble behind a smaller one; every second photograph has an alpha channel."""
    mesh = joined(ball(12, 14, radius=0.85, bumps=0.3), ball(6, 8, (0.75, 0.35, 0.6), 0.28))
    frames = []
    for index in range(10):
        azimuth, elevation = 36 * index, 12 + 10 * (index % 3)
        camera = pinhole((50, 40), 74.0, on_sphere(3.6, azimuth, elevation))
        light = on_sphere(4.2, azimuth + 25, elevation + 30)
        diffuse, specular, coverage = scene.photograph(mesh, camera, light, LIGHT)
        codes = files.to_srgb(diffuse + specular)
        if index % 2 == 0:
            codes = np.dstack([codes, np.where(coverage, 255, 0).astype(np.uint8)])
        frames.append(frame(camera, light, f"{index:02}.png"))
        files.write_png(folder / frames[-1]["file_path"], codes)
    files.write_ply(folder / "scan.ply", mesh)
    files.write_transforms(folder, description(camera, "srgb"), frames)


def lens(folder):
    """Barrel, pincushion and fisheye lenses, each camera with its own; photographs through polarisers."""
    mesh = joined(torus(18, 8, 0.7, 0.3, 0.15), ball(6, 9, (0.0, 0.0, 0.0), 0.33))
    size, distance = (56, 44), 3.4
    white = 0.95 / np.pi * np.array(LIGHT) / distance**2
    frames = []
    for index in range(8):
        eye = on_sphere(distance, 24 * index, 22 + 6 * (index % 2))
        light = eye + np.array([0.4, 0.9, 0.1])
        bend = (-1) ** index
        focal = (72.0 + index, 70.5 + 0.5 * index)
        names = ("k1", "k2", "p1", "p2")
        coefficients = dict(zip(names, rounded([0.22 * bend, 0.05, 0.006 - 0.001 * index, -0.004 * bend])))
        camera = Camera(size, focal, (28.0 + 0.7 * bend, 21.0 + 0.2 * index), look_at(eye, (0, 0, 0)), "OPENCV",
                        coefficients)
        if index == 5:
            camera.lens, camera.coefficients = "OPENCV_FISHEYE", {"k1": 0.05, "k2": -0.02, "k3": 0.004, "k4": 0.0}
        diffuse, specular, coverage = scene.photograph(mesh, camera, light, LIGHT)
        names = {key: f"{index:02}-{what}" for key, what in
                 (("file_path", "off.exr"), ("cross_file_path", "cross.exr"), ("mask_path", "mask.png"))}
        files.write_exr(folder / names["file_path"], diffuse + specular)
        files.write_exr(folder / names["cross_file_path"], BETA * diffuse)
        files.write_mask(folder / names["mask_path"], coverage)
        frames.append(frame(camera, light, "") | names | intrinsics(camera))
    for name, factor in (("white_off.exr", 1.0), ("white_cross.exr", BETA)):
        files.write_exr(folder / name, np.broadcast_to(factor * white, (8, 8, 3)))
    files.write_ply(folder / "scan.ply", mesh)
    top = {"mesh_file": "scan.ply", "color_space": "linear-rec709", "light": {"type": "point", "intensity": LIGHT},
           "white_reference": {"file_path": "white_off.exr", "cross_file_path": "white_cross.exr"}}
    files.write_transforms(folder, top, frames)


def quaternion(rotation):
    """w, x, y, z of a rotation."""
    w = 0.5 * np.sqrt(max(0.0, 1 + np.trace(rotation)))
    assert w > 0.05
    turn = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    return [w, *(np.array(turn) / (4 * w))]


def sizes(folder):
    """One light that stays, nine sizes; EXR and 16-bit PNG; masks for every third photograph."""
    mesh = joined(ball(10, 14, radius=0.7, bumps=0.25), torus(16, 6, 1.0, 0.12, 0.0))
    shapes = [(64, 48), (48, 64), (33, 57), (96, 80), (5, 4), (64, 48), (41, 9), (7, 50), (31, 31), (72, 40)]
    light = [1.6, 3.2, 2.6]
    cameras = ["# Camera list: CAMERA_ID MODEL WIDTH HEIGHT PARAMS"]
    images = ["# Image list: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and a line of points"]
    for index, size in enumerate(shapes):
        eye = on_sphere(3.8, 22 * index - 99, 10 + 16 * (index % 2))
        camera = pinhole(size, 1.3 * min(max(size), 2 * min(size)), eye, (0, 0, 0), (0.3, -0.2))
        diffuse, specular, coverage = scene.photograph(mesh, camera, light, LIGHT)
        name = f"{index:02}.{'png' if index % 2 else 'exr'}"
        if index % 2:
            files.write_png(folder / "images" / name, files.to_srgb(diffuse + specular, 65535))
        else:
            files.write_exr(folder / "images" / name, diffuse + specular)
        if index % 3 == 0:
            files.write_mask(folder / "masks" / f"{name}.png", grown(coverage, 1))
        # World to camera with OpenCV's axes.
        rotation = (camera.pose[:3, :3] * [1, -1, -1]).T
        place = -rotation @ camera.centre
        numbers = [*camera.focal, *camera.principal]
        cameras.append(" ".join(map(str, [index + 1, "PINHOLE", *size, *rounded(numbers)])))
        images += [" ".join(map(str, [index + 1, *rounded(quaternion(rotation)), *rounded(place), index + 1, name])), ""]
    for name, lines in (("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", ["# Point list"])):
        files.save(folder / "sparse" / name, ("\n".join(lines) + "\n").encode())
    files.write_ply(folder / "scan.ply", mesh)


CAPTURES = {make.__name__: make for make in (dome, unpolarised, lens, sizes)}

if __name__ == "__main__":
    for wanted in sys.argv[1:] or CAPTURES:
        folder = DATA / wanted
        make = CAPTURES[wanted]
        shutil.rmtree(folder, ignore_errors=True)
        make(folder)
        print(wanted, sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()), "bytes")
