"""``orchid export``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
    print_text,
)
from orchid_uav.experiments.runs.records import DEFAULT_RUNS_DIR, expanded

if TYPE_CHECKING:
    from orchid_uav.experiments.exporting.onnx_file import ExportedActor


def export(
    run: Annotated[
        str,
        typer.Argument(
            metavar="RUN",
            help="A run's id, the beginning of one, a path, or the key of a released policy.",
            autocompletion=completion.policies,
        ),
    ],
    onnx: Annotated[
        Path,
        typer.Option(metavar="FILE", help="The ONNX file to write.", rich_help_panel=OUTPUT_PANEL),
    ],
    runs_dir: Annotated[
        Path,
        typer.Option(envvar="ORCHID_RUNS_DIR", help="Directory that contains the runs."),
    ] = DEFAULT_RUNS_DIR,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Replace the file if it exists.", rich_help_panel=OUTPUT_PANEL
        ),
    ] = False,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Write a policy as an ONNX file, for the companion computer of an autopilot.

    The file takes observations and gives actions, of any number of UAVs at once. It is compared
    with the policy on 10,000 observations before it appears. To give a whole run to a colleague:
    orchid runs export.

    Example: orchid export orchid-distilled --onnx actor.onnx
    """
    with failing_well(debug):
        from orchid_uav.experiments.exporting.onnx_file import export_onnx, find_policy

        target = expanded(onnx)
        exported = export_onnx(find_policy(run, expanded(runs_dir)), target, force)
        parity = exported.parity
        if parity is None:
            print_note(
                "onnxruntime cannot be imported: the file was checked by onnx.checker alone, and "
                "not compared with the policy"
            )
        elif parity.rounding is not None:
            print_note(
                f"actions differ by up to {parity.largest_difference:.1e} by rounding: on such "
                f"extreme observations float32 itself is off by {parity.rounding:.1e}"
            )
        if as_json:
            print(json.dumps(_document(exported), allow_nan=False))
        else:
            _print(exported)


def _document(exported: "ExportedActor") -> dict[str, object]:
    from orchid_uav.experiments.exporting.graph import BATCH, INPUT, IR_VERSION, OPSET, OUTPUT

    ends = (("input", INPUT, exported.observation_size), ("output", OUTPUT, exported.action_size))
    return {
        "schema": 1,
        "run": exported.run,
        "file": str(exported.path),
        "bytes": exported.size,
        "opset": OPSET,
        "ir_version": IR_VERSION,
        **{
            end: {"name": name, "shape": [BATCH, size], "type": "float32"}
            for end, name, size in ends
        },
        "parity": None if exported.parity is None else exported.parity._asdict(),
    }


def _print(exported: "ExportedActor") -> None:
    from orchid_uav.experiments.exporting.graph import BATCH, INPUT, OPSET, OUTPUT

    out = console()
    print_line(
        out,
        plain(
            f"{exported.path}: {INPUT} ({BATCH}, {exported.observation_size}) to {OUTPUT} "
            f"({BATCH}, {exported.action_size}), opset {OPSET}, {exported.size / 1e6:.1f} MB"
        ),
    )
    parity = exported.parity
    if parity is not None:
        print_text(
            out,
            f"compared with the policy on {parity.observations:,} observations: onnxruntime "
            f"{parity.runtime} differs by {parity.largest_difference:.1e} at most",
        )
