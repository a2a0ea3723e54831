"""The package beside the reference decoder and the program, whose figures are the same, and what it says of wrong input.

TSUYA_PROGRAM is the program, target/release/tsuya by default.
"""

import io
import json
import os
import pathlib
import pickle
import subprocess
import sys
import tempfile
import threading
import unittest

import numpy as np

import tsuya

ROOT = pathlib.Path(__file__).resolve().parents[3]
VECTORS = ROOT / "spec/vectors"
SAMPLES = ROOT / "tests/data"
PROGRAM = os.environ.get("TSUYA_PROGRAM", str(ROOT / "target/release/tsuya"))

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "examples"))
import contact_sheet  # noqa: E402
import made_capture  # noqa: E402
import to_mitsuba  # noqa: E402


def run(*arguments):
    """Standard output of the program."""
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def read_pfm(path):
    """A portable float map: little-endian, rows from the bottom."""
    with open(path, "rb") as file:
        assert file.readline() == b"PF\n"
        width, height = map(int, file.readline().split())
        assert float(file.readline()) == -1
        return np.frombuffer(file.read(), "<f4").reshape(height, width, 3)[::-1]


def write_hdr(path, mantissas, exponents):
    """A Radiance picture without run lengths: (height, width, 3) and (height, width), uint8."""
    height, width = exponents.shape
    with open(path, "wb") as file:
        file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width))
        file.write(np.dstack([mantissas, exponents]).astype(np.uint8).tobytes())


class Folder(unittest.TestCase):
    """Tests that write."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)


class Decoding(Folder):
    def test_arrays_are_those_of_the_reference_decoder(self):
        for name in ("ring-small", "ring-tiles", "ring-fastest", "ring-paper", "dome-surface", "sizes-small", "unpolarised-small"):
            file, view = VECTORS / f"{name}.tsuya", 1
            reference = [sys.executable, str(ROOT / "tools/reference/decode.py"), str(file), "--view", str(view)]
            subprocess.run([*reference, "-o", str(self.folder / name)], check=True, capture_output=True)
            asset = tsuya.open(file)
            photograph = asset.view(view).photograph()
            self.assertEqual(photograph.name, asset.views[view].name)
            self.assertEqual(tuple(photograph.components), asset.components)
            for component in asset.components:
                (path,) = (self.folder / name).glob(f"{view:03}-*-{component}.pfm")
                with self.subTest(name=name, component=component):
                    found = photograph[component]
                    self.assertEqual(found.dtype, np.float32)
                    np.testing.assert_array_equal(found, read_pfm(path))
                    self.assertFalse(found[~photograph.mask].any())
            lines = (self.folder / name / "mesh.obj").read_text().splitlines()
            vertices = np.array([line.split()[1:] for line in lines if line[0] == "v"], float)
            np.testing.assert_array_equal(asset.mesh.positions, vertices)
            for path in (self.folder / name).glob("reflectance-*.pfm"):
                found = getattr(asset.reflectance, path.stem.partition("-")[2], None)
                if found is not None and asset.reflectance.lobes is None:
                    expected = read_pfm(path)
                    np.testing.assert_array_equal(found, expected if found.ndim == 3 else expected[..., 0])

    def test_one_by_one_and_together_whole_and_in_part_agree(self):
        asset = tsuya.open(VECTORS / "ring-tiles.tsuya")
        together = {photograph.index: photograph for photograph in asset.photographs()}
        self.assertEqual(sorted(together), list(range(len(asset))))
        for view in asset.views:
            alone = view.photograph()
            np.testing.assert_array_equal(alone.radiance, together[view.index].radiance)
            np.testing.assert_array_equal(alone.mask, together[view.index].mask)
        whole, part = together[2], asset.view(2).photograph(region=(20, 30, 40, 25))
        np.testing.assert_array_equal(part.radiance, whole.radiance[30:55, 20:60])
        self.assertEqual((part.camera.width, part.camera.height), (40, 25))
        small = asset.view(2).photograph(reduction=1)
        self.assertEqual(small.radiance.shape[:2], tuple(-(-side // 2) for side in whole.radiance.shape[:2]))
        self.assertEqual([photograph.index for photograph in asset.photographs(k for k in (1,))], [1])
        for value in (whole.camera, asset.views[0].light):
            self.assertEqual(pickle.loads(pickle.dumps(value)), value)
        names = [photograph.name for photograph in asset.photographs([asset.views[0].name, -1])]
        self.assertEqual(sorted(names), sorted([asset.views[0].name, asset.views[-1].name]))

    def test_a_path_bytes_and_a_stream_are_one_file(self):
        path = VECTORS / "dome-small.tsuya"
        data = path.read_bytes()
        for given in (str(path), data, bytearray(data), memoryview(data), io.BytesIO(data)):
            asset = tsuya.open(given)
            self.assertEqual(asset.file_bytes, len(data))
            np.testing.assert_array_equal(asset.view(0).photograph().mask, tsuya.open(path).view(0).photograph().mask)
        info = json.loads(run("info", path, "--json"))
        self.assertEqual(asset.sections, {section["tag"]: section["bytes"] for section in info["sections"]})

    def test_photographs_that_nobody_waits_for_end(self):
        before = threading.active_count()
        photographs = iter(tsuya.open(VECTORS / "ring-small.tsuya").photographs())
        next(photographs)
        del photographs
        self.assertEqual(threading.active_count(), before)

    def test_the_mesh_to_draw_has_what_maps_need(self):
        asset = tsuya.open(VECTORS / "dome-surface.tsuya")
        mesh = asset.render_mesh
        self.assertGreater(len(mesh.triangles), len(asset.mesh.triangles))
        self.assertLess(mesh.triangles.max(), len(mesh.positions))
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
        self.assertTrue(((mesh.texture_coordinates >= 0) & (mesh.texture_coordinates <= 1)).all())
        self.assertEqual(asset.reflectance.lobes.shape[0], len(asset.reflectance.lobe_roughness))
        to_mitsuba.export(asset, self.folder)
        self.assertEqual(np.load(self.folder / "diffuse.npy").shape, asset.reflectance.diffuse.shape)
        sheet = contact_sheet.contact_sheet(asset, columns=4)
        self.assertTrue(sheet.any() and sheet.dtype == np.uint8)


class Images(Folder):
    def test_images_are_those_of_the_program(self):
        file = VECTORS / "dome-surface.tsuya"
        asset = tsuya.open(file)
        camera = asset.view(1).camera
        mantissas = np.arange(16 * 8 * 3).reshape(8, 16, 3) % 200 + 50
        write_hdr(self.folder / "sky.hdr", mantissas, np.full((8, 16), 129))
        sky = tsuya.Environment.read(self.folder / "sky.hdr")
        self.assertEqual(sky.radiance.shape, (8, 16, 3))
        lamp, other = tsuya.PointLight((1, 2, 3), (9, 8, 7)), tsuya.PointLight((-2, 1, 1), (4, 4, 4))
        place = np.array([*camera.centre * 1.2, 0, 0, 0])
        up = -np.sum([view.camera.rotation[1] for view in asset.views], axis=0)
        around = tsuya.Camera.look_at(place[:3], place[3:], width=camera.width, height=camera.height, up=up)
        cases = {
            "captured": ([], {}),
            "lamps": (["--light", "1,2,3,9,8,7", "--light", "-2,1,1,4"], {"lights": [lamp, other]}),
            "model": (["--layers", "diffuse,model"], {"layers": ["diffuse", "model"]}),
            "environment": (["--env", self.folder / "sky.hdr"], {"environment": sky}),
            "plain": (["--env", self.folder / "sky.hdr", "--no-shadows"], {"environment": sky, "shadows": False}),
        }
        for name, (arguments, keywords) in cases.items():
            for which, view in ((["--view", "1"], camera), (["--camera=" + ",".join(map(repr, map(float, place)))], around)):
                output = self.folder / f"{name}-{view is camera}.exr"
                run("render", file, "-o", output, *which, *arguments)
                with self.subTest(name=name, camera=which):
                    image = asset.render(view, **keywords)
                    np.testing.assert_array_equal(image.radiance, tsuya.read_image(output))
                    self.assertEqual(image.coverage.shape, image.radiance.shape[:2])
                    self.assertFalse(image.radiance[image.coverage == 0].any())
        first, second = asset.render([camera, around])
        np.testing.assert_array_equal(first.radiance, asset.render(camera).radiance)
        self.assertFalse(np.array_equal(first.radiance, second.radiance))

    def test_a_modelled_object_takes_lights(self):
        material = {"model": "blinn-phong", "exponent": 40, "diffuse": [0.4, 0.2, 0.1], "specular": [0.3, 0.3, 0.3]}
        file = self.folder / "made.tsuya"
        run("make", SAMPLES / "dome/scan.ply", "--material", json.dumps(material), "-o", file)
        asset = tsuya.open(file)
        self.assertEqual(([*asset.materials.values()][0].form, len(asset)), ("blinn-phong", 0))
        camera = tsuya.Camera.look_at((1, 2, 4), (0, 0, 0), width=48, height=32)
        run("render", file, "-o", self.folder / "lit.exr", "--camera=1,2,4,0,0,0", "--size", "48x32", "--light=1,2,3,9")
        with self.assertRaisesRegex(ValueError, "lights"):
            asset.render(camera)
        image = asset.render(camera, lights=[tsuya.PointLight((1, 2, 3), (9, 9, 9))])
        np.testing.assert_array_equal(image.radiance, tsuya.read_image(self.folder / "lit.exr"))
        self.assertTrue(image.radiance.any())

class Encoding(Folder):
    def test_the_bytes_are_those_of_the_program(self):
        for name, arguments, keywords in (
            ("unpolarised", ["--quality", "60"], {"quality": 60}),
            ("dome", ["--psnr", "36", "--refine", "none", "--title", "Dome"], {"psnr": 36, "refine": "none", "metadata": {"title": "Dome"}}),
            ("sizes", ["--profile", "wavelet-texture"], {"profile": "wavelet-texture"}),
        ):
            output = self.folder / f"{name}.tsuya"
            report = json.loads(run("encode", SAMPLES / name, "-o", output, "--json", *arguments))
            with self.subTest(name=name):
                encoded = tsuya.encode(SAMPLES / name, **keywords)
                self.assertEqual(encoded.data, output.read_bytes())
                self.assertEqual(encoded.warnings, report["warnings"])
                self.assertEqual(encoded.psnr["sum"], report["image_psnr_db"]["sum"])

    def test_a_capture_of_arrays_comes_back(self):
        made = made_capture.capture()
        with self.assertRaisesRegex(ValueError, "'000'"):
            made.add("000", tsuya.Camera.look_at((4, 1, 0), (0, 0, 0), width=8, height=8), np.zeros((8, 8, 3)))
        encoded = tsuya.encode(made, quality=85)
        asset = tsuya.open(encoded.data)
        self.assertEqual((len(asset), asset.components), (12, ("combined",)))
        squares = values = 0
        for photograph in asset.photographs():
            expected, mask = made_capture.photograph(asset.view(photograph.index).camera, asset.view(photograph.index).light)
            shown = photograph.mask & mask
            self.assertGreater(shown.sum(), 0.95 * mask.sum())
            signals = [np.sqrt(np.clip(image[shown], 0, None)) for image in (photograph.radiance, expected)]
            squares, values = squares + ((signals[0] - signals[1]) ** 2).sum(), values + signals[0].size
        measured = -10 * np.log10(squares / values)
        self.assertGreater(measured, 38)
        # The encoder's statement is of display values, mine is of the square root of radiance.
        self.assertLess(abs(measured - encoded.psnr["sum"]), 3)

    def test_other_threads_go_on(self):
        ticks, stop = [0], threading.Event()

        def tick():
            while not stop.wait(0.001):
                ticks[0] += 1

        thread = threading.Thread(target=tick)
        thread.start()
        tsuya.encode(SAMPLES / "unpolarised")
        stop.set()
        thread.join()
        self.assertGreater(ticks[0], 10)

    def test_checks_are_those_of_the_program(self):
        said = json.loads(run("check", SAMPLES / "dome", "--json"))
        found = tsuya.check(SAMPLES / "dome")
        self.assertTrue(found["agrees"])
        for key in found:
            self.assertEqual(found[key], said[key], key)


class Materials(Folder):
    def directions(self, count=60):
        """Pairs of unit vectors above the horizon."""
        random = np.random.default_rng(1)
        vectors = random.normal(size=(2, count, 3))
        vectors[..., 2] = np.abs(vectors[..., 2]) + 0.2
        return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)

    def test_a_material_is_fitted_written_and_read(self):
        model = {"diffuse": [0.3, 0.2, 0.1], "specular": [0.5, 0.5, 0.5], "lobe": {"model": "cook-torrance-ggx", "roughness": 0.2, "reflectance": 0.4}}
        material = tsuya.brdf.Material.classical(model, name="plastic")
        self.assertEqual((material.form, material.parameters["lobe"]), ("cook-torrance-ggx", model["lobe"]))
        incoming, outgoing = self.directions()
        values = material.evaluate(incoming, outgoing)
        np.testing.assert_allclose(values, material.evaluate(outgoing, incoming), rtol=1e-9)
        self.assertFalse(material.evaluate(-incoming, outgoing).any())
        fit = tsuya.brdf.fit((incoming, outgoing, values), "cook-torrance-ggx", name="again")
        self.assertLess(fit.log_rmse, 0.01)
        self.assertAlmostEqual(fit.material.parameters["lobe"]["roughness"], 0.2, 2)
        read = tsuya.open(tsuya.brdf.encode([material, fit.material], metadata={"title": "Two"}))
        self.assertEqual((list(read.materials), read.metadata["title"], len(read)), (["plastic", "again"], "Two", 0))
        np.testing.assert_allclose(read.materials["plastic"].evaluate(incoming, outgoing), values, rtol=1e-5)
        # The same values as text, by the program.
        rows = np.hstack([incoming, outgoing, values])
        np.savetxt(self.folder / "plastic.csv", rows, "%.17g", ",", header="wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,r,g,b", comments="")
        report = json.loads(run("brdf", "fit", self.folder / "plastic.csv", "--form", "compact", "--json"))
        of_text = tsuya.brdf.fit(self.folder / "plastic.csv")
        self.assertEqual((of_text.log_rmse, of_text.expected_log_rmse), (report["log_rmse_at_samples"], report["expected_log_rmse"]))
        self.assertEqual((of_text.material.name, of_text.material.coded_bytes), ("plastic", report["bytes"]))

    def test_what_to_measure_is_planned(self):
        def material(roughness):
            lobe = {"model": "cook-torrance-ggx", "roughness": roughness, "reflectance": 0.4}
            return tsuya.brdf.Material.classical({"diffuse": [0.1] * 3, "specular": [0.5] * 3, "lobe": lobe})

        population = [material(roughness) for roughness in (0.1, 0.2, 0.3, 0.5)]
        plan = tsuya.brdf.plan(population, 8)
        self.assertEqual((plan["incoming"].shape, plan["outgoing"].shape), ((8, 3), (8, 3)))
        np.testing.assert_allclose(np.linalg.norm(plan["incoming"], axis=1), 1, atol=1e-9)
        fewer = tsuya.brdf.plan(population, 4)["expected_log_rmse"]
        self.assertLess(plan["expected_log_rmse"], fewer)


class Faults(Folder):
    def test_each_fault_has_its_exception(self):
        file = VECTORS / "ring-small.tsuya"
        data = file.read_bytes()
        with self.assertRaises(FileNotFoundError) as caught:
            tsuya.open(self.folder / "none.tsuya")
        self.assertEqual(caught.exception.filename, str(self.folder / "none.tsuya"))
        damaged = bytearray(data)
        (coded,) = (section for section in json.loads(run("info", file, "--json"))["sections"] if section["tag"] == "PLAN")
        damaged[coded["offset"] + coded["bytes"] // 2] ^= 1
        for exception, pattern, act in (
            (tsuya.FormatError, "", lambda: tsuya.open(data[: len(data) // 2])),
            (tsuya.FormatError, "checksum|crc", lambda: [*tsuya.open(bytes(damaged)).photographs()]),
            (tsuya.LimitError, "limit", lambda: [*tsuya.open(file, memory_bytes=2 << 20).photographs()]),
            (tsuya.InputError, "", lambda: tsuya.encode(self.folder)),
            (FileNotFoundError, "", lambda: tsuya.encode(self.folder / "none")),
            (TypeError, "path", lambda: tsuya.open(3)),
            (IndexError, "99", lambda: tsuya.open(file).view(99)),
            (KeyError, "none", lambda: tsuya.open(file).view("none")),
            (KeyError, "none", lambda: tsuya.open(file).view(0).photograph()["none"]),
            (ValueError, "region", lambda: tsuya.open(file).view(0).photograph(region=(0, 0, 999, 9))),
            (ValueError, "reduction", lambda: tsuya.open(file).view(0).photograph(reduction=9)),
            (ValueError, "reduction", lambda: tsuya.open(file).photographs(reduction=-1)),
            (ValueError, "region", lambda: tsuya.open(file).view(0).photograph(region=(-1, 0, 5, 5))),
            (ValueError, "position_bits", lambda: tsuya.encode(SAMPLES / "unpolarised", position_bits=3)),
            (ValueError, "quality", lambda: tsuya.encode(SAMPLES / "dome", quality=50, psnr=40)),
            (ValueError, "hold_out", lambda: tsuya.encode(SAMPLES / "dome", hold_out=1)),
            (ValueError, "profile", lambda: tsuya.encode(SAMPLES / "dome", profile="none")),
            (ValueError, "layer", lambda: tsuya.open(file).render(tsuya.open(file).view(0).camera, layers=["none"])),
            (ValueError, "rotation", lambda: tsuya.Camera(8, 8, (8, 8), (4, 4), np.ones((3, 3)), (0, 0, 1))),
            (ValueError, "finite", lambda: tsuya.Camera(8, 8, (8, np.nan), (4, 4), np.eye(3), (0, 0, 1))),
            (ValueError, "fov", lambda: tsuya.Camera.look_at((0, 0, 1), (0, 0, 0), width=8, height=8, fov=0)),
            (ValueError, "shape", lambda: tsuya.Environment(np.ones((4, 8, 4)))),
            (ValueError, "not finite", lambda: tsuya.Environment(np.full((4, 8, 3), np.nan))),
            (ValueError, "no form", lambda: tsuya.brdf.fit(([[0, 0, 1]], [[0, 0, 1]], [[1, 1, 1]]), "none")),
            (ValueError, "horizon", lambda: tsuya.brdf.fit(([[0, 0, -1]], [[0, 0, 1]], [[1, 1, 1]]))),
            (ValueError, "no measured value", lambda: tsuya.brdf.fit((np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3))))),
        ):
            with self.subTest(exception=exception.__name__, pattern=pattern):
                with self.assertRaisesRegex(exception, pattern):
                    act()

    def test_arrays_that_do_not_fit_are_refused(self):
        corners, triangles = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
        camera = tsuya.Camera.look_at((0, 0, 3), (0, 0, 0), width=8, height=6)
        made = tsuya.Capture(corners, triangles, beta=(0.5, 0.5, 0.5))
        image, mask = np.ones((6, 8, 3)), np.ones((6, 8), bool)
        for pattern, act in (
            ("no photograph", lambda: tsuya.encode(made)),
            ("8 x 6", lambda: made.add("a", camera, np.ones((8, 6, 3)))),
            ("8 x 6", lambda: made.add("a", camera, image, cross=np.ones((6, 7, 3)))),
            ("mask", lambda: made.add("a", camera, image, mask=np.ones((5, 8), bool))),
            ("mask", lambda: made.add("a", camera, image, mask=~mask)),
            ("shape", lambda: made.add("a", camera, np.ones((6, 8, 4)))),
            ("vertices", lambda: tsuya.Capture(corners, [[0, 1, 3]])),
            ("vertices", lambda: tsuya.Capture(corners, [[0, 1, -1]])),
            ("triangle", lambda: tsuya.Capture(corners, [[0, 1, 1]])),
            ("finite", lambda: tsuya.Capture([[0, 0, np.inf], [1, 0, 0], [0, 1, 0]], triangles)),
            ("above 0", lambda: tsuya.Capture(corners, triangles, white=(0, 1, 1))),
        ):
            with self.subTest(pattern=pattern):
                with self.assertRaisesRegex(ValueError, pattern):
                    act()
        made.add("a", camera, image, cross=image / 4, mask=mask)
        with self.assertRaisesRegex(ValueError, "crossed"):
            made.add("b", camera, image)


if __name__ == "__main__":
    unittest.main()
