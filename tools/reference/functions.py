"""Functions of spec/README.md section 6."""

import math


def exponential(x):
    if x < -87:
        return 0.0
    x = min(x, 87.0)
    k = math.floor(x * float.fromhex("0x1.71547652b82fep0") + 0.5)
    r, s = x - k * float.fromhex("0x1.62e42fefa39efp-1"), 1.0
    for n in range(12, 0, -1):
        s = 1 + r * s * (1 / n)
    return s * 2.0**k


def squared_angle(c):
    y, s = min(max(1 - c, 0.0), 1.0), 1.0
    for n in range(24, 0, -1):
        s = 1 + y * s * (n * n / ((n + 1) * (2 * n + 1)))
    return 2 * y * s
