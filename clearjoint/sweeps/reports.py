"""What a sweep warns of when it is done: lanes that failed, and journals that slid out."""

import warnings
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from ..dynamics.journals import HOLD_IT, slid_out
from ..fields.cautions import LeftBearingWarning, caution
from ..model.bodies import BodyState
from ..result_codes import result_numbers
from .axes import Lanes
from .layout import RESULT

if TYPE_CHECKING:
    import xarray as xr


def report_failures(results: "xr.Dataset", lanes: Lanes) -> None:
    """Warn of lanes that failed: how many with each result code, and why the first of them could
    not begin, if it could not."""
    names = {number: name for name, number in result_numbers().items()}
    counts = Counter(names.get(int(code), "pending") for code in results[RESULT].values.ravel())
    del counts["successful"]
    if counts:
        failed = ", ".join(f"{count} {name}" for name, count in counts.items())
        first = next(iter(lanes.bad.items()), None)
        example = "" if first is None else f" Lane {first[0]}: {first[1]}"
        warnings.warn(
            f"{counts.total()} of {results[RESULT].size} lanes failed: {failed}.{example}",
            stacklevel=3,
        )


def report_journals_outside(results: "xr.Dataset", lanes: Lanes) -> None:
    """Warn of journals that are outside their bearings at the end of a lane."""
    parts = (results[f"final_{part}"] for part in ("position", "orientation", "velocity", "spin"))
    columns = [part.values.reshape(-1, *part.shape[-2:]) for part in parts]
    bodies = {
        str(name): BodyState(*(column[:, k] for column in columns))
        for k, name in enumerate(results["body"].values)
    }
    for name, excess in slid_out(lanes.contact_joints(), bodies).items():
        count = int(np.count_nonzero(excess > 0.0))
        if count:
            caution(
                f"In {count} of {excess.size} lanes the journal of joint {name!r} has slid out of "
                f"its bearing at the end, by up to {np.nanmax(excess):.3g} m. {HOLD_IT}",
                LeftBearingWarning,
            )
