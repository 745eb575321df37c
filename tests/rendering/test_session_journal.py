"""Journals of a pass: whatever happens to one, what is gone on with has the bits of an undisturbed render."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wdpm
from wdpm.cli.journals import journals, places_of
from wdpm.cli.main import make_parser
from wdpm.cluster.kept import Kept, TaskKept
from wdpm.cluster.messages import packing
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.session import Session
from wdpm.images.image import Image
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.journal_head import head_of
from wdpm.rendering.pass_plan import PassPlan, session_of
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.prepare import Prepared
from wdpm.rendering.record_file import FileLock, RecordWriter, read_records
from wdpm.rendering.session_journal import SessionJournal
from wdpm.scenes.errors import GuardError, JournalInUseError, SettingsError
from wdpm.scenes.model.scene import Scene

CHOSEN = RenderSettings(photons=1000, spp=2, k=20, indirect=Indirect.CACHE, bucket=8)
PLAN = PassPlan(0, 0, CHOSEN.spp)


class Interrupting(SessionJournal):
    """One whose render is interrupted after so many tasks."""

    left = 10**9

    def keep(self, done: TaskKept) -> None:
        super().keep(done)
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


def render(scene: Scene, log: SessionJournal | None, workers: int = 1, **changed: Any) -> Image:
    with InProcess(threads=1, workers=workers) as backend:
        return render_in_passes(scene, backend, replace(CHOSEN, **changed), log=log)


@dataclass(frozen=True)
class Interrupted:
    """A render, and the journal that it left."""

    scene: Scene
    digest: str
    journal: bytes
    ends: tuple[int, ...]
    prepared: Prepared
    session: Session
    kept: Kept


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> Interrupted:
    scene = wdpm.load("cornell-box", size=(24, 16))
    path = tmp_path_factory.mktemp("left") / "journal"
    log = Interrupting(path, resume=False, at_once=True)
    log.left = 12
    with pytest.raises(KeyboardInterrupt):
        render(scene, log)
    log.close()
    whole = render(scene, None)
    with InProcess(threads=1) as backend:
        prepared = backend.prepare(scene, CHOSEN, SilentProgress())
    session = session_of(prepared.session, PLAN)
    ends = tuple(end for _, end in read_records(path))
    kept = begun(path, prepared, session).kept
    assert len(kept.records) >= 2
    assert len(kept.buckets) >= 2
    assert len(kept.records) + len(kept.buckets) == 12
    return Interrupted(scene, whole.digest(), path.read_bytes(), ends, prepared, session, kept)


def begun(path: Path, prepared: Prepared, session: Session, notes: Callable[[str], object] = lambda _: None) -> Session:
    """The session that goes on with a journal."""
    log = SessionJournal(path, resume=True)
    try:
        return log.begin(prepared, session, PLAN, notes)
    finally:
        log.close()


def bits_of(done: TaskKept) -> tuple[object, ...]:
    arrays = vars(done.result.records) if hasattr(done.result, "records") else done.result.layers
    task = (each.tobytes() if isinstance(each, np.ndarray) else each for each in vars(done.task).values())
    return (*task, *((name, array.tobytes()) for name, array in arrays.items()))


def test_an_interrupted_render_goes_on_to_the_same_bits(interrupted: Interrupted, tmp_path: Path) -> None:
    """In another process's place, with other numbers of workers and buckets; what is kept is not done again."""
    path = tmp_path / "journal"
    for workers, bucket in ((1, 8), (3, 16)):
        path.write_bytes(interrupted.journal)
        log = Interrupting(path, resume=True)
        done = 10**9
        log.left = done
        image = render(interrupted.scene, log, workers, bucket=bucket)
        assert image.digest() == interrupted.digest
        [uncounted] = [each for each in image.metadata["report"]["warnings"] if "missing in this report" in each]
        assert "finished before this render went on" in uncounted
        buckets = 3 * 2
        assert sum(1 for _ in read_records(path)) - 1 >= buckets  # the journal is whole at the end
        assert done - log.left >= buckets - len(interrupted.kept.buckets)
        assert done - log.left < sum(1 for _ in read_records(path)) - 1
        log.remove()
        assert not path.exists()


@pytest.mark.parametrize("keep", [0, 4, 8])
def test_a_journal_may_end_anywhere(interrupted: Interrupted, keep: int, tmp_path: Path) -> None:
    path = tmp_path / "journal"
    path.write_bytes(interrupted.journal[: interrupted.ends[keep] + 5])
    log = SessionJournal(path, resume=True)
    assert render(interrupted.scene, log).digest() == interrupted.digest
    log.close()


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_nothing_wrong_is_believed(interrupted: Interrupted, tmp_path_factory: Any, data: st.DataObject) -> None:
    """Bytes changed, left out, put in, cut off: what is gone on with is a beginning of what was kept, or nothing."""
    path = tmp_path_factory.getbasetemp() / f"journal-{os.getpid()}"
    whole = bytearray(interrupted.journal)
    place = data.draw(st.integers(0, len(whole) - 1) | st.sampled_from(interrupted.ends))
    place = min(place, len(whole) - 1)
    match data.draw(st.sampled_from(["cut", "flip", "leave out", "put in", "double"])):
        case "cut":
            del whole[place:]
        case "flip":
            whole[place] ^= data.draw(st.integers(1, 255))
        case "leave out":
            del whole[place : place + data.draw(st.integers(1, 64))]
        case "put in":
            whole[place:place] = data.draw(st.binary(min_size=1, max_size=64))
        case "double":
            whole += whole[interrupted.ends[0] :]
    path.write_bytes(whole)
    try:
        session = begun(path, interrupted.prepared, interrupted.session)
    except SettingsError:
        return
    known = {bits_of(each) for each in (*interrupted.kept.buckets, *interrupted.kept.records)}
    assert {bits_of(each) for each in (*session.kept.buckets, *session.kept.records)} <= known
    tasks = [(each.task.round, each.task.start) for each in session.kept.records]
    assert len(tasks) == len(set(tasks))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"photons": 3000}, "photons 1000 where 3000 is asked for"),
        ({"k": 21, "seed": 4}, "k 20 where 21 is asked for, seed 0 where 4 is asked for"),
        ({"spp": 4}, "pass 1 of samples 0 to 1, where pass 1 of samples 0 to 3 is next"),
    ],
)
def test_other_settings_are_refused(
    interrupted: Interrupted, changed: dict[str, Any], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "journal"
    path.write_bytes(interrupted.journal)
    with pytest.raises(SettingsError, match=words):
        render(interrupted.scene, SessionJournal(path, resume=True), **changed)
    assert path.read_bytes() == interrupted.journal


def test_a_journal_of_a_later_pass_is_of_no_use_where_those_before_were_not_kept(
    interrupted: Interrupted, tmp_path: Path
) -> None:
    """The disk had no room for their mean: the render begins anew, and no other render's journal is lost by that."""
    path = tmp_path / "journal"
    head = head_of(interrupted.prepared, interrupted.session, PassPlan(1, PLAN.spp, PLAN.spp))
    notes: list[str] = []
    for changed, other in (({}, False), ({"scene": "other"}, True)):
        writer = RecordWriter(path)
        writer.append(packing.encode(replace(head, identity={**head.identity, **changed})))
        writer.close()
        journal = SessionJournal(path, resume=True)
        again = (interrupted.prepared, interrupted.session, PLAN, notes.append)
        if other:
            with pytest.raises(SettingsError, match=r"another scene.*pass 2 of samples .* where pass 1"):
                journal.begin(*again)
        else:
            assert journal.begin(*again).kept == interrupted.session.kept
            assert "is of pass 2, but those before it were not kept; it begins anew" in notes[0]
        journal.close()


def test_another_scene_camera_or_version_is_refused(
    interrupted: Interrupted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal"
    path.write_bytes(interrupted.journal)
    with pytest.raises(SettingsError, match="is of another camera"):
        render(wdpm.load("cornell-box", size=(24, 12)), SessionJournal(path, resume=True))
    less = replace(interrupted.scene, meshes=interrupted.scene.meshes[1:])
    with pytest.raises(SettingsError, match="another scene"):
        render(less, SessionJournal(path, resume=True))
    monkeypatch.setattr("wdpm.rendering.journal_head.versions", lambda: {"wdpm code": "other"})
    with pytest.raises(SettingsError, match=r"another version .*wdpm code .* where other is asked for"):
        render(interrupted.scene, SessionJournal(path, resume=True))
    assert path.read_bytes() == interrupted.journal


def test_what_is_left_is_not_overwritten(interrupted: Interrupted, tmp_path: Path) -> None:
    path = tmp_path / "journal"
    path.write_bytes(interrupted.journal)
    with pytest.raises(SettingsError, match="give --resume to go on with it, or delete it"):
        SessionJournal(path, resume=False)
    path.write_bytes(b"\x89PNG something else that is longer")
    with pytest.raises(SettingsError, match="no journal of wdpm; move it away"):
        SessionJournal(path, resume=True)


def owner_of(path: Path) -> subprocess.Popen[bytes]:
    """A process that writes to a journal, and forks another that outlives it; it ends when its input does."""
    code = (
        "import os, signal, sys; from pathlib import Path; from wdpm.rendering.record_file import FileLock\n"
        "lock = FileLock(Path(sys.argv[1]))\n"
        "if not os.fork():\n"
        "    print(os.getpid(), flush=True)\n"  # by now it has let go of what it was forked with
        "    signal.pause()\n"
        "sys.stdin.read()"
    )
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", code, str(path)], stdin=pipe, stdout=pipe)


@pytest.mark.skipif(os.name != "posix", reason="there is no flock")
def test_another_process_that_renders_the_same_image_keeps_its_journal(
    interrupted: Interrupted, tmp_path: Path
) -> None:
    path = tmp_path / "journal"
    early = SessionJournal(path, resume=True, at_once=True)  # both began before either had anything to keep
    path.write_bytes(interrupted.journal)
    owner = owner_of(path)
    assert owner.stdout is not None
    child = int(owner.stdout.readline())
    try:
        for resume in (True, False):
            with pytest.raises(JournalInUseError, match="another process that renders this image writes it; wait for"):
                SessionJournal(path, resume=resume)
        notes: list[str] = []
        early.begin(interrupted.prepared, interrupted.session, PLAN, notes.append)
        early.keep(interrupted.kept.buckets[0])
        assert "cannot be written any more (another render writes it); the render goes on without" in notes[0]
        early.remove()
        assert path.read_bytes() == interrupted.journal
    finally:
        owner.kill()
        owner.wait()
    # What the owner has forked may live on for a moment, and keeps nobody from going on.
    begun(path, interrupted.prepared, interrupted.session)
    os.kill(child, signal.SIGKILL)
    owner.communicate()


@pytest.mark.skipif(os.name != "posix", reason="there is no flock")
def test_a_lock_is_of_the_file_that_has_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The one before may end, and remove its journal, between our opening it and our locking it."""
    import fcntl

    path, flock, left = tmp_path / "journal", fcntl.flock, [False, True]

    def late(file: int, how: int) -> None:
        if left.pop():
            path.unlink()
        flock(file, how)

    with monkeypatch.context() as patched:
        patched.setattr(fcntl, "flock", late)
        lock = FileLock(path)
    assert left == []
    with pytest.raises(BlockingIOError):
        FileLock(path)
    lock.release()
    FileLock(path).release()


def test_where_there_are_no_locks_no_file_stays_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows removes none that somebody has open."""
    opened: list[int] = []
    closed: list[int] = []
    really_open, really_close = os.open, os.close
    monkeypatch.setitem(sys.modules, "fcntl", None)
    with monkeypatch.context() as patched:
        patched.setattr("os.open", lambda *how: opened.append(really_open(*how)) or opened[-1])
        patched.setattr("os.close", lambda file: closed.append(file) or really_close(file))
        locks = FileLock(tmp_path / "journal"), FileLock(tmp_path / "journal")
    assert len(opened) == 2
    assert closed == opened
    for lock in locks:
        lock.release()


def test_a_writer_that_got_no_further_than_to_its_lock_keeps_nothing(interrupted: Interrupted, tmp_path: Path) -> None:
    path = tmp_path / "journal"
    path.touch()
    log = SessionJournal(path, resume=False)
    assert render(interrupted.scene, log).digest() == interrupted.digest
    log.remove()
    assert not path.exists()


def test_journals_of_python_go_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.rendering.session_journal.WORTH_S", 0.0)
    scene = wdpm.load("cornell-box", size=(8, 8))
    wdpm.render(scene, replace(CHOSEN, passes=2), threads=1, journal=tmp_path / "passes")
    assert list(tmp_path.iterdir()) == []


def test_what_a_guard_ends_is_not_kept(interrupted: Interrupted, tmp_path: Path) -> None:
    """It would end there again."""
    output = tmp_path / "box.exr"
    args = make_parser("render").parse_args(["render", "cornell-box", "-o", str(output), "--journal", str(tmp_path)])

    def strict() -> None:
        with journals(args, output) as told:
            log = told["log"]
            log.begin(interrupted.prepared, interrupted.session, PLAN, print)
            log.keep(interrupted.kept.buckets[0])
            assert places_of(output).log.exists()
            raise GuardError("light was lost")

    with pytest.raises(GuardError):
        strict()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_ends_the_journal_and_not_the_render(
    interrupted: Interrupted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, room = tmp_path / "journal", [len(interrupted.journal) // 2]
    write, notes = os.write, []

    def full(descriptor: int, data: Any) -> int:
        if os.path.samestat(os.fstat(descriptor), path.stat()):
            if not room[0]:
                raise OSError(28, "No space left on device")
            data = data[: room[0]]
            room[0] -= len(data)
        return write(descriptor, data)

    class Notes(SilentProgress):
        def note(self, text: str) -> None:
            notes.append(text)

    log = SessionJournal(path, resume=False, at_once=True)
    with monkeypatch.context() as patched, InProcess(threads=1) as backend:
        patched.setattr("wdpm.rendering.record_file.os.write", full)
        image = render_in_passes(interrupted.scene, backend, CHOSEN, log=log, progress=Notes())
    assert image.digest() == interrupted.digest
    assert [note for note in notes if "No space left on device); the render goes on without" in note]
    log.close()
    again = SessionJournal(path, resume=True)
    assert render(interrupted.scene, again).digest() == interrupted.digest
    again.close()


def test_a_short_render_leaves_nothing(interrupted: Interrupted, tmp_path: Path) -> None:
    """Unless it is asked for: who stops a preview does not want to clear up."""
    now = [0.0]
    log = Interrupting(tmp_path / "journal", resume=False, clock=lambda: now[0])
    log.left = 5
    with pytest.raises(KeyboardInterrupt):
        render(interrupted.scene, log)
    assert log.picture() is None
    assert list(tmp_path.iterdir()) == []


def test_there_is_no_picture_of_a_journal_that_somebody_has_removed(interrupted: Interrupted, tmp_path: Path) -> None:
    """The render ended with that for an error, and with exit code 2, in place of the interrupt."""
    folder = tmp_path / "kept"
    folder.mkdir()
    log = Interrupting(folder / "journal", resume=False, at_once=True)
    log.left = 12
    with pytest.raises(KeyboardInterrupt):
        render(interrupted.scene, log)
    shutil.rmtree(folder)
    assert log.picture() is None
    log.close()
    log.remove()


def test_the_picture_so_far(interrupted: Interrupted, tmp_path: Path) -> None:
    log = Interrupting(tmp_path / "journal", resume=False, at_once=True)
    log.left = 12
    with pytest.raises(KeyboardInterrupt):
        render(interrupted.scene, log)
    picture = log.picture()
    assert picture is not None
    done = interrupted.kept.buckets[0]
    task = done.task
    assert (picture.layers["beauty"][task.y0 : task.y1, task.x0 : task.x1] == done.result.layers["beauty"]).all()
    log.close()
    assert picture.metadata["partial"] == f"{len(interrupted.kept.buckets)} buckets of 8 pixels"


def test_the_disk_is_asked_as_seldom_as_it_is_slow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At most half a hundredth of the time is spent waiting for it."""
    now, asked = [0.0], []

    def slow(_: int) -> None:
        asked.append(now[0])
        now[0] += 2.0

    writer = RecordWriter(tmp_path / "records", clock=lambda: now[0])
    monkeypatch.setattr("wdpm.rendering.record_file.os.fsync", slow)
    while now[0] < 4000:
        now[0] += 1.0
        writer.append([b"x"])
    writer.close()
    assert 2.0 * len(asked) <= 0.01 * 4000
    assert len(asked) >= 5
