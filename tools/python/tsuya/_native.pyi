from collections.abc import Iterable, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, Protocol, TypedDict, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path = str | PathLike[str]
_Vector = Sequence[float] | NDArray[Any]
_Matrix = Sequence[Sequence[float]] | NDArray[Any]
_Which = int | str | View
_Layer = Literal["diffuse", "specular", "model", "residual", "interreflection"]

class _Readable(Protocol):
    def read(self) -> bytes: ...

__all__ = [
    "Asset",
    "Camera",
    "Capture",
    "CheckError",
    "Encoded",
    "Environment",
    "Error",
    "Fit",
    "FormatError",
    "InputError",
    "LimitError",
    "Material",
    "Mesh",
    "Photograph",
    "Photographs",
    "PointLight",
    "Reflectance",
    "Rendering",
    "UnsupportedError",
    "View",
    "__version__",
    "check",
    "encode",
    "encode_materials",
    "fit_material",
    "open",
    "plan_measurements",
    "read_image",
    "read_material",
]

__version__: str

class Error(Exception): ...
class FormatError(Error): ...
class InputError(Error): ...
class LimitError(Error): ...
class UnsupportedError(Error): ...
class CheckError(Error): ...

def open(file: _Path | bytes | bytearray | memoryview | _Readable, *, memory_bytes: int | None = None) -> Asset: ...
def read_image(path: _Path, *, color_space: str = "srgb", memory_bytes: int | None = None) -> NDArray[np.float32]: ...
def check(
    capture: _Path,
    *,
    mesh: _Path | None = None,
    mesh_scale: float | None = None,
    color_space: str | None = None,
    invert_masks: bool = False,
    allow_outside: bool = False,
    memory_bytes: int | None = None,
) -> dict[str, Any]: ...
def encode(
    capture: _Path | Capture,
    *,
    quality: float | None = None,
    psnr: float | None = None,
    max_bytes: int | None = None,
    max_error: float | None = None,
    keep_percent: float | None = None,
    profile: Literal["predictive", "wavelet-texture"] = "predictive",
    decode_speed: Literal["automatic", "normal", "fast", "fastest"] = "automatic",
    specular: Literal["automatic", "torrance-sparrow", "dsbrdf", "ggx"] = "automatic",
    refine: Literal["automatic", "none", "surface"] = "automatic",
    hold_out: int | None = None,
    position_bits: int | None = None,
    light: Literal["camera", "environment"] | PointLight | _Vector | None = None,
    metadata: Mapping[str, Any] | None = None,
    check: bool = True,
    mesh: _Path | None = None,
    mesh_scale: float | None = None,
    beta: _Vector | None = None,
    color_space: str | None = None,
    invert_masks: bool = False,
    unchecked: bool = False,
    exif_exposure: bool = False,
    allow_outside: bool = False,
    memory_bytes: int | None = None,
) -> Encoded: ...

@final
class Camera:
    def __new__(
        cls, width: int, height: int, focal: _Vector, principal: _Vector, rotation: _Matrix, translation: _Vector
    ) -> Camera: ...
    @staticmethod
    def look_at(
        position: _Vector,
        target: _Vector,
        *,
        width: int,
        height: int,
        up: _Vector | None = None,
        fov: float = 35.0,
    ) -> Camera: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def focal(self) -> NDArray[np.float64]: ...
    @property
    def principal(self) -> NDArray[np.float64]: ...
    @property
    def rotation(self) -> NDArray[np.float64]: ...
    @property
    def translation(self) -> NDArray[np.float64]: ...
    @property
    def centre(self) -> NDArray[np.float64]: ...
    @property
    def matrix(self) -> NDArray[np.float64]: ...
    def resized(self, width: int, height: int) -> Camera: ...
    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def __getnewargs__(self) -> tuple[Any, ...]: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class PointLight:
    def __new__(cls, position: _Vector, intensity: _Vector) -> PointLight: ...
    @property
    def position(self) -> NDArray[np.float64]: ...
    @property
    def intensity(self) -> NDArray[np.float64]: ...
    def __getnewargs__(self) -> tuple[Any, ...]: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...

@final
class Environment:
    def __new__(cls, radiance: ArrayLike) -> Environment: ...
    @staticmethod
    def read(path: _Path, *, memory_bytes: int | None = None) -> Environment: ...
    def turned(self, *, scale: float = 1.0, degrees: float = 0.0) -> Environment: ...
    @property
    def radiance(self) -> NDArray[np.float32]: ...

@final
class Asset:
    @property
    def metadata(self) -> dict[str, Any]: ...
    @property
    def sections(self) -> dict[str, int]: ...
    @property
    def file_bytes(self) -> int: ...
    @property
    def components(self) -> tuple[str, ...]: ...
    @property
    def white(self) -> NDArray[np.float64]: ...
    @property
    def thumbnail(self) -> bytes | None: ...
    @property
    def views(self) -> tuple[View, ...]: ...
    def view(self, which: _Which) -> View: ...
    def photographs(
        self,
        views: Iterable[_Which] | None = None,
        *,
        reduction: int = 0,
        region: tuple[int, int, int, int] | None = None,
    ) -> Photographs: ...
    @property
    def mesh(self) -> Mesh: ...
    @property
    def render_mesh(self) -> Mesh: ...
    @property
    def reflectance(self) -> Reflectance | None: ...
    @property
    def materials(self) -> dict[str, Material]: ...
    @overload
    def render(
        self,
        camera: Camera,
        *,
        lights: Sequence[PointLight] | None = None,
        environment: Environment | None = None,
        layers: Sequence[_Layer] | None = None,
        shadows: bool = True,
        samples: int | None = None,
        capture_light: int = 0,
    ) -> Rendering: ...
    @overload
    def render(
        self,
        camera: Sequence[Camera],
        *,
        lights: Sequence[PointLight] | None = None,
        environment: Environment | None = None,
        layers: Sequence[_Layer] | None = None,
        shadows: bool = True,
        samples: int | None = None,
        capture_light: int = 0,
    ) -> list[Rendering]: ...
    def __len__(self) -> int: ...

@final
class View:
    @property
    def index(self) -> int: ...
    @property
    def name(self) -> str: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def light(self) -> PointLight | None: ...
    def photograph(
        self, *, reduction: int = 0, region: tuple[int, int, int, int] | None = None
    ) -> Photograph | None: ...

@final
class Photograph:
    @property
    def index(self) -> int: ...
    @property
    def name(self) -> str: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def mask(self) -> NDArray[np.bool_]: ...
    @property
    def components(self) -> dict[str, NDArray[np.float32]]: ...
    @property
    def radiance(self) -> NDArray[np.float32]: ...
    def __getitem__(self, component: str, /) -> NDArray[np.float32]: ...

@final
class Photographs:
    def __iter__(self) -> Iterator[Photograph]: ...
    def __next__(self) -> Photograph: ...

@final
class Mesh:
    @property
    def positions(self) -> NDArray[np.float32]: ...
    @property
    def triangles(self) -> NDArray[np.uint32]: ...
    @property
    def normals(self) -> NDArray[np.float32] | None: ...
    @property
    def tangents(self) -> NDArray[np.float32] | None: ...
    @property
    def texture_coordinates(self) -> NDArray[np.float32] | None: ...
    def to_trimesh(self) -> Any: ...

@final
class Reflectance:
    @property
    def relightable(self) -> bool: ...
    @property
    def diffuse(self) -> NDArray[np.float32]: ...
    @property
    def specular(self) -> NDArray[np.float32] | None: ...
    @property
    def sigma(self) -> NDArray[np.float32] | None: ...
    @property
    def lobes(self) -> NDArray[np.float32] | None: ...
    @property
    def lobe_roughness(self) -> NDArray[np.float64]: ...

@final
class Rendering:
    @property
    def radiance(self) -> NDArray[np.float32]: ...
    @property
    def coverage(self) -> NDArray[np.float32]: ...

@final
class Capture:
    def __new__(
        cls,
        positions: ArrayLike,
        triangles: ArrayLike,
        *,
        name: str = "capture",
        white: _Vector | None = None,
        beta: _Vector | None = None,
    ) -> Capture: ...
    def add(
        self,
        name: str,
        camera: Camera,
        photograph: ArrayLike,
        *,
        cross: ArrayLike | None = None,
        mask: ArrayLike | None = None,
        light: PointLight | None = None,
    ) -> None: ...
    def __len__(self) -> int: ...

@final
class Encoded:
    @property
    def data(self) -> bytes: ...
    @property
    def sections(self) -> dict[str, int]: ...
    @property
    def psnr(self) -> dict[str, float]: ...
    @property
    def coverage(self) -> float: ...
    @property
    def assumed_light(self) -> dict[str, Any] | None: ...
    @property
    def warnings(self) -> list[str]: ...
    def __len__(self) -> int: ...

_Measurements = tuple[ArrayLike, ArrayLike, ArrayLike]

class _Plan(TypedDict):
    incoming: NDArray[np.float64]
    outgoing: NDArray[np.float64]
    expected_log_rmse: float

@final
class Material:
    @staticmethod
    def classical(parameters: Mapping[str, Any], *, name: str = "material") -> Material: ...
    @property
    def name(self) -> str: ...
    @property
    def form(self) -> str: ...
    @property
    def coded_bytes(self) -> int | None: ...
    @property
    def parameters(self) -> dict[str, Any] | None: ...
    def evaluate(self, incoming: ArrayLike, outgoing: ArrayLike) -> NDArray[np.float64]: ...
    def albedo(self, degrees: float = 0.0) -> NDArray[np.float64]: ...

@final
class Fit:
    @property
    def material(self) -> Material: ...
    @property
    def log_rmse(self) -> float: ...
    @property
    def expected_log_rmse(self) -> float | None: ...
    @property
    def warnings(self) -> list[str]: ...

def read_material(path: _Path, *, memory_bytes: int | None = None) -> Material: ...
def fit_material(
    measured: Material | _Path | _Measurements,
    form: str = "compact",
    *,
    max_bytes: int = 256,
    noise: float | None = None,
    population: Sequence[Material] | None = None,
    name: str | None = None,
    memory_bytes: int | None = None,
) -> Fit: ...
def plan_measurements(
    population: Sequence[Material], count: int, *, method: Literal["optimal", "variance", "uniform"] = "optimal"
) -> _Plan: ...
def encode_materials(materials: Sequence[Material], *, metadata: Mapping[str, Any] | None = None) -> bytes: ...
