"""Direct light of the composite solver becomes finer as the indirect light does: it is no floor."""

import time

import numpy as np
from reference import DIRECT, path_traced_reference
from usd_scenes.cornell_box.generate import generate

import isolux
from isolux.core_scene import build_core_scene


def test_shadows_become_finer_while_light_is_gathered(tmp_path):
    generate(tmp_path / "box.usdc", density=0.3)
    scene = isolux.read_stage(tmp_path / "box.usdc")
    core = build_core_scene(scene, isolux.SolverSettings(), 2)
    reference = path_traced_reference(scene, core, vertices=250, batches=8, strata=12)
    settings = isolux.SolverSettings(
        method="composite", target_error=0.0, photons=600_000, stages=7, threads=1
    )
    # What the machine does besides has no say in how many passes there are.
    solver = isolux.ProgressiveSolver(scene, settings, clock=time.process_time)
    errors, rays = [], []
    for solution in solver.stages():
        if solution.stage.component == "gather":
            errors.append(reference.error(solution.direct, solution.indirect, DIRECT).rms)
            rays.append(solution.stage.shadow_rays)
    assert [s.component for s in solution.steps].count("DDL") >= 3
    assert errors[0] > 0.01
    assert errors[-1] < 0.005
    assert np.all(np.diff(rays) >= 0)
