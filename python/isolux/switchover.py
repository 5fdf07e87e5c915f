"""When the composite solver goes from photons to direct lighting [Volevich 2000, §3.3].

T1 ends the first photon phase. It is as long as the indirect light needs to be roughly right, but
no longer than the first iteration of direct lighting will take; T2 is when direct lighting is done.
"""

from __future__ import annotations

# The pilot's share of the first iteration of direct lighting [Volevich 2000, §3.3: alpha].
PILOT_SHARE = 0.1
# s. Departure: the paper's 0.5 s was the shortest interval over which its implementation of 1999
# sampled errors; ours has emitted some 20,000 photons after this time.
LEAST_PILOT_SECONDS = 0.04
# RMS error of the indirect light that is a reasonable start [Volevich 2000, §3.3: E_thr].
# Departure: the paper's 15 % is what its late photons start from; the gather that follows here
# gains little by more of them (composite.GATHER_RAYS_PER_PHOTON).
START_ERROR = 0.35


def pilot_seconds(first_iteration: float) -> float:
    """T_alpha, s: how long photons are traced before the switchover is chosen.

    first_iteration : T_i0, s, estimated time of the first iteration of direct lighting
    """
    return max(LEAST_PILOT_SECONDS, PILOT_SHARE * first_iteration)


def switchover_photons(
    pilot_photons: int, pilot: float, pilot_error: float, first_iteration: float
) -> int:
    """T1 in photons, which a run by counts replays.

    pilot_photons : emitted in the pilot
    pilot : T_alpha, s, that the pilot took
    pilot_error : RMS error of the indirect light after it
    first_iteration : T_i0, s
    """
    start = pilot * (pilot_error / START_ERROR) ** 2  # T_thr: the error falls with the root
    return round(pilot_photons * max(1.0, min(start, first_iteration) / pilot))
