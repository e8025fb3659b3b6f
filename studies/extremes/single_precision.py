"""The paper's pendulum in 32-bit floats up to its second impact; prints JSON."""

import json
from typing import Any

import jax
import numpy as np

import clearjoint as cj

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
DURATION = 0.02


def first_impact(rtol: float) -> dict[str, Any]:
    """Return the first impact, and the energy error over the energy exchanged."""
    scene, state = cj.mechanisms.double_pendulum()
    solution = cj.simulate(
        scene,
        state,
        DURATION,
        cj.Settings(rtol=rtol, ledger=True, max_steps=50_000, allow_float32=True),
        save=cj.Saving([0.0, DURATION], impacts=True),
        throw=False,
        progress=False,
    )
    if solution.result != cj.RESULTS.successful:
        nothing = dict.fromkeys(("onset", "entry_speed", "peak_force", "ledger"), 1.0)
        return {"rtol": rtol, "result": "max_steps_reached", **nothing}
    impacts, observed = solution.impacts, cj.observe(scene, solution)
    assert impacts is not None
    exchanged = np.ptp(observed.energies["gravity"])
    return {
        "rtol": rtol,
        "result": "successful",
        "onset": float(impacts.onset[0]),
        "entry_speed": float(impacts.entry_speed[0]),
        "peak_force": float(impacts.peak_force[0]),
        "ledger": float(abs(observed.ledger_residual()[-1]) / exchanged),
    }


if __name__ == "__main__":
    cj.configure(threads=1)
    jax.config.update("jax_enable_x64", False)
    print(json.dumps([first_impact(rtol) for rtol in TOLERANCES]))
