"""Compiles the kernels that most tests use, on all cores.

Processes that run tests side by side would all compile these at the same time, each for itself.
"""

from __future__ import annotations

import time

from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.work.replica import with_camera
from wdpm.kernels.compile import compile_for_cpu, compile_kernels, kernels_for_all_scenes
from wdpm.quiet import quiet_warp
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten

if __name__ == "__main__":
    quiet_warp()
    began = time.monotonic()
    flat = flatten(cornell_box())
    compile_for_cpu(kernels_for_all_scenes())
    compile_kernels("cpu", with_camera(features_of(flat, RenderSettings()), flat.camera))
    print(f"kernels compiled in {time.monotonic() - began:.0f} s")
