"""From a master's instructions to whoever is told how far a render is, and whoever is shown the image."""

from __future__ import annotations

from collections.abc import Iterable

from wdpm.cluster.display import OF_NOBODY, Bucket, Display, Frame
from wdpm.cluster.kept import BucketKept, Keeper, RecordsKept
from wdpm.cluster.master import events as m
from wdpm.cluster.master.members import Member, Members
from wdpm.cluster.progress import ProgressObserver
from wdpm.cluster.session import Session
from wdpm.cluster.task import BucketRendered, BucketTask, RecordsMade, RecordTask, Task, TaskResult


def tell_observer(instruction: m.Instruction, observer: ProgressObserver | None) -> None:
    """Pass on what an instruction says about progress; nothing if it says nothing, or nobody listens."""
    if observer is None:
        return
    match instruction:
        case m.Started(phase, total):
            observer.start(phase, total)
        case m.Advanced(amount):
            observer.advance(amount)
        case m.Noted(text):
            observer.note(text)


def tell_display(answer: object, display: Display | None) -> None:
    """Pass on what an instruction says about the image; nothing if it says nothing, or nobody looks."""
    if display is None:
        return
    match answer:
        case m.FrameBegun(frame):
            display.begin(frame)
        case m.BucketDone(bucket):
            display.bucket(bucket)
        case m.SlavesSeen(slaves):
            display.slaves(slaves)
        case m.Finished(result):
            display.end(result.statistics)


def tell_keeper(answer: object, keeper: Keeper | None) -> None:
    """Pass on what is worth keeping."""
    if keeper is not None and isinstance(answer, m.WorthKeeping):
        keeper.keep(answer.done)


def worth_keeping(task: Task, result: TaskResult) -> list[m.Instruction]:
    """What of a task is worth keeping: photons are not, since no slave that takes over has them."""
    if isinstance(task, BucketTask) and isinstance(result, BucketRendered):
        return [m.WorthKeeping(BucketKept(task, result))]
    if isinstance(task, RecordTask) and isinstance(result, RecordsMade):
        return [m.WorthKeeping(RecordsKept(task, result))]
    return []


def shown_again(kept: Iterable[BucketKept]) -> list[m.Instruction]:
    """Pixels that were kept, for those who show the image."""
    return [m.BucketDone(Bucket(each.task.x0, each.task.y0, each.result.layers, OF_NOBODY)) for each in kept]


def frame_begun(session: Session, holders: tuple[int, ...], members: Members) -> m.FrameBegun:
    """The image of a session begins."""
    view = session.view
    slaves = tuple(member.name for member in members.ever_joined)
    camera = view.camera
    return m.FrameBegun(
        Frame(
            camera.width,
            camera.height,
            session.layers,
            view.first_sample,
            view.spp,
            holders,
            slaves,
            view.allotment,
        )
    )


def bucket_done(member: Member, result: TaskResult) -> list[m.Instruction]:
    """The pixels that a slave's result brings, if it is one of a bucket."""
    if not isinstance(result, BucketRendered):
        return []
    return [m.BucketDone(Bucket(result.x0, result.y0, result.layers, member.number))]
