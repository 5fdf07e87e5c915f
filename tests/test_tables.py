"""What the command line tells of progressive stages."""

from dataclasses import replace

from hand_built import grid, solution_of
from isolux.tables import new_console, stage_table


def shown(*stages):
    """The table's lines, each with single spaces."""
    console = new_console()
    with console.capture() as capture:
        console.print(stage_table(stages))
    lines = (" ".join(line.split()) for line in capture.get().splitlines())
    return [line for line in lines if line]


def stage(**numbers):
    plain = {name: 0 for name in ("shadow_rays", "indirect_rays", "switchover_time")}
    made = solution_of([grid("/World/Mesh")]).stage
    return replace(made, **(plain | {"second_switchover_time": 0.0} | numbers))


def test_rays_that_no_stage_has_traced_have_no_column():
    header, *_ = shown(stage(photons=1000))
    assert header == "stage component photons elements seconds RMS error indirect"
    header, *_, row = shown(stage(), stage(component="DDL", photons=1000, shadow_rays=1234567))
    assert header == "stage component photons shadow rays elements seconds RMS error indirect"
    assert row.startswith("1 DDL 1,000 1,234,567 12 ")


def test_the_switchovers_are_told_once_they_have_come():
    before, at_t1 = stage(), stage(switchover_time=1.25, switchover_photons=50000)
    done = replace(at_t1, second_switchover_time=4.5)
    assert not any("T1" in line for line in shown(before))
    assert shown(before, at_t1)[-1] == "T1 1.25 s, 50,000 photons"
    assert shown(before, at_t1, done)[-1] == "T1 1.25 s, 50,000 photons; T2 4.50 s"
