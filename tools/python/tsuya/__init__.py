"""Objects captured with their measured appearance.

A ``.tsuya`` file holds an object's photographs, split into components of reflection, its mesh and its reflectance::

    import tsuya

    asset = tsuya.open("vase.tsuya")
    photograph = asset.views[0].photograph()
    photograph["diffuse"]                      # linear radiance, (height, width, 3), float32
    relit = asset.render(asset.views[0].camera, lights=[tsuya.PointLight((1, 2, 3), (8, 8, 8))])

    encoded = tsuya.encode("vase/", quality=75)
    open("vase.tsuya", "wb").write(encoded.data)

Images are arrays (height, width, 3) of linear radiance, red, green, blue (Rec. 709), float32; masks are (height, width), bool. What takes long
runs on all cores, or as many as the environment's variable ``RAYON_NUM_THREADS`` says, without the interpreter's lock.
"""

from . import brdf
from ._native import (
    Asset,
    Camera,
    Capture,
    CheckError,
    Encoded,
    Environment,
    Error,
    FormatError,
    InputError,
    LimitError,
    Mesh,
    Photograph,
    Photographs,
    PointLight,
    Reflectance,
    Rendering,
    UnsupportedError,
    View,
    __version__,
    check,
    encode,
    open,
    read_image,
)

__all__ = [
    "Asset",
    "Camera",
    "Capture",
    "CheckError",
    "Encoded",
    "Environment",
    "Error",
    "FormatError",
    "InputError",
    "LimitError",
    "Mesh",
    "Photograph",
    "Photographs",
    "PointLight",
    "Reflectance",
    "Rendering",
    "UnsupportedError",
    "View",
    "__version__",
    "brdf",
    "check",
    "encode",
    "open",
    "read_image",
]
