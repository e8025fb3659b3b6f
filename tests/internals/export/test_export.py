"""Results as datasets, data frames and files: names, units, and numbers to the last bit."""

from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import clearjoint as cj
from clearjoint._export import datasets
from clearjoint._export.datasets import setting_notes
from clearjoint._simulation.results.observe import AccelerationSeries, ContactObservation, Load
from clearjoint.results import ContactTotals
from tests.support.observations import observation_of
from tests.support.tumbling_bearing import solution_of

COUNT = 5
TIMES = np.linspace(0.0, 0.3, COUNT) / 3.0


def drawn(*shape):
    """Numbers whose digits don't end."""
    return np.random.default_rng(sum(shape)).normal(size=shape)


def states() -> cj.State:
    bodies = {
        name: cj.BodyState(drawn(COUNT, 3) + k, drawn(COUNT, 4), drawn(COUNT, 3), drawn(COUNT, 3))
        for k, name in enumerate(("arm", "long arm"))
    }
    entry_speeds = {"pin": {"V": drawn(COUNT), "W": np.zeros(COUNT)}}
    work, bristles = {"friction": drawn(COUNT)}, {"pin": {"V": drawn(COUNT, 3)}}
    return cj.State(bodies, entry_speeds, work, bristles)


def solution(**changes) -> cj.results.Solution:
    everything = states()
    final = cj.State({n: cj.body_state((1.0, 2.0, 3.0)) for n in everything.bodies})
    settings = setting_notes(vars(cj.presets.accurate))
    changes = {"final": final, "saved_count": COUNT, "settings": settings} | changes
    return replace(solution_of(cj.results.Trajectory(TIMES, everything)), **changes)


def contact(eccentricity: bool) -> ContactObservation:
    own = (drawn(COUNT), drawn(COUNT, 3)) if eccentricity else (None, None)
    return ContactObservation(
        drawn(COUNT), drawn(COUNT), *own, drawn(COUNT), None, *(drawn(COUNT, 3) for _ in range(3))
    )


def observation() -> cj.results.Observation:
    return observation_of(
        TIMES,
        contacts={"pin": {"V": contact(True), "shoulder": contact(False)}},
        modes={"pin": np.array([0, 1, 2, 3, 0])},
        reactions={"hinge": {"arm": Load(drawn(COUNT, 3), drawn(COUNT, 3))}},
        accelerations={"arm": AccelerationSeries(drawn(COUNT, 3), drawn(COUNT, 3))},
        drift={"hinge": drawn(COUNT)},
        drift_rate={"hinge": drawn(COUNT)},
        energies={"kinetic": drawn(COUNT), "gravity": drawn(COUNT)},
    )


def impacts(count: int = 3) -> cj.results.Impacts:
    return cj.results.Impacts.of_rows(("pin", "V", *drawn(count, 8)[k]) for k in range(count))


def sensitivities() -> cj.results.Sensitivities:
    outputs, derivatives = {"x": drawn(COUNT)}, {"x": drawn(COUNT, 2)}
    ended = 0.1, cj.RESULTS.successful, 12, 10
    labels = {"units": {"x": "m"}, "scales": ("log clearance", "mass")}
    return cj.results.Sensitivities(
        ("clearance", "mass"), TIMES, outputs, derivatives, *ended, **labels
    )


def crossings() -> cj.results.Crossings:
    return cj.results.Crossings(TIMES, {"height": drawn(COUNT)}, {"height": "m"})


def nonsmooth() -> cj.results.NonsmoothSolution:
    one = solution()
    totals = ContactTotals(*(np.arange(COUNT) * (k + 0.1) for k in range(6)))
    history = {"pin": {"V": totals}}
    return cj.results.NonsmoothSolution(
        *(one.time, one.final, one.result, np.asarray(7), one.saved, history),
        *(np.asarray(4), history, np.asarray(0.0), one.formulation, ()),
    )


RESULTS = {
    "solution": solution,
    "trajectory": lambda: solution().saved,
    "observation": observation,
    "impacts": impacts,
    "no impacts": lambda: impacts(0),
    "sensitivities": sensitivities,
    "crossings": crossings,
    "nonsmooth": nonsmooth,
}


@pytest.fixture(params=RESULTS)
def result(request):
    return RESULTS[request.param]()


def test_every_number_has_a_unit_and_the_whole_says_where_it_comes_from(result):
    found = result.to_xarray()
    unlabelled = {
        name
        for name, variable in found.variables.items()
        if variable.dtype.kind == "f" and not variable.attrs.get("units")
    }
    # Drift is the largest of numbers in m, rad and without unit, and its description says so.
    without = {name for name in ("drift", "drift_rate") if name in found}
    assert unlabelled == without
    assert all("in m" in found[name].attrs["long_name"] for name in without)
    assert "clearjoint 0" in found.attrs["source"] and found.attrs["title"]


def test_a_package_that_is_not_installed_has_an_unknown_version(monkeypatch):
    def version(name: str) -> str:
        if name == "clearjoint":  # in a source tree on PYTHONPATH
            raise PackageNotFoundError(name)
        return "1.2"

    monkeypatch.setattr(datasets, "version", version)
    versions = datasets.versions.__wrapped__()  # without the cache
    assert versions["version of clearjoint"] == "unknown" and versions["version of jax"] == "1.2"


def test_netcdf_gives_back_every_bit(result, tmp_path: Path):
    written = result.to_xarray()
    result.to_netcdf(tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "out.nc", engine="scipy") as read:
        assert set(read.variables) == set(written.variables)
        for name, variable in written.variables.items():
            if variable.dtype.kind == "f":
                assert read[name].values.tobytes() == variable.values.tobytes(), name
            else:
                assert read[name].values.tolist() == variable.values.tolist(), name
            for key, value in variable.attrs.items():
                np.testing.assert_array_equal(read[name].attrs[key], value)
        texts, others = (
            {k: v for k, v in one.attrs.items() if isinstance(v, str)} for one in (read, written)
        )
        assert texts == others


def test_csv_gives_back_every_bit(result, tmp_path: Path):
    frame = result.to_dataframe()
    result.to_csv(tmp_path / "out.csv")
    read = pd.read_csv(tmp_path / "out.csv", index_col=0, float_precision="round_trip")
    assert read.columns.tolist() == frame.columns.tolist()
    assert read.index.name == frame.index.name
    for name in frame:
        if frame[name].dtype.kind == "f":
            assert read[name].to_numpy(float).tobytes() == frame[name].to_numpy().tobytes(), name


def test_columns_are_named_with_body_part_component_and_unit():
    frame, seen = solution().to_dataframe(), states()
    assert frame.index.name == "time [s]"
    np.testing.assert_array_equal(frame.index, TIMES)
    columns = {
        "long arm.position.y [m]": seen.bodies["long arm"].position[:, 1],
        "arm.orientation.e0 [1]": seen.bodies["arm"].orientation[:, 0],
        "pin V.entry_speed [m/s]": seen.entry_speeds["pin"]["V"],
        "pin V.bristle_deflection.z [m]": seen.bristles["pin"]["V"][:, 2],
    }
    for name, values in columns.items():
        np.testing.assert_array_equal(frame[name], values, err_msg=name)


def test_a_solution_tells_its_settings_and_its_end():
    found = solution().to_xarray()
    assert found.attrs["setting_rtol"] == 1e-8 and found.attrs["setting_solver"].startswith("Tsit5")
    assert found.attrs["result"] == "The run reached its end time."
    assert found["final_position"].sel(body="arm").values.tolist() == [1.0, 2.0, 3.0]


def test_without_saved_states_there_is_nothing_to_take_out():
    with pytest.raises(ValueError, match=r"`solution`.*save=Saving\(times\)"):
        solution(saved=None, saved_count=None).to_dataframe()


def test_what_is_observed_is_named_by_contact_joint_and_body():
    frame, seen = observation().to_dataframe(), observation()
    assert frame["pin shoulder.eccentricity [m]"].isna().all()
    assert frame["pin.mode"].tolist()[:3] == ["free_flight", "one_base", "line_contact"]
    columns = {
        "pin V.eccentricity [m]": seen.contacts["pin"]["V"].eccentricity,
        "hinge on arm.reaction_force.x [N]": seen.reactions["hinge"]["arm"].force[:, 0],
        "energy.kinetic [J]": seen.energies["kinetic"],
    }
    for name, values in columns.items():
        np.testing.assert_array_equal(frame[name], values, err_msg=name)


def test_impacts_are_rows_with_names():
    frame = impacts().to_dataframe()
    assert frame["joint"].tolist() == ["pin"] * 3 and frame["contact"].tolist() == ["V"] * 3
    np.testing.assert_array_equal(frame["peak_force [N]"], impacts().peak_force)


def test_derivatives_stand_by_parameter_and_tell_their_coordinate():
    found = sensitivities().to_xarray()
    by_mass = found["x_derivative"].sel(parameter="mass")
    np.testing.assert_array_equal(by_mass, sensitivities().derivatives["x"][:, 1])
    assert found["coordinate"].values.tolist() == ["log clearance", "mass"]
    assert "x_derivative.clearance [m]" in sensitivities().to_dataframe()


def test_names_that_a_dataset_needs_are_refused():
    with pytest.raises(ValueError, match=r"`names` must be other .*, but is \['time'\]: rename"):
        replace(crossings(), values={"time": drawn(COUNT)}).to_xarray()
    rows = dict.fromkeys(("x", "x_derivative"), drawn(COUNT, 2))
    with pytest.raises(ValueError, match="`outputs` must be one that .* is 'x_derivative': rename"):
        replace(sensitivities(), derivatives=rows, outputs=rows).to_xarray()


def test_rigid_contacts_tell_what_was_reached_alone():
    found = nonsmooth().to_xarray()
    assert found.sizes["time"] == 4 and found["impulse"].attrs["units"] == "N s"
