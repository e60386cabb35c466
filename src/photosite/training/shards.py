"""Shards: a dataset in files of a folder, written by any number of processes, resumed after an interruption.

A shard appears whole or not at all, and its bytes depend on the dataset alone. A folder without `manifest.json` is
incomplete: the same call writes the shards that are missing.
"""

from __future__ import annotations

import io
import json
import re
import tarfile
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any, Literal, SupportsIndex

import numpy as np

from photosite.engine.workers import run_tasks
from photosite.errors import FileError, InputError, message_of, printable
from photosite.files.hdf5 import create_hdf5, open_hdf5
from photosite.files.small_files import read_json_object
from photosite.files.writing import FolderLock, atomic_path, is_temporary, remove_abandoned
from photosite.training.card import card_text
from photosite.training.dataset import PairDataset, item_number
from photosite.training.digest import sha256_of
from photosite.training.pair import Pair
from photosite.values.choice import check_choice
from photosite.values.shown import Shown, clipped

ShardFormat = Literal["hdf5", "webdataset"]
Report = Callable[[int, int], object]

MANIFEST, PLAN, CARD = "manifest.json", "plan.json", "CARD.md"
FORMAT_NAME, FORMAT_VERSION = "photosite-pairs", 1
_SUFFIX = {"hdf5": ".h5", "webdataset": ".tar"}


@dataclass(frozen=True)
class _Plan:
    """What the shards of a folder depend on."""

    dataset: PairDataset
    folder: Path
    form: ShardFormat
    pairs_per_shard: int

    @property
    def count(self) -> int:
        return -(-len(self.dataset) // self.pairs_per_shard)

    def path(self, shard: int) -> Path:
        return self.folder / f"shard-{shard:06d}{_SUFFIX[self.form]}"

    def indices(self, shard: int) -> range:
        first = shard * self.pairs_per_shard
        return range(first, min(first + self.pairs_per_shard, len(self.dataset)))

    def write(self, shard: int) -> int:
        """Write a shard, and return its number."""
        pairs = (self.dataset[index] for index in self.indices(shard))
        with atomic_path(self.path(shard)) as temporary:
            (_write_hdf5 if self.form == "hdf5" else _write_tar)(temporary, pairs, len(self.indices(shard)))
        return shard

    @cached_property
    def description(self) -> dict[str, Any]:
        """All that the bytes of the shards depend on, as JSON holds it."""
        found = {
            "format": FORMAT_NAME,
            "version": FORMAT_VERSION,
            "photosite": version("photosite"),
            "shard_format": self.form,
            "pairs": len(self.dataset),
            "pairs_per_shard": self.pairs_per_shard,
            "dataset": self.dataset.describe(),
        }
        plain: dict[str, Any] = json.loads(json.dumps(found))
        return plain


def write_shards(
    dataset: PairDataset,
    folder: str | PathLike[str],
    *,
    shard_format: ShardFormat = "hdf5",
    pairs_per_shard: int = 64,
    processes: int | None = 1,
    scheduler: str | None = None,
    license: str = "",
    report: Report | None = None,
) -> Path:
    """Write a dataset to a folder of shards, with a manifest and a data card; return the manifest's path.

    A call with the same dataset goes on where another was interrupted, by whatever: shards that exist are kept. The
    files are the same as without interruption, and for any number of workers.

    Parameters
    ----------
    dataset
        The dataset.
    folder
        The folder; it is made if it is missing, and must otherwise be empty or begun by such a call.
    shard_format
        "hdf5": `clean` and `noisy` (pairs, rows, cols), and the metadata as JSON, a text for each pair. "webdataset":
        tar files with `INDEX.clean.npy`, `INDEX.noisy.npy` and `INDEX.json` for each pair.
    pairs_per_shard
        Pairs in a file; the last may have fewer.
    processes, scheduler
        Number of local processes (None: one for each core), or address of a Dask scheduler, whose workers must see the
        inputs and the folder under the same names. With several processes, scripts need `if __name__ == "__main__":`.
    license
        License of the inputs, for the card and the manifest; empty: not stated.
    report
        Called with the shards done, and of how many.

    Raises
    ------
    InputError
        If an argument is invalid, or there is no scheduler.
    FileError
        If the folder holds something else, such as another dataset, a shard has changed since the manifest was written,
        or is damaged where none was written, another process writes to the folder, or it cannot be written.
    WorkerError
        If a shard ends its workers.

    Examples
    --------
    >>> import tempfile
    >>> import photosite as ps
    >>> light = ps.training.Electrons([np.full((8, 8), 100.0)])
    >>> pairs = ps.training.PairDataset(light, ps.load_sensor("vendor-2.2um"), draws=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     manifest = write_shards(pairs, folder, pairs_per_shard=2)
    ...     sorted(path.name for path in manifest.parent.iterdir())
    ['CARD.md', 'manifest.json', 'plan.json', 'shard-000000.h5', 'shard-000001.h5', 'shard-000002.h5']
    """
    check_choice("shard_format", shard_format, ShardFormat)
    if isinstance(pairs_per_shard, bool) or not isinstance(pairs_per_shard, int) or pairs_per_shard < 1:
        raise InputError("pairs_per_shard", value=pairs_per_shard, expected="a whole number of 1 or more")
    plan = _Plan(dataset, Path(folder), shard_format, pairs_per_shard)
    is_new = not plan.folder.exists()
    try:
        plan.folder.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(folder, f"cannot be made: {message_of(error)}") from None
    lock = FolderLock(plan.folder)
    begun = False
    try:
        begun = _begin(plan)
        missing = [shard for shard in range(plan.count) if not plan.path(shard).exists()]
        written = run_tasks(plan.write, missing, processes=processes, scheduler=scheduler, name="shard {}".format)
        for done, _ in enumerate(written, 1):
            if report is not None:
                report(plan.count - len(missing) + done, plan.count)
        remove_abandoned(plan.folder)  # by workers that died
        return _finish(plan, license, written_now=frozenset(missing))
    except Exception:
        if begun:
            _take_back(plan)
        raise
    finally:
        lock.release()
        if is_new:
            with suppress(OSError):  # unless something was written
                plan.folder.rmdir()


def _begin(plan: _Plan) -> bool:
    """Check that a folder is empty or holds the beginning of the same dataset; remove what a killed process left.

    Return whether the plan was written now.
    """
    path = plan.folder / PLAN
    known = {PLAN, MANIFEST, CARD}
    remove_abandoned(plan.folder)
    for entry in plan.folder.iterdir():
        if not (entry.name in known or entry.name.startswith((".lock", "shard-")) or is_temporary(entry.name)):
            raise FileError(
                plan.folder, f"holds '{entry.name}', which is no part of a dataset", hint="Use another folder"
            )
    has_shards = any(entry.name.startswith("shard-") for entry in plan.folder.iterdir())
    if path.exists() and has_shards:
        begun = read_json(path)
        for name, there, here in _differences(begun, plan.description):
            if name == "pairs":
                continue  # a result of other settings
            hint = "Use another folder, or the settings and inputs that it was begun with"
            if name.endswith(".sha256"):
                what = f"was begun with other content of {_changed_input(begun, name)}"
                raise FileError(plan.folder, what, hint=hint)
            expected = f"{clipped(repr(there), 60)}, as in its {PLAN}"
            raise FileError(
                plan.folder, name.removeprefix("dataset.settings."), value=here, expected=expected, hint=hint
            )
        return False
    if has_shards:
        raise FileError(plan.folder, f"holds shards without {PLAN}", hint="Use another folder")
    _write_json(path, plan.description)
    return True


def _take_back(plan: _Plan) -> None:
    """Remove the plan of a folder that was begun now, if no shard was written."""
    with suppress(OSError):
        remove_abandoned(plan.folder)
        if not any(entry.name.startswith("shard-") for entry in plan.folder.iterdir()):
            (plan.folder / PLAN).unlink()


def _changed_input(begun: dict[str, Any], name: str) -> str:
    """Return the file or the array whose digest has a name such as `dataset.source.images[0].sha256`."""
    place: Any = begun
    for part in re.findall(r"[^.\[\]]+", name.removesuffix(".sha256")):
        place = place[int(part) if isinstance(place, list) else part]
    return str(place.get("file", name.removeprefix("dataset.").removesuffix(".sha256")))


def _differences(one: Any, other: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield name and values of each entry that differs; None for one that is missing."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in dict.fromkeys([*one, *other]):
            yield from _differences(one.get(key), other.get(key), f"{name}.{key}".lstrip("."))
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for number, pair in enumerate(zip(one, other, strict=True)):
            yield from _differences(*pair, f"{name}[{number}]")
    elif one != other:
        yield name, one, other


def _finish(plan: _Plan, license: str, written_now: Set[int]) -> Path:
    listed = read_json(plan.folder / MANIFEST).get("shards", []) if (plan.folder / MANIFEST).exists() else []
    before = {entry["file"]: entry for entry in listed}
    shards = []
    for shard in range(plan.count):
        path, indices = plan.path(shard), plan.indices(shard)
        entry = {"file": path.name, "first": indices.start, "pairs": len(indices)}
        shards.append({**entry, "bytes": path.stat().st_size, "sha256": sha256_of(path)})
        if shard in written_now:
            continue
        if path.name not in before:
            _check_last_pair(path, plan, indices)
        elif before[path.name] != shards[-1]:
            raise FileError(path, f"has changed since {MANIFEST} was written", hint=f"Remove the file. {_WRITE_AGAIN}")
    manifest = {**plan.description, "license_of_inputs": license or "not stated", "shards": shards}
    with atomic_path(plan.folder / CARD) as temporary:
        temporary.write_text(printable(card_text(manifest, plan.dataset)), encoding="utf-8")
    _write_json(plan.folder / MANIFEST, manifest)
    return plan.folder / MANIFEST


def _check_last_pair(path: Path, plan: _Plan, indices: range) -> None:
    """Raise `FileError` unless the last pair of a shard is that of the dataset, so that the file is whole."""
    hint = f"Remove the file. {_WRITE_AGAIN}"
    try:
        stored = _read_pair(path, plan.form, len(indices) - 1, indices[-1])
    except FileError as error:
        raise FileError(path, error.what, hint=hint) from None
    wanted = plan.dataset[indices[-1]]
    same = all(np.array_equal(one, other) for one, other in zip(stored[:2], wanted[:2], strict=True))
    if not same or stored.metadata != json.loads(json.dumps(wanted.metadata)):
        raise FileError(path, f"does not hold pair {indices[-1]} of this dataset", hint=hint)


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file."""
    return dict(read_json_object(path))


def _write_hdf5(path: Path, pairs: Iterator[Pair], count: int) -> None:
    with create_hdf5(path) as file:
        for number, pair in enumerate(pairs):
            if number == 0:
                shape = pair.clean.shape
                clean = file.create_dataset("clean", (count, *shape), pair.clean.dtype, chunks=(1, *shape))
                noisy = file.create_dataset("noisy", (count, *shape), pair.noisy.dtype, chunks=(1, *shape))
                texts = []
            clean[number], noisy[number] = pair.clean, pair.noisy
            texts.append(json.dumps(pair.metadata).encode())
        # Texts of one length need no heap.
        file.create_dataset("metadata", data=np.array(texts, dtype=f"S{max(map(len, texts))}"))


def _write_tar(path: Path, pairs: Iterator[Pair], count: int) -> None:
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
        for pair in pairs:
            name = f"{pair.metadata['index']:010d}"
            _add(tar, f"{name}.clean.npy", _npy(pair.clean))
            _add(tar, f"{name}.noisy.npy", _npy(pair.noisy))
            _add(tar, f"{name}.json", json.dumps(pair.metadata).encode())


def _npy(array: np.ndarray[Any, Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    return stream.getvalue()


def _add(tar: tarfile.TarFile, name: str, content: bytes) -> None:
    entry = tarfile.TarInfo(name)  # without the time, so that equal shards have equal bytes
    entry.size = len(content)
    tar.addfile(entry, io.BytesIO(content))


@dataclass(frozen=True, eq=False)
class ShardDataset(Shown):
    """The pairs in a folder of `write_shards`, as a map-style dataset.

    When an item of a shard is first read, size and SHA-256 of the shard are compared with the manifest, once in each
    process.

    Parameters
    ----------
    folder
        The folder.

    Raises
    ------
    FileError
        If the folder has no manifest, because it is incomplete or something else. An item raises it if its shard is
        missing, or is not the file that the manifest lists.

    Examples
    --------
    >>> import tempfile
    >>> import photosite as ps
    >>> light = ps.training.Electrons([np.full((8, 8), 100.0)])
    >>> pairs = ps.training.PairDataset(light, ps.load_sensor("vendor-2.2um"), draws=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = write_shards(pairs, folder, pairs_per_shard=2)
    ...     stored = ShardDataset(folder)
    ...     len(stored), bool((stored[4].noisy == pairs[4].noisy).all()), stored[4].metadata == pairs[4].metadata
    (5, True, True)
    """

    folder: str | PathLike[str]

    def __post_init__(self) -> None:
        path = Path(self.folder) / MANIFEST
        if not path.parent.is_dir():
            raise FileError(self.folder, "there is no such folder")
        if not path.exists():
            hint = "Complete the dataset by the call that began it"
            raise FileError(self.folder, f"has no {MANIFEST}", hint=hint)
        manifest = read_json(path)
        if manifest.get("format") != FORMAT_NAME or manifest.get("version") != FORMAT_VERSION:
            raise FileError(path, "is no manifest of this version of a dataset")
        object.__setattr__(self, "manifest", manifest)
        object.__setattr__(self, "_checked", set())

    def __len__(self) -> int:
        return int(self.manifest["pairs"])  # type: ignore[attr-defined]  # set in __post_init__

    def __getitem__(self, index: SupportsIndex) -> Pair:
        """Return an item; raise `IndexError` beyond the last."""
        number = item_number(index, len(self))
        manifest: dict[str, Any] = self.manifest  # type: ignore[attr-defined]  # set in __post_init__
        shard, place = divmod(number, manifest["pairs_per_shard"])
        path = Path(self.folder) / manifest["shards"][shard]["file"]
        checked: set[int] = self._checked  # type: ignore[attr-defined]  # set in __post_init__
        if shard not in checked:
            _check_shard(path, manifest["shards"][shard])
            checked.add(shard)
        return _read_pair(path, manifest["shard_format"], place, number)


def _read_pair(path: Path, shard_format: str, place: int, number: int) -> Pair:
    if shard_format == "hdf5":
        with open_hdf5(path) as found:
            clean, noisy = found.datasets["clean"][place], found.datasets["noisy"][place]
            return Pair(clean, noisy, json.loads(bytes(found.datasets["metadata"][place])))
    try:
        with tarfile.open(path) as tar:
            name = f"{number:010d}"
            parts = {kind: tar.extractfile(f"{name}.{kind}") for kind in ("clean.npy", "noisy.npy", "json")}
            content = {kind: b"" if part is None else part.read() for kind, part in parts.items()}
        clean, noisy = (np.load(io.BytesIO(content[f"{kind}.npy"]), allow_pickle=False) for kind in ("clean", "noisy"))
        return Pair(clean, noisy, json.loads(content["json"]))
    except (OSError, KeyError, ValueError, tarfile.TarError) as error:
        raise FileError(path, f"cannot be read: {message_of(error)}") from None


def _check_shard(path: Path, listed: Mapping[str, Any]) -> None:
    """Raise `FileError` unless a shard is the file that the manifest lists; the size is compared first."""
    try:
        size = path.stat().st_size
    except OSError as error:
        raise FileError(path, f"cannot be read: {message_of(error)}", hint=_WRITE_AGAIN) from None
    for name, found in (("bytes", lambda: size), ("sha256", lambda: sha256_of(path))):
        if (value := found()) != listed[name]:
            expected = f"{listed[name]}, as in {MANIFEST}"
            raise FileError(path, name, value=value, expected=expected, hint=f"Remove the file. {_WRITE_AGAIN}")


_WRITE_AGAIN = "The same call again writes the shards that are missing"
