"""The shadow on the ground against Mitsuba 3: light on a plane with the bunny over the light without, ours and a path-traced pair's.

    pip install mitsuba numpy    (llvm_ad_rgb needs LLVM; DRJIT_LIBLLVM_PATH names it)
    python tools/bench/relight/shadow.py --tsuya target/release/tsuya --data DATA [--out DIR] [--samples 1024] [ENVIRONMENT ...]

PSNR of the ratios (1 is no shadow) over the pixels that show the ground, all of the picture and where either is below 0.98. "direct" is light
straight from the environment, which is what the ratio says; "paths" has light that object and ground throw on each other, too.
"""

import argparse
import json
import os
import subprocess

import numpy as np

import peer
import mitsuba as mi

CAMERA = {"position": [0.25, 0.3, 0.45], "target": [-0.0168, 0.06, -0.0015], "up": [0, 1, 0], "fov_y_deg": 36}
SIZE = [320, 240]


def scene(job, ground, integrator, with_object):
    camera, light = job["camera"], job["environment"]
    grey = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}}
    parts = {
        "type": "scene",
        "integrator": {"type": integrator, "hide_emitters": True},
        "ground": {"type": "rectangle", "bsdf": grey,
                   "to_world": mi.ScalarTransform4f().translate([0, ground, 0]).rotate([1, 0, 0], -90).scale(50)},
        "light": {"type": "envmap", "filename": light["file"]},
        "sensor": {
            "type": "perspective", "fov": camera["fov_y_deg"], "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(camera["position"], camera["target"], camera["up"]),
            "film": {"type": "hdrfilm", "width": SIZE[0], "height": SIZE[1], "pixel_format": "rgb", "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        },
    }
    if with_object:
        parts["object"] = peer.mesh_of(job["mesh"], mi.load_dict(grey))
    return mi.load_dict(parts)


def render(description, samples):
    return sum(np.array(mi.render(description, spp=64, seed=k)) for k in range(samples // 64)) / (samples // 64)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--tsuya", default="target/release/tsuya")
    arguments.add_argument("--data", required=True)
    arguments.add_argument("--out", default="shadow-bench")
    arguments.add_argument("--samples", type=int, default=1024)
    arguments.add_argument("environments", nargs="*")
    options = arguments.parse_args()
    os.makedirs(options.out, exist_ok=True)
    path = lambda *parts: os.path.abspath(os.path.join(options.data, *parts))
    print("| environment | direct, dB (shadow alone) | paths, dB (shadow alone) |\n|---|---|---|", flush=True)
    for environment in options.environments or ["museum.exr", "KernerEnvLatLong.exr", "studio.exr"]:
        job = {"mesh": path("meshes", "stanford-bunny.obj"), "material": {"model": "lambert", "diffuse": 0.5},
               "environment": {"file": path("envmaps", environment)}, "camera": CAMERA, "size": SIZE, "samples": 1}
        ground = float(peer.read_obj(job["mesh"])[0][:, 1].min())
        place = os.path.join(options.out, environment.split(".")[0])
        with open(place + ".json", "w") as file:
            json.dump(job, file)
        mi.Bitmap(np.ones((SIZE[1], SIZE[0], 3), np.float32)).write(place + "-white.exr")
        subprocess.run([options.tsuya, "composite", place + ".json", "--photograph", place + "-white.exr", "--ground", str(ground),
                        "-o", place + "-ours.exr", "--force"], check=True)
        ours = np.array(mi.Bitmap(place + "-ours.exr").convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))
        # Pixels whose middle and corners all miss the object.
        depth = scene(job, ground, "depth", True), scene(job, ground, "depth", False)
        near, far = (np.array(mi.render(d, spp=64, seed=1))[..., 0] for d in depth)
        plane = (np.abs(near - far) < 1e-4 * far) & (far > 0)
        columns, pictures = [], [ours]
        for integrator in ["direct", "path"]:
            pair = [render(scene(job, ground, integrator, with_object), options.samples) for with_object in [True, False]]
            ratio = np.clip(pair[0] / np.maximum(pair[1], 1e-9), 0, 1)
            squares = (ratio - np.clip(ours, 0, 1)) ** 2
            dark = plane & ((ratio.min(axis=2) < 0.98) | (ours.min(axis=2) < 0.98))
            value = lambda mask: -10 * np.log10(squares[mask].mean())
            columns.append(f"{value(plane):.1f} ({value(dark):.1f})")
            pictures.append(np.where(plane[..., None], ratio, ours))
        sheet = np.clip(np.concatenate(pictures, axis=1), 0, 1) ** (1 / 2.2)
        mi.Bitmap((sheet * 255 + 0.5).astype(np.uint8)).write(place + ".png")
        print(f"| {environment} | " + " | ".join(columns) + " |", flush=True)


if __name__ == "__main__":
    main()
