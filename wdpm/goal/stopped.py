"""What ends a render before its goal, once there is an image."""

from __future__ import annotations

from wdpm.images.image import Image
from wdpm.scenes.errors import ClusterError


class Interrupted(KeyboardInterrupt):
    """Someone pressed Ctrl-C during the passes.

    Attributes:
        image: the mean of those that were done, with its outcome.
    """

    def __init__(self, image: Image) -> None:
        super().__init__()
        self.image = image


class Abandoned(ClusterError):
    """The cluster ended because of an error during the passes.

    Attributes:
        image: the mean of those that were done, with its outcome.
    """

    def __init__(self, reason: str, image: Image) -> None:
        super().__init__(reason)
        self.image = image


def raise_if_stopped(error: BaseException | None, image: Image) -> None:
    """Hand over an image whose passes an error ended."""
    match error:
        case KeyboardInterrupt():
            raise Interrupted(image) from error
        case ClusterError():
            raise Abandoned(str(error), image) from error
