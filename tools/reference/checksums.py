"""Checksums of what a file decodes to, the lines of tools/platforms: CRC-32 of each part's values, little-endian, rows from the top,
both zeros as +0; and the check of all golden files of spec/vectors:

    python3 tools/reference/checksums.py spec/vectors/*.tsuya
"""

import os
import struct
import sys
import zlib

import numpy as np

import container
import coordinates
import light
import materials
import mesh
import paper
import planes
import reflectance
import visibility

COMPONENTS = ["diffuse", "specular", "combined"]


def singles(values):
    return (np.asarray(values, np.float32) + np.float32(0)).astype("<f4").tobytes()


def doubles(values):
    return (np.asarray(values, float) + 0.0).astype("<f8").tobytes()


def view_bytes(view):
    name, camera = view.name.encode("utf-8"), view.camera
    data = struct.pack("<I", len(name)) + name + struct.pack("<II", camera.width, camera.height)
    rotation = [x for row in camera.rotation for x in row]
    data += doubles([*camera.focal, *camera.principal, *rotation, *camera.translation])
    data += struct.pack("<I", view.light is not None)
    return data + (doubles([*view.light[0], *view.light[1]]) if view.light else b"")


def parts(sections):
    """Name and bytes of each part."""
    if "MESH" in sections:
        positions, triangles = mesh.decode(sections["MESH"])
        yield "mesh positions", singles(positions)
        yield "mesh triangles", np.array(triangles, "<u4").tobytes()
    if "VIEW" in sections:
        views = container.Views(sections["VIEW"])
        yield "views", doubles(views.white) + b"".join(view_bytes(view) for view in views.views)
    if "DISP" in sections:
        charts = reflectance.Charts(sections["CHRT"], positions, triangles)
        yield "surface positions", singles(reflectance.surface(sections["DISP"], charts)[0])
    if "RFLC" in sections:
        charts = reflectance.Charts(sections["CHRT"], positions, triangles)
        maps, _ = reflectance.decode(sections["RFLC"], charts)
        for name in maps:
            yield f"reflectance {name}", singles(maps[name])
    pictures = None
    if "PLAN" in sections:
        pictures = planes.Planes(sections, views, positions, triangles)
    elif "PAPR" in sections:
        pictures = paper.Paper(sections["PAPR"], views, positions, triangles)
    for index in range(len(views.views) if pictures else 0):
        mask, images = pictures.view(index)
        yield f"view {index} mask", mask.astype(np.uint8).tobytes()
        for component, image in zip(views.components, images):
            yield f"view {index} {COMPONENTS[component]}", singles(image)
    if "bIND" in sections:
        bound, _ = materials.binding(sections["bIND"], len(triangles), materials.decode(sections["mATl"]))
        yield "binding", np.array(bound, "<u2").tobytes()
    if "tCOR" in sections:
        yield "texture coordinates", singles(coordinates.decode(sections["tCOR"], positions, triangles))
    if "vISB" in sections:
        bases, weights = visibility.decode(sections["vISB"], positions, triangles)
        yield "visibility bases", singles(bases)
        yield "visibility weights", weights.astype("<i1").tobytes()
    if "lIGt" in sections:
        lobes, levels = light.decode(sections["lIGt"])
        yield "light lobes", doubles(lobes)
        for index, (_, cells) in enumerate(levels):
            yield f"light level {index}", singles(cells)


def lines(path):
    # Sections compressed with zstd hold text and materials only, which have no checksums here.
    sections = {tag: content for tag, (codec, content) in container.read(path).items() if codec != 1}
    return [f"{name} {zlib.crc32(data):08x}" for name, data in parts(sections)]


def main():
    wrong = 0
    for path in sys.argv[1:]:
        found, expected = lines(path), open(os.path.splitext(path)[0] + ".txt").read().splitlines()[1:]
        same = found == expected
        print(f"{os.path.basename(path)}: {len(found)} parts, {'the same' if same else 'DIFFERENT'}")
        if not same:
            wrong += 1
            print("\n".join(f"  {a} | {b}" for a, b in zip(expected, found) if a != b), file=sys.stderr)
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
