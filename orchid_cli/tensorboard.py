"""``orchid tensorboard``."""

import json
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from orchid_uav.cli import completion
from orchid_uav.cli.console import (
    OUTPUT_PANEL,
    DebugOption,
    JsonOption,
    console,
    failing_well,
    plain,
    print_line,
    print_note,
)
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.runs.records import DEFAULT_RUNS_DIR, expanded

_LONG_S = 3600.0


def tensorboard(
    runs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RUN]...",
            help="Runs to show: ids, their beginnings, or paths (default: all of --runs-dir).",
            autocompletion=completion.runs,
            show_default=False,
        ),
    ] = None,
    runs_dir: Annotated[
        Path,
        typer.Option(envvar="ORCHID_RUNS_DIR", help="Directory that contains the runs."),
    ] = DEFAULT_RUNS_DIR,
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help="Port to listen on; 0 is any free one (default: the first free one from 6006).",
            rich_help_panel=OUTPUT_PANEL,
            show_default=False,
        ),
    ] = None,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on; others than localhost can be reached from elsewhere.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = "localhost",
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Start TensorBoard on runs: their curves, and settings beside final metrics under HPARAMS.

    It goes on until ctrl-C.

    Example: orchid tensorboard 20261122T2112 20261122T2115
    """
    with failing_well(debug):
        from orchid_uav.experiments.runs.index import read_index
        from orchid_uav.experiments.runs.tensorboard_server import (
            folder_of,
            named_folders,
            start_tensorboard,
        )

        directory = expanded(runs_dir)
        folders = named_folders(runs or [], directory)
        if not folders:
            if not directory.is_dir():
                raise InputError(f"there is no directory {directory}")
            if not read_index(directory).runs:
                print_note(f"no runs in {directory} yet; they are shown once they are there")
        with folder_of(folders) if folders else nullcontext(directory) as folder:
            url = start_tensorboard(folder, host, port)
            if as_json:
                document = {"runs": list(folders) or None, "runs_dir": str(directory)}
                print(json.dumps({"schema": 1, "url": url, **document}))
            else:
                count = f"{len(folders)} run" + "s" * (len(folders) > 1)
                shown = plain(count if folders else str(directory))
                print_line(console(), f"TensorBoard of {shown}: {url} (ctrl-C ends it)")
            sys.stdout.flush()
            while True:
                time.sleep(_LONG_S)
