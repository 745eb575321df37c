"""wdpm as a render engine of Blender (docs/blender.md).

`settings` and `panels` are what a person sees, `export/` makes a Scene of what Blender has evaluated, `engine` renders
it, `layers` writes its passes; `addon` registers all that. `extension` packs the file that Blender installs: it, and
this package, can be imported where no Blender is.
"""
