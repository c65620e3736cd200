"""``orchid runs export`` and ``import``: what goes in, and what never comes out."""

import hashlib
import io
import json
import os
import random
import shutil
import stat
import struct
import tempfile
import zipfile
from pathlib import Path

import pytest

from orchid_uav.experiments import provenance
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.runs import archive as run_archive
from orchid_uav.experiments.runs.archive import MANIFEST, export_runs, import_runs
from tests.helpers.damage import reseal
from tests.helpers.processes import TINY_FLAGS, assert_is_an_error, file_size_limit, fingerprint
from tests.helpers.run_directories import begin_run, make_run, rows

EVENTS = "events.out.tfevents.1795390545.host.26320"
REGULAR = (stat.S_IFREG | 0o644) << 16


@pytest.fixture(autouse=True)
def _no_git(monkeypatch):
    """It would be asked for every run that is made."""
    monkeypatch.setattr(provenance, "git_commit", lambda: None)


@pytest.fixture
def run(tmp_path):
    """A run with everything a run may have."""
    path = make_run(tmp_path / "here", checkpoints=[2, 3], episodes=3)
    (path / EVENTS).write_bytes(b"events" * 30)
    return path


@pytest.fixture
def zipped(run, tmp_path):
    """The run, exported."""
    return export_runs([run], tmp_path / "run.zip", checkpoints=True).path


def visible(directory: Path) -> dict[str, str]:
    """A run's content without locks."""
    return {
        name: digest for name, digest in fingerprint(directory).items() if "/." not in f"/{name}"
    }


class TestExport:
    def test_holds_all_but_checkpoints_locks_and_unfinished_files(self, run, tmp_path):
        (run / ".episodes.csv.x1y2").write_text("unfinished")
        (run / "checkpoints" / ".3.old").mkdir()
        (run / "checkpoints" / ".3.old" / "state.json").write_text("{}")
        assert (run / ".lock").exists()
        exported = export_runs([run], tmp_path / "run.zip")
        names = zipfile.ZipFile(exported.path).namelist()
        own = ["config.json", "episodes.csv", EVENTS, "policy.json", "policy.safetensors"]
        assert names == [*(f"{run.name}/{name}" for name in [*own, "run.json"]), MANIFEST]
        assert exported.runs == [run.name]
        assert exported.left_out == []
        assert exported.size == exported.path.stat().st_size

    def test_checkpoints_come_along_where_they_are_asked_for(self, run, tmp_path):
        plain = export_runs([run], tmp_path / "a.zip").path
        whole = export_runs([run], tmp_path / "b.zip", checkpoints=True).path
        more = set(zipfile.ZipFile(whole).namelist()) - set(zipfile.ZipFile(plain).namelist())
        assert more == {
            f"{run.name}/checkpoints/{episode}/{name}"
            for episode in (2, 3)
            for name in ("state.json", "weights.safetensors")
        }

    def test_the_manifest_has_the_size_and_sha256_of_every_file(self, run, zipped):
        archive = zipfile.ZipFile(zipped)
        manifest = json.loads(archive.read(MANIFEST))
        assert manifest["schema"] == 1
        assert list(manifest["runs"]) == [run.name]
        files = manifest["runs"][run.name]
        assert {f"{run.name}/{name}" for name in files} == set(archive.namelist()) - {MANIFEST}
        for name, file in files.items():
            content = (run / name).read_bytes()
            assert file == {
                "bytes": len(content),
                "sha256": hashlib.sha256(content).hexdigest(),
            }

    def test_the_same_runs_give_the_same_bytes(self, run, tmp_path):
        other = make_run(tmp_path / "here", "other")
        first = export_runs([run, other], tmp_path / "a.zip").path
        for path in run.rglob("*"):
            os.utime(path, (0, 0))
            path.chmod(0o700)
        second = export_runs([other, run], tmp_path / "b.zip").path
        assert first.read_bytes() == second.read_bytes()

    def test_never_writes_over_a_file_unasked(self, run, tmp_path, orchid):
        target = tmp_path / "run.zip"
        target.write_text("mine")
        with pytest.raises(InputError, match="--force"):
            export_runs([run], target)
        assert target.read_text() == "mine"
        export_runs([run], target, force=True)
        assert zipfile.is_zipfile(target)

    def test_nor_over_one_that_appears_meanwhile(self, run, tmp_path, monkeypatch):
        target = tmp_path / "run.zip"
        write = run_archive._write

        def write_and_be_overtaken(file, files):
            write(file, files)
            target.write_text("mine")

        monkeypatch.setattr(run_archive, "_write", write_and_be_overtaken)
        for has_links in (True, False):
            if not has_links:
                monkeypatch.setattr(Path, "hardlink_to", _no_links)
            target.unlink(missing_ok=True)
            with pytest.raises(InputError, match="File exists"):
                export_runs([run], target)
            assert target.read_text() == "mine"
        assert {path.name for path in tmp_path.iterdir()} == {"here", "run.zip"}

    def test_goes_without_hard_links(self, run, tmp_path, monkeypatch):
        monkeypatch.setattr(Path, "hardlink_to", _no_links)
        assert zipfile.is_zipfile(export_runs([run], tmp_path / "run.zip").path)
        assert {path.name for path in tmp_path.iterdir()} == {"here", "run.zip"}

    def test_a_full_disk_leaves_nothing(self, run, tmp_path):
        with file_size_limit(500), pytest.raises(InputError, match="cannot write"):
            export_runs([run], tmp_path / "run.zip")
        assert [path.name for path in tmp_path.iterdir()] == ["here"]

    def test_a_run_that_is_running_is_not_exported(self, tmp_path):
        live = begin_run(tmp_path / "here")
        with pytest.raises(InputError, match="is running"):
            export_runs([live.path], tmp_path / "run.zip")
        live.finish("completed", rows(1), [], 1.0)
        assert export_runs([live.path], tmp_path / "run.zip").runs == [live.id]

    def test_a_run_that_changes_meanwhile_is_not_exported(self, run, tmp_path, monkeypatch):
        write = run_archive._write

        def write_while_it_changes(file, files):
            write(file, files)
            reseal(run / "run.json", seconds=99.0)

        monkeypatch.setattr(run_archive, "_write", write_while_it_changes)
        with pytest.raises(RunFailedError, match="changed"):
            export_runs([run], tmp_path / "run.zip")
        assert [path.name for path in tmp_path.iterdir()] == ["here"]

    def test_damaged_runs_and_runs_given_twice_are_refused(self, run, tmp_path):
        with pytest.raises(InputError, match="twice"):
            export_runs([run, run], tmp_path / "run.zip")
        (run / "config.json").write_text("{}")
        with pytest.raises(InputError, match="sha256"):
            export_runs([run], tmp_path / "run.zip")

    def test_links_and_other_peoples_files_are_left_out_and_named(self, run, tmp_path):
        secret = tmp_path / "secret"
        secret.mkdir()
        (secret / "key").write_text("secret")
        (run / "notes.txt").write_text("mine")
        (run / "policy.json").unlink()
        (run / "policy.json").symlink_to(secret / "key")
        (run / "checkpoints" / "9").symlink_to(secret)
        os.mkfifo(run / "evaluation.json")
        exported = export_runs([run], tmp_path / "run.zip", checkpoints=True)
        left_out = ("checkpoints/9", "evaluation.json", "notes.txt", "policy.json")
        assert exported.left_out == [f"{run.name}/{name}" for name in left_out]
        archive = zipfile.ZipFile(exported.path)
        assert not any(b"secret" in archive.read(name) for name in archive.namelist())

    def test_more_than_an_archive_holds_is_refused(self, run, tmp_path, monkeypatch):
        monkeypatch.setattr(run_archive, "LARGEST_TOTAL", 1000)
        with pytest.raises(InputError, match="too many"):
            export_runs([run], tmp_path / "run.zip")


class TestCommand:
    def test_names_the_archive_by_the_run_where_no_name_is_given(
        self, run, tmp_path, orchid, monkeypatch
    ):
        monkeypatch.chdir(tmp_path)
        arguments = ["runs", "export", run.name, "--runs-dir", run.parent]
        finished = orchid(*arguments)
        assert finished.code == 0, finished.err
        assert f"{run.name}.zip: 1 run, " in finished.out
        assert (tmp_path / f"{run.name}.zip").is_file()
        assert_is_an_error(orchid(*arguments), f"{run.name}.zip exists", "--force")
        finished = orchid(*arguments, "--force", "--json")
        assert json.loads(finished.out)["runs"] == [run.name]

    def test_several_runs_need_a_name(self, run, tmp_path, orchid, monkeypatch):
        monkeypatch.chdir(tmp_path)
        other = make_run(run.parent, "other")
        arguments = ["runs", "export", run.name, other.name, "--runs-dir", run.parent]
        assert_is_an_error(orchid(*arguments), "--out")
        assert orchid(*arguments, "--out", "both.zip").code == 0
        finished = orchid("runs", "import", "both.zip", "--runs-dir", "there", "--json")
        assert [one["id"] for one in json.loads(finished.out)["runs"]] == sorted(
            [run.name, other.name]
        )

    @pytest.mark.parametrize("content", [b"", b"PK", b"not a zip at all" * 10])
    def test_what_is_no_archive_is_an_error(self, tmp_path, orchid, content):
        path = tmp_path / "x.zip"
        path.write_bytes(content)
        finished = orchid("runs", "import", path, "--runs-dir", tmp_path / "there")
        assert_is_an_error(finished, "x.zip is not an archive of runs")
        assert not (tmp_path / "there").exists()

    def test_what_is_not_there_is_an_error(self, tmp_path, orchid):
        for name in ("missing.zip", "."):
            finished = orchid("runs", "import", tmp_path / name, "--runs-dir", tmp_path / "there")
            assert_is_an_error(finished)

    def test_an_imported_policy_can_be_evaluated(self, tmp_path, orchid):
        here, there = tmp_path / "here", tmp_path / "there"
        finished = orchid(
            *("train", *TINY_FLAGS, "--episodes=3", "--no-rf", "--quiet", "--json"),
            *("--runs-dir", here),
        )
        run = json.loads(finished.out)["run"]
        archive = tmp_path / "run.zip"
        assert orchid("runs", "export", run, "--runs-dir", here, "--out", archive).code == 0
        shutil.rmtree(here)
        assert orchid("runs", "import", archive, "--runs-dir", there).code == 0
        finished = orchid(
            *("eval", run, "--runs-dir", there, "--methods", "static-mmf", "--episodes", 2),
            *("--uavs", 2, "--users", 20, "--set", "network.episode_slots=5", "--no-figures"),
            *("--out", tmp_path / "eval", "--json", "--quiet"),
        )
        assert finished.code == 0, finished.err
        methods = [result["method"] for result in json.loads(finished.out)["results"]]
        assert run in methods


class TestImport:
    @pytest.mark.parametrize("checkpoints", [True, False])
    def test_gives_back_what_was_exported(self, run, tmp_path, checkpoints):
        archive = export_runs([run], tmp_path / "run.zip", checkpoints=checkpoints).path
        (imported,) = import_runs(archive, tmp_path / "there" / "runs")
        assert imported == tmp_path / "there" / "runs" / run.name
        expected = {
            name: digest
            for name, digest in visible(run).items()
            if checkpoints or not name.startswith("checkpoints")
        }
        assert visible(imported) == expected
        assert [path.name for path in imported.parent.iterdir()] == [run.name]

    def test_a_run_that_is_there_is_never_touched(self, run, zipped, tmp_path, monkeypatch):
        monkeypatch.setattr(tempfile, "mkdtemp", lambda **options: pytest.fail("it wrote"))
        before = fingerprint(run)
        with pytest.raises(InputError, match=f"{run.name} is already in"):
            import_runs(zipped, run.parent)
        assert fingerprint(run) == before
        there = tmp_path / "there"
        there.mkdir()
        (there / run.name).symlink_to("nowhere")
        with pytest.raises(InputError, match="is already in"):
            import_runs(zipped, there)
        assert (there / run.name).is_symlink()

    def test_of_several_runs_all_come_or_none(self, run, tmp_path, monkeypatch):
        other = make_run(run.parent, "other")
        archive = export_runs([run, other], tmp_path / "both.zip").path
        there = tmp_path / "there"
        rename = Path.rename
        renamed = []

        def rename_one(self, target):
            if Path(target).parent == there and renamed:
                raise OSError(28, "No space left on device")
            renamed.append(target)
            return rename(self, target)

        with monkeypatch.context() as patch:
            patch.setattr(Path, "rename", rename_one)
            with pytest.raises(InputError, match="No space left"):
                import_runs(archive, there)
        assert not there.exists()
        assert len(import_runs(archive, there)) == 2

    def test_ctrl_c_leaves_nothing(self, zipped, tmp_path, monkeypatch):
        there = tmp_path / "there"
        there.mkdir()

        def interrupt(path):
            raise KeyboardInterrupt

        monkeypatch.setattr(run_archive, "_check_run", interrupt)
        with pytest.raises(KeyboardInterrupt):
            import_runs(zipped, there)
        assert list(there.iterdir()) == []

    def test_a_full_disk_leaves_nothing(self, zipped, tmp_path):
        with file_size_limit(500), pytest.raises(InputError, match="File too large"):
            import_runs(zipped, tmp_path / "there")
        assert not (tmp_path / "there").exists()

    def test_a_disk_that_would_be_full_is_told_beforehand(self, zipped, tmp_path, monkeypatch):
        usage = type(shutil.disk_usage("/"))(10**9, 10**9, 10)
        monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
        monkeypatch.setattr(tempfile, "mkdtemp", lambda **options: pytest.fail("it wrote"))
        with pytest.raises(InputError, match="has room for only 10"):
            import_runs(zipped, tmp_path / "there")

    def test_a_directory_that_cannot_be_made_is_an_error(self, zipped, tmp_path):
        (tmp_path / "file").write_text("mine")
        for place in (tmp_path / "file", tmp_path / "file" / "deeper"):
            with pytest.raises(InputError, match="cannot import"):
                import_runs(zipped, place)
        assert (tmp_path / "file").read_text() == "mine"


def _no_links(self, target):
    raise OSError(1, "Operation not permitted")


def contents(path: Path) -> dict[str, bytes]:
    """Files of an archive, by name."""
    archive = zipfile.ZipFile(path)
    return {name: archive.read(name) for name in archive.namelist()}


def pack(files, attributes=REGULAR, compression=zipfile.ZIP_DEFLATED) -> bytes:
    """A zip of (name, content) pairs; what belongs to one of them may be given as a ZipInfo."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", compression) as archive:
        for name, content in files:
            entry = name
            if not isinstance(name, zipfile.ZipInfo):
                entry = zipfile.ZipInfo(name)
                entry.external_attr = attributes
                entry.create_system = 3
                entry.compress_type = compression
            archive.writestr(entry, content)
    return target.getvalue()


def with_large_file_records(content: bytes) -> bytes:
    """The archive with the records, right in themselves, that those beyond 4 GiB have.

    What they say overrules the last record, which is made to look as if they were not there.
    """
    _, _, _, _, count, length, start, _ = struct.unpack("<4s4H2LH", content[-22:])
    large = struct.pack("<4sQ2H2L4Q", b"PK\6\6", 44, 45, 45, 0, 0, count, count, length, start)
    locator = struct.pack("<4sLQL", b"PK\6\7", 0, len(content) - 22, 1)
    more = length + len(large) + len(locator)
    end = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, count, count, more, start, 0)
    packed = content[:-22] + large + locator + end
    assert zipfile.ZipFile(io.BytesIO(packed)).testzip() is None
    return packed


def with_manifest(files: dict[str, bytes]) -> list[tuple[str, bytes]]:
    """The files and a manifest that describes them as they are."""
    runs: dict[str, dict[str, object]] = {}
    for name, content in files.items():
        run, _, inner = name.partition("/")
        runs.setdefault(run, {})[inner] = {
            "bytes": len(content),
            "sha256": hashlib.sha256(content).hexdigest(),
        }
    manifest = json.dumps({"schema": 1, "runs": runs}).encode()
    return [*files.items(), (MANIFEST, manifest)]


def entry(name: str, **attributes: object) -> zipfile.ZipInfo:
    made = zipfile.ZipInfo(name)
    made.external_attr = REGULAR
    for key, value in attributes.items():
        setattr(made, key, value)
    return made


class TestHostile:
    @pytest.fixture
    def files(self, zipped):
        """Of a good archive, without its manifest."""
        return {name: content for name, content in contents(zipped).items() if name != MANIFEST}

    @pytest.fixture
    def refused(self, tmp_path):
        """Asserts that some bytes are refused as an archive, for a reason, and leave nothing."""
        yard = tmp_path / "yard"

        def check(content: bytes, *parts: str):
            shutil.rmtree(yard, ignore_errors=True)
            (yard / "there").mkdir(parents=True)
            archive = yard / "x.zip"
            archive.write_bytes(content)
            before = fingerprint(tmp_path)
            with pytest.raises(InputError) as error:
                import_runs(archive, yard / "there")
            assert fingerprint(tmp_path) == before
            message = str(error.value)
            assert len(message) < 500 and message.isprintable()
            for part in parts:
                assert part in message

        return check

    @pytest.mark.parametrize(
        "name",
        [
            "/etc/cron.d/job",
            "../escaped.json",
            "{run}/../../escaped.json",
            "{run}/../other/run.json",
            "{run}/checkpoints/../../x/state.json",
            "{run}/./run.json",
            "{run}//run.json",
            "..\\escaped.json",
            "{run}\\..\\escaped.json",
            "C:/windows/run.json",
            "C:run.json",
            "{run}/",
            "{run}/checkpoints/",
            "{run}/checkpoints/3/",
            "{run}/.lock",
            "{run}/.bashrc",
            "{run}/run.py",
            "{run}/policy.pkl",
            "{run}/policy.safetensors.exe",
            "{run}/checkpoints/three/state.json",
            "{run}/checkpoints/3/state.pickle",
            "{run}/checkpoints/3/deeper/state.json",
            "{run}/events.out.tfevents.",
            "{run}/events.out.tfevents.a/b",
            "{run}/run.json\n",
            "run.json",
            "../run.json",
            "./run.json",
            ".hidden/run.json",
            "-rf/run.json",
            "a b/run.json",
            "{run}\u202e/run.json",
            "{run}/{long}",
            "{long}/run.json",
        ],
    )
    def test_a_name_that_no_export_gives(self, files, refused, run, name):
        given = name.format(run=run.name, long="x" * 300)
        packed = pack(with_manifest(files | {given: b"{}"}))
        refused(packed, "not a file of a run")

    def test_a_name_that_ends_for_some_at_a_zero_byte(self, files, refused, run):
        packed = pack(with_manifest(files | {f"{run.name}/run.jsonX.py": b"{}"}))
        refused(packed.replace(b"run.jsonX.py", b"run.json\0.py"), "not a file of a run")

    @pytest.mark.parametrize(
        "kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR, stat.S_IFBLK, stat.S_IFDIR, 0]
    )
    def test_what_is_no_regular_file(self, files, refused, run, kind):
        name = f"{run.name}/evaluation.json"
        *own, manifest = with_manifest(files | {name: b"/etc/passwd"})
        odd = entry(name, external_attr=(kind | 0o777) << 16)
        refused(
            pack([*[pair for pair in own if pair[0] != name], (odd, b"/etc/passwd"), manifest]),
            "special file",
        )

    def test_the_same_name_twice(self, files, refused, run):
        name = f"{run.name}/policy.json"
        with pytest.warns(UserWarning, match="Duplicate name"):
            packed = pack([*with_manifest(files), (name, b"other")])
        refused(packed, name, "twice")

    def test_names_that_are_the_same_on_some_file_systems(self, files, refused, run):
        more = {f"{run.name}/events.out.tfevents.{letter}": b"x" for letter in "aA"}
        refused(pack(with_manifest(files | more)), "twice")
        other = {name.swapcase(): content for name, content in files.items()}
        refused(pack(with_manifest(files | other)))

    def test_a_checksum_that_does_not_fit(self, files, refused):
        *own, manifest = with_manifest(files)
        for number, (name, content) in enumerate(own):
            changed = list(own)
            changed[number] = (name, bytes([content[0] ^ 1]) + content[1:])
            refused(pack([*changed, manifest]), name, "sha256")

    def test_a_manifest_of_other_files_than_there_are(self, files, refused):
        *own, manifest = with_manifest(files)
        refused(pack([*own[1:], manifest]), "does not list the files")
        refused(pack([*own, ("a/run.json", b"{}"), manifest]), "does not list the files")
        refused(pack(own), MANIFEST)
        refused(pack([(MANIFEST, b'{"schema": 1, "runs": {}}')]), "no run")

    @pytest.mark.parametrize(
        "manifest",
        [
            b"",
            b"not json",
            b"\xff\xfe",
            b"[]",
            b"{}",
            b'{"schema": 1}',
            b'{"schema": 2, "runs": {}}',
            b'{"schema": 1, "runs": []}',
            b'{"schema": 1, "runs": {"a": []}}',
            b'{"schema": 1, "runs": {"a": {"run.json": 3}}}',
            b'{"schema": 1, "runs": {"a": {"run.json": {"bytes": 2}}}}',
            b"[" * 100_000,
            b'{"a":' * 100_000,
            b"9" * 10_000,
        ],
    )
    def test_a_manifest_that_is_none(self, files, refused, manifest):
        # Ratios of bombs are looked at elsewhere.
        kept = list(files.items())
        refused(pack([*kept, (entry(MANIFEST, compress_type=zipfile.ZIP_STORED), manifest)]))

    @pytest.mark.parametrize("change", [float, str, bool, lambda size: None, lambda size: -size])
    def test_a_size_that_is_none(self, files, refused, change):
        *own, (_, manifest) = with_manifest(files)
        document = json.loads(manifest)
        for kept in document["runs"].values():
            kept["run.json"]["bytes"] = change(kept["run.json"]["bytes"])
        refused(pack([*own, (MANIFEST, json.dumps(document).encode())]), "run.json")

    def test_a_checksum_that_is_none(self, files, refused):
        *own, (_, manifest) = with_manifest(files)
        for wrong in (None, "", "0" * 63, ["0" * 64]):
            document = json.loads(manifest)
            for kept in document["runs"].values():
                kept["run.json"]["sha256"] = wrong
            refused(pack([*own, (MANIFEST, json.dumps(document).encode())]), "run.json")

    def test_a_run_whose_files_do_not_belong_together(self, files, refused, run, tmp_path):
        other = make_run(tmp_path / "elsewhere", "other", config={"training__seed": 9})
        for name in ("run.json", "config.json"):
            mixed = files | {f"{run.name}/{name}": (other / name).read_bytes()}
            refused(pack(with_manifest(mixed)), run.name)
        refused(pack(with_manifest(files | {"manifest.json/run.json": b"{}"})), "config.json")
        less = {name: content for name, content in files.items() if "config" not in name}
        refused(pack(with_manifest(less)), "config.json")

    def test_a_run_under_another_ones_name(self, files, refused, run):
        renamed = {name.replace(run.name, "innocent"): content for name, content in files.items()}
        refused(pack(with_manifest(renamed)), "innocent", run.name)

    def test_records_that_are_sealed_but_make_no_sense(self, refused, run):
        for number, changes in enumerate(
            [
                {"status": "immortal"},
                {"final": {"reward": "much"}},
                {"episodes": None},
                {"id": "../../up"},
                {"host": None},
            ]
        ):
            path = run.with_name(f"copy-{number}")
            shutil.copytree(run, path)
            reseal(path / "run.json", **{"id": path.name} | changes)
            files = {
                f"{path.name}/{name}": (path / name).read_bytes()
                for name in ("run.json", "config.json")
            }
            refused(pack(with_manifest(files)))

    def test_bombs(self, files, refused, run, monkeypatch):
        name = f"{run.name}/episodes.csv"
        refused(pack(with_manifest(files | {name: bytes(10**7)})), name, "times its size")
        monkeypatch.setattr(run_archive, "LARGEST_TOTAL", 10**6)
        stored = {name: random.Random(0).randbytes(10**6)}
        refused(pack(with_manifest(files | stored)), "unpack to")

    def test_a_size_that_is_a_lie(self, files, refused, run):
        # In the directory, in the manifest, and in both, beside what is there.
        packed = pack(with_manifest(files), compression=zipfile.ZIP_STORED)
        size = len(files[f"{run.name}/run.json"])
        for lie in (size - 1, size + 1, 2**31):
            changed = bytearray(packed)
            at = packed.rindex(f"{run.name}/run.json".encode())
            struct.pack_into("<L", changed, at - 22, lie)
            refused(bytes(changed))

    def test_many_files(self, refused, monkeypatch, files):
        monkeypatch.setattr(run_archive, "MOST_FILES", 5)
        refused(pack(with_manifest(files)), "files")

    def test_other_compressions_and_encryption(self, files, refused, run):
        for compression in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
            refused(pack(with_manifest(files), compression=compression), "compressed")
        packed = bytearray(pack(with_manifest(files)))
        at = packed.index(b"PK\1\2")
        packed[at + 8] |= 1
        refused(bytes(packed), "encrypted, or not compressed as")

    def test_other_layouts_of_the_format(self, zipped, refused, files):
        content = zipped.read_bytes()
        refused(b"#!/bin/sh\n" + content)
        refused(content + b"\n")
        comment = io.BytesIO(content)
        with zipfile.ZipFile(comment, "a") as archive:
            archive.comment = b"hello"
        refused(comment.getvalue())
        refused(with_large_file_records(content))
        extra = entry(next(iter(files)), extra=b"\x75\x70\x04\x00abcd")
        refused(pack([(extra, files[extra.filename]), *with_manifest(files)[1:]]))

    def test_files_in_each_other(self, files, refused, run):
        packed = bytearray(pack(with_manifest(files), compression=zipfile.ZIP_STORED))
        begins = []
        at = packed.index(b"PK\1\2")
        while at >= 0:
            begins.append(at)
            at = packed.find(b"PK\1\2", at + 1)
        (first,) = struct.unpack_from("<L", packed, begins[0] + 42)
        struct.pack_into("<L", packed, begins[1] + 42, first)
        refused(bytes(packed))

    def test_wherever_it_is_cut_off(self, zipped, refused):
        content = zipped.read_bytes()
        generator = random.Random(0)
        for length in [
            0,
            1,
            21,
            22,
            len(content) - 1,
            *generator.choices(range(len(content)), k=60),
        ]:
            refused(content[:length])

    def test_whichever_bit_is_flipped_nothing_wrong_comes_out(self, run, zipped, tmp_path):
        content = zipped.read_bytes()
        generator = random.Random(1)
        expected = visible(run)
        archive, there = tmp_path / "flipped.zip", tmp_path / "there"
        # The directory and the manifest are small, and most there is to get wrong.
        directory = content.index(b"PK\1\2")
        places = [
            *generator.choices(range(len(content)), k=100),
            *generator.choices(range(directory - 600, len(content)), k=200),
        ]
        refusals = 0
        for place in places:
            flipped = bytearray(content)
            flipped[place] ^= 1 << generator.randrange(8)
            archive.write_bytes(flipped)
            try:
                (imported,) = import_runs(archive, there)
            except InputError:
                refusals += 1
                assert not there.exists()
            else:  # a bit that means nothing, of a time for example
                assert visible(imported) == expected
                shutil.rmtree(there)
        assert refusals > len(places) / 2

    def test_bytes_at_random(self, zipped, refused):
        generator = random.Random(2)
        content = zipped.read_bytes()
        end = content[-22:]
        for _ in range(50):
            noise = generator.randbytes(generator.randrange(300))
            refused(noise)
            refused(noise + end)
            refused(noise + struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 1, 1, len(noise), 0, 0))
