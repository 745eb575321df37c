"""What a pass of so many samples will take, by what the last ones took."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from wdpm.rendering.pass_plan import share_of_rays

RECORDS_GROW = 1.5
"""By this power of the rays that all have, what records take: they may err less, too, and those that do have more rays.
In daylight through blinds it was 1.4 from 14 to 42 samples, and 1.45 to 99."""

FAR_APART = 0.5
"""By so many times their samples two passes differ, or what they took tells more of the machine than of a sample."""

LEAST_OF_SAMPLES = 0.5
"""Of what the samples of a pass took, what grows with them, whatever two passes tell."""


@dataclass(frozen=True)
class PassCosts:
    """Of passes of one render.

    Attributes:
        samples: a pixel, of a pass that was rendered.
        fixed: what it took whatever its samples: its photons, and their maps [s].
        records: what its irradiance records took, whose rays grow with the samples [s].
        render: what its samples took [s].
        sample: what one sample more would have taken [s].
    """

    samples: int
    fixed: float
    records: float
    render: float
    sample: float

    @classmethod
    def measured(
        cls, samples: int, seconds: float, phases: Mapping[str, float], before: PassCosts | None = None
    ) -> PassCosts:
        """Of a pass.

        Args:
            seconds: that it took, wall-clock.
            phases: of these, by name; the same if nothing went by between them.
            before: of another pass. What two passes of different samples took tells what each sample adds; of one
                pass, all that its samples took is taken to grow with them, which is too much where they are few.
        """
        records, render = phases.get("records", 0.0), phases.get("render", 0.0)
        within = min(seconds / (records + render), 1.0) if records + render > 0 else 1.0
        records, render = within * records, within * render
        sample = render / samples
        if before is not None and abs(samples - before.samples) >= FAR_APART * before.samples:
            slope = (render - before.render) / (samples - before.samples)
            sample = min(max(slope, LEAST_OF_SAMPLES * sample), sample)
        return cls(samples, seconds - records - render, records, render, sample)

    def seconds(self, samples: int) -> float:
        """Of a pass of so many samples."""
        more = share_of_rays(samples) / share_of_rays(self.samples)
        rays = more**RECORDS_GROW if more > 1.0 else more
        return self.fixed + rays * self.records + max(self.render + (samples - self.samples) * self.sample, 0.0)

    def samples_in(self, seconds: float, most: int) -> int:
        """The most samples whose pass takes no longer, 0 if not even one does."""
        low, high = 0, most
        while low < high:
            middle = (low + high + 1) // 2
            low, high = (middle, high) if self.seconds(middle) <= seconds else (low, middle - 1)
        return low
