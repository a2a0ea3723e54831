"""Files of a capture, written byte by byte: EXR, PNG, PLY and transforms.json."""
import json
import struct
import zlib
from pathlib import Path

import numpy as np


def write_exr(path, picture):
    """Linear RGB as half floats, ZIP blocks of 16 scan lines (OpenEXR file layout, version 2)."""
    height, width, _ = picture.shape
    header = struct.pack("<II", 20000630, 2)

    def attribute(name, kind, value):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(value)) + value

    half = struct.pack("<IB3xII", 1, 0, 1, 1)
    channels = b"".join(name + b"\0" + half for name in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header += attribute("channels", "chlist", channels)
    header += attribute("compression", "compression", b"\3")
    header += attribute("dataWindow", "box2i", window)
    header += attribute("displayWindow", "box2i", window)
    header += attribute("lineOrder", "lineOrder", b"\0")
    header += attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1.0)) + b"\0"
    lines = np.asarray(picture, "<f2")[:, :, ::-1].transpose(0, 2, 1)
    blocks = []
    for top in range(0, height, 16):
        raw = np.frombuffer(lines[top:top + 16].tobytes(), np.uint8)
        # Low bytes before high ones, then differences; stored as they were where that is no larger.
        split = np.concatenate([raw[0::2], raw[1::2]]).astype(np.int16)
        steps = np.concatenate([split[:1], (split[1:] - split[:-1] + 128)]).astype(np.uint8)
        packed = zlib.compress(steps.tobytes(), 9)
        packed = packed if len(packed) < len(raw) else raw.tobytes()
        blocks.append(struct.pack("<iI", top, len(packed)) + packed)
    offset, table = len(header) + 8 * len(blocks), b""
    for block in blocks:
        table += struct.pack("<Q", offset)
        offset += len(block)
    save(path, header + table + b"".join(blocks))


def write_png(path, codes):
    """Grey, RGB or RGBA of 8 or 16 bits, by the array's shape and type."""
    kind = {2: 0, 3: 2 if codes.shape[-1] == 3 else 6}[codes.ndim]
    depth = 8 * codes.dtype.itemsize
    height, width = codes.shape[:2]
    rows = codes.astype(f">u{codes.dtype.itemsize}").reshape(height, -1)
    body = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    head = struct.pack(">2I5B", width, height, depth, kind, 0, 0, 0)
    content = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(body, 9)) + chunk(b"IEND", b"")
    save(path, b"\x89PNG\r\n\x1a\n" + content)


def write_mask(path, mask):
    """A mask as a grey PNG."""
    write_png(path, np.where(mask, 255, 0).astype(np.uint8))


def write_ply(path, mesh):
    """A mesh as binary PLY."""
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.positions)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    corners = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    corners["count"], corners["corners"] = 3, mesh.triangles
    save(path, "\n".join(head).encode() + mesh.positions.astype("<f4").tobytes() + corners.tobytes())


def write_transforms(folder, top, frames):
    """transforms.json, a frame a line."""
    lines = ",\n".join("  " + json.dumps(frame) for frame in frames)
    text = json.dumps(top, indent=1)[:-2] + ',\n "frames": [\n' + lines + "\n ]\n}\n"
    save(Path(folder) / "transforms.json", text.encode())


def rounded(values):
    """Numbers for a text file, a ten-billionth exact."""
    return np.round(np.asarray(values, float), 10).tolist()


def to_srgb(radiance, top=255):
    """sRGB codes (IEC 61966-2-1) of linear radiance."""
    linear = np.clip(radiance, 0.0, 1.0)
    bent = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(bent * top).astype(np.uint8 if top == 255 else np.uint16)


def save(path, content):
    """Writes a file and the folders that it lies in."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
