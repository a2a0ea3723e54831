"""Collections over a cluster of this machine: the bytes of one process, whatever is lost on the way.

Needs ray, fsspec and pyarrow, and for a store of objects s3fs and moto; says what is left out.
"""

import contextlib
import hashlib
import importlib.util
import logging
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import unittest

import tsuya

ROOT = pathlib.Path(__file__).resolve().parents[3]
SAMPLES = ROOT / "tests/data"
NAMES = ("dome", "lens", "sizes", "unpolarised")
OPTIONS = {"quality": 60, "refine": "none"}
missing = [name for name in ("ray", "fsspec", "pyarrow") if importlib.util.find_spec(name) is None]
without_store = [name for name in ("s3fs", "moto") if importlib.util.find_spec(name) is None]


@unittest.skipIf(missing, f"needs {', '.join(missing)}")
class Collection(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        import ray

        import tsuya.ray

        try:
            ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
        except (OSError, RuntimeError, TimeoutError, ray.exceptions.RayError) as error:
            raise unittest.SkipTest(f"no cluster can be started here: {error}") from error
        cls.expected = {name: tsuya.encode(SAMPLES / name, **OPTIONS).data for name in NAMES}

    @classmethod
    def tearDownClass(cls):
        import ray

        ray.shutdown()

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.captures, self.out = self.folder / "captures", self.folder / "out"
        for name in NAMES:
            shutil.copytree(SAMPLES / name, self.captures / name)

    def check(self, rows, resumed=()):
        """All files are those of one process, and none is half-written."""
        for row in rows:
            self.assertIsNone(row["error"], row)
            data = (self.out / f"{row['name']}.tsuya").read_bytes()
            self.assertEqual(data, self.expected[row["name"]], row["name"])
            self.assertEqual((row["sha256"], row["bytes"]), (hashlib.sha256(data).hexdigest(), len(data)))
            self.assertEqual(row["resumed"], row["name"] in resumed, row["name"])
        self.assertFalse([path.name for path in self.out.iterdir() if path.name.startswith(".")])

    def test_a_collection_is_what_one_process_makes(self):
        import pyarrow.parquet

        (self.captures / "broken").mkdir()
        seen = []
        rows = tsuya.ray.encode(
            str(self.captures / "*"), self.out, progress=lambda done, total, row: seen.append((done, total)), **OPTIONS
        )
        self.assertEqual([row["name"] for row in rows], sorted([*NAMES, "broken"]))
        self.assertEqual(seen, [(k + 1, len(rows)) for k in range(len(rows))])
        broken = next(row for row in rows if row["name"] == "broken")
        self.assertIn("InputError", broken["error"])
        self.check([row for row in rows if row is not broken])
        table = pyarrow.parquet.read_table(self.out / "catalogue.parquet")
        self.assertEqual(table.schema.names, tsuya.ray.SCHEMA.names)
        catalogue = {row["name"]: row for row in table.to_pylist()}
        self.assertEqual(catalogue["dome"]["views"], len(tsuya.open(self.expected["dome"])))
        self.assertTrue(catalogue["dome"]["thumbnail"].startswith(b"\x89PNG"))
        self.assertGreater(catalogue["dome"]["psnr_sum"], 30)
        with self.assertRaisesRegex(ValueError, "one name"):
            tsuya.ray.encode([self.captures / "dome", SAMPLES / "dome"], self.out)
        with self.assertRaisesRegex(ValueError, "no folder"):
            tsuya.ray.encode(str(self.folder / "none*"), self.out)

    def test_what_is_there_and_right_is_left_alone(self):
        self.check(tsuya.ray.encode(str(self.captures / "*"), self.out, **OPTIONS))
        stamps = {name: (self.out / f"{name}.tsuya").stat().st_mtime_ns for name in NAMES}
        # One is gone, one is damaged, one was made from something else.
        (self.out / "dome.tsuya").unlink()
        damaged = bytearray(self.expected["lens"])
        damaged[len(damaged) // 2] ^= 1
        (self.out / "lens.tsuya").write_bytes(damaged)
        (self.captures / "sizes/note.txt").write_text("new")
        self.check(tsuya.ray.encode(str(self.captures / "*"), self.out, **OPTIONS), resumed=("unpolarised",))
        self.assertEqual((self.out / "unpolarised.tsuya").stat().st_mtime_ns, stamps["unpolarised"])
        # Other options are another file.
        (row,) = tsuya.ray.encode(self.captures / "unpolarised", self.out, quality=50)
        self.assertFalse(row["resumed"])
        self.assertLess(row["bytes"], len(self.expected["unpolarised"]))

    def test_a_lost_worker_loses_nothing(self):
        killed = []

        def kill():
            # Some of the workers, while they work.
            until = time.monotonic() + 60
            while len(killed) < 2 and time.monotonic() < until:
                found = subprocess.run(["pgrep", "-f", "ray::_encode_one"], capture_output=True, text=True, check=False).stdout.split()
                for process in set(map(int, found)) - {pid for pid, _ in killed}:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(process, signal.SIGKILL)
                        killed.append((process, time.monotonic()))
                        break
                time.sleep(0.05)

        thread = threading.Thread(target=kill)
        thread.start()
        rows = tsuya.ray.encode(str(self.captures / "*"), self.out, **OPTIONS)
        thread.join()
        self.assertEqual(len(killed), 2)
        self.assertEqual(len(rows), len(NAMES))
        self.check(rows)

    def test_an_interrupted_run_goes_on(self):
        class Enough(Exception):
            pass

        def stop(done, total, row):
            if done == 2:
                raise Enough

        with self.assertRaises(Enough):
            tsuya.ray.encode(str(self.captures / "*"), self.out, progress=stop, **OPTIONS)
        before = {path.stem for path in self.out.glob("*.tsuya") if path.with_suffix(".tsuya.json").exists()}
        self.assertGreaterEqual(len(before), 2)
        rows = tsuya.ray.encode(str(self.captures / "*"), self.out, **OPTIONS)
        self.check(rows, resumed={row["name"] for row in rows if row["resumed"]})
        self.assertLessEqual(before, {row["name"] for row in rows if row["resumed"]})
        self.assertEqual(tsuya.ray.main([str(self.captures / "*"), "--out", str(self.out), "--quality", "60"]), 0)

    @unittest.skipIf(without_store, f"needs {', '.join(without_store)}")
    def test_captures_and_files_of_a_store_of_objects(self):
        import s3fs
        from moto.server import ThreadedMotoServer

        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        server = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
        server.start()
        self.addCleanup(server.stop)
        host, port = server.get_host_and_port()
        storage = {"key": "none", "secret": "none", "client_kwargs": {"endpoint_url": f"http://{host}:{port}"}}
        store = s3fs.S3FileSystem(**storage)
        store.mkdir("museum")
        for name in ("lens", "unpolarised"):
            store.put(str(SAMPLES / name), f"museum/captures/{name}", recursive=True)
        for resumed in (False, True):
            rows = tsuya.ray.encode("s3://museum/captures/*", "s3://museum/objects", storage=storage, **OPTIONS)
            self.assertEqual([(row["name"], row["error"], row["resumed"]) for row in rows], [("lens", None, resumed), ("unpolarised", None, resumed)])
        store.invalidate_cache()
        for name in ("lens", "unpolarised"):
            self.assertEqual(store.cat_file(f"museum/objects/{name}.tsuya"), self.expected[name])
        self.assertTrue(store.exists("museum/objects/catalogue.parquet"))


if __name__ == "__main__":
    unittest.main()
