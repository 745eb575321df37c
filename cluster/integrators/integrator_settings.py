"""What an integrator reads of the settings of a render."""

from __future__ import annotations

from typing import Protocol

from wdpm.cluster.integrators.indirect import Indirect


class IntegratorSettings(Protocol):
    """Some of the fields of RenderSettings, which name an integrator and so lie above."""

    @property
    def photons(self) -> int: ...

    @property
    def caustic_photons(self) -> int: ...

    @property
    def volume_photons(self) -> int: ...

    @property
    def spp(self) -> int: ...

    @property
    def samples_of_pass(self) -> int: ...

    @property
    def indirect(self) -> Indirect: ...

    @property
    def without(self) -> tuple[str, ...]: ...
