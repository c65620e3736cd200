"""The checkpoints ``checkpoints/<episode>/`` of a run, written whole and checked before use."""

import hashlib
import re
import shutil
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from safetensors.numpy import save

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.runs.records import CHECKPOINTS_FOLDER
from orchid_uav.experiments.training.state import TrainingState
from orchid_uav.notices import reason_of
from orchid_uav.storage.files import json_bytes, read_sealed, sealed, sync_directory, sync_file
from orchid_uav.storage.tensors import TensorSpec, read_tensors

STATE_FILE = "state.json"
_SCHEMA = 1
_LARGEST_STATE = 64 * 2**20
_PLACE = re.compile(r"\.([0-9]+)\.old|([0-9]+)")
_LEFTOVER = re.compile(r"\.[0-9]+\.(new|old|gone)")

Specs = dict[str, dict[str, TensorSpec]]


class CheckpointStore:
    """The checkpoints of a run, at most ``keep`` of them.

    Args:
        run: the run's directory.
        run_id: the run's id, which every checkpoint names.
        keep: how many of the latest checkpoints are kept.
        former_ids: the run's earlier ids, which older checkpoints name.
    """

    def __init__(self, run: Path, run_id: str, keep: int, former_ids: Collection[str] = ()) -> None:
        self.folder = run / CHECKPOINTS_FOLDER
        self._run_id = run_id
        self._known_ids = (run_id, *former_ids)
        self._keep = keep

    def episodes(self) -> list[int]:
        """The episodes after which there is a checkpoint, latest first."""
        return sorted(self._places(), reverse=True)

    def _places(self) -> dict[int, Path]:
        """The folder of each; one may lie aside, left by a process that died while replacing it."""
        if self.folder.is_symlink():  # removing checkpoints would remove files elsewhere
            raise InputError(f"{self.folder} is a link, and old checkpoints in it would be removed")
        if not self.folder.is_dir():
            return {}
        places = {}
        for path in sorted(self.folder.iterdir()):  # those aside come first, with a "."
            name = _PLACE.fullmatch(path.name)
            if name and path.is_dir():
                places[int(name[1] or name[2])] = path
        return places

    def save(self, episode: int, state: TrainingState, log: tuple[int, str]) -> None:
        """Write a checkpoint, which appears in one step, and remove those beyond ``keep``.

        Args:
            episode: number of finished episodes.
            state: the state of the training.
            log: size and SHA-256 of ``episodes.csv``.

        Raises:
            OSError: the checkpoint cannot be written; the others are untouched.
        """
        if not self.folder.is_dir():
            self.folder.mkdir()
            sync_directory(self.folder.parent)
        self._remove_leftovers()
        unfinished = self.folder / f".{episode}.new"
        try:
            unfinished.mkdir()
            checksums = {}
            for name, tensors in state.tensors.items():
                content = save(tensors)
                checksums[name] = hashlib.sha256(content).hexdigest()
                _write(unfinished / _file(name), content)
            document = {
                "schema": _SCHEMA,
                "run": self._run_id,
                "episode": episode,
                "log_size": log[0],
                "log_sha256": log[1],
                "files_sha256": checksums,
                **state.document,
            }
            _write(unfinished / STATE_FILE, json_bytes(sealed(document)))
            sync_directory(unfinished)
            self._put_in_place(unfinished, self.folder / str(episode))
        except BaseException:
            shutil.rmtree(unfinished, ignore_errors=True)
            raise
        for other in self.episodes()[self._keep :]:
            self._remove(other)

    def _put_in_place(self, unfinished: Path, place: Path) -> None:
        if place.exists():
            place.rename(self.folder / f".{place.name}.old")
        unfinished.rename(place)
        sync_directory(self.folder)
        self._remove_leftovers()

    def _remove(self, episode: int) -> None:
        """Rename a checkpoint, then delete it: nobody finds half of it under its own name."""
        gone = self.folder / f".{episode}.gone"
        with suppress(OSError):
            (self.folder / str(episode)).rename(gone)
        shutil.rmtree(gone, ignore_errors=True)

    def _remove_leftovers(self) -> None:
        """Clean up after a process that died: put back a checkpoint set aside, remove the rest."""
        places = {path: episode for episode, path in self._places().items()}
        for path in list(self.folder.iterdir()):
            if not _LEFTOVER.fullmatch(path.name):
                continue
            if path in places:
                path.rename(self.folder / str(places[path]))
            else:
                shutil.rmtree(path, ignore_errors=True)

    def read(self, episode: int, specs: Callable[[Mapping[str, Any]], Specs]) -> TrainingState:
        """Read a checkpoint and check it.

        Args:
            episode: its number.
            specs: gives the shapes and types of all tensors of a document, by file and name.

        Raises:
            InputError: the checkpoint is damaged, or belongs to another run.
        """
        directory = self._places().get(episode, self.folder / str(episode))
        try:
            document = read_sealed(directory / STATE_FILE, _LARGEST_STATE)
            named = document["schema"], document["run"], document["episode"]
            if named not in [(_SCHEMA, run_id, episode) for run_id in self._known_ids]:
                raise ValueError(f"{directory} is checkpoint {named[2]} of run {named[1]}")
            expected = specs(document)
            checksums = document["files_sha256"]
            if set(checksums) != set(expected):
                raise ValueError(f"{directory} has files for {', '.join(checksums)}")
            tensors = {
                name: read_tensors(directory / _file(name), wanted, checksums[name])
                for name, wanted in expected.items()
            }
        except OSError as error:
            raise InputError(f"cannot read {directory}: {reason_of(error)}") from error
        except STATE_ERRORS as error:
            raise InputError(f"checkpoint {episode} is damaged: {error}") from error
        return TrainingState(document, tensors)

    def forget_later_than(self, episode: int) -> None:
        """Remove the checkpoints that are later than the one that the run resumes from."""
        self._remove_leftovers()
        for other in self.episodes():
            if other > episode:
                self._remove(other)


STATE_ERRORS = (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RuntimeError)
"""Errors that reading or restoring the state of something else may raise."""


def _file(name: str) -> str:
    return f"{name}.safetensors"


def _write(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        sync_file(file, path.parent)
