"""What a photometric file or a stage may do, whatever is in it: be read, or raise IsoluxError.

Anything else that comes out of these functions is a finding. What is read has to be what
`scene_description` promises.
"""

from __future__ import annotations

import itertools
import os
import shutil
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.errors import IsoluxError
from isolux.photometry import read_photometric_bytes
from isolux.scene_description import (
    GoniometricDiagram,
    LuminaireDescription,
    MeshDescription,
    SceneDescription,
)
from isolux.settings import SolverSettings
from isolux.stage_reader import read_stage

KEPT = Path(__file__).parents[2] / "tests" / "fuzz"
CORPUS = KEPT / "corpus"
BESIDE = KEPT / "beside"  # what the stages of the corpus refer to

# Larger scenes are not built, to have more tries.
LARGEST_SCENE = 20_000  # faces
PHOTONS = 200

_number = itertools.count()


def read_photometry(content: bytes, folder: Path) -> bool:
    """Whether a photometric file of this content can be read."""
    try:
        file = read_photometric_bytes(content, "light.ldt")  # of LM-63 the content tells
    except IsoluxError:
        return False
    _check_diagram(file.diagram)
    assert np.isfinite([file.opening.along_c0, file.opening.along_c90, file.opening.height]).all()
    assert file.lamp_flux is None or 0 < file.lamp_flux < np.inf
    assert file.declared_flux is None or 0 < file.declared_flux < np.inf
    assert np.isfinite(file.input_watts)
    return True


def read_stage_text(content: bytes, folder: Path) -> bool:
    """Whether a stage of this content can be read, and then take some photons.

    folder : where the stage is written, beside copies of BESIDE
    """
    _lay_beside(folder)
    # USD knows a file by its name as long as somebody holds it.
    path = folder / f"stage_{os.getpid()}_{next(_number)}.usda"
    path.write_bytes(content)
    warnings.simplefilter("error", RuntimeWarning)  # of NumPy, which would reach the terminal
    try:
        scene = read_stage(path)
        _check_scene(scene)
        _light(scene)
    except IsoluxError:
        return False
    finally:
        path.unlink()
    return True


def _lay_beside(folder: Path) -> None:
    for file in BESIDE.iterdir():
        if not (folder / file.name).exists():
            shutil.copy(file, folder)


def _light(scene: SceneDescription) -> None:
    if sum(len(mesh.face_vertex_counts) for mesh in scene.meshes) > LARGEST_SCENE:
        return
    built = build_core_scene(scene, SolverSettings(), threads=1)
    if built.element_count == 0 or built.luminous_flux == 0:
        return
    buckets = _core.PhotonBuckets(built)
    _core.trace_photons(built, buckets, 1, 0, PHOTONS, 1)


def _check_scene(scene: SceneDescription) -> None:
    assert 0 < scene.meters_per_unit < np.inf
    assert scene.up_axis in ("Y", "Z")
    for finding in scene.findings:
        assert finding.path and finding.reason
    paths = [mesh.path for mesh in scene.meshes]
    assert len(set(paths)) == len(paths)
    for mesh in scene.meshes:
        _check_mesh(mesh)
    for luminaire in scene.luminaires:
        _check_luminaire(luminaire, set(paths))


def _check_mesh(mesh: MeshDescription) -> None:
    faces, corners = len(mesh.face_vertex_counts), len(mesh.face_vertex_indices)
    assert mesh.points.shape[1:] == (3,) and np.isfinite(mesh.points).all()
    assert (mesh.face_vertex_counts >= 0).all() and mesh.face_vertex_counts.sum() == corners
    _check_indices(mesh.face_vertex_indices, len(mesh.points))
    _check_indices(mesh.hole_faces, faces)
    if mesh.corner_normals is not None:
        assert mesh.corner_normals.shape == (corners, 3)
        assert np.isfinite(mesh.corner_normals).all()
    assert mesh.reflectance.shape in ((1, 3), (faces, 3))
    assert ((mesh.reflectance >= 0) & (mesh.reflectance < 1)).all()
    if mesh.opacity is not None:
        assert mesh.opacity.shape in ((1,), (faces,))
        assert ((mesh.opacity >= 0) & (mesh.opacity <= 1)).all()
    if mesh.emission is not None:
        assert mesh.emission.shape in ((1, 3), (faces, 3))
        assert ((mesh.emission >= 0) & np.isfinite(mesh.emission)).all()


def _check_luminaire(luminaire: LuminaireDescription, meshes: set[str]) -> None:
    assert 0 < luminaire.luminous_flux < np.inf
    for values in (luminaire.origin, luminaire.axes, luminaire.size, luminaire.colour):
        assert np.isfinite(values).all()
    assert (np.asarray(luminaire.size) >= 0).all()
    assert np.allclose(luminaire.axes @ luminaire.axes.T, np.eye(3), atol=1e-6)
    for paths in (luminaire.lit_meshes, luminaire.shadow_meshes):
        assert paths is None or paths <= meshes
    if luminaire.diagram is not None:
        _check_diagram(luminaire.diagram)
    if luminaire.environment is not None:
        assert np.isfinite(luminaire.environment).all()


def _check_diagram(diagram: GoniometricDiagram) -> None:
    gamma, c, candela = diagram.gamma, diagram.c_angles, diagram.candela
    assert (np.diff(gamma) > 0).all() and gamma[0] >= 0 and gamma[-1] <= np.pi
    assert len(c) == 1 or (c[0] == 0 and c[-1] == 2 * np.pi and (np.diff(c) > 0).all())
    assert candela.shape == (len(c), len(gamma))
    assert (np.isfinite(candela) & (candela >= 0)).all() and candela.max() > 0


def _check_indices(indices: ArrayLike, count: int) -> None:
    values = np.asarray(indices)
    assert values.size == 0 or (values.min() >= 0 and values.max() < count)


TARGETS = {"photometry": read_photometry, "stage": read_stage_text}
