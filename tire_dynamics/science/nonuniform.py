"""A tire whose sidewall is not uniform: the names of three modules, for those who ask.

``nonuniform_matrices`` has the equations, ``nonuniform_stability`` their Floquet analysis, and ``tongues`` where
parametric instability begins. Modules below this one import those.
"""

from __future__ import annotations

from .nonuniform_matrices import (
    Nonuniformity,
    PeriodicFrame,
    coordinates,
    coupling,
    fixed_frame_matrix,
    is_irreducibly_periodic,
    periodic_frame,
    sidewall,
    state_matrix,
)
from .nonuniform_stability import stability
from .tongues import (
    CombinationResonance,
    TongueMap,
    TongueThreshold,
    combination_resonances,
    instability_scale,
    nearest_resonance,
    nearest_tongue,
    tongue_map,
    tongue_threshold,
)

__all__ = [
    "Nonuniformity",
    "PeriodicFrame",
    "CombinationResonance",
    "TongueMap",
    "TongueThreshold",
    "coordinates",
    "coupling",
    "fixed_frame_matrix",
    "instability_scale",
    "is_irreducibly_periodic",
    "nearest_resonance",
    "nearest_tongue",
    "periodic_frame",
    "sidewall",
    "stability",
    "state_matrix",
    "tongue_map",
    "tongue_threshold",
    "combination_resonances",
]
