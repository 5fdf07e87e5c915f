"""What other programs get of a scene, and how their answers are judged."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from path_tracer import refuse_what_paths_lack
from peers.agreement import agreement
from peers.export import export_scene, lit_vertices
from peers.peer_scene import PeerScene
from peers.time_to_error import Place, Reached, slowest, time_to
from reference import PathTracedReference
from usd_scenes.shapes import box
from usd_scenes.stage_writing import PHOTOMETRY

from core_scenes import luminaire, surface
from hand_built import scene_of
from isolux.core_scene import build_core_scene
from isolux.photometry import read_photometric_file
from isolux.settings import SolverSettings


def room(*luminaires):
    description = scene_of([surface(box((4, 3, 4), 1.0).flipped(), 0.5)])
    return replace(description, luminaires=luminaires)


def exported(*luminaires):
    scene = room(*luminaires)
    return export_scene(scene, build_core_scene(scene, SolverSettings(), 1))


def test_a_peer_gets_the_light_of_every_luminaire_in_lumens() -> None:
    """The candela of a diagram, and the luminance of a plain surface, integrated anew."""
    diagram = read_photometric_file(PHOTOMETRY / "wall_washer.ies").diagram
    plain = luminaire(1000.0, (0, 1, 0), "rect", size=(0.5, 0.25))
    shaped = replace(luminaire(700.0, (0, 1, 0), "disk", size=(0.1, 0)), diagram=diagram)
    rect, disk = exported(plain, shaped).luminaires
    assert np.pi * rect.luminance * 0.5 * 0.25 == pytest.approx(1000.0 * rect.colour)
    gamma = np.linspace(0, np.pi, disk.candela.shape[1])
    ring = disk.candela[:-1].mean(axis=0) * 2 * np.pi * np.sin(gamma)
    assert float(np.diff(gamma) @ (ring[1:] + ring[:-1]) / 2) == pytest.approx(700.0, rel=1e-3)


def test_peers_are_asked_for_all_vertices_and_read_what_was_written(tmp_path: Path) -> None:
    scene = room(luminaire(1000.0, (0, 0, 0), "sphere", size=(0.1, 0)))
    core = build_core_scene(scene, SolverSettings(), 1)
    written = export_scene(scene, core)
    written.save(tmp_path / "scene.npz")
    read = PeerScene.load(tmp_path / "scene.npz")
    lit = lit_vertices(core)
    assert len(lit) == core.vertex_count
    assert read.positions == pytest.approx(core.receiver_positions[lit], abs=1e-4)
    off = np.einsum("ni,ni->n", read.positions - core.receiver_positions[lit], read.normals)
    assert (off > 0).all()
    area = np.linalg.norm(np.cross(*np.diff(read.corners, axis=1).transpose(1, 0, 2)), axis=1) / 2
    assert area.sum() == pytest.approx(2 * 4 * 4 + 4 * 4 * 3)
    assert read.luminaires[0].candela is None and read.luminaires[0].shape == "sphere"


@pytest.mark.parametrize("shape", ["distant", "dome", "mesh"])
def test_what_the_reference_lacks_is_refused_by_name(shape: str) -> None:
    with pytest.raises(SystemExit, match=f"/Lamp.*{shape}"):
        refuse_what_paths_lack(room(replace(luminaire(), path="/Lamp", shape=shape)))


def reference_of(truth, noise, random):
    """Batches with independent noise, all of it in the direct part."""
    batches = np.zeros((16, len(truth), 2, 3))
    batches[:, :, 0] = (truth + noise * random.normal(size=(16, len(truth))))[..., None]
    count = len(truth)
    return PathTracedReference(np.arange(count), np.full(count, 1 / count), True, batches)


@pytest.mark.parametrize(
    ("case", "scale", "spot", "within"),
    [
        ("the same light", 1.0, 0.0, True),
        ("one per cent too much", 1.01, 0.0, False),
        ("the same mean, elsewhere", 1.0, 0.1, False),
    ],
)
def test_agreement_tells_a_wrong_adapter_from_noise(
    case: str, scale: float, spot: float, within: bool
) -> None:
    random = np.random.default_rng(5)
    truth = 100 + 50 * random.random(1000)
    reference = reference_of(truth, 10.0, random)
    elsewhere = spot * truth * np.sin(np.arange(1000))
    runs = tuple(
        np.repeat((scale * truth + elsewhere + 5 * random.normal(size=1000))[:, None], 3, axis=1)
        for _ in range(2)
    )
    found = agreement(runs, reference)
    assert found.within == within, case
    assert found.mean_ratio == pytest.approx(scale, abs=0.003)
    if spot:  # sin² is a half in the mean
        assert found.rms_difference == pytest.approx(spot / np.sqrt(2), rel=0.05)


def test_times_are_interpolated_and_extrapolated_only_where_noise_alone_is_left() -> None:
    runs = [Place(1.0, 0.16), Place(4.0, 0.08), Place(16.0, 0.04)]
    assert time_to(0.08, runs, "cycles") == Reached(pytest.approx(4.0))
    assert time_to(0.04 * 2**0.5, runs, "cycles") == Reached(pytest.approx(8.0))
    assert time_to(0.02, runs, "cycles") == Reached(pytest.approx(64.0), extrapolated=True)
    assert time_to(0.02, runs, "radiance-cached") is None
    assert time_to(0.5, runs, "isolux") == Reached(1.0)


def test_a_seed_that_never_gets_there_tells_so_unless_it_was_stopped_before() -> None:
    fast, slow = [Place(1.0, 0.1), Place(2.0, 0.05)], [Place(1.0, 0.2), Place(8.0, 0.05)]
    stopped, never = [Place(1.0, 0.2), Place(4.0, 0.1)], [Place(1.0, 0.2), Place(16.0, 0.1)]
    assert slowest(0.05, [fast, slow], "isolux") == Reached(8.0)
    assert slowest(0.05, [fast, stopped, slow], "isolux") == Reached(8.0)
    assert slowest(0.05, [fast, stopped], "isolux") is None
    assert slowest(0.05, [slow, never], "isolux") is None
    assert slowest(0.05, [], "isolux") is None
