"""What a render tells about itself: times, photons, slaves, and everything that was left out or cut short."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from wdpm.scenes.errors import ImageError

PHASES = ("load", "compile", "partition", "photons", "map", "records", "render")


@dataclass(frozen=True)
class LightPhotons:
    """Photons of one light in one map.

    Attributes:
        name: of the light.
        paths: photon paths that started there.
        stored: photons that these left in the map.
        flux: power of the light, mean of the channels [W].
        use: flux of these photons, as a share of that of all photons in the map; None where it was not measured.
    """

    name: str
    paths: int
    stored: int
    flux: float
    use: float | None = None


@dataclass(frozen=True)
class PhotonCounts:
    """Photons asked for, shot and stored.

    Attributes:
        asked: photons that were to be stored.
        paths: photon paths shot for that.
        stored: photons in the map; every one of them is used.
        lights: the same for each light.
    """

    asked: int = 0
    paths: int = 0
    stored: int = 0
    lights: tuple[LightPhotons, ...] = ()


@dataclass(frozen=True)
class SlaveReport:
    """What one slave held and did.

    Attributes:
        slave: its name.
        cells: cells of the partition that it held.
        triangles: triangles that overlap its cells.
        photons: photons that landed in its cells, of paths that its team traced.
        copies: photons of its cells that landed in another team.
        ghosts: copies of photons of its neighbours, in the overlap band.
        records: irradiance records that reach its cells.
        rays_in, rays_out: rays that came from other cells, and that were sent there.
        bytes_in, bytes_out: of batches from and to other slaves, as they travelled.
        busy_s: time in kernels, all threads together [s].
        peak_memory_bytes: largest resident size of its process.
        spent_s: wall-clock time of its process by what it went to: computing, or a wait by its cause [s]; empty, as are
            the rest, of a render in one process.
        messages: that it sent, by name; without signs of life, which follow the clock.
        batches_by_rays, batches_by_bytes: batches that it sent to other slaves, by the largest power of two that is no
            larger than how many rays (or hits, photons, results) were in them, and than their bytes as they travelled;
            "0" rays for batches that only bring credit home.
    """

    slave: str
    cells: int
    triangles: int
    photons: int
    ghosts: int
    rays_in: int
    rays_out: int
    bytes_in: int
    bytes_out: int
    busy_s: float
    peak_memory_bytes: int
    records: int = 0
    copies: int = 0
    spent_s: dict[str, float] = field(default_factory=dict)
    messages: dict[str, int] = field(default_factory=dict)
    batches_by_rays: dict[str, int] = field(default_factory=dict)
    batches_by_bytes: dict[str, int] = field(default_factory=dict)

    @property
    def held(self) -> int:
        """Photons in its memory."""
        return self.photons + self.copies + self.ghosts


@dataclass(frozen=True)
class EnergyLedger:
    """Where the power of the photon paths went, mean of the channels [W]: emitted = absorbed + escaped + travelling.

    Attributes:
        travelling: what was still under way at the depth limit.
    """

    emitted: float = 0.0
    absorbed: float = 0.0
    escaped: float = 0.0
    travelling: float = 0.0

    @property
    def imbalance(self) -> float:
        """What is missing or too much, as a share of what was emitted."""
        missing = self.emitted - self.absorbed - self.escaped - self.travelling
        return abs(missing) / self.emitted if self.emitted > 0 else abs(missing)


@dataclass(frozen=True)
class KernelReport:
    """The kernels of a render.

    Attributes:
        features: effects that they were compiled for.
        all_effects: whether these are all that there are, by --all-effects.
        kernels: how many kernels depend on the features.
        modules: modules that they are compiled in.
        compiled: modules that this process had to compile, of these or others; the rest came from Warp's cache.
        standing_in: kernels with all effects that began in the place of such as were not compiled.
    """

    features: tuple[str, ...] = ()
    all_effects: bool = False
    kernels: int = 0
    modules: int = 0
    compiled: int = 0
    standing_in: int = 0


@dataclass(frozen=True)
class PassReport:
    """One pass of a progressive render.

    Attributes:
        number: from 0.
        spp: samples a pixel.
        radius: largest gather radius of the global map [scene units].
        seconds: wall-clock seconds by phase.
    """

    number: int
    spp: int
    radius: float
    seconds: dict[str, float]


@dataclass(frozen=True)
class ErrorFigure:
    """An estimate with its interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ErrorParts:
    """A mean squared error, taken apart.

    Attributes:
        noise: what another seed would change.
        bias: what it would not, squared; None if there were too few passes to tell.
        total: both.
    """

    noise: ErrorFigure
    bias: ErrorFigure | None
    total: ErrorFigure | None


@dataclass(frozen=True)
class ErrorReport:
    """What the passes of a render tell about the error of their mean (error_layers).

    Attributes:
        passes: how many.
        mse: mean squared error; rel_mse: relative to the image's square + 0.01, as in comparison.Comparison.
    """

    passes: int
    mse: ErrorParts
    rel_mse: ErrorParts


@dataclass(frozen=True)
class FinalGatherReport:
    """What final gathering and the irradiance cache did; times are of all slaves together [s].

    Attributes:
        points: photons whose irradiance was computed ahead, those in overlap bands once for each cell.
        points_s: time for that.
        rays: gather rays that arrived on a surface.
        short: that went on, being shorter than the radius of the estimate there.
        unread: that went on, since no irradiance was within reach.
        read_s: time of looking it up, but for samples that are followed whole, whose gather rays are not timed.
        records: irradiance records of the view; made, or loaded.
        record_rays: gather rays that were shot to make them.
        records_s: wall-clock time of making them.
        interpolated: vertices whose indirect light came from records.
        uncovered: that no record reached, of surfaces that records serve: gather rays went on from there.
        interpolated_s: time of interpolation, but for samples that are followed whole.
    """

    points: int = 0
    points_s: float = 0.0
    rays: int = 0
    short: int = 0
    unread: int = 0
    read_s: float = 0.0
    records: int = 0
    record_rays: int = 0
    records_s: float = 0.0
    interpolated: int = 0
    uncovered: int = 0
    interpolated_s: float = 0.0


@dataclass(frozen=True)
class Report:
    """All that a render tells about itself.

    Attributes:
        phases: wall-clock seconds by phase, in the order of PHASES.
        triangles: triangles of the scene, each counted once.
        photons, caustics, volume: of the global, the caustic and the volume map.
        vertices: of camera paths beyond their first surface.
        chains_cut: camera paths that were still going at the limit of vertices.
        beams: stretches of camera rays in media, once for each cell that they pass.
        beams_clamped: contributions of photons to these that were too large for their exact sum, and cut.
        gathers: photon gathers of the render.
        gathers_truncated: those with fewer than k photons within the gather radius.
        gathers_left_band: those that may have missed a photon beyond the overlap band; 0 in an exact render.
        gathers_s: time of these, of all slaves together, but for samples that are followed whole [s].
        final_gather: what gather rays and irradiance records did, in renders that have any.
        nonfinite: samples that were NaN or infinite, by cause.
        guards: how often each guard acted, by cause (cluster.work.guards); those above and dropped triangles included.
        chose: what was chosen where nobody said, and why.
        left_out: effects that the scene calls for, and that were left out knowingly.
        approximated: what is only approximated, with its figures.
        warnings: what the loader or the render ignored, dropped, mended or left out.
        passes: of a render in several: all figures above are of all of them together.
        sampled: fewest and most samples of a pixel, where passes were adaptive.
        error: what these tell about the error of the image.
        asked: of a render that was asked for an error or a time: what that was, what is estimated, and whether it was
            reached (goal.outcome.Outcome.to_dict).
        settings: the settings of the render; versions: of wdpm and the packages that its bits depend on.
    """

    phases: dict[str, float] = field(default_factory=dict)
    triangles: int = 0
    photons: PhotonCounts = PhotonCounts()
    caustics: PhotonCounts = PhotonCounts()
    volume: PhotonCounts = PhotonCounts()
    slaves: tuple[SlaveReport, ...] = ()
    kernels: KernelReport = KernelReport()
    vertices: int = 0
    chains_cut: int = 0
    beams: int = 0
    beams_clamped: int = 0
    gathers: int = 0
    gathers_truncated: int = 0
    gathers_left_band: int = 0
    gathers_s: float = 0.0
    final_gather: FinalGatherReport | None = None
    nonfinite: dict[str, int] = field(default_factory=dict)
    guards: dict[str, int] = field(default_factory=dict)
    energy: EnergyLedger = EnergyLedger()
    chose: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    approximated: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    passes: tuple[PassReport, ...] = ()
    sampled: tuple[int, ...] = ()
    error: ErrorReport | None = None
    asked: dict[str, Any] | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def stored(self) -> int:
        """Photons in all maps."""
        return self.photons.stored + self.caustics.stored + self.volume.stored

    def to_dict(self) -> dict[str, Any]:
        """Plain dicts, lists, strings and numbers, as JSON has them; for Image.metadata."""
        plain: dict[str, Any] = json.loads(self.to_json())
        return plain

    def to_json(self) -> str:
        """One JSON object. Raises ValueError when a figure is not finite."""
        return json.dumps(asdict(self), allow_nan=False, indent=2)


def from_dict(data: object) -> Report:
    """The report that `to_dict` gave. Raises ImageError when it is another thing."""
    try:
        report: Report = _restore(Report, data)
    except (TypeError, ValueError) as error:
        raise ImageError(f"not a report of this version of wdpm: {error}") from None
    return report


def _restore(kind: Any, data: Any) -> Any:
    """Rebuild dataclasses and tuples from what JSON left of them. Raises TypeError for an unknown or missing key."""
    if hasattr(kind, "__dataclass_fields__"):
        if not isinstance(data, dict):
            raise TypeError(f"{kind.__name__} must be an object (got {data!r})")
        hints = get_type_hints(kind)
        unknown = sorted(set(data) - set(hints))
        if unknown:
            raise TypeError(f"{kind.__name__} has no field '{unknown[0]}'")
        return kind(**{name: _restore(hints[name], value) for name, value in data.items()})
    if isinstance(kind, UnionType):  # a value or None
        return None if data is None else _restore(next(each for each in get_args(kind) if each is not NoneType), data)
    if get_origin(kind) is tuple:
        if not isinstance(data, list):
            raise TypeError(f"must be a list (got {data!r})")
        return tuple(_restore(get_args(kind)[0], item) for item in data)
    expected = get_origin(kind) or kind
    if expected is float and type(data) is int:
        return float(data)
    if expected is not Any and (not isinstance(data, expected) or (isinstance(data, bool) and expected is not bool)):
        raise TypeError(f"must be {expected.__name__} (got {data!r})")
    return data


PACKAGES = ("wdpm", "warp-lang", "numpy")
"""Packages whose versions the bits of an image may depend on."""
