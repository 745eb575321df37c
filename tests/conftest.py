"""What all tests share."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import warp as wp
from failures import (  # noqa: F401 - hooks
    pytest_runtest_logreport,
    pytest_runtest_makereport,
    pytest_sessionfinish,
)
from hypothesis import HealthCheck, Phase, settings

# The same examples every time, and no limits of time: a shared machine is slow at times, and kernels compile at first
# use. HYPOTHESIS_PROFILE=search looks for new examples, unshrunk makes none of those that fail simpler.
UNHURRIED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("repeatable", UNHURRIED, derandomize=True)
settings.register_profile("search", UNHURRIED)
settings.register_profile("unshrunk", UNHURRIED, derandomize=True, phases=(Phase.explicit, Phase.generate))
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

SCENES_VARIABLE = "WDPM_SCENES"
FOREIGN_VARIABLE = "WDPM_FOREIGN_SCENES"

OWN_KERNELS = pytest.StashKey[bool]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs the scenes with references, or those of others, where they are not."""
    wanted = {
        "shared": (SCENES_VARIABLE, "a folder of Mitsuba scenes with references"),
        "foreign": (FOREIGN_VARIABLE, "a folder of Mitsuba scenes of others"),
    }
    for marker, (variable, what) in wanted.items():
        if os.environ.get(variable):
            continue
        skip = pytest.mark.skip(reason=f"{variable} is not set: it names {what}")
        for item in items:
            if item.get_closest_marker(marker):
                item.add_marker(skip)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Before its fixtures are made, whatever their scope."""
    item.session.stash[OWN_KERNELS] = item.get_closest_marker("own_kernels") is not None


@pytest.fixture(scope="session", autouse=True)
def _signals_reach_processes() -> None:
    """That tests start: from a shell's background, or nohup, they would inherit that these are ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: None)  # which a process that is started does not inherit


@pytest.fixture(scope="session", autouse=True)
def _kernels_of_all_tests(request: pytest.FixtureRequest) -> Iterator[None]:
    """Scenes have the kernels that all tests share, for no effects or for all: to compile others takes 20 s each time.

    No bit depends on it, which tests with a scene's own kernels hold; they are marked own_kernels.
    """
    from wdpm.kernels import compile as compiling
    from wdpm.kernels.features import ALL, Features
    from wdpm.kernels.stand_ins import Chosen, own_kernels, stand_ins
    from wdpm.kernels.variants import CAN_DO_WITHOUT

    def chosen(features: Features) -> Chosen:
        own = own_kernels(features)
        if request.session.stash[OWN_KERNELS] or features in (Features(), compiling.ALL_AT_ONCE, ALL):
            return own
        names = frozenset(own.variants.kernels())
        every = {name: kernel for name, kernel in stand_ins().kernels().items() if name in names}
        variants = replace(own.variants, **{**every, **dict.fromkeys(names & CAN_DO_WITHOUT)})
        return Chosen(variants, ALL, names)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiling, "own_kernels", chosen)
        patch.setattr(compiling, "make_variants", lambda features: chosen(features).variants)
        yield


@pytest.fixture(autouse=True)
def _process_as_it_was() -> Iterator[None]:
    """Put back what belongs to the whole process: no test may depend on which tests ran before it there.

    Commands keep Warp quiet for the rest of their process, and a test of theirs is not the end of it.
    """
    environment, folder, log_level = dict(os.environ), Path.cwd(), wp.config.log_level
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    hook = sys.unraisablehook
    policy = os.sched_getscheduler(0) if hasattr(os, "sched_getscheduler") else None  # slaves change it
    yield
    if dict(os.environ) != environment:
        os.environ.clear()
        os.environ.update(environment)
    os.chdir(folder)
    wp.config.log_level = log_level
    for number, handler in handlers.items():
        signal.signal(number, handler)
    sys.unraisablehook = hook
    if policy is not None and os.sched_getscheduler(0) != policy:
        os.sched_setscheduler(0, policy, os.sched_param(0))


@pytest.fixture(scope="module")
def small_pilot() -> Iterator[None]:
    """A shorter photon pilot and fewer surface points: the same for all renders of a file, and quicker."""
    from wdpm.cluster.plan import map_plans, photon_pilot

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photon_pilot, "PILOT_PATHS", 1 << 12)
        patch.setattr(map_plans, "POINTS_LEAST", 1 << 12)
        yield


@pytest.fixture(scope="session")
def scenes_dir() -> Path:
    """The folder of scenes with references; only for tests that are marked `shared`."""
    folder = Path(os.environ[SCENES_VARIABLE])
    assert folder.is_dir(), f"{SCENES_VARIABLE} names {folder}, which is not a folder"
    return folder


@pytest.fixture
def empty_cache(tmp_path: Path) -> Iterator[Path]:
    """A folder for compiled kernels with none in it."""
    from wdpm.kernels.cached import cache_folder, use_cache_folder

    before = cache_folder()
    use_cache_folder(tmp_path)
    yield tmp_path
    use_cache_folder(before)
