"""Section PLAN, from spec/planes.md."""

import struct
import zlib

import numpy as np

import geometry
from container import varint
from entropy import Bit, Damaged, Mixer, Number, Range, States
from model import Model

single = np.float32


class Component:
    def __init__(self, data):
        self.step = single(struct.unpack("<f", data[:4])[0])
        self.shrink = [single(b / 256) for b in data[4:6]]
        self.signed, self.shaded = data[6] & 1, data[6] >> 1 & 1
        self.rotation = (np.array(struct.unpack("<9h", data[7:25])) / 16384).astype(single).reshape(3, 3)

    def colours(self, signal):
        m, y = self.rotation, signal
        return np.stack([m[0, k] * y[..., 0] + m[1, k] * y[..., 1] + m[2, k] * y[..., 2] for k in range(3)], -1)

    def radiance(self, signal, mask, white):
        s = self.colours(signal)
        if not self.signed:
            s = np.where(s > 0, s, single(0))
        return np.where(mask[..., None], s * np.abs(s) * np.array(white, single), single(0))


class Step:
    pass


class Tile:
    """A tile of a level at (x, y) of its grid; `streams` are its components'."""

    def __init__(self, level, x, y, streams):
        self.level, self.x, self.y, self.streams = level, x, y, streams


class Head:
    """Section 1."""

    def __init__(self, data, views, components):
        length, checksum = struct.unpack("<II", data[:8])
        head = data[8 : 8 + length]
        if zlib.crc32(head) != checksum:
            raise Damaged("head of PLAN")
        self.masks, self.level, self.direct = head[0] & 1, head[0] >> 1 & 3, head[0] >> 3 & 1
        self.modelled = head[0] >> 4 & 1
        at, self.tile_side = 1, None
        if self.level:
            at, self.tile_side = 2, 1 << head[1]
            if not 4 <= head[1] <= 12:
                raise Damaged("head of PLAN")
        if head[0] > 31 or head[at] != components:
            raise Damaged("head of PLAN")
        at += 1
        self.components = [Component(head[at + 25 * k : at + 25 + 25 * k]) for k in range(components)]
        count, at = varint(head, at + 25 * components)
        if count != len(views):
            raise Damaged("steps of PLAN")
        self.steps, offset = [], 8 + length
        for index in range(count):
            step = Step()
            step.view, at = varint(head, at)
            step.scale = head[at]
            back, at = varint(head, at + 1)
            step.parent = index - back if back else None
            step.references, references, at = [], head[at], at + 1
            for _ in range(references):
                back, at = varint(head, at)
                step.references.append((index - back, head[at]))
                at += 1

            def streams(count, always):
                nonlocal at, offset
                found, start = [], offset
                for _ in range(count):
                    size, at = varint(head, at)
                    found.append(data[offset : offset + size])
                    offset += size
                if always or offset > start:
                    if zlib.crc32(data[start:offset]) != struct.unpack("<I", head[at : at + 4])[0]:
                        raise Damaged("streams of a view")
                    at += 4
                return found

            step.streams = streams(components + 1, True)
            camera = views[step.view].camera
            levels = min(self.level, geometry.level_count(camera.width, camera.height))
            step.tiles = []
            for level in range(levels, 0, -1):
                columns, rows = (-(-size // (self.tile_side << level)) for size in (camera.width, camera.height))
                for y in range(rows):
                    for x in range(columns):
                        step.tiles.append(Tile(level, x, y, streams(components, False)))
            self.steps.append(step)
        if offset != len(data) or at != length:
            raise Damaged("length of PLAN")


class MaskModels:
    def __init__(self):
        self.mixer = Mixer([512, 1024, 1024, 1024, 512, 64, 256, 64], [16, 32])
        self.differs, self.plain = Bit(), [Bit(), Bit()]

    def copy(self):
        other = MaskModels.__new__(MaskModels)
        other.mixer, other.differs = self.mixer.copy(), self.differs.copy()
        other.plain = [b.copy() for b in self.plain]
        return other


CAUSAL = [(-1, 0), (0, -1), (-1, -1), (1, -1), (-2, 0), (0, -2), (-2, -1), (2, -1), (-1, -2), (1, -2)]
AROUND = [(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (2, 0), (0, 2), (3, 0)]


def decode_mask(coder, models, coverage):
    """Section 8."""
    height, width = coverage.shape
    covered = np.pad(coverage, 3).astype(int).tolist()
    out = [[0] * (width + 6) for _ in range(height + 6)]

    def bits(grid, offsets):
        value = 0
        for dx, dy in offsets:
            value = value << 1 | grid[y + dy][x + dx]
        return value

    for y in range(3, height + 3):
        differs = models.differs.decode(coder)
        for x in range(3, width + 3):
            causal, around = bits(out, CAUSAL), bits(covered, AROUND)
            if (causal, around) in ((0, 0), (1023, 1023)):
                side = around & 1
                out[y][x] = models.plain[side].decode(coder) if differs else side
                continue
            past = bits(covered, CAUSAL[:6])
            contexts = [
                (causal >> 6) * 32 + (around >> 5),
                causal,
                around,
                (causal >> 4) * 16 + (past >> 2),
                (causal >> 6) * 32 + (((causal >> 6) ^ (past >> 2)) & 15) * 2 + (around >> 9),
                (causal >> 4) & 63,
                (causal >> 6) * 16 + (past >> 2),
                ((causal ^ (past << 4)) >> 4) & 63,
            ]
            out[y][x] = models.mixer.decode(coder, contexts, [causal >> 6, around >> 5])
    return np.array(out, bool)[3:-3, 3:-3]


class Decoded:
    """What later steps need of one."""


class Planes:
    """The pictures of section PLAN; steps are decoded when they are asked for."""

    def __init__(self, sections, views, positions, triangles):
        from coefficients import Models, decode, decode_tile

        self.decode_coefficients, self.decode_tile, self.Models = decode, decode_tile, Models
        self.views, self.triangles = views, triangles
        self.positions = np.array(positions, np.float64).reshape(-1, 3)
        self.normals = geometry.vertex_normals(self.positions, triangles)
        self.head = Head(sections["PLAN"], views.views, len(views.components))
        self.model = Model(sections, views, positions, triangles) if self.head.modelled else None
        self.done = {}

    def view(self, view):
        """Mask and radiance of each component."""
        index = next(i for i, step in enumerate(self.head.steps) if step.view == view)
        result = self.step(index)
        pairs = zip(self.head.components, result.signals)
        return result.mask, [c.radiance(s, result.mask, self.views.white) for c, s in pairs]

    def step(self, index):
        if index not in self.done:
            self.done[index] = self.decode(self.head.steps[index])
        return self.done[index]

    def decode(self, step):
        """Section 2."""
        parent = None if step.parent is None else self.step(step.parent)
        references = [(self.step(index), share) for index, share in step.references]
        result, view = Decoded(), self.views.views[step.view]
        width, height = view.camera.width, view.camera.height
        level = min(self.head.level, geometry.level_count(width, height))
        camera = geometry.low_camera(view.camera, level)
        result.geometry = geometry.Geometry(camera, view.light, self.positions, self.triangles, self.normals)
        result.mask = geometry.enlarged(result.geometry.coverage, width, height, level)
        result.mask_models = parent.mask_models.copy() if parent else MaskModels()
        mask_coder = Range(step.streams[0])
        if self.head.masks:
            result.mask = decode_mask(mask_coder, result.mask_models, result.mask)
        if not mask_coder.ends_rightly():
            raise Damaged("end of a mask's stream")
        transform = geometry.Transform(result.mask)
        low = transform.masks[level]
        result.geometry.extend(low)
        found = [geometry.find(result.geometry, r.geometry, low) for r, _ in references]
        modelled = None
        if self.model and low.any():
            modelled = self.model.signals(result.geometry, low, self.head.components, level)
        result.models, result.signals, result.filled, result.modelled = [], [], [], []
        for k, component in enumerate(self.head.components):
            models = parent.models[k].copy() if parent else self.Models(self.head.direct)
            warped = predicted = correction = None
            if references:
                sources = [(r.filled[k], f, share) for (r, share), f in zip(references, found)]
                warped = geometry.predict(low, sources, component.shaded)
                predicted = transform.forward(warped, level)
            if modelled:
                other = warped
                sources = [(r.modelled[k], f, share) for (r, share), f in zip(references, found) if r.modelled]
                if component.shaded and sources:
                    other = geometry.predict(low, sources, True)
                correction = transform.forward(modelled[k] if other is None else modelled[k] - other, level)
            step_size = component.step * single(step.scale / 64)
            start = States if self.head.direct else Range
            coder = start(step.streams[k + 1])
            base = len(transform.bands) - 3 * level
            bands, magnitudes = self.decode_coefficients(
                coder, models, transform.bands[:base], step_size, component.shrink, predicted, correction
            )
            if not coder.ends_rightly():
                raise Damaged("end of a component's stream")
            for band in transform.bands[base:]:
                bands.append(np.zeros(band.mask.shape + (3,), single))
            done = {}
            for tile in step.tiles:
                above = done.get((tile.level + 1, tile.x // 2, tile.y // 2), (models, magnitudes[-3:], (0, 0)))
                first = len(bands) - 3 * tile.level
                coder = start(tile.streams[k])
                done[tile.level, tile.x, tile.y] = self.decode_tile(
                    coder,
                    transform.bands[first : first + 3],
                    bands[first : first + 3],
                    (tile.x * self.head.tile_side, tile.y * self.head.tile_side, self.head.tile_side),
                    above,
                    step_size,
                    component.shrink,
                )
                if not coder.ends_rightly():
                    raise Damaged("end of a tile's stream")
            lows = transform.lows(bands)
            filled, known = lows[level].copy(), low.copy()
            geometry.fill(known, filled, 4)
            if modelled:
                shown, known = modelled[k].copy(), low.copy()
                geometry.fill(known, shown, 4)
                result.modelled.append(shown)
            result.models.append(models)
            result.signals.append(lows[0])
            result.filled.append(filled)
        return result
