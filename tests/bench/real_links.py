"""Holds `wdpm bench scaling --simulate` against real slaves on links that are slow on purpose.

Every slave, and the master, gets a network namespace with an interface whose rate the system keeps (tc, tbf); a bridge
joins them. Needs Linux, iproute2 and the rights of the superuser, so it is no test of the suite:

    python tests/bench/real_links.py cornell-box --slaves 2 --rate 20
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from wdpm.bench.scaling import warm_render
from wdpm.bench.simulation.machines import Link
from wdpm.bench.simulation.measure import Description, simulate
from wdpm.cluster.plan.copies import Copies
from wdpm.clusters import Cluster
from wdpm.progress import SilentProgress
from wdpm.quiet import quiet_warp
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.scene_settings import settings_for
from wdpm.scenes.load import load

PORT = 7117
BRIDGE_S = 50e-6
"""From one namespace to another, about."""


def main() -> None:
    """Measure, simulate, and print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--slaves", type=int, default=2)
    parser.add_argument("--copies", choices=[each.value for each in Copies], default="none")
    parser.add_argument("--rate", type=float, default=20.0, help="Mbit/s of every interface, each way")
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--photons", type=int, default=20_000)
    parser.add_argument("--inside", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.inside:
        print(json.dumps(_render(args)))
        return
    real = _measured(args)
    link = Link(args.rate * 1e6 / 8, BRIDGE_S)
    chosen = {"size": (args.size, args.size), "spp": args.spp, "photons": args.photons}
    description = Description(link, apart=True)
    [run] = simulate(args.scene, (args.slaves,), (Copies(args.copies),), description, SilentProgress(), **chosen).runs
    real["difference"] = run.seconds / real["seconds"] - 1.0
    print(json.dumps({"simulated": {"seconds": run.seconds, "phases": run.phases, "sent": run.sent}, "real": real}))


def _render(args: argparse.Namespace) -> dict[str, Any]:
    """As the master, in its namespace: the second render of a warm cluster."""
    quiet_warp()
    scene = load(args.scene, size=(args.size, args.size))
    settings = settings_for(scene, spp=args.spp, photons=args.photons)
    with Cluster.listen(args.inside, args.slaves, copies=Copies(args.copies), insecure=True) as cluster:
        warm_render(scene, settings, cluster)
        began = time.perf_counter()
        image = render_in_passes(scene, cluster, settings)
        seconds = time.perf_counter() - began
    report = image.metadata["report"]
    return {
        "seconds": seconds,
        "phases": report["phases"],
        "between_slaves": sum(each["bytes_out"] for each in report["slaves"]),
    }


def _measured(args: argparse.Namespace) -> dict[str, Any]:
    with ExitStack() as stack:
        names = stack.enter_context(_namespaces(args.slaves + 1, args.rate))
        address = f"tcp://10.77.0.1:{PORT}"
        words = [sys.executable, __file__, *sys.argv[1:], "--inside", address]
        master = stack.enter_context(_process(names[0], words, stdout=subprocess.PIPE))
        for name in names[1:]:
            stack.enter_context(
                _process(name, [sys.executable, "-m", "wdpm", "slave", address, "--threads", "1", "--insecure"])
            )
        told, _ = master.communicate(timeout=500)
        figures: dict[str, Any] = json.loads(told.splitlines()[-1])
        return figures


@contextmanager
def _process(namespace: str, words: list[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(["ip", "netns", "exec", namespace, *words], env=dict(os.environ), **options)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


@contextmanager
def _namespaces(count: int, rate: float) -> Iterator[list[str]]:
    """Namespaces with addresses 10.77.0.1, 10.77.0.2, ... whose interfaces are that slow both ways."""
    mine = f"wdpm{os.getpid()}"
    names = [f"{mine}n{number}" for number in range(count)]
    shape = f"tbf rate {rate}mbit burst 16kb limit 256mb"
    try:
        for name in (mine, *names):
            _ip(f"netns add {name}")
        _ip(f"-n {mine} link add bridge type bridge")
        _ip(f"-n {mine} link set bridge up")
        for number, name in enumerate(names):
            _ip(f"-n {mine} link add port{number} type veth peer name eth0 netns {name}")
            _ip(f"-n {mine} link set port{number} master bridge up")
            _ip(f"-n {name} addr add 10.77.0.{number + 1}/24 dev eth0")
            _ip(f"-n {name} link set eth0 up")
            _ip(f"-n {name} link set lo up")
            _run(["tc", "-n", name, *f"qdisc add dev eth0 root {shape}".split()])
            _run(["tc", "-n", mine, *f"qdisc add dev port{number} root {shape}".split()])
        yield names
    finally:
        for name in (*names, mine):
            subprocess.run(["ip", "netns", "del", name], check=False, stderr=subprocess.DEVNULL)


def _ip(words: str) -> None:
    _run(["ip", *words.split()])


def _run(words: list[str]) -> None:
    subprocess.run(words, check=True)


if __name__ == "__main__":
    main()
