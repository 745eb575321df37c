"""The live view: a page at this machine that shows an image while it is rendered (docs/view.md)."""
