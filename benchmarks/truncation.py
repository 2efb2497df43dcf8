"""What a highest wavenumber costs: the deflection under the load against n_max, for three contact patches.

    python benchmarks/truncation.py
"""

from __future__ import annotations

import numpy as np

from tire_dynamics import TireWheelUnit
from tire_dynamics.science.modes import CONTACT_ANGLE, RingModes

SPEED, LOAD = 100.0, 2000.0  # [rad/s], [N]
ENOUGH = 12_800


def main() -> None:
    patches = (0.0, 0.1, 0.2)
    limits = (5, 10, 20, 30, 50, 100)
    print(f"Table 1, inextensional, {LOAD:.0f} N at {SPEED:.0f} rad/s: radial deflection under the load, n = 2..n_max")
    print("n_max " + "".join(f"{f'phi_c = {patch} rad [mm]':>26}{'missing':>10}" for patch in patches))
    tables = [deflections(patch) for patch in patches]
    for limit in limits:
        cells = [f"{1e3 * table[limit]:26.4f}{100.0 * (1.0 - table[limit] / table[ENOUGH]):9.3f}%" for table in tables]
        print(f"{limit:5} " + "".join(cells))


def deflections(patch: float) -> dict[int, float]:
    """Deflection at the contact [m] by the highest wavenumber."""
    numbers = np.arange(2, ENOUGH + 1)
    modes = RingModes(TireWheelUnit.table_1(contact_half_angle=patch), numbers)
    amplitude, _ = modes.amplitudes(modes.at(SPEED).steady(-LOAD, 0.0))
    shares = (amplitude.conj() * np.exp(1j * numbers * CONTACT_ANGLE)).real
    return dict(zip(numbers.tolist(), np.cumsum(shares).tolist(), strict=True))


if __name__ == "__main__":
    main()
