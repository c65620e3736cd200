"""TensorBoard on the folders of runs."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.runs.records import find_run, name_of, read_record
from orchid_uav.notices import in_one_line, reason_of

_EVENTS = "events.out.tfevents.*"


def named_folders(names: Sequence[str], runs_dir: Path) -> dict[str, Path]:
    """The folders of runs that TensorBoard can show, by the names under which it does.

    Args:
        names: ids, beginnings of ids, or paths.
        runs_dir: where runs are looked for.

    Raises:
        InputError: there is no such run, it has no events, or another one has its name.
    """
    folders: dict[str, Path] = {}
    for name in names:
        path = find_run(name, runs_dir)
        read_record(path)
        label, place = name_of(path), path.resolve()
        if not any(place.glob(_EVENTS)):
            raise InputError(f"run {label} has no events for TensorBoard: no {path / _EVENTS}")
        if folders.setdefault(label, place) != place:
            raise InputError(f"two runs are called {label}: {folders[label]} and {place}")
    return folders


@contextmanager
def folder_of(folders: Mapping[str, Path]) -> Iterator[Path]:
    """A temporary folder of links to these; TensorBoard's own list of folders renames them.

    Raises:
        InputError: no links can be made, as on Windows without the right to.
    """
    with TemporaryDirectory(prefix="orchid-tensorboard-") as folder:
        try:
            for name, path in folders.items():
                (Path(folder) / name).symlink_to(path, target_is_directory=True)
        except OSError as error:
            raise InputError(
                f"no link to a run can be made in {folder} ({reason_of(error)}); without RUN, all "
                "of --runs-dir are shown"
            ) from error
        yield Path(folder)


def start_tensorboard(directory: Path, host: str, port: int | None) -> str:
    """Start TensorBoard in a thread that ends with the process, and return its address.

    Args:
        directory: contains the runs.
        host: where it listens.
        port: 0 takes any free one, None the first free one from 6006 on.

    Raises:
        InputError: it cannot listen there.
    """
    from tensorboard import program

    board = program.TensorBoard()
    try:
        with redirect_stderr(StringIO()):  # praise of its faster reader
            board.configure(logdir=str(directory), host=host, port=port)
            return str(board.launch())
    except program.TensorBoardServerException as error:
        raise InputError(f"TensorBoard cannot start: {in_one_line(error)}") from error
