"""Relighting against Mitsuba 3: the same jobs rendered by both, PSNR of the pictures (sRGB-encoded, white = 1, clamped).

    pip install mitsuba numpy    (llvm_ad_rgb needs LLVM; DRJIT_LIBLLVM_PATH names it)
    python tools/bench/relight/compare.py --tsuya target/release/tsuya --data DATA [--out DIR] [--references DIR] [--samples 256] [CASE ...]

DATA holds meshes/ and envmaps/. A case is MATERIAL-MESH-ENVIRONMENT, such as glossy-bunny-museum; all of them without any.
Both pictures have a black background. In brackets: the PSNR over the pixels of the object only. "noise" is that of the peer's picture,
by its two halves: no figure near it says anything. The peer's pictures are kept in the folder of --references and used again.
"""

import argparse
import json
import os
import subprocess
import time

import numpy as np

import peer
import mitsuba as mi

MATERIALS = {
    "lambert": {"model": "lambert", "diffuse": 0.7},
    "phong": {"model": "blinn-phong", "diffuse": [0.3, 0.2, 0.15], "specular": 0.3, "exponent": 60},
    "rough": {"model": "cook-torrance", "diffuse": [0.2, 0.25, 0.3], "reflectance": 0.3, "roughness": 0.35},
    "glossy": {"model": "cook-torrance", "diffuse": 0.1, "specular": [1, 0.75, 0.5], "reflectance": 0.7, "roughness": 0.12},
    "ward": {"model": "ward", "diffuse": 0.1, "specular": 0.6, "roughness": [0.1, 0.3]},
    "ashikhmin": {"model": "ashikhmin-shirley", "diffuse": 0.1, "reflectance": 0.5, "exponent": [40, 400]},
    "lafortune": {"model": "lafortune", "diffuse": 0.1, "specular": 0.3, "coefficients": [-1, 0.95], "exponent": 40},
    "ggx": {"model": "cook-torrance", "diffuse": 0.1, "reflectance": 0.5, "roughness": 0.2, "distribution": "ggx"},
}
ASKED = ["lambert", "phong", "rough", "glossy"]
MESHES = {"bunny": "stanford-bunny.obj", "spot": "spot_triangulated.obj"}
ENVIRONMENTS = {"museum": "museum.exr", "kerner": "KernerEnvLatLong.exr"}
CAMERAS = {
    "bunny": {"position": [0.1, 0.2, 0.35], "target": [-0.0168, 0.106, -0.0015], "up": [0, 1, 0], "fov_y_deg": 32},
    "spot": {"position": [-1.6, 1.2, -3.2], "target": [0, 0.1, 0.15], "up": [0, 1, 0], "fov_y_deg": 32},
}
# The sun of the second environment from the side.
ROTATION = {("spot", "kerner"): -26.0}


def encoded(linear):
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


def read(path):
    return np.array(mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))


def psnr(squares):
    return -10 * np.log10(max(squares.mean(), 1e-12))


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--tsuya", default="target/release/tsuya")
    arguments.add_argument("--data", required=True)
    arguments.add_argument("--out", default="relight-bench")
    arguments.add_argument("--references", help="folder of the peer's pictures [default: that of --out]")
    arguments.add_argument("--samples", type=int, default=256, help="paths a pixel of the peer")
    arguments.add_argument("--size", type=int, nargs=2, default=[320, 240])
    arguments.add_argument("--evaluators", default="sg,filtered")
    arguments.add_argument("--references-only", action="store_true", help="make the peer's pictures, nothing else")
    arguments.add_argument("cases", nargs="*")
    options = arguments.parse_args()
    options.references = options.references or options.out
    os.makedirs(options.out, exist_ok=True)
    os.makedirs(options.references, exist_ok=True)
    cases = options.cases or [f"{m}-{o}-{e}" for m in ASKED for o in MESHES for e in ENVIRONMENTS]
    evaluators = options.evaluators.split(",")
    print("| case | " + " | ".join(f"{e}, dB (object)" for e in evaluators) + " | noise |", flush=True)
    print("|---|" + "---|" * (len(evaluators) + 1))
    worst = dict.fromkeys(evaluators, float("inf"))
    for case in cases:
        material, mesh, environment = case.split("-")
        path = lambda *parts: os.path.abspath(os.path.join(options.data, *parts))
        job = {
            "mesh": path("meshes", MESHES[mesh]),
            "material": MATERIALS[material],
            "environment": {"file": path("envmaps", ENVIRONMENTS[environment]), "scale": 1.0,
                            "rotation_y_deg": ROTATION.get((mesh, environment), 0.0)},
            "camera": CAMERAS[mesh],
            "size": options.size,
            "shadows": True,
            "samples": 4,
        }
        place = os.path.join(options.out, case)
        reference = os.path.join(options.references, f"{case}-{options.size[0]}x{options.size[1]}-{options.samples}.npz")
        if not os.path.exists(reference):
            mean, noise = peer.render(job, "", options.samples)
            np.savez_compressed(reference, mean=mean.astype(np.float32), noise=noise.astype(np.float32))
        stored = np.load(reference)
        wanted, noise = stored["mean"], stored["noise"]
        if options.references_only:
            print(case, flush=True)
            continue
        hit = wanted.sum(axis=2) > 0
        floor = (encoded(wanted + noise) - encoded(wanted)) ** 2
        # Visibility is baked once for each mesh.
        baked = os.path.join(options.out, mesh + ".tsuya")
        if not os.path.exists(baked):
            command = [options.tsuya, "bake", job["mesh"], "-o", baked, "--position-bits", "24"]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        job["mesh"] = os.path.abspath(baked)
        columns, rows = [], [encoded(wanted)]
        for evaluator in evaluators:
            job["evaluator"] = evaluator
            with open(place + ".json", "w") as file:
                json.dump(job, file, indent=1)
            start = time.time()
            subprocess.run([options.tsuya, "render", "--job", place + ".json", "-o", f"{place}-{evaluator}.exr", "--force",
                            "--allow-outside"],
                           check=True)
            seconds = time.time() - start
            found = read(f"{place}-{evaluator}.exr")
            squares = (encoded(found) - encoded(wanted)) ** 2
            columns.append(f"{psnr(squares):.1f} ({psnr(squares[hit]):.1f}), {seconds:.1f} s")
            worst[evaluator] = min(worst[evaluator], psnr(squares))
            rows += [encoded(found)]
        sheet = (np.concatenate(rows, axis=1) * 255 + 0.5).astype(np.uint8)
        mi.Bitmap(sheet).write(place + ".png")
        print(f"| {case} | " + " | ".join(columns) + f" | {psnr(floor):.1f} ({psnr(floor[hit]):.1f}) |", flush=True)
    print("least: " + ", ".join(f"{e} {worst[e]:.1f} dB" for e in evaluators))


if __name__ == "__main__":
    main()
