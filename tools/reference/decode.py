#!/usr/bin/env python3
"""Reference decoder of tsuya files, written from spec/ alone. Slow and plain; needs NumPy.

    python3 tools/reference/decode.py FILE.tsuya --view 0 -o DIR

writes for each component VIEW-NAME-COMPONENT.pfm (linear radiance) and VIEW-NAME-mask.pgm, mesh.obj, and the maps of the
reflectance (sigma in all three colours).
"""

import argparse
import os
import re

import numpy as np

import container
import mesh
import paper
import planes
import reflectance

COMPONENTS = ["diffuse", "specular", "combined"]


def write_pfm(path, image):
    """Portable float map: little-endian, rows from the bottom."""
    with open(path, "wb") as file:
        file.write(b"PF\n%d %d\n-1.0\n" % (image.shape[1], image.shape[0]))
        file.write(image[::-1].astype("<f4").tobytes())


def main():
    parser = argparse.ArgumentParser(description="Decodes views of a tsuya file, slowly.")
    parser.add_argument("file")
    parser.add_argument("--view", type=int, action="append", help="index of a view (may repeat); all without it")
    parser.add_argument("-o", "--output", default=".", help="folder for the pictures")
    parser.add_argument("--no-reflectance", action="store_true", help="leave the maps of the reflectance out")
    arguments = parser.parse_args()
    sections = container.read(arguments.file)
    views = container.Views(sections["VIEW"][1])
    positions, triangles = mesh.decode(sections["MESH"][1])
    print(f"{len(positions)} vertices, {len(triangles)} triangles, {len(views.views)} views")
    os.makedirs(arguments.output, exist_ok=True)
    with open(os.path.join(arguments.output, "mesh.obj"), "w") as file:
        file.writelines(f"v {float(x)!r} {float(y)!r} {float(z)!r}\n" for x, y, z in positions)
        file.writelines(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles)
    if "DISP" in sections:
        charts = reflectance.Charts(sections["CHRT"][1], positions, triangles)
        finer, _ = reflectance.surface(sections["DISP"][1], charts)
        with open(os.path.join(arguments.output, "surface.obj"), "w") as file:
            file.writelines(f"v {float(x)!r} {float(y)!r} {float(z)!r}\n" for x, y, z in finer)
    if "RFLC" in sections and not arguments.no_reflectance:
        charts = reflectance.Charts(sections["CHRT"][1], positions, triangles)
        maps, relightable = reflectance.decode(sections["RFLC"][1], charts)
        for name, image in maps.items():
            image = image if image.ndim == 3 else np.repeat(image[..., None], 3, -1)
            write_pfm(os.path.join(arguments.output, f"reflectance-{name}.pfm"), image)
        print(f"reflectance: {charts.width} x {charts.height} texels, {'relightable' if relightable else 'lights unknown'}")
    if "PLAN" in sections:
        contents = {tag: content for tag, (_, content) in sections.items()}
        pictures = planes.Planes(contents, views, positions, triangles)
    elif "PAPR" in sections:
        pictures = paper.Paper(sections["PAPR"][1], views, positions, triangles)
    else:
        return
    wanted = arguments.view if arguments.view is not None else range(len(views.views))
    for view in wanted:
        mask, images = pictures.view(view)
        name = re.sub(r"[^A-Za-z0-9._-]", "_", views.views[view].name) or str(view)
        base = os.path.join(arguments.output, f"{view:03}-{name}")
        for component, image in zip(views.components, images):
            write_pfm(f"{base}-{COMPONENTS[component]}.pfm", image)
        with open(f"{base}-mask.pgm", "wb") as file:
            file.write(b"P5\n%d %d\n255\n" % (mask.shape[1], mask.shape[0]))
            file.write((mask * np.uint8(255)).tobytes())
        print(f"view {view} ({name}): {int(mask.sum())} pixels")


if __name__ == "__main__":
    main()
