"""All hard cases, in the order of their numbers."""

from __future__ import annotations

# Each import enters its cases.
import hard_cases.luminaires
import hard_cases.own_luminaires
import hard_cases.own_stages
import hard_cases.own_surfaces
import hard_cases.photon_counts
import hard_cases.placement
import hard_cases.topology  # noqa: F401
from hard_cases.hard_case import CASES, HardCase

TABLE: tuple[HardCase, ...] = tuple(sorted(CASES, key=lambda case: (case.number, case.part)))
