"""What a server that never answers costs a run: ``python -m benchmarks.dead_tracker``.

Runs with ``--track mlflow``, at a server that accepts connections and is silent, and runs without
are trained in turns, as processes of their own. Compared is the wall-clock time of whole commands,
as a ratio within one turn. It needs the extra ``mlflow``.
"""

import argparse
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=700)
    arguments = parser.parse_args()
    ratios = []
    # Connections are completed by the kernel, and nobody ever reads what is sent.
    with (
        socket.create_server(("127.0.0.1", 0), backlog=128) as server,
        tempfile.TemporaryDirectory() as folder,
    ):
        dead = {"MLFLOW_TRACKING_URI": f"http://127.0.0.1:{server.getsockname()[1]}"}
        for turn in range(arguments.turns):
            seconds = {}
            # The order alternates, so that a machine that slows down favours neither.
            for is_dead in ((False, True), (True, False))[turn % 2]:
                command = [
                    *(sys.executable, "-m", "orchid_uav", "train", "--quiet", "--seed", str(turn)),
                    *("--episodes", str(arguments.episodes), "--runs-dir", folder),
                    *(("--track", "mlflow") if is_dead else ()),
                ]
                began = time.perf_counter()
                finished = subprocess.run(
                    command, env=os.environ | dead, capture_output=True, text=True, check=True
                )
                seconds[is_dead] = time.perf_counter() - began
                assert ("warning: mlflow is off" in finished.stderr) == is_dead, finished.stderr
            ratios.append(seconds[True] / seconds[False])
            print(
                f"turn {turn + 1}: {seconds[False]:.1f} s without, {seconds[True]:.1f} s with a "
                f"dead server, ratio {ratios[-1]:.3f}",
                flush=True,
            )
    print(f"median of {len(ratios)} ratios: {statistics.median(ratios):.3f}")


if __name__ == "__main__":
    main()
