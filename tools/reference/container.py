"""Container and section VIEW, from spec/container.md."""

import math
import re
import struct
import zlib

from entropy import Bit, Damaged, Number, Range


KNOWN = ("mETA", "tHMB", "MESH", "VIEW", "CHRT", "DISP", "RFLC", "PLAN", "PAPR", "mATl", "bIND", "tCOR", "vISB", "lIGt")


def varint(data, at, shortest=False):
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            if shortest and byte == 0 and shift > 7:
                raise Damaged("a number longer than it needs to be")
            return value, at


def read(path):
    """Sections by tag, as stored, with their codec."""
    data = open(path, "rb").read()
    if len(data) < 20 or data[:8] != bytes.fromhex("E8545359 0D0A1A0A") or data[-4:] != bytes.fromhex("595354E8"):
        raise Damaged("not a whole tsuya file")
    if struct.unpack("<HH", data[8:12]) != (0, 1):
        raise Damaged("written by another version of the format")
    length = struct.unpack("<I", data[-8:-4])[0]
    start = len(data) - 8 - length
    directory = data[start : len(data) - 8]
    if zlib.crc32(data[:12] + directory[:-4]) != struct.unpack("<I", directory[-4:])[0] or directory[:4] != b"DRCT":
        raise Damaged("directory")
    count, at = varint(directory, 4, True)
    sections, offset = {}, 12
    for _ in range(count):
        first, tag, codec = at, directory[at : at + 4].decode("ascii"), directory[at + 4]
        if not tag.isalpha() or not tag[2].isupper() or codec > 2:
            raise Damaged(f"tag or codec of section {tag}")
        if tag in KNOWN and tag in sections or tag[0].isupper() and tag not in KNOWN:
            raise Damaged(f"a second section {tag}, or a critical one that nobody knows")
        stored, at = varint(directory, at + 5, True)
        if codec == 1:
            _, at = varint(directory, at, True)
        header, at = directory[first : at + 4], at + 4
        end = offset + len(header) + stored
        content = data[offset + len(header) : end]
        if data[offset : offset + len(header)] != header:
            raise Damaged(f"header of section {tag}")
        if zlib.crc32(header[:-4] + content) != struct.unpack("<I", header[-4:])[0]:
            raise Damaged(f"checksum of section {tag}")
        sections[tag] = (codec, content)
        offset = end
    if offset != start:
        raise Damaged("sections do not fill the file")
    return sections


class Camera:
    """Pinhole camera: rotation rows, translation, focal lengths, principal point, size."""


class View:
    """Name, camera, and light as (position, intensity) or None."""


def successor(name):
    runs = list(re.finditer(rb"[0-9]+", name))
    if not runs:
        return None
    run = runs[-1]
    digits = str(int(run.group()) + 1).encode().rjust(len(run.group()), b"0")
    return name[: run.start()] + digits + name[run.end() :]


def product(a, b):
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def normalised(q):
    w, x, y, z = q
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length < 0.5:
        raise Damaged("rotation")
    return (w / length, x / length, y / length, z / length)


def rotation_rows(q):
    w, x, y, z = q
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


class Views:
    """Section VIEW, section 6."""

    def __init__(self, data):
        if data[0] != 0:
            raise Damaged("version of VIEW")
        c = self.coder = Range(data[1:])
        self.white = [c.float() for _ in range(3)]
        small = Number()
        self.components = [small.decode(c) for _ in range(small.decode(c))]
        count = small.decode(c)
        self.R, self.L = small.signed(c), small.signed(c)
        self.follow, self.lag = small.decode(c), small.decode(c) + 1
        self.name = b""
        self.follows = [Bit(), Bit()]
        self.last_follows = 0
        self.name_numbers = [Number() for _ in range(3)]
        self.characters = [Bit() for _ in range(256)]
        self.intrinsics, self.intrinsics_bits, self.intrinsics_numbers = [], [Bit(), Bit()], [Number() for _ in range(3)]
        self.poses, self.same, self.last_same = [], [Bit(), Bit()], 0
        self.pose, self.pose_bits, self.pose_numbers = None, [Bit(), Bit()], [Number() for _ in range(7)]
        self.lights, self.light_bits, self.light_numbers = [], [Bit(), Bit()], [Number() for _ in range(4)]
        self.intensities = []
        self.views = [self.view() for _ in range(count)]
        c.end_mark()
        if not c.ends_rightly():
            raise Damaged("end of VIEW")

    def view(self):
        view = View()
        view.name = self.read_name().decode("utf-8")
        camera = view.camera = Camera()
        camera.width, camera.height, camera.focal, camera.principal = self.read_intrinsics()
        q, t = self.read_pose()
        camera.rotation = rotation_rows(q)
        camera.translation = [v * 2.0**-self.L for v in t]
        view.light = self.read_light(camera)
        return view

    def read_name(self):
        c, expected = self.coder, successor(self.name)
        if expected is not None:
            self.last_follows = self.follows[self.last_follows].decode(c)
            if self.last_follows:
                self.name = expected
                return self.name
        start, end, between = (n.decode(c) for n in self.name_numbers)
        middle = bytearray()
        for _ in range(between):
            node = 1
            for _ in range(8):
                node = node << 1 | self.characters[node].decode(c)
            middle.append(node & 255)
        self.name = self.name[:start] + bytes(middle) + self.name[len(self.name) - end :]
        return self.name

    def read_intrinsics(self):
        c = self.coder
        if not self.intrinsics_bits[0].decode(c):
            return self.intrinsics[-1 - self.intrinsics_numbers[0].decode(c)]
        width, height = self.intrinsics_numbers[1].decode(c), self.intrinsics_numbers[2].decode(c)
        equal = self.intrinsics_bits[1].decode(c)
        fx = c.float()
        fy = fx if equal else c.float()
        self.intrinsics.append((width, height, (fx, fy), (c.float(), c.float())))
        return self.intrinsics[-1]

    def read_pose(self):
        c = self.coder
        if self.poses:
            self.last_same = self.same[self.last_same].decode(c)
            if self.last_same:
                return self.pose
        q, t = ((1.0, 0.0, 0.0, 0.0), (0, 0, 0))
        if self.poses:
            q1, t1 = q, t = self.poses[-1]
        if len(self.poses) >= 2:
            q0, t0 = self.poses[-2]
            conjugate = (q0[0], -q0[1], -q0[2], -q0[3])
            if self.pose_bits[0].decode(c):
                q = product(product(q1, conjugate), q1)
            if self.pose_bits[1].decode(c):
                t = tuple(2 * b - a for a, b in zip(t0, t1))
        d = [n.signed(c) for n in self.pose_numbers[:4]]
        t = tuple(v + n.signed(c) for v, n in zip(t, self.pose_numbers[4:]))
        unit = 2.0**-self.R
        e = normalised(((d[0] + 2**self.R) * unit, d[1] * unit, d[2] * unit, d[3] * unit))
        self.pose = (normalised(product(q, e)), t)
        self.poses.append(self.pose)
        return self.pose

    def read_light(self, camera):
        c = self.coder
        if not self.light_bits[0].decode(c):
            return None
        before = (0, 0, 0)
        if self.lights:
            before = self.lights[-self.lag] if len(self.lights) >= self.lag else self.lights[-1]
        place = tuple(v + n.signed(c) for v, n in zip(before, self.light_numbers[:3]))
        self.lights.append(place)
        position = [v * 2.0**-self.L for v in place]
        if self.follow:
            u = [p - t for p, t in zip(position, camera.translation)]
            r = camera.rotation
            position = [r[0][i] * u[0] + r[1][i] * u[1] + r[2][i] * u[2] for i in range(3)]
        if self.light_bits[1].decode(c):
            self.intensities.append([c.float() for _ in range(3)])
        return position, self.intensities[-1 - self.light_numbers[3].decode(c)]
