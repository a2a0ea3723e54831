"""Collections of captures over a cluster: each capture is a task of Ray, and what is done stays done.

::

    import tsuya.ray

    rows = tsuya.ray.encode("s3://museum/captures/*", "s3://museum/objects", quality=75)

or ``python -m tsuya.ray CAPTURE ... --out OUT [--quality 75]``. Places are paths or whatever fsspec reads (``s3://``, ``gs://``, ``abfs://``). Needs
the packages ray, fsspec and pyarrow: ``pip install tsuya[ray]``.

A file is written whole or not at all, and beside it ``NAME.tsuya.json`` with the checksums of what it was made from and of itself. A run that finds both
as they should be leaves that capture alone, so that a run that was interrupted goes on where it was, and one over a collection of which little has
changed takes little. Tasks whose worker is lost are tried again. The bytes are those of `tsuya.encode`, wherever they were made.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import logging
import os
import pathlib
import secrets
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import fsspec
import fsspec.implementations.local
import pyarrow
import pyarrow.parquet
import ray

import tsuya

__all__ = ["encode", "SCHEMA"]

#: How names of files begin that are not whole yet, and when they are taken for forgotten.
TEMPORARY = ".tsuya-"
STALE_SECONDS = 24 * 3600

#: Columns of the catalogue, one row for each capture.
SCHEMA = pyarrow.schema(
    [
        ("name", pyarrow.string()),
        ("capture", pyarrow.string()),
        ("file", pyarrow.string()),
        ("bytes", pyarrow.int64()),
        ("sha256", pyarrow.string()),
        ("views", pyarrow.int32()),
        ("psnr_sum", pyarrow.float64()),
        ("psnr_diffuse", pyarrow.float64()),
        ("psnr_specular", pyarrow.float64()),
        ("coverage", pyarrow.float64()),
        ("title", pyarrow.string()),
        ("warnings", pyarrow.list_(pyarrow.string())),
        ("error", pyarrow.string()),
        ("resumed", pyarrow.bool_()),
        ("seconds", pyarrow.float64()),
        ("thumbnail", pyarrow.binary()),
    ]
)


def encode(
    captures: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    resume: bool = True,
    retries: int = 3,
    cpus: int = 1,
    catalogue: str | None = "catalogue.parquet",
    progress: Callable[[int, int, dict[str, Any]], None] | None = None,
    storage: Mapping[str, Any] | None = None,
    **options: Any,
) -> list[dict[str, Any]]:
    """Encodes captures into the folder ``out``, each as NAME.tsuya, where NAME is that of the capture's folder.

    ``captures`` are places, or one place with wildcards (``captures/*``). ``options`` are those of `tsuya.encode`. ``cpus`` are the processors, and
    threads, of a task. ``retries`` says how often a task is tried again whose worker was lost. ``progress(done, total, row)`` is called after each
    capture. ``storage`` are fsspec's options for both places. With ``resume`` captures whose file is there and right are left alone.

    Returns the rows of the catalogue, in the order of the captures; ``out/catalogue.parquet`` has them with a thumbnail each. A capture that can't be
    encoded has its ``error`` there and stops no other one. Connects to the cluster that the process is connected to, else to that of ``RAY_ADDRESS``,
    else to one of this machine.
    """
    storage = dict(storage or {})
    places = _expand(captures, storage)
    names = [_name(place) for place in places]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"two captures have one name, and so would their files: {', '.join(sorted(twice))}")
    if cpus < 1 or retries < 0:
        raise ValueError("cpus is 1 or more, retries is 0 or more")
    out_fs, out_path = fsspec.core.url_to_fs(os.fspath(out), **storage)
    out_fs.makedirs(out_path, exist_ok=True)
    # What runs left that ended long ago.
    _sweep(out_fs, out_path, f"{TEMPORARY}*", STALE_SECONDS)
    run = secrets.token_hex(8)
    if not ray.is_initialized():
        ray.init(log_to_driver=False, include_dashboard=False, logging_level=logging.ERROR)
    # The pool of threads is as large as the task.
    task = ray.remote(_encode_one).options(
        num_cpus=cpus, max_retries=retries, runtime_env={"env_vars": {"RAYON_NUM_THREADS": str(cpus)}}
    )
    window = max(4, 2 * int(ray.cluster_resources().get("CPU", 1)))
    rows: list[dict[str, Any] | None] = [None] * len(places)
    waiting = list(range(len(places)))[::-1]
    running: dict[Any, int] = {}
    done = 0
    try:
        while waiting or running:
            while waiting and len(running) < window:
                index = waiting.pop()
                arguments = (places[index], names[index], os.fspath(out), options, storage, resume, run)
                running[task.remote(*arguments)] = index
            for reference in ray.wait(list(running), num_returns=1)[0]:
                index = running.pop(reference)
                try:
                    row = ray.get(reference)
                except (ray.exceptions.RayTaskError, ray.exceptions.RaySystemError, ray.exceptions.WorkerCrashedError) as error:
                    row = _row(names[index], places[index], error=str(error))
                rows[index] = row
                done += 1
                if progress is not None:
                    progress(done, len(places), row)
    finally:
        for reference in running:
            ray.cancel(reference, force=True)
        if running:
            ray.wait(list(running), num_returns=len(running), timeout=30)
            _sweep(out_fs, out_path, f"{TEMPORARY}{run}-*", 0)
        finished = [row for row in rows if row is not None]
        if catalogue is not None and finished:
            table = pyarrow.Table.from_pylist(finished, schema=SCHEMA)
            buffer = io.BytesIO()
            pyarrow.parquet.write_table(table, buffer)
            _put(out_fs, f"{out_path}/{catalogue}", buffer.getvalue(), run)
    return finished


def _expand(captures, storage) -> list[str]:
    """Places of captures, wildcards expanded."""
    given = [captures] if isinstance(captures, (str, os.PathLike)) else list(captures)
    places = []
    for place in [os.fspath(place) for place in given]:
        if not any(letter in place for letter in "*?["):
            places.append(place)
            continue
        fs, path = fsspec.core.url_to_fs(place, **storage)
        found = sorted(match for match in fs.glob(path) if fs.isdir(match))
        if not found:
            raise ValueError(f"{place}: no folder matches")
        places += [fs.unstrip_protocol(match) for match in found]
    if not places:
        raise ValueError("no capture was given")
    return places


def _name(place: str) -> str:
    """What a capture's file is called: as its folder, or as the file that describes it."""
    path = pathlib.PurePosixPath(place.replace("\\", "/").rstrip("/"))
    return path.parent.name if path.name == "transforms.json" else path.stem if path.suffix in (".xml", ".json", ".csv", ".sfm") else path.name


def _is_local(fs) -> bool:
    return isinstance(fs, fsspec.implementations.local.LocalFileSystem)


def _put(fs, path: str, data: bytes, run: str) -> None:
    """Writes a file, whole or not at all."""
    if not _is_local(fs):
        # An object is there when all of it has arrived.
        fs.pipe_file(path, data)
        return
    folder, name = os.path.split(path)
    # A task that is tried again writes over what the lost one left.
    temporary = os.path.join(folder, f"{TEMPORARY}{run}-{name}")
    with open(temporary, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


def _sweep(fs, path: str, pattern: str, age: float) -> None:
    """Removes files of a name that are so many seconds old."""
    if not _is_local(fs):
        return
    for file in pathlib.Path(path).glob(pattern):
        with contextlib.suppress(OSError):
            if time.time() - file.stat().st_mtime >= age:
                file.unlink()


def _fingerprint(fs, path: str, options: Mapping[str, Any]) -> str:
    """What a file depends on: the capture's files (their content, or the checksum that their store has of it), the options, this version."""
    digest = hashlib.sha256(json.dumps([tsuya.__version__, options], sort_keys=True, default=str).encode())
    root = path.rstrip("/")
    files = sorted(fs.find(root)) if fs.isdir(root) else [root]
    for file in files:
        digest.update(b"\0" + file[len(root) :].encode() + b"\0")
        if _is_local(fs):
            with open(file, "rb") as content:
                digest.update(hashlib.file_digest(content, "sha256").digest() if hasattr(hashlib, "file_digest") else hashlib.sha256(content.read()).digest())
        else:
            digest.update(str(fs.checksum(file)).encode())
    return digest.hexdigest()


def _row(name: str, capture: str, **known: Any) -> dict[str, Any]:
    row = dict.fromkeys(SCHEMA.names)
    row.update(name=name, capture=capture, warnings=[], resumed=False)
    row.update(known)
    return row


def _encode_one(capture: str, name: str, out: str, options: dict, storage: dict, resume: bool, run: str) -> dict[str, Any]:
    """A task: encodes a capture, unless its file is there and right; the row of the catalogue."""
    begun = time.monotonic()
    fs, path = fsspec.core.url_to_fs(capture, **storage)
    out_fs, out_path = fsspec.core.url_to_fs(out, **storage)
    target = f"{out_path}/{name}.tsuya"
    try:
        made_from = _fingerprint(fs, path, options)
        if resume and out_fs.exists(target) and out_fs.exists(target + ".json"):
            record = json.loads(out_fs.cat_file(target + ".json"))
            data = out_fs.cat_file(target)
            if record.get("made_from") == made_from and hashlib.sha256(data).hexdigest() == record["row"]["sha256"]:
                return _row(name, capture, **record["row"], resumed=True, thumbnail=tsuya.open(data).thumbnail)
        with tempfile.TemporaryDirectory() as work:
            local = path
            if not _is_local(fs):
                local = os.path.join(work, name)
                fs.get(path, local, recursive=True)
            encoded = tsuya.encode(local, **options)
        asset = tsuya.open(encoded.data)
        figures = {
            "file": out_fs.unstrip_protocol(target),
            "bytes": len(encoded.data),
            "sha256": hashlib.sha256(encoded.data).hexdigest(),
            "views": len(asset),
            "psnr_sum": encoded.psnr.get("sum"),
            "psnr_diffuse": encoded.psnr.get("diffuse"),
            "psnr_specular": encoded.psnr.get("specular"),
            "coverage": encoded.coverage,
            "title": asset.metadata.get("title"),
            "warnings": encoded.warnings,
        }
        _put(out_fs, target, encoded.data, run)
        # After the file: a record says that the file is there.
        _put(out_fs, target + ".json", json.dumps({"made_from": made_from, "row": figures}, indent=1).encode(), run)
        return _row(name, capture, **figures, seconds=time.monotonic() - begun, thumbnail=asset.thumbnail)
    except (tsuya.Error, ValueError, OSError) as error:
        return _row(name, capture, error=f"{type(error).__name__}: {error}", seconds=time.monotonic() - begun)


def main(arguments: list[str] | None = None) -> int:
    """``python -m tsuya.ray``: exit code 1 where a capture could not be encoded."""
    parser = argparse.ArgumentParser(prog="python -m tsuya.ray", description="Encodes collections of captures over a cluster of Ray.")
    parser.add_argument("captures", nargs="+", help="folders, or whatever fsspec reads; * expands")
    parser.add_argument("--out", required=True, help="folder of the files and their catalogue")
    parser.add_argument("--quality", type=float)
    parser.add_argument("--psnr", type=float)
    parser.add_argument("--cpus", type=int, default=1, help="processors of a task")
    parser.add_argument("--again", action="store_true", help="encodes also what is there and right")
    given = parser.parse_args(arguments)

    def tell(done, total, row):
        what = row["error"] or f"{row['bytes']} bytes, {row['psnr_sum'] or float('inf'):.2f} dB{', was there' if row['resumed'] else ''}"
        print(f"[{done}/{total}] {row['name']}: {what}", file=sys.stderr)

    options = {key: value for key, value in (("quality", given.quality), ("psnr", given.psnr)) if value is not None}
    # Places that are given apart, each of which may have wildcards.
    captures = [place for pattern in given.captures for place in _expand(pattern, {})]
    rows = encode(captures, given.out, cpus=given.cpus, resume=not given.again, progress=tell, **options)
    return int(any(row["error"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
