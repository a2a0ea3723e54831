#!/usr/bin/env python3
"""Checks the test vectors of spec/vectors against this decoder: python3 tools/reference/vectors.py spec/vectors"""

import glob
import json
import os
import sys
import tempfile

import numpy as np

import checksums
import container
import materials
import planes
from coefficients import Models
from coefficients import decode as decode_coefficients
from entropy import Average, Bit, Damaged, Mixer, Number, Range, States, Symbols
from geometry import Transform

single = np.float32


def cases(folder, name):
    with open(os.path.join(folder, name + ".json")) as file:
        return json.load(file)["cases"]


def singles(text):
    return np.frombuffer(bytes.fromhex(text), ">f4").astype(single)


def bits(values):
    return (np.asarray(values, single) + single(0)).view(np.uint32).ravel().tolist()


def mask(rows):
    return np.array([[c == "#" for c in row] for row in rows])


def entropy(case):
    kind, stream = case["kind"], bytes.fromhex(case["stream"])
    expected = case.get("values", case.get("bits"))
    if kind == "symbols":
        coder, model = States(stream), Symbols(case["slots"])
        for context, value, (count, extra) in zip(case["contexts"], expected, case["equiprobable"]):
            assert model.decode(coder, context) == value
            assert coder.equiprobable(count) == extra
        assert coder.ends_rightly()
        return
    coder = Range(stream)
    if kind == "bit":
        found = [coder.bit(p) for p in case["probabilities"]]
    elif kind == "mixer":
        model = Mixer(case["slots"], case["selectors"])
        found = [model.decode(coder, c[:8], c[8:]) for c in case["contexts"]]
    elif kind == "average":
        model = Average(case["slots"])
        found = [model.decode(coder, c) for c in case["contexts"]]
    else:
        model = Bit() if kind == "model" else Number()
        found = [model.signed(coder) if kind == "signed" else model.decode(coder) for _ in expected]
    assert found == expected, kind
    coder.end_mark()
    assert coder.ends_rightly(), kind


def coefficients(case):
    used = mask(case["mask"])
    transform = Transform(used)

    def part(name):
        if not case[name]:
            return None
        picture = np.zeros(used.shape + (3,), single)
        picture[used] = singles(case[name]).reshape(-1, 3)
        return transform.forward(picture)

    predicted, correction = part("predicted"), part("correction")
    direct = case["modelling"] == "direct"
    coder = (States if direct else Range)(bytes.fromhex(case["stream"]))
    step, shrink = singles(case["step"])[0], list(singles(case["shrink"]))
    found, _ = decode_coefficients(coder, Models(direct), transform.bands, step, shrink, predicted, correction)
    assert coder.ends_rightly()
    assert bits(transform.inverse(found)[used]) == bits(singles(case["picture"]))


def refused(case):
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "case.tsuya")
        with open(path, "wb") as file:
            file.write(bytes.fromhex(case["file"]))
        try:
            sections = container.read(path)
            sound = "VIEW" in sections or any(tag in sections for tag in ("vISB", "lIGt", "mATl"))
        except Damaged:
            sound = False
    assert sound == (case["kind"] == "sound"), case["why"]


def masks(case):
    coder = Range(bytes.fromhex(case["stream"]))
    found = planes.decode_mask(coder, planes.MaskModels(), mask(case["coverage"]))
    assert (found == mask(case["mask"])).all() and coder.ends_rightly()


def material(case):
    found = materials.decode(bytes.fromhex(case["section"]))[case["name"]]
    for i, o, expected in case["values"]:
        assert np.allclose(found.evaluate(i, o), expected, rtol=1e-9, atol=0), (case["name"], i, o)


CHECKS = {"entropy": entropy, "masks": masks, "planes": coefficients, "refused": refused, "materials": material, "models": material}


def main():
    folder, count = sys.argv[1], 0
    for name, check in CHECKS.items():
        for case in cases(folder, name):
            check(case)
            count += 1
    files = sorted(glob.glob(os.path.join(folder, "*.tsuya")))
    for path in files:
        with open(path[:-5] + "txt") as file:
            expected = file.read().splitlines()[1:]
        found = checksums.lines(path)
        assert found == expected, f"{path}: {[pair for pair in zip(expected, found) if pair[0] != pair[1]]}"
    print(f"{len(files)} golden files, {count} cases: the same")


if __name__ == "__main__":
    main()
