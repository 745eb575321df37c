"""tev, the image viewer by Thomas Müller: images sent to it while they are rendered (docs/view.md)."""
