"""The sdist and the wheel of the last commit, the same bytes every time: ``make dist``.

They are built from what git has of the commit, so that nothing which merely lies in the checkout
gets in. What setuptools takes from the machine is set here: times, owners, permissions, the order
of files. What is left are the versions of setuptools and of zlib, which compresses.
"""

import argparse
import gzip
import io
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILE_MODE, FOLDER_MODE = 0o644, 0o755
_UMASK = 0o022


def commit_seconds(root: Path) -> int:
    """When the last commit was made, in seconds since 1970."""
    return int(_git(root, "log", "-1", "--format=%ct"))


def export(root: Path, into: Path) -> None:
    """Write the files of the last commit, with permissions that do not depend on the user."""
    with tarfile.open(fileobj=io.BytesIO(_git(root, "archive", "HEAD"))) as archive:
        archive.extractall(into, filter="data")
    for path in into.rglob("*"):
        path.chmod(FOLDER_MODE if path.is_dir() else FILE_MODE)


def normalised(sdist: bytes, seconds: int) -> bytes:
    """The same files in an archive without their times, owners, order and permissions.

    Args:
        sdist: a ``.tar.gz``.
        seconds: since 1970, the time of every file.
    """
    content = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(sdist)) as given,
        tarfile.open(fileobj=content, mode="w", format=tarfile.PAX_FORMAT) as made,
    ):
        for member in sorted(given.getmembers(), key=lambda member: member.name):
            plain = tarfile.TarInfo(member.name)
            plain.type, plain.size, plain.mtime = member.type, member.size, seconds
            plain.mode = FOLDER_MODE if member.isdir() else FILE_MODE
            made.addfile(plain, given.extractfile(member) if member.isfile() else None)
    packed = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", fileobj=packed, mtime=seconds) as archive:
        archive.write(content.getvalue())
    return packed.getvalue()


def build(root: Path, into: Path) -> list[Path]:
    """Build the sdist of a checkout's last commit, and the wheel from that sdist.

    Args:
        root: a git checkout.
        into: folder of the results; files of the same names are replaced.

    Returns:
        The paths of the sdist and of the wheel.

    Raises:
        subprocess.CalledProcessError: it cannot be built; the output says why.
    """
    seconds = commit_seconds(root)
    into.mkdir(parents=True, exist_ok=True)
    previous = os.umask(_UMASK)
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            export(root, folder / "commit")
            made = _made("--sdist", folder / "commit", folder / "sdist", seconds)
            sdist = into / made.name
            sdist.write_bytes(normalised(made.read_bytes(), seconds))
            with tarfile.open(sdist) as archive:
                archive.extractall(folder, filter="data")
            source = folder / sdist.name.removesuffix(".tar.gz")
            made = _made("--wheel", source, folder / "wheel", seconds)
            wheel = into / made.name
            wheel.write_bytes(made.read_bytes())
    finally:
        os.umask(previous)
    return [sdist, wheel]


def _made(what: str, source: Path, into: Path, seconds: int) -> Path:
    # Not isolated: setuptools is the pinned one of this environment, and nothing is fetched.
    command = [sys.executable, "-m", "build", "--no-isolation", what, "--outdir", str(into)]
    environment = {**os.environ, "SOURCE_DATE_EPOCH": str(seconds), "LC_ALL": "C", "TZ": "UTC"}
    subprocess.run([*command, str(source)], env=environment, check=True, stdout=subprocess.DEVNULL)
    [made] = into.iterdir()
    return made


def _git(root: Path, *words: str) -> bytes:
    return subprocess.run(["git", *words], cwd=root, check=True, stdout=subprocess.PIPE).stdout


def main() -> None:
    """Build both."""
    parser = argparse.ArgumentParser(prog="studies.supply_chain.distributions", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the results")
    for path in build(ROOT, parser.parse_args().out):
        print(path)


if __name__ == "__main__":
    main()
