"""Breaks the physics on purpose, one place at a time, and says which tests notice.

    python tools/mutations.py                 all, some ten minutes
    python tools/mutations.py --only gather   those whose name has the word

Works on a copy of the last commit. A mutation that no test notices is a missing test: exit code 1.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LONGEST_BUILD, LONGEST_TESTS = 1200, 1800  # s


@dataclass(frozen=True)
class Mutation:
    """One change of one place, and the tests that ought to fail by it.

    text : stands once in the file
    """

    name: str
    file: str
    text: str
    instead: str
    tests: str


_CORE, _PYTHON = "plugin/core/", "python/isolux/"
MUTATIONS = (
    Mutation(
        "a far luminaire without the cosine at the receiver",
        _CORE + "luminaire_illuminance.cpp",
        "intensity(to) * dot(to, receiver.normal.as<double>()) / (squared * std::sqrt(squared))",
        "intensity(to) / squared",
        "tests/physics/test_cie_171_direct.py",
    ),
    Mutation(
        "1/r in place of 1/r²",
        _CORE + "luminaire_illuminance.cpp",
        "intensity(to) * dot(to, receiver.normal.as<double>()) / (squared * std::sqrt(squared))",
        "intensity(to) * dot(to, receiver.normal.as<double>()) / squared",
        "tests/physics/test_cie_171_direct.py",
    ),
    Mutation(
        "π lost between flux and luminance",
        _CORE + "luminaire_illuminance.cpp",
        "luminaire_.luminous_flux / (kPi * area_)",
        "luminaire_.luminous_flux / area_",
        "tests/physics/test_direct_illuminance.py",
    ),
    Mutation(
        "half the flux in the filter",
        _CORE + "illumination_filter.cpp",
        "settings.accuracy * std::numbers::sqrt2, 2.0 * photon_flux,",
        "settings.accuracy * std::numbers::sqrt2, photon_flux,",
        "tests/physics/test_filter_bias.py tests/test_illumination_filter.py",
    ),
    Mutation(
        "the filter's value from the photons that chose its support",
        _CORE + "illumination_filter.cpp",
        "support.other_hits * to_illuminance",
        "support.hit_count * to_illuminance",
        "tests/physics/test_filter_bias.py",
    ),
    Mutation(
        "a filter that is not normalised: its supports 3 % too wide",
        _CORE + "support_selection.cpp",
        "taken.area += candidate.area;",
        "taken.area += 1.03 * candidate.area;",
        "tests/test_illumination_filter.py tests/physics/test_filter_bias.py",
    ),
    Mutation(
        "the winding flipped",
        _CORE + "triangulation.cpp",
        "if (mesh.flip_winding) {\n                    std::swap(j, k);",
        "if (!mesh.flip_winding) {\n                    std::swap(j, k);",
        "tests/test_triangulation.py",
    ),
    Mutation(
        "one row off in the candela table",
        _CORE + "candela_distribution.cpp",
        "&candela_[k * gamma_.size() + j];",
        "&candela_[k * bands_.size() + j];",
        "tests/test_candela_distribution.py",
    ),
    Mutation(
        "Russian roulette that does not make up for colour",
        _CORE + "photon_tracer.cpp",
        "photon.colour = reflected * (1.0F / survival);",
        "photon.colour = reflected;",
        "tests/physics/test_coloured_light.py",
    ),
    Mutation(
        "photons that bounce in a narrower lobe than the cosine's",
        _CORE + "photon_tracer.cpp",
        "photon.ray.direction = cosine_direction(photon.normal, photon.random);",
        "photon.ray.direction =\n"
        "            normalize(cosine_direction(photon.normal, photon.random) + photon.normal);",
        "tests/physics/test_radiosity.py",
    ),
    Mutation(
        "photons in the bucket of the wrong vertex",
        _CORE + "photon_tracer.cpp",
        "return hit.u >= hit.v ? element.vertices[1] : element.vertices[2];",
        "return hit.u >= hit.v ? element.vertices[2] : element.vertices[1];",
        "tests/physics/test_direct_light.py",
    ),
    Mutation(
        "rays that start too far off the surface",
        _CORE + "ray_caster.cpp",
        "kRelativeOffset = 0x1p-20F",
        "kRelativeOffset = 0x1p-8F",
        "tests/test_photon_tracer.py tests/physics/test_cie_171_direct.py "
        "tests/test_direct_lighting.py tests/physics/test_far_field.py",
    ),
    Mutation(
        "a corner's rays taken for as even as a wall's",
        _CORE + "record_smoothing.cpp",
        "kClose = 0.3F",
        "kClose = 2.0F",
        "tests/physics/test_gather_noise.py",
    ),
    Mutation(
        "an area weight dropped from the exitance that a gather sees",
        _CORE + "final_gather.cpp",
        "surface.reflectance * static_cast<float>(third / mesh.areas[v])",
        "surface.reflectance * 0.3F",
        "tests/physics/test_gather.py tests/test_final_gather.py",
    ),
    Mutation(
        "a gather without the cosine",
        _CORE + "gather_records.cpp",
        "receiver.normal * std::sqrt(std::max(0.0F, 1.0F - a * a - b * b))",
        "receiver.normal * std::max(0.0F, 1.0F - a * a - b * b)",
        "tests/physics/test_gather.py tests/test_final_gather.py",
    ),
    Mutation(
        "twice the form factor",
        _CORE + "form_factor.cpp",
        "/ (2.0 * std::numbers::pi)",
        "/ std::numbers::pi",
        "tests/test_progressive_radiosity.py tests/physics/test_radiosity.py",
    ),
    Mutation(
        "of many luminaires one that does not stand for the others",
        _CORE + "shadow_testing.cpp",
        "unoccluded / probability, &cluster",
        "unoccluded, &cluster",
        "tests/test_direct_lighting.py tests/physics/test_direct_illuminance.py",
    ),
    Mutation(
        "exposure in powers of e",
        _PYTHON + "light_inputs.py",
        "np.exp2(exposure)",
        "np.exp(exposure)",
        "tests/test_light_reader.py",
    ),
    Mutation(
        "a colour temperature that is not enabled",
        _PYTHON + "light_inputs.py",
        'if context.value(prim, "inputs:enableColorTemperature", False):',
        "if True:",
        "tests/test_light_reader.py",
    ),
    Mutation(
        "metersPerUnit not squared in a light's area",
        _PYTHON + "light_reader.py",
        "float(area) * metres**2",
        "float(area) * metres",
        "tests/test_light_reader.py",
    ),
    Mutation(
        "normals transformed like points",
        _PYTHON + "mesh_reader.py",
        "np.linalg.inv(to_world[:3, :3]).T",
        "to_world[:3, :3]",
        "tests/test_mesh_reader.py tests/properties/test_any_geometry.py",
    ),
    Mutation(
        "a mirrored mesh not turned over",
        _PYTHON + "mesh_reader.py",
        "flip_winding = left_handed != mirrored",
        "flip_winding = left_handed",
        "tests/test_mesh_reader.py tests/properties/test_any_geometry.py",
    ),
    Mutation(
        "EULUMDAT about C90-C270 mirrored to the other side",
        _PYTHON + "photometry/eulumdat.py",
        "c_angles = 180.0 - np.where",
        "c_angles = 180.0 + np.where",
        "tests/test_eulumdat.py tests/properties/test_any_photometry.py",
    ),
    Mutation(
        "the twelfth number of LM-63 multiplied in 2019 too",
        _PYTHON + "photometry/ies.py",
        "if year < 2019:",
        "if year <= 2019:",
        "tests/test_ies.py tests/properties/test_any_photometry.py",
    ),
)


class Copy:
    """The last commit in a folder of its own, built in place."""

    def __init__(self, folder: Path) -> None:
        self.tree, self._build = folder / "tree", folder / "build"
        _run(["git", "worktree", "add", "--detach", str(self.tree), "HEAD"], ROOT)
        # The base interpreter doesn't know of an editable install, which would hide this one.
        self._python = str(getattr(sys, "_base_executable", sys.executable))
        packages = sysconfig.get_path("purelib")
        self._environment = {**os.environ, "PYTHONPATH": f"{self.tree / 'python'}:{packages}"}

    def build(self) -> None:
        if not self._build.exists():
            _run(
                [
                    *("cmake", "-S", str(self.tree), "-B", str(self._build), "-G", "Ninja"),
                    *("-DCMAKE_BUILD_TYPE=Release", f"-DPython_EXECUTABLE={sys.executable}"),
                ],
                self.tree,
            )
        _run(["cmake", "--build", str(self._build)], self.tree)
        _run(
            ["cmake", "--install", str(self._build), "--prefix", str(self.tree / "python")],
            self.tree,
        )

    def failed_test(self, tests: str) -> str | None:
        """The first test that fails, with its reason; None where all pass."""
        command = [self._python, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=no"]
        try:
            done = subprocess.run(
                [*command, "-rfE", *tests.split()],
                cwd=self.tree,
                env=self._environment,
                capture_output=True,
                text=True,
                timeout=LONGEST_TESTS,
            )
        except subprocess.TimeoutExpired:
            return f"none ends within {LONGEST_TESTS} s"
        if done.returncode == 0:
            return None
        failed = re.search(
            r"^(?:FAILED|ERROR) (?:tests/)?(.+?)(?: - |$)", done.stdout, re.MULTILINE
        )
        return failed[1] if failed else (done.stdout + done.stderr)[-300:]

    def close(self) -> None:
        _run(["git", "worktree", "remove", "--force", str(self.tree)], ROOT)


def _run(command: list[str], folder: Path) -> None:
    subprocess.run(
        command, cwd=folder, check=True, capture_output=True, text=True, timeout=LONGEST_BUILD
    )


def try_mutation(copy: Copy, mutation: Mutation) -> str | None:
    """What notices the mutation: a test, or the compiler; None where nothing does."""
    file = copy.tree / mutation.file
    sound = file.read_text(encoding="utf-8")
    if sound.count(mutation.text) != 1:
        raise SystemExit(
            f"{mutation.file} has {mutation.text!r} {sound.count(mutation.text)} times"
        )
    file.write_text(sound.replace(mutation.text, mutation.instead), encoding="utf-8")
    try:
        copy.build()  # of Python too: the mutation before is still compiled in
        return copy.failed_test(mutation.tests)
    finally:
        file.write_text(sound, encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="a part of the names")
    chosen = [m for m in MUTATIONS if parser.parse_args().only in m.name]
    survivors = 0
    with tempfile.TemporaryDirectory(prefix="isolux_mutations_") as folder:
        copy = Copy(Path(folder))
        try:
            copy.build()
            tests = " ".join(sorted({t for m in chosen for t in m.tests.split()}))
            if failed := copy.failed_test(tests):
                print(f"{failed} fails without any mutation")
                return 1
            print("| mutation | in | caught by |\n|---|---|---|", flush=True)
            for mutation in chosen:
                found = try_mutation(copy, mutation)
                survivors += found is None
                caught = "**nothing**" if found is None else f"`{found}`"
                print(f"| {mutation.name} | `{mutation.file}` | {caught} |", flush=True)
        finally:
            copy.close()
    print(f"\n{len(chosen) - survivors} of {len(chosen)} caught")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
