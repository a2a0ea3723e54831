"""Writes all photographs of a file, small and in rows, as one picture: contact_sheet.py FILE.tsuya OUT.ppm"""

import sys

import numpy as np

import tsuya


def to_srgb(radiance, white):
    """Linear radiance as 8-bit sRGB; the white board is the brightest."""
    linear = np.clip(radiance / white, 0, 1)
    return np.uint8(255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055) + 0.5)


def contact_sheet(asset, columns=6, reduction=1):
    """The photographs in rows of so many, (height, width, 3), uint8."""
    small = {photograph.index: photograph.radiance for photograph in asset.photographs(reduction=reduction)}
    height, width = (max(image.shape[axis] for image in small.values()) for axis in (0, 1))
    rows = -(-len(asset.views) // columns)
    sheet = np.zeros((rows * height, columns * width, 3), np.uint8)
    for index, radiance in small.items():
        top, left = index // columns * height, index % columns * width
        sheet[top : top + radiance.shape[0], left : left + radiance.shape[1]] = to_srgb(radiance, asset.white)
    return sheet


if __name__ == "__main__":
    sheet = contact_sheet(tsuya.open(sys.argv[1]))
    with open(sys.argv[2], "wb") as file:
        file.write(b"P6 %d %d 255\n" % (sheet.shape[1], sheet.shape[0]) + sheet.tobytes())
    print(f"{sys.argv[2]}: {sheet.shape[1]} x {sheet.shape[0]}")
