"""The light at the illumination vertices as it stands between two steps, and its error."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .components import Array, FilteredLight, IndirectLight, photometric, root_mean_square


class Illumination:
    """Direct and indirect illuminance, each replaced by what a step finds; dark at first.

    Errors are absolute, lx.

    direct, indirect : (V, 3)
    direct_error, indirect_error : (V,), standard errors
    support_radius : (V,) m, of the filter of the indirect light; 0 where there was none
    """

    def __init__(self, areas: NDArray[np.float64]) -> None:
        """areas : (V,) m^2"""
        self._areas = areas
        self.direct = self.indirect = np.zeros((len(areas), 3), np.float32)
        self.direct_error = self.indirect_error = np.zeros(len(areas), np.float32)
        self.support_radius = np.zeros(len(areas), np.float32)
        # Area-weighted RMS errors; nan: not known.
        self._direct_rms = self._indirect_rms = math.nan
        self._photons_rms: float | None = None  # of both together, where both are photons'

    @property
    def total(self) -> Array:
        """(V, 3)"""
        return self.direct + self.indirect

    @property
    def rms_error(self) -> float:
        """Relative RMS error of the total; nan: not known."""
        rms = self._photons_rms
        if rms is None:
            rms = math.hypot(self._direct_rms, self._indirect_rms)
        return self._relative(rms, self.total)

    @property
    def rms_error_indirect(self) -> float:
        """The same of the indirect light."""
        return self._relative(self._indirect_rms, self.indirect)

    @property
    def direct_share(self) -> float:
        """Error of the direct light over that of the indirect light."""
        if self._direct_rms == 0:
            return 0.0
        return self._direct_rms / self._indirect_rms if self._indirect_rms > 0 else math.inf

    def take_photons(self, found: FilteredLight) -> None:
        """Direct and indirect light of filtered photons."""
        self.direct = found.direct
        self.direct_error = found.direct_error
        self.take_indirect_photons(found)
        self._photons_rms = found.rms_error * self._mean(self.total)

    def take_indirect_photons(self, found: FilteredLight) -> None:
        """Indirect light of filtered photons."""
        self.indirect = found.indirect
        self.indirect_error = found.indirect_error
        self.support_radius = found.support_radius
        self._indirect_rms = found.rms_error_indirect * self._mean(found.indirect)

    def take_direct(self, illuminance: Array, standard_error: Array) -> None:
        """Deterministic direct light: (V, 3), and (V,) lx."""
        self.direct, self.direct_error = illuminance, standard_error
        self._direct_rms = root_mean_square(standard_error, self._areas)
        self._photons_rms = None

    def take_indirect(self, found: IndirectLight) -> None:
        """Indirect light that no filter made."""
        self.indirect, self.indirect_error = found.illuminance, found.standard_error
        self.support_radius = np.zeros_like(self.support_radius)
        self._indirect_rms = found.rms

    def leave_indirect_dark(self) -> None:
        """Where nothing reflects, no indirect light is the exact one."""
        self._indirect_rms = 0.0

    def _mean(self, illuminance: Array) -> float:
        """Area-weighted photometric mean, lx."""
        total = float(self._areas.sum())
        flux = np.einsum("i,i", self._areas, photometric(illuminance))
        return float(flux) / total if total > 0 else 0.0

    def _relative(self, rms: float, illuminance: Array) -> float:
        mean = self._mean(illuminance)
        if mean == 0 and not math.isnan(rms):
            return 0.0
        return rms / mean if mean > 0 else math.nan


def relative_deviation(total: Array, direct_error: Array, indirect_error: Array) -> Array:
    """Of the total (n, 3), (n,); 1 where there is no light. Errors are absolute, lx."""
    illuminance = photometric(total)
    error = np.hypot(direct_error, indirect_error)
    return np.divide(error, illuminance, out=np.ones_like(error), where=illuminance > 0)
