"""Writes what another renderer needs of a file: mesh.obj, diffuse.npy, specular.npy, roughness.npy, cameras.json: to_mitsuba.py FILE.tsuya FOLDER

The textures are linear; `sigma` of Torrance and Sparrow is close to the `alpha` of a Beckmann lobe over the square root of two.
"""

import json
import pathlib
import sys

import numpy as np

import tsuya


def write_obj(path, mesh):
    """A Wavefront OBJ with normals and texture coordinates, v upwards."""
    u, v = mesh.texture_coordinates.T
    with open(path, "w") as file:
        file.writelines("v %.9g %.9g %.9g\n" % tuple(row) for row in mesh.positions)
        file.writelines("vt %.9g %.9g\n" % row for row in zip(u, 1 - v))
        file.writelines("vn %.9g %.9g %.9g\n" % tuple(row) for row in mesh.normals)
        file.writelines("f {0}/{0}/{0} {1}/{1}/{1} {2}/{2}/{2}\n".format(*row) for row in mesh.triangles + np.uint32(1))


def export(asset, folder):
    """Writes the files."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    maps = asset.reflectance
    write_obj(folder / "mesh.obj", asset.render_mesh)
    np.save(folder / "diffuse.npy", maps.diffuse)
    if maps.specular is not None:
        np.save(folder / "specular.npy", maps.specular)
        np.save(folder / "roughness.npy", maps.sigma * np.sqrt(2))
    cameras = [
        {"name": view.name, "intrinsic": view.camera.matrix.tolist(), "rotation": view.camera.rotation.tolist(),
         "translation": view.camera.translation.tolist(), "size": [view.camera.width, view.camera.height]}
        for view in asset.views
    ]
    (folder / "cameras.json").write_text(json.dumps(cameras, indent=1))


if __name__ == "__main__":
    export(tsuya.open(sys.argv[1]), sys.argv[2])
