"""What a photometric file says of its luminaire, whatever its format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..scene_description import GoniometricDiagram

OpeningShape = Literal["point", "rectangle", "round"]


@dataclass(frozen=True, slots=True)
class LuminousOpening:
    """The part of a luminaire that shines, centred on its photometric centre.

    shape : round stands for disks, ellipses, cylinders and spheres alike
    along_c0, along_c90, height : m, along local X, Y and Z; 0 in all three: a point
    """

    shape: OpeningShape
    along_c0: float
    along_c90: float
    height: float


@dataclass(frozen=True, slots=True)
class PhotometricFile:
    """One luminaire as its photometric file describes it.

    path : file or asset, as named by the caller
    format : such as "IES LM-63-2002" or "EULUMDAT"
    diagram : candela as the file states them: absolute, for its own lamps
    lamp_flux : lm, rated flux of all lamps; None: not stated, or absolute photometry
    declared_flux : lm, flux of the luminaire itself; None: not stated (LM-63 has no place for it)
    opening : size of the luminous opening, m
    input_watts : W, ballast included; 0: not stated
    keywords : what the header says, by its keyword
    warnings : what was repaired, assumed or ignored, a plain sentence each
    """

    path: str
    format: str
    diagram: GoniometricDiagram
    lamp_flux: float | None
    declared_flux: float | None
    opening: LuminousOpening
    input_watts: float
    keywords: dict[str, str]
    warnings: tuple[str, ...]
