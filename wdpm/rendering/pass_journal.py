"""What an interrupted progressive render leaves behind, to go on from: a file beside the image.

It holds the sums of all passes so far (no pass itself), and what they are of (array_file). It is replaced after each
pass, whole or not at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from wdpm.cluster.versions import versions
from wdpm.rendering.array_file import read_arrays, write_arrays
from wdpm.rendering.journal_head import changed_settings, other_parts, settings_in_words
from wdpm.rendering.pass_average import PassAverage
from wdpm.rendering.pass_plan import PassPlan
from wdpm.rendering.prepare import Prepared
from wdpm.scenes.errors import ImageError, SettingsError

FORMAT = 2
"""Of the file; grows with every change that older or newer code would not understand."""


@dataclass(frozen=True, eq=False)
class Saved:
    """A journal that was read.

    Attributes:
        identity: what its passes are of (Prepared.identity), and the versions that rendered them.
        settings: of these, in words, by name; none where an older wdpm wrote it.
        account, arrays: of PassAverage.
    """

    path: Path
    identity: dict[str, Any]
    settings: dict[str, str]
    account: dict[str, Any]
    arrays: dict[str, NDArray[Any]]

    @property
    def plans(self) -> tuple[PassPlan, ...]:
        """The passes that are done."""
        return tuple(PassPlan(**plan) for plan in self.account["plans"])

    def average(self, prepared: Prepared) -> PassAverage:
        """The mean so far, to go on with. Raises SettingsError if it is of another render."""
        settings = changed_settings(self.settings, settings_in_words(prepared)) if self.settings else ()
        differing = list(other_parts(self.identity, identity_of(prepared), list(settings)))
        if differing:
            raise SettingsError(
                f"{self.path}: its passes were rendered with {', and '.join(differing)}; give the same as before, or "
                "leave --resume out and delete it to begin anew"
            )
        average = PassAverage(prepared)
        camera = prepared.session.view.camera
        size = (camera.height, camera.width)
        like = {name: size if count == 1 else (*size, count) for name, count in prepared.session.layers.items()}
        try:
            average.restore(self.arrays, self.account, like)
        except (KeyError, TypeError, ValueError) as error:
            raise _broken(self.path, error) from None
        return average


def identity_of(prepared: Prepared) -> dict[str, Any]:
    """What must be equal for passes to be of the same image."""
    return {**prepared.identity, "version of wdpm or its packages": versions()}


def write_journal(path: Path, average: PassAverage, prepared: Prepared) -> None:
    """Keep all passes so far. Raises ImageError if the file cannot be written; an older one is then as it was."""
    header = {
        "format": FORMAT,
        "identity": identity_of(prepared),
        "settings": settings_in_words(prepared),
        "account": average.account(),
    }
    write_arrays(path, header, average.arrays())


def read_journal(path: Path) -> Saved:
    """What an interrupted render left. Raises SettingsError if there is none, ImageError if it is broken."""
    if not path.is_file():
        raise SettingsError(f"{path}: no such file, so there is no interrupted render to resume; leave --resume out")
    try:
        header, arrays = read_arrays(path)
        if header["format"] != FORMAT:
            raise SettingsError(
                f"{path}: is of format {header['format']}, this wdpm has {FORMAT}; go on with the wdpm that wrote it, "
                "or delete it"
            )
        settings = {str(name): str(word) for name, word in dict(header.get("settings", {})).items()}
        saved = Saved(path, dict(header["identity"]), settings, dict(header["account"]), arrays)
        if not saved.plans:
            raise ValueError("no passes")
    except (KeyError, TypeError, ValueError) as error:
        raise _broken(path, error) from None
    return saved


def _broken(path: Path, error: Exception) -> ImageError:
    return ImageError(f"{path}: broken ({error}), so there is nothing to go on from; delete it and render anew")
