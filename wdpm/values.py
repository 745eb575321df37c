"""Values on the command line: sizes, counts, memory, addresses. Each parser says in one line what it expected."""

from __future__ import annotations

import math
import re
from argparse import ArgumentTypeError

from wdpm.cluster.plan.copies import Copies
from wdpm.scenes.model.viewpoint import Viewpoint

_COUNT_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
MOST_STOPS = 64.0
"""Size of an exposure: beyond it there is nothing to be seen."""

MOST_FRAMES = 1_000_000
"""Of a sequence: some eleven hours of film. What is known of each is held from the beginning."""

_MEMORY_UNITS = {"k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}


def size(text: str) -> tuple[int, int]:
    """`512x384` to (width, height)."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if match is None or 0 in (int(match[1]), int(match[2])):
        raise ArgumentTypeError(
            f"'{text}' is not a size: expected WIDTHxHEIGHT in pixels, both at least 1, like 512x384"
        )
    return int(match[1]), int(match[2])


def region(text: str) -> tuple[int, int, int, int]:
    """`0,0,64,64` to (left, top, right, bottom)."""
    match = re.fullmatch(r"(\d+),(\d+),(\d+),(\d+)", text)
    if match is None:
        raise ArgumentTypeError(f"'{text}' is not a region: expected LEFT,TOP,RIGHT,BOTTOM in pixels, like 0,0,64,64")
    left, top, right, bottom = map(int, match.groups())
    return left, top, right, bottom


def camera(text: str) -> Viewpoint | str:
    """A viewpoint, or the name of a camera: what has a slash, or points alone, is a viewpoint."""
    points = "," in text and re.fullmatch(r"[-+\d.,eE/\s]*", text) is not None
    return viewpoint(text) if "/" in text or points else text


def viewpoint(text: str) -> Viewpoint:
    """`0,1,5/0,1,0/0,1,0/40` to a viewpoint; the direction that is up and the field of view may be left out."""
    try:
        parts = [tuple(float(number) for number in part.split(",")) for part in text.split("/")]
        lone = [part[0] for part in parts[2:] if len(part) == 1]
        points = [(part[0], part[1], part[2]) for part in parts if len(part) == 3]
    except ValueError:
        parts, lone, points = [], [], []
    fine = len(lone) <= 1 and 2 <= len(points) <= 3 and len(points) + len(lone) == len(parts)
    fine = fine and (not lone or (len(parts[-1]) == 1 and 0.0 < lone[0] < 180.0))
    if not fine or not all(math.isfinite(axis) for point in points for axis in point):
        raise ArgumentTypeError(
            f"'{text}' is not a camera: expected FROM/AT, FROM/AT/UP, FROM/AT/FOV or FROM/AT/UP/FOV, with points x,y,z "
            "and FOV between 0 and 180 degrees, like 0,1,5/0,1,0/40"
        )
    up = points[2] if len(points) == 3 else (0.0, 1.0, 0.0)
    return Viewpoint(points[0], points[1], up, lone[0] if lone else None)


def viewpoint_text(given: Viewpoint) -> str:
    """What `viewpoint` reads as the same."""
    points = [",".join(map(repr, point)) for point in (given.origin, given.target, given.up)]
    return "/".join(points if given.fov is None else [*points, repr(given.fov)])


def exposure(text: str) -> float | str:
    """`auto`, or stops such as -1.5."""
    if text == "auto":
        return text
    try:
        stops = float(text)
    except ValueError:
        stops = math.nan
    if not abs(stops) <= MOST_STOPS:
        raise ArgumentTypeError(f"'{text}' is not an exposure: expected auto, or stops (each doubles), like 1.5 or -2")
    return stops


def frames(text: str) -> tuple[int, ...]:
    """`1..24`, `1..24..2` (every other one) or `7`."""
    match = re.fullmatch(r"(\d{1,9})(?:\.\.(\d{1,9})(?:\.\.(\d{1,9}))?)?", text)
    first, last, step = (int(part or 0) for part in match.groups()) if match else (1, 0, 0)
    if match is not None and match[2] is None:
        last = first
    step = step or 1 if match is None or match[3] is None else step
    if last < first or step < 1:
        raise ArgumentTypeError(f"'{text}' are no frames: expected FIRST..LAST, FIRST..LAST..STEP or one number")
    if len(range(first, last + 1, step)) > MOST_FRAMES:
        raise ArgumentTypeError(f"'{text}' are more than {MOST_FRAMES:,} frames: render them in several parts")
    return tuple(range(first, last + 1, step))


def rate(text: str) -> float:
    """A number above 0."""
    number = length(text)
    if not (0.0 < number < math.inf):
        raise ArgumentTypeError(f"'{text}' must be above 0")
    return number


def sample(text: str) -> tuple[int, int, int]:
    """`10,7,3` to (x, y, sample)."""
    match = re.fullmatch(r"(\d+),(\d+),(\d+)", text)
    if match is None:
        raise ArgumentTypeError(f"'{text}' is not a sample: expected X,Y,SAMPLE, all from 0, like 10,7,3")
    x, y, number = map(int, match.groups())
    return x, y, number


def count(text: str) -> int:
    """`250k`, `1M`, `2.5M` or a plain number, 0 or more."""
    match = re.fullmatch(r"(\d+)(?:\.(\d+))?([kKmMgG]?)", text)
    if match is not None:
        unit, decimals = _COUNT_UNITS[match[3].lower()], match[2] or ""
        scaled, rest = divmod(int(match[1] + decimals) * unit, 10 ** len(decimals))
        if rest == 0:
            return scaled
    raise ArgumentTypeError(
        f"'{text}' is not a count: expected a whole number, or one with k, M or G, like 250k or 1.5M"
    )


def slaves(text: str) -> tuple[int, int]:
    """How many slaves to begin with, and how many there may be: 4, or 2..8."""
    least, _, most = text.partition("..")
    numbers = positive_count(least), positive_count(most or least)
    if numbers[1] < numbers[0]:
        raise ArgumentTypeError(f"'{text}': begins with more slaves than there may be")
    return numbers


def cluster_sizes(text: str) -> tuple[int, ...]:
    """`2..256` to the powers of two between, ends included; or `2,4,12` as they are. Each once."""
    match = re.fullmatch(r"(\d{1,6})\.\.(\d{1,6})", text)
    if match is None:
        return tuple(dict.fromkeys(positive_count(part) for part in text.split(",")))
    first, last = positive_count(match[1]), positive_count(match[2])
    if last < first:
        raise ArgumentTypeError(f"'{text}' has no size in it: expected FIRST..LAST, like 2..256")
    between = [1 << power for power in range(last.bit_length()) if first < 1 << power < last]
    return tuple(dict.fromkeys((first, *between, last)))


def bandwidth(text: str) -> float:
    """`10Gb`, `100Mb` (bits a second) or `1GB` (bytes) to bytes a second."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([kMG])(b|B)(?:/s)?", text)
    size = 0.0 if match is None else float(match[1]) * _COUNT_UNITS[match[2].lower()] / (8 if match[3] == "b" else 1)
    if not size:
        raise ArgumentTypeError(f"'{text}' is no bandwidth: expected bits or bytes a second above 0, like 10Gb or 1GB")
    return size


def latency(text: str) -> float:
    """`50us`, `1.5ms` or `2s` to seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)(us|ms|s)", text)
    if match is None:
        raise ArgumentTypeError(f"'{text}' is no latency: expected a time with its unit, like 50us or 1.5ms")
    return float(match[1]) * {"us": 1e-6, "ms": 1e-3, "s": 1.0}[match[2]]


def copies(text: str) -> Copies:
    """Whether slaves hold copies of what others hold."""
    try:
        return Copies(text)
    except ValueError:
        known = ", ".join(each.value for each in Copies)
        raise ArgumentTypeError(f"'{text}': expected one of {known}") from None


def positive_count(text: str) -> int:
    """A count of at least 1."""
    number = count(text)
    if number == 0:
        raise ArgumentTypeError("must be at least 1")
    return number


def counts(text: str) -> tuple[int, ...]:
    """Counts of at least 1, separated by commas."""
    return tuple(positive_count(each.strip()) for each in text.split(","))


def length(text: str) -> float:
    """A number; its range is for the settings to check."""
    try:
        return float(text)
    except ValueError:
        raise ArgumentTypeError(f"'{text}' is not a number") from None


def error_bound(text: str) -> float:
    """A positive number."""
    number = length(text)
    if not 0.0 < number < math.inf:
        raise ArgumentTypeError(f"'{text}' is not an error: expected a positive number, like 0.02")
    return number


def memory(text: str) -> int:
    """`8G` or `512M` to bytes, in powers of 1024."""
    match = re.fullmatch(r"(\d+)([kKmMgGtT])", text)
    if match is None or int(match[1]) == 0:
        raise ArgumentTypeError(
            f"'{text}' is not an amount of memory: expected a whole number with K, M, G or T, like 8G"
        )
    return int(match[1]) * _MEMORY_UNITS[match[2].lower()]


def address(text: str) -> str:
    """`tcp://HOST:PORT`, also with an IPv6 address in brackets."""
    match = re.fullmatch(r"tcp://(?:[^\s:/\[\]]+|\[[0-9a-fA-F:.%]+\]):(\d{1,5})", text)
    if match is None or not 0 < int(match[1]) < 65536:
        raise ArgumentTypeError(f"'{text}' is not an address: expected tcp://HOST:PORT, like tcp://127.0.0.1:7117")
    return text


def address_of_master(text: str) -> str:
    """The same, or where a master that started slaves itself has them find it: `ipc://FOLDER/NAME`."""
    return text if re.fullmatch(r"ipc:///.+", text) else address(text)


def device(text: str) -> str:
    """`cpu`, `cuda` or `cuda:N`."""
    if re.fullmatch(r"cpu|cuda(:\d+)?", text) is None:
        raise ArgumentTypeError(f"'{text}' is not a device: expected cpu or cuda:N, like cuda:0")
    return text


def definition(text: str) -> tuple[str, str]:
    """`name=value`."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise ArgumentTypeError(f"'{text}' is not a definition: expected NAME=VALUE, like spp=64")
    return name, value


def names(text: str) -> tuple[str, ...]:
    """Names separated by commas."""
    found = tuple(name.strip() for name in text.split(","))
    if not all(found):
        raise ArgumentTypeError(f"'{text}' must be names separated by commas")
    return found


def duration(text: str) -> float:
    """`90`, `90s`, `5m` or `1.5h`, in seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)(s|m|h)?", text)
    seconds = float(match[1]) * {"s": 1, "m": 60, "h": 3600}[match[2] or "s"] if match else 0.0
    if seconds <= 0:
        raise ArgumentTypeError(f"'{text}' is not a time: expected seconds, or one with s, m or h, like 5m")
    return seconds
