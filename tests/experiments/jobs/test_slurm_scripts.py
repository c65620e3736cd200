"""The batch scripts of ``examples/slurm``, with stand-ins for Slurm's own commands."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from orchid_uav.experiments.interruption import Interruption
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.runs.records import read_config, read_record
from orchid_uav.experiments.training.loop import train
from tests.helpers.processes import TINY_FLAGS, Audience, learned_files, record_of

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="Slurm is POSIX"),
    pytest.mark.usefixtures("plain_environment"),
]

REAL = pytest.mark.skipif("CLUSTER_TESTS" not in os.environ, reason="slow: make test-ray")
SCRIPTS = Path(__file__).parents[3] / "examples" / "slurm"
GIVE_UP_AFTER_S = 300.0

SRUN = """#!/bin/sh
case "$1" in --cpus-per-task=*) shift ;; esac
echo $$ > "$SLURM_STANDIN/step"
exec "$@"
"""
SCONTROL = """#!/bin/sh
echo "$@" >> "$SLURM_STANDIN/scontrol"
"""
ORCHID = f"""#!/bin/sh
exec {sys.executable} -m orchid_uav "$@"
"""


@pytest.fixture
def sbatch(tmp_path, start_process):
    """Starts a script as Slurm would: ``srun`` runs a step, which ``--signal`` reaches."""
    standin = tmp_path / "slurm"
    (standin / "bin").mkdir(parents=True)
    for name, text in (("srun", SRUN), ("scontrol", SCONTROL), ("orchid", ORCHID)):
        (standin / "bin" / name).write_text(text)
        (standin / "bin" / name).chmod(0o755)

    def start(script, *arguments, **environment):
        (standin / "step").unlink(missing_ok=True)
        own = {
            "PATH": f"{standin / 'bin'}{os.pathsep}{os.environ['PATH']}",
            "SLURM_STANDIN": str(standin),
            "SLURM_JOB_ID": "17",
            "SLURM_CPUS_PER_TASK": "1",
        }
        command = ["sh", str(SCRIPTS / script), *arguments]
        return start_process(command, env=os.environ | own | environment, cwd=tmp_path)

    start.standin = standin
    return start


def until(condition, process):
    give_up_s = time.monotonic() + GIVE_UP_AFTER_S
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < give_up_s
        time.sleep(0.02)


def ended(process):
    out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
    return process.returncode, out + err


def runs_of(study):
    found = {}
    for path in (study / "runs").iterdir():
        seed = json.loads((path / "config.json").read_text())["training"]["seed"]
        found[record_of(path)["name"], seed] = path
    return found


@pytest.mark.parametrize("script", ["ablate.sbatch", "seeds.sbatch"])
def test_a_script_says_what_slurm_and_the_shell_understand(script):
    lines = (SCRIPTS / script).read_text().splitlines()
    directives = [line for line in lines if line.startswith("#SBATCH")]
    commands = [index for index, line in enumerate(lines) if line and not line.startswith("#")]
    # Slurm reads no directive behind the first command, and only --requeue lets a job begin again.
    assert max(map(lines.index, directives)) < commands[0]
    assert "#SBATCH --requeue" in directives
    assert any(re.fullmatch(r"#SBATCH --signal=USR1@\d+", line) for line in directives)
    checked = subprocess.run(
        ["sh", "-n", str(SCRIPTS / script)], check=False, capture_output=True, text=True
    )
    assert (checked.returncode, checked.stderr) == (0, "")


def test_a_job_that_was_stopped_before_its_limit_is_put_back_and_any_other_is_not(sbatch):
    (sbatch.standin / "bin" / "orchid").write_text(
        "#!/bin/sh\n"
        'trap "exit 130" USR1\n'
        f'echo "$@" > "{sbatch.standin}/told"\n'
        'case "$2" in --jobs) shift 3 ;; esac\n'
        'case "$1" in waits) while :; do sleep 0.05; done ;; esac\n'
        'exit "$1"\n'
    )
    requeued = sbatch.standin / "scontrol"
    for code in (0, 1, 2):
        assert ended(sbatch("ablate.sbatch", str(code)))[0] == code
    assert (sbatch.standin / "told").read_text() == "ablate --jobs 1 2\n"
    assert not requeued.exists()
    waiting = sbatch("ablate.sbatch", "waits")
    until(lambda: "waits" in (sbatch.standin / "told").read_text(), waiting)
    os.kill(int((sbatch.standin / "step").read_text()), signal.SIGUSR1)
    assert ended(waiting)[0] == 130
    assert requeued.read_text() == "requeue 17\n"


@REAL
def test_a_study_stops_before_the_limit_and_its_next_job_goes_on(sbatch, tmp_path):
    study = ["--no-rf", *[one.replace("--set", "--base") for one in TINY_FLAGS], "--seeds=0"]
    study += ["--base=checkpoint.every_episodes=5", "--topologies=2", "--episodes=100"]
    first = sbatch("ablate.sbatch", *study, "--out=it")
    until(lambda: len(list(tmp_path.glob("it/runs/*/checkpoints/[0-9]*"))) >= 2, first)
    os.kill(int((sbatch.standin / "step").read_text()), signal.SIGUSR1)
    code, told = ended(first)
    assert (code, "interrupted; continue with: orchid ablate" in told) == (130, True), told
    assert (sbatch.standin / "scontrol").read_text() == "requeue 17\n"
    assert ended(sbatch("ablate.sbatch", *study, "--out=it"))[0] == 0
    assert (sbatch.standin / "scontrol").read_text() == "requeue 17\n"
    runs = runs_of(tmp_path / "it")
    assert runs.keys() == {("base", 0), ("no-rf", 0)}
    assert [record_of(path)["status"] for path in runs.values()] == ["completed"] * 2
    resumed = [path for path in runs.values() if record_of(path)["resumed"]]
    assert resumed  # the other one may have been complete
    for path in resumed:
        config = read_config(path, read_record(path))
        whole = RunDirectory.create(tmp_path / "whole", "whole", config, ("orchid",))
        train(config, whole, Audience(), (), Interruption())
        assert learned_files(path) == learned_files(whole.path)


@REAL
def test_an_array_trains_the_runs_that_the_study_then_finds(sbatch, tmp_path):
    # The script trains the paper's run; this `orchid` makes it a tiny one.
    tiny = [*TINY_FLAGS, "--set=checkpoint.every_episodes=5"]
    flags = " ".join(f"'{flag}'" for flag in tiny)
    (sbatch.standin / "bin" / "orchid").write_text(
        "#!/bin/sh\n"
        f'case "$2" in --resume) {sys.executable} -m orchid_uav "$@"; exit;; esac\n'
        f'exec {sys.executable} -m orchid_uav "$@" {flags} --episodes "$EPISODES"\n'
    )
    study = {"STUDY": str(tmp_path / "it"), "EPISODES": "100"}
    first = sbatch("seeds.sbatch", SLURM_ARRAY_TASK_ID="1", **study)
    until((sbatch.standin / "step").exists, first)
    until(lambda: len(list(tmp_path.glob("it/runs/*/checkpoints/[0-9]*"))) >= 1, first)
    os.kill(int((sbatch.standin / "step").read_text()), signal.SIGUSR1)
    assert ended(first)[0] == 130
    assert (sbatch.standin / "scontrol").read_text() == "requeue 17\n"
    for task in "01":
        code, told = ended(sbatch("seeds.sbatch", SLURM_ARRAY_TASK_ID=task, **study))
        assert code == 0, told
    runs = runs_of(tmp_path / "it")
    assert runs.keys() == {("base", 0), ("no-rf", 0)}
    assert [len(record_of(runs[name, 0])["resumed"]) for name in ("base", "no-rf")] == [0, 1]
    command = [sys.executable, "-m", "orchid_uav", "ablate", "--no-rf", "--seeds=0"]
    command += [one.replace("--set", "--base") for one in TINY_FLAGS]
    command += [
        "--base=checkpoint.every_episodes=5",
        "--episodes=100",
        "--topologies=2",
        f"--out={tmp_path / 'it'}",
    ]
    finished = subprocess.run(command, check=False, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    assert "2 of them already done" in finished.stdout
    assert runs_of(tmp_path / "it") == runs
