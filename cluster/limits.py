"""Limits that a cluster keeps: of time, of sizes, of what is in flight. None of them changes a bit of the image."""

from __future__ import annotations

from dataclasses import dataclass

from wdpm.scenes.errors import SettingsError

MOST_SLAVES = 256
"""Each has a connection with every other one, which takes three sockets of ZeroMQ's and five of the system's files."""


def check_most_slaves(slaves: int) -> None:
    """Raise SettingsError for more slaves than there can be at a time."""
    if slaves > MOST_SLAVES:
        raise SettingsError(f"{slaves} slaves: at most {MOST_SLAVES} can be connected with each other")


DEAD_S = 90.0
"""Silence that counts as death [s]: a laptop's lid, a process that is stopped for a minute or a switch that starts
again are none. It is only waited for where nothing else tells: a process that dies closes its connections."""


@dataclass(frozen=True, kw_only=True)
class ClusterLimits:
    """Limits of a cluster; the master's hold for its slaves.

    Attributes:
        heartbeat_s: a process sends something at least this often [s].
        late_s: silence that is worth a word [s]. Five heartbeats: long enough for a machine that swaps for a moment.
        dead_s: silence that counts as death [s].
        rejoin_s: how long a master that has lost all its slaves waits for another one [s].
        peer_gone_s: time between the news that a connection between slaves broke and a new beginning of their team [s].
            One of the two may have died, or may be stopping: the master then hears so itself.
        peer_answer_s: time after which the person hears that a slave has not answered another one's greeting [s]. Far
            more than any link takes; a machine that no packet reaches never does. After `dead_s` the render ends.
        join_first_s: first wait of a slave for the master's answer [s]; it doubles with every try ...
        join_longest_s: ... up to this [s]. Both as in the Paranoid Pirate pattern of the ZeroMQ guide.
        rejoin_longest_s: the same for a slave that has lost its master: one that is started again has work for it [s].
        join_timeout_s: how long a master that has something to render waits for slaves that have not joined [s] ...
        join_news_s: ... and how often it says who has [s].
        photon_task_paths: photon paths a task. Enough for long kernel launches, few enough that the rays of all tasks
            in flight stay within some 10 MB.
        photon_tasks_in_flight: photon tasks handed to a slave at once; the second keeps it busy while the first one's
            last photons travel.
        record_parts: where there are several slaves, each is handed an even share of the candidates of a round that are
            left, divided by this, and then as much of what is left then: so the last tasks are small ...
        record_even: where they are processes of one machine, which are equally fast, they are handed this much of what
            is left at a time, and all of it if another task each would not be worth it ...
        record_task_spread: ... but none is smaller than the first by more than this factor ...
        record_task_rays: ... nor expected to have fewer gather rays than this, unless a slave would have no task: they
            take three times as long as what the interpreter does for a task however small ...
        record_task_least, record_task_most: ... and all are within these numbers of candidates. All of an early round
            become records, few of a late one.
        record_home_rays: gather rays, as many as set out at once, that are worth one more home of records where slaves
            hold but parts of the scene, and share cores: all of them work at each task there.
        buckets_in_flight: buckets or tasks of records handed to a slave at once: one to be at, and one to go on with.
            Of more, a slave that is slower than it seemed would still have some when others have none.
        shared_in_flight: the same where a slave holds but a part of the scene. Its buckets wait for its peers, and all
            that is in flight must keep each cell busy, and many a bucket sees few of them.
        cells_in_flight: cells on their way to slaves at once. Bounds what the master holds besides the scene.
        part_triangles: triangles of one Partition message, 140 bytes each: 9 MB. What is swallowed on the way is missed
            the later, the longer a message is (transport.receipts).
    """

    heartbeat_s: float = 2.0
    late_s: float = 10.0
    dead_s: float = DEAD_S
    rejoin_s: float = 60.0
    peer_gone_s: float = 2.0
    peer_answer_s: float = 15.0
    join_first_s: float = 1.0
    join_longest_s: float = 32.0
    rejoin_longest_s: float = 4.0
    join_timeout_s: float = 600.0
    join_news_s: float = 30.0
    photon_task_paths: int = 65_536
    photon_tasks_in_flight: int = 2
    record_parts: float = 1.5
    record_even: float = 0.75
    record_task_spread: int = 8
    record_task_rays: int = 32_768
    record_task_least: int = 32
    record_task_most: int = 131_072
    record_home_rays: int = 131_072
    buckets_in_flight: int = 2
    shared_in_flight: int = 6
    cells_in_flight: int = 2
    part_triangles: int = 65_536

    @property
    def slept_s(self) -> float:
        """Time between two ticks of a process's loop after which the process itself stood still, a laptop's lid say, so
        that the silence of others says nothing [s]: far more than a turn of the loop takes."""
        return max(self.late_s / 2, 1.0)
