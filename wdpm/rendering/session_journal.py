"""A journal of the pass that is being rendered: what is finished of it, on disk as it comes.

    journal = SessionJournal(path, resume=True)
    session = journal.begin(prepared, session, plan, note)   # with what the journal has of it
    backend.keeper = journal

It is a file of records (record_file): first what it is of (journal_head), then buckets and irradiance records, packed
and checked as on the wire. Passes that are complete are kept elsewhere (pass_journal); a new pass begins the file anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wdpm.cluster.kept import BucketKept, Kept, RecordsKept, TaskKept
from wdpm.cluster.master.film import Film
from wdpm.cluster.messages import packing
from wdpm.cluster.records import candidate_count, check_records
from wdpm.cluster.session import Session
from wdpm.images.image import Image
from wdpm.rendering.journal_head import JournalHead, differences, head_of, is_of_later_pass
from wdpm.rendering.pass_plan import PassPlan
from wdpm.rendering.prepare import Prepared
from wdpm.rendering.record_file import FileLock, Frame, RecordWriter, read_records
from wdpm.scenes.errors import JournalInUseError, ProtocolError, SettingsError

WORTH_S = 10.0
"""A render that takes no longer leaves no journal [s], unless one was asked for."""

_HEAD = {"JournalHead": JournalHead}
_DONE = {"BucketKept": BucketKept, "RecordsKept": RecordsKept}


@dataclass(frozen=True)
class _Left:
    """What an interrupted render left: what it is of, and where that ends in the file."""

    head: JournalHead
    end: int


class SessionJournal:
    """Keeps what is finished (a cluster.kept.Keeper), and finds what was.

    Args:
        path: of the file.
        resume: go on with what is there; there may be nothing.
        at_once: begin to write with the first bucket, however short the render may be.
        clock: seconds, growing.

    Attributes:
        mean: of the passes that were complete when the render was interrupted, if there were some.

    Raises:
        JournalInUseError: another process renders the same image, and writes it.
        SettingsError: there is a journal, and it is not to be gone on with; or it cannot be.
    """

    def __init__(
        self, path: Path, *, resume: bool, at_once: bool = False, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.path = path
        self._clock = clock
        self._write_at = clock() + (0.0 if at_once else WORTH_S)
        self._writer: RecordWriter | None = None
        self._waiting: list[list[Frame]] = []
        self._note: Callable[[str], object] = lambda _: None
        self._failed = False
        self._lock: FileLock | None = None
        self.mean: Image | None = None
        self._left = self._found(resume) if path.exists() else None

    def _found(self, resume: bool) -> _Left | None:
        """What there is, which nobody else may write from now on."""
        self._lock = _locked(self.path)
        try:
            if resume or not self.path.stat().st_size:  # a writer that got no further than to its lock keeps nothing
                return _read_head(self.path)
        except (OSError, SettingsError):
            self.close()
            raise
        self.close()
        raise SettingsError(
            f"{self.path}: keeps what an interrupted render has done; give --resume to go on with it, or delete it"
        )

    def begin(self, prepared: Prepared, session: Session, plan: PassPlan, note: Callable[[str], object]) -> Session:
        """A pass begins. Returns its session, with what is done of it already.

        Args:
            note: shows a person a line.

        Raises:
            SettingsError: the journal is of another render.
        """
        self._note = note
        self._close_writer()
        head = head_of(prepared, session, plan)
        left, self._left = self._left, None
        if left is not None and is_of_later_pass(left.head, head):
            note(f"{self.path}: is of pass {left.head.number + 1}, but those before it were not kept; it begins anew")
            left = None
        if left is None or left.head.number < plan.number:  # a pass that is complete, and kept elsewhere
            self._waiting = [packing.encode(head)]
            return session
        found = differences(left.head, head)
        if found:
            self.close()
            raise SettingsError(
                f"{self.path}: is of {', and '.join(found)}; give the same as before, or delete it to begin anew"
            )
        session = replace(session, view=replace(session.view, bucket=left.head.bucket))
        kept, end = self._kept(session, left)
        lost = self.path.stat().st_size - end
        note(
            f"goes on with {self.path}: {len(kept.buckets)} buckets and irradiance records of "
            f"{sum(each.task.count for each in kept.records)} candidates are done"
            + (f"; its last {lost} bytes were cut off or changed" if lost else "")
        )
        self._try(lambda: self._open(end))
        return replace(session, kept=kept)

    def keep(self, done: TaskKept) -> None:
        """Add what is done. A file that cannot be written any more ends the journal, not the render."""
        if self._failed:
            return
        self._waiting.append(packing.encode(done))
        if self._writer is not None or self._clock() >= self._write_at:
            self._try(self._write)

    def picture(self) -> Image | None:
        """The image as far as it is: the mean of passes, or what is on disk and black elsewhere. None for nothing."""
        if self.mean is not None or self._writer is None:
            return self.mean
        if not self.path.exists():  # somebody has removed it, or its folder: what ended the render is told all the same
            return None
        left = _read_head(self.path)
        if left is None:
            return None
        head, buckets = left.head, 0
        film = Film(head.width, head.height, head.channels)
        for done, _ in _finished(self.path):
            if isinstance(done, BucketKept):
                film.put(done.task, done.result)
                buckets += 1
        return Image(film.layers, {"partial": f"{buckets} buckets of {head.bucket} pixels"}) if buckets else None

    def close(self) -> None:
        """Let go of the file; may be called again."""
        self._close_writer()
        if self._lock is not None:
            self._lock.release()
        self._lock = None

    def remove(self) -> None:
        """All is done: the file goes, if it is this render's, as one that was let go of is no more."""
        self._close_writer()  # Windows takes no name from a file that is open
        if self._lock is not None:
            self.path.unlink(missing_ok=True)
        self.close()

    def _close_writer(self) -> None:
        if self._writer is not None:
            self._writer.close()
        self._writer, self._waiting = None, []

    def _kept(self, session: Session, left: _Left) -> tuple[Kept, int]:
        """What the file holds of a session, and where that ends."""
        film = Film(session.view.camera.width, session.view.camera.height, session.layers)
        buckets: list[BucketKept] = []
        records: list[RecordsKept] = []
        end = left.end
        for done, ends in _finished(self.path):
            try:
                if isinstance(done, BucketKept):
                    film.check(done.task, done.result)
                    buckets.append(done)
                else:
                    _check(done, session, records)
                    records.append(done)
            except ProtocolError:  # whole, and yet wrong: as good as cut off
                break
            end = ends
        return Kept(tuple(buckets), tuple(records)), end

    def _write(self) -> None:
        if self._writer is None:
            self._open(0)
        if self._writer is not None:
            for frames in self._waiting:
                self._writer.append(frames)
            self._waiting = []

    def _open(self, end: int) -> None:
        if self._lock is None:
            self._lock = FileLock(self.path)
        self._writer = RecordWriter(self.path, end, self._clock)

    def _try(self, write: Callable[[], None]) -> None:
        try:
            write()
        except OSError as error:
            self._failed = True
            self._close_writer()
            why = "another render writes it" if isinstance(error, BlockingIOError) else error.strerror or error
            self._note(f"{self.path}: cannot be written any more ({why}); the render goes on without")


def _locked(path: Path) -> FileLock | None:
    """The right to write a journal that is there; None if this process may not write it anyway."""
    try:
        return FileLock(path)
    except BlockingIOError:
        raise JournalInUseError(
            f"{path}: another process that renders this image writes it; wait for that one, or name another image"
        ) from None
    except OSError:  # found and told where it is read or written
        return None


def _read_head(path: Path) -> _Left | None:
    """What a journal is of; None if its writer did not come so far."""
    try:
        first = next(read_records(path), None)
        head = None if first is None else packing.decode(first[0], _HEAD)
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        if path.stat().st_size == 0:
            return None
        raise SettingsError(f"{path}: {error}; move it away, or choose another place by --journal") from None
    except ProtocolError as error:
        raise SettingsError(
            f"{path}: was written by another version of wdpm ({error}); go on with that one, or delete it"
        ) from None
    if first is None or not isinstance(head, JournalHead) or not head.sound:
        return None
    return _Left(head, first[1])


def _finished(path: Path) -> Iterator[tuple[TaskKept, int]]:
    """What a journal says is done, and where that ends in the file."""
    whole = read_records(path)
    next(whole)
    for frames, end in whole:
        try:
            done: TaskKept = packing.decode(frames, _DONE)
        except ProtocolError:
            return
        yield done, end


def _check(done: RecordsKept, session: Session, before: list[RecordsKept]) -> None:
    """Raise ProtocolError unless irradiance records may be those of a session, and are no others' once more."""
    task, result, view = done.task, done.result, session.view
    count = 0
    if task.round < view.cache.rounds:
        count = candidate_count(view.camera.width, view.camera.height, view.cache, task.round)
    if result.round != task.round or task.stop > count or result.rays < 0:
        raise ProtocolError(f"irradiance records of round {task.round} are none of this view")
    check_records(result.records, task.round, task.start, task.stop, task.some)
    for other in (each.task for each in before if each.task.round == task.round):
        if len(np.intersect1d(task.candidates, other.candidates, assume_unique=True)):
            raise ProtocolError(f"irradiance records of round {task.round} are there twice")
