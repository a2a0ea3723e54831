"""Materials: measured ones are read and fitted, what to measure is planned, all are evaluated."""

from ._native import Fit, Material
from ._native import encode_materials as encode
from ._native import fit_material as fit
from ._native import plan_measurements as plan
from ._native import read_material as read

__all__ = ["Fit", "Material", "encode", "fit", "plan", "read"]
