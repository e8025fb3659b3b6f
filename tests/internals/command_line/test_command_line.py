"""The program `clearjoint`: messages, exit codes, and results equal to those of the library."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tomllib
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path

import click
import jax
import jsonschema
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

import clearjoint as cj
from clearjoint._command_line import fitting, folders, reports, running, study, wearing
from clearjoint._command_line.checking import number_paths
from clearjoint._command_line.endings import understandable
from clearjoint._command_line.folders import read_run
from clearjoint._command_line.program import clearjoint
from clearjoint._command_line.reports import lane_table
from clearjoint._command_line.study import find_path, read_study, study_schema
from clearjoint._command_line.sweeping import sweep_axes
from clearjoint._export.datasets import describe, setting_notes, write_netcdf
from clearjoint._fields.objects import with_arrays
from clearjoint._scene_files.documents import FileLocation, keys_of, written
from clearjoint._simulation.run import host_run, terminal
from clearjoint._sweeps.store.metadata import write_dataset
from clearjoint.extend import Formulation
from tests.support.dropped_rod import dropped_rod
from tests.support.one_body import hinge, one_body
from tests.support.processes import ROOT, printed
from tests.support.repetitions import repetitions
from tests.support.slow import slow
from tests.support.tumbling_bearing import solution_of

STUDY = """
title = "A rod that falls"
scene = "rod.toml"

[run]
end = "31.25 ms"
save_every = "1 ms"
settings = { rtol = 1e-7 }
outputs.height = { kind = "Position", body = "rod", component = "y" }
outputs.force = { kind = "ContactForce", joint = "pin" }
outputs.hardest = { kind = "Peak", quantity = { kind = "ContactForce", joint = "pin" } }
outputs.heating = { kind = "MeanPowerLost", after = "0 ms" }

[run.sections.low]
crossing = { kind = "PenetrationRate", joint = "pin", contact = "V" }
channels.offset = { kind = "JournalOffset", joint = "pin", component = "y" }
count = 5

[sweep]
preset = "preview"
outputs.peak = { kind = "Peak", quantity = { kind = "ContactForce", joint = "pin" } }
outputs.impacts = { kind = "ImpactCount", joint = "pin" }

[sweep.axes.clearance]
path = "joints.pin.clearance"
values = ["0.4 mm", 5e-4]

[sweep.axes.gravity]
path = "gravity.1"
start = 9.0
stop = 10.0
count = 2

[fit]
measurements = "rig.csv"
time = "time"
columns.height = { quantity = { kind = "Position", body = "rod", component = "y" }, noise = "1 um" }

[fit.parameters.clearance]
path = "joints.pin.clearance"
scale = { kind = "Log" }
guess = "0.49 mm"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a scene and a study, in which the program runs."""
    monkeypatch.chdir(tmp_path)
    cj.save(*dropped_rod(), "rod.toml")
    Path("study.toml").write_text(STUDY)
    return tmp_path


def invoke(*arguments: str):
    """The exit code and output of a command, which says nothing twice."""
    outcome = CliRunner().invoke(clearjoint, arguments)
    said = [line for line in outcome.output.splitlines() if line.split(":")[0] in SAID]
    assert repetitions("\n".join(said)) == []
    return outcome


SAID = "error", "warning", "note"
"""Beginnings of the lines of messages."""


def succeeds(*arguments: str) -> str:
    """What a command that succeeds says."""
    outcome = invoke(*arguments)
    assert outcome.exit_code == 0, outcome.output
    return outcome.output


def is_refused(message: str, *arguments: str) -> None:
    """A command ends with the exit code of bad input, a message, and no result."""
    outcome = invoke(*arguments)
    assert outcome.exit_code == 2, outcome.output
    assert re.search(message, outcome.output, re.DOTALL), outcome.output
    assert "Traceback" not in outcome.output and not Path("results").exists()


def changed(old: str, new: str, study: str = STUDY, name: str = "study.toml") -> None:
    """Write a study in which a text is replaced."""
    assert old in study
    Path(name).write_text(study.replace(old, new))


def test_help_has_examples_for_each_command():
    assert "Exit codes: 0" in invoke("--help").output
    for name in clearjoint.commands:
        assert re.search(rf"clearjoint {name}", succeeds(name, "--help")), name


def test_a_scene_is_described(folder):
    output = succeeds("check", "rod.toml")
    for part in (
        "bodies: rod (7.02 kg)",
        "joints: pin (ClearanceJoint)",
        "degrees of freedom: 6",
        "clearance 0.5 mm, LankaraniNikravesh; at the start V 0.5 mm apart",
        "ready to run",
    ):
        assert part in output


@pytest.mark.slow
def test_constraint_errors_have_units_of_lengths_and_of_angles(rotor):
    expected = "largest constraint error: 0 m or rad, rate 0 m/s or rad/s\n"
    assert expected in invoke("check", "rotor.toml").output


def test_check_describes_a_study(folder):
    output = invoke("check", "study.toml").output
    assert "run: 0 s to 0.03125 s" in output
    assert "sweep: 2x2 lanes over clearance, gravity" in output
    assert "fit: clearance from rig.csv" in output


def test_lanes_of_zipped_axes_are_counted_once(folder):
    changed("[sweep]", "[sweep]\nzipped = true")
    assert "sweep: 2 lanes over clearance, gravity" in invoke("check", "study.toml").output
    unequal = "--set", "sweep.axes.gravity.count=3"
    message = r"`sweep.axes`: found [^\n]*2, [^\n]*3[^\n]*expected axes of equal length"
    for command in ("check", "sweep"):
        is_refused(message, command, "study.toml", *unequal)


def test_scene_and_study_may_be_one_file(folder):
    scene = Path("rod.toml").read_text()
    Path("both.toml").write_text(f"title = 'x'\n{scene}\n[run]\nend = 0.03125\n")
    assert "run: 0 s to" in invoke("check", "both.toml").output
    tables = re.sub(r"^\[", "[scene.", scene, flags=re.MULTILINE)
    tables = tables.replace("format = 1\n", "[scene]\n", 1)
    Path("held.toml").write_text(f"{tables}\n[run]\nend = 0.03125\n")
    assert "run: 0 s to" in succeeds("check", "held.toml")


def test_every_number_has_a_written_path(folder):
    lines = invoke("check", "study.toml", "--paths").output.splitlines()
    assert any(re.match(r"joints\.pin\.clearance +0\.0005 m$", line) for line in lines)
    assert any(line.startswith("state.bodies.rod.velocity ") for line in lines)
    scene, state = dropped_rod()
    location = FileLocation("here")
    for name, (value, unit) in cj.parameters(scene).items():
        if np.ndim(value) == 0:
            found = find_path(written(keys_of(name)), scene, state, location)
            assert found.path(scene) is value and found.unit == unit


def test_numbers_with_one_value_have_one_unit():
    scene, state = dropped_rod()
    location, texts = FileLocation("here"), ["joints.pin.clearance", "joints.pin.journal_length"]
    assert find_path(texts, scene, state, location).unit == "m"
    with pytest.raises(ValueError, match="found .'m', 'kg'., expected paths of numbers with one"):
        find_path([*texts, "bodies.rod.mass"], scene, state, location)


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("joints.crank pin.clearance", ("joints", "crank pin", "clearance")),
        ("joints['a.b'].clearance", ("joints", "a.b", "clearance")),
        ("gravity.1", ("gravity", "1")),
        ("gravity[1]", ("gravity", "1")),
        ("state.bodies['a']['b.c'].\"d'e\"", ("state", "bodies", "a", "b.c", "d'e")),
    ],
)
def test_paths_are_written_with_dots_or_brackets(text, keys):
    assert keys_of(text) == keys


NAMES = ["a.b", "a'b", 'a"b', "a[0]", "it's 1.5", 'the "1.5" gear', "", """its 'a' "b".""", "a=b"]
NAMES += ["\\", "\\'", "a\\.b\\", "new\nline", "\u2028", "轴", "\x00", "'", '"', "=", "\\n"]


@pytest.mark.parametrize("key", NAMES)
def test_a_written_key_is_read_back(key):
    # As written in messages and by `check --paths`, and as in the names of `parameters`.
    for text in (written(("joints", key, "axis", 0)), f"joints[{key!r}].axis[0]"):
        assert keys_of(text) == ("joints", key, "axis", "0")
    assert keys_of(written((key, "axis"))) == (key, "axis")
    assert written((key, "axis")).isprintable()


def test_numbers_of_elements_with_any_name_are_set_and_listed(tmp_path):
    scene, state = dropped_rod()
    for name in filter(None, NAMES):
        renamed = cj.Scene(scene.bodies, {name: scene.joints["pin"]}, gravity=scene.gravity)
        cj.save(renamed, state, tmp_path / "SCENE.TOML")
        path = written(("joints", name, "clearance"))
        study = read_study(tmp_path / "SCENE.TOML", (f"{path} = 0.2mm",))
        assert float(study.scene.joints[name].clearance) == pytest.approx(2e-4)
        assert any(line.startswith(f"{path} ") for line in number_paths(study))


@pytest.mark.parametrize(
    "text",
    [
        *("", "joints..pin", ".gravity", "gravity.", "gravity]]", "joints.'pin"),
        *("a]b", "joints.[0", "joints.[0]", "joints[0", "a'b'", "'a'b", "a[0]b"),
    ],
)
def test_a_text_that_is_no_path_is_refused(text):
    with pytest.raises(ValueError, match="Argument `path` must be names with dots between"):
        keys_of(text)


def test_numbers_are_set_on_the_command_line(folder):
    settings = ("joints.pin.clearance=0.2mm", "joints.pin.law.restitution=0.5", "run.end=1")
    study = read_study(Path("study.toml"), (*settings, "gravity.1=-9.7", "bodies.rod.mass='7 kg'"))
    pin = study.scene.joints["pin"]
    assert float(pin.clearance) == 0.2e-3 and float(pin.law.restitution) == 0.5
    assert float(study.scene.gravity[1]) == -9.7 and float(study.scene.bodies["rod"].mass) == 7.0
    assert study.end() == 1.0


def test_settings_are_a_preset_with_changes(folder):
    study = read_study(Path("study.toml"))
    assert study.settings("run") == cj.Settings(rtol=1e-7, ledger=True)  # for MeanPowerLost
    assert study.settings("sweep") == cj.presets.preview
    kind = ("run.settings = { kind = 'Settings', rtol = 1e-7 }",)
    assert read_study(Path("study.toml"), kind).settings("run") == study.settings("run")
    none = read_study(Path("study.toml"), ("run.settings = 'none'",)).settings("run")
    assert none == cj.Settings(ledger=True)
    assert study.settings("fit") == cj.presets.identification
    changed('preset = "preview"', "")
    assert read_study(Path("study.toml")).settings("sweep") == cj.Settings(rtol=1e-7)
    without_sections = read_study(Path("rod.toml"), ("run.settings.rtol=1e-7",))
    assert without_sections.settings("run") == cj.Settings(rtol=1e-7)


def test_reductions_have_the_unit_of_their_quantity_and_columns_that_of_the_header(folder):
    parts = read_study(Path("study.toml")).parts
    assert parts.run.outputs["hardest"].unit == "N" and parts.fit.columns["height"].unit is None


def test_axes_take_units_and_ranges(folder):
    study = read_study(Path("study.toml"))
    axes = sweep_axes(study, study.parts.sweep)
    np.testing.assert_array_equal(axes["clearance"].values, [4e-4, 5e-4])
    np.testing.assert_array_equal(axes["gravity"].values, [9.0, 10.0])


WRONG_UNIT, OFF = "joints.pin.clearance=2kg", "'joints.pin.bearing_point=[0.1, 0, 0]'"
REFUSED = [
    ("check rd.toml", "'rd.toml' does not exist"),
    ("check .", "'.' is a directory"),
    ("report .", "expected a folder of results"),
    ("run rod.toml", r"`run`.*expected an `end`.*--end 1"),
    ("check rod.toml --set joints.pn.x=1", "did you mean 'pin'"),
    ("check rod.toml --set run.setings.rtol=1", "mean 'settings'"),
    ("check rod.toml --set gravity", "a path and a value"),
    (f"check rod.toml --set {WRONG_UNIT}", rf"rod.toml with --set {WRONG_UNIT}, `joints.pin.clear"),
    (f"check rod.toml --set {WRONG_UNIT}", "`joints.pin.clearance`: found.*of this dim"),
    ("run study.toml --preset acurate", "did you mean 'accurate'"),
    ("sweep rod.toml --end 1", r"add a section \[sweep\]"),
    ("fit rod.toml", r"expected a section \[fit\]"),
    ("wear rod.toml", r"`wear`.*expected a section \[wear\]"),
    ("fit study.toml", r"`fit\.measurements`.*expected a CSV file"),
    ("check study.toml --set run.outputs=3", "`run.outputs`: found 3, expected a table of entries"),
    ("check study.toml --set run.save_every='1h'", "at most the duration"),
    (f"check rod.toml --set {OFF}", "assemble"),
]


@pytest.mark.parametrize(("words", "message"), REFUSED)
def test_bad_input_is_a_sentence_with_a_remedy(words, message, folder):
    is_refused(message, *shlex.split(words))


WRONG = {
    "end": ('end = "31.25 ms"', "end = 0", r"study.toml, line 6, `run.end`: .*after the start"),
    "end of lanes": (
        'preset = "preview"',
        'preset = "preview"\nend = -1',
        r"study.toml, line \d+, `sweep.end`: .*after the start",
    ),
    "path": ('"joints.pin.clearance"\nvalues', '"joints.pin.clearence"\nvalues', "clearance'"),
    "not a number": ('"gravity.1"', '"gravity"', "the path of one number.*0, 1, 2"),
    "quantity": (
        '"Position", body = "rod", component = "y" }\noutputs.force',
        '"Positon" }\noutputs.force',
        r"study.toml, line 9, `run.outputs.height.kind`.*did you mean 'Position'",
    ),
    "window": ('after = "0 ms"', 'after = "0 mm"', "`run.outputs.heating.after`.*number in s"),
    "body": ('"Position", body = "rod"', '"Position", body = "arm"', "scene's.*rod"),
    "key": ("save_every", "save_evry", "did you mean 'save_every'"),
    "both": ("start = 9.0", "values = [1.0]\nstart = 9.0", "either `values`"),
    "geometric": (
        "count = 2",
        'count = 2\nspacing = "log"',
        "`.*gravity.spacing`.*one of geometric, linear",
    ),
    "preset": ('preset = "preview"', "preset = 3", "`sweep.preset`: found 3, expected one of acc"),
    "presets": ('preset = "preview"', 'preset = ["default"]', "`sweep.preset`: .*one of accurate"),
    "joint": (
        '"ImpactCount", joint = "pin"',
        '"ImpactCount", joint = "hinge"',
        r"study.toml, line \d+, `sweep.outputs.impacts`.*scene's.*pin",
    ),
    "reduction": (
        '"ContactForce", joint = "pin" } }\noutputs.heat',
        '"ContactForce", joint = "hinge" } }\noutputs.heat',
        "line 11, `run.outputs.hardest`.*scene's.*pin",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_errors_in_a_study_have_locations(case, folder):
    old, new, message = WRONG[case]
    changed(old, new)
    is_refused(message, "check", "study.toml")


def test_a_state_that_violates_joints_is_refused(folder):
    scene, state = cj.mechanisms.four_bar()
    moved = cj.body_state(np.asarray(state.bodies["crank"].position) + (1e-3, 0.0, 0.0))
    off = cj.State({**state.bodies, "crank": moved})
    cj.save(scene, off, "off.toml")
    is_refused("crank foot.*--assemble NEW.toml", "check", "off.toml")


def test_warnings_are_lines(folder):
    output = succeeds("check", "rod.toml", "--set", "joints.pin.law.stiffness.young_modulus=207")
    assert re.search(r"^warning: .*young_modulus.*207", output, re.MULTILINE)
    assert ".py:" not in output and "filterwarnings" not in output


def test_an_unknown_name_is_reported_with_its_line(folder):
    text = Path("rod.toml").read_text()
    line = 1 + text.split("\n").index('journal_body = "rod"')
    Path("rod.toml").write_text(text.replace('journal_body = "rod"', 'journal_body = "rot"'))
    output = invoke("check", "study.toml").output
    assert f"rod.toml, line {line}, `joints.pin.journal_body`: Argument" in output
    assert "did you mean 'rod'" in output and "top level" not in output


@cache
def study_validator() -> jsonschema.Draft202012Validator:
    """Checks the schema once, unlike `jsonschema.validate`, which does so at each call."""
    schema = study_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_new_writes_files_that_can_run_and_fit_the_schema(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "fourbar").exit_code == 2
    for name in ("double_pendulum", "four_bar", "slider_crank"):
        succeeds("new", name)
        study_validator().validate(tomllib.loads(Path(f"{name}_study.toml").read_text()))
        read_study(Path(f"{name}_study.toml"))
    assert invoke("new", "four_bar").exit_code == 2  # nothing is overwritten
    written = Path("four_bar_study.toml").read_text()
    assert invoke("schema", "study", "--example").output == written
    assert invoke("schema", "--example").output == Path("four_bar.toml").read_text()
    assert "ready to run" in succeeds("check", "four_bar_study.toml")
    wanted = re.sub(r"^# (?=\S* ?=|\[)", "", written, flags=re.MULTILINE)  # fit and wear too
    Path("four_bar_study.toml").write_text(wanted)
    described = invoke("check", "four_bar_study.toml").output
    assert "fit: clearance from rig.csv" in described
    assert "wear: crank pin over 1e+06 cycles of 0.209" in described


def test_a_note_replaces_a_view_that_is_not_installed(folder, monkeypatch, capsys):
    def needs_trimesh(*_arguments):
        raise ImportError("Views need trimesh: pip install 'clearjoint[view]'")

    monkeypatch.setattr(reports, "view", needs_trimesh)
    reports._write_view(Path("."), None, None)
    assert "note: view.html is not written. Views need trimesh" in capsys.readouterr().err


def test_a_study_fits_its_schema(folder):
    study_validator().validate(tomllib.loads(STUDY))
    study_validator().validate(tomllib.loads(WEAR))
    with pytest.raises(jsonschema.ValidationError):
        study_validator().validate({**tomllib.loads(STUDY), "run": {"ende": 1}})
    assert json.loads(invoke("schema", "study").output) == study_validator().schema


@pytest.mark.parametrize("spread", [0.5, 1, {"clearance": 0.2}])
def test_an_entry_may_be_a_number_or_a_table(spread, folder):
    part = {"measurements": "a.csv", "columns": {}, "parameters": {}}
    fit = {**part, "starts": {"kind": "Starts", "number": 3, "spread": spread}}
    study_validator().validate({"scene": "rod.toml", "fit": fit})
    Path("study.json").write_text(json.dumps({"scene": "rod.toml", "fit": fit}))
    assert read_study(Path("study.json")).parts.fit.starts.spread == spread


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (ValueError("what was wrong"), 2, "error: what was wrong"),
        (RuntimeError("what was wrong"), 1, "what was wrong"),
        (OSError(28, "No space left on device"), 2, "error: No space left on device."),
        (OSError(2, "No such file or directory", "a.toml"), 2, "error: a.toml: No such file"),
    ],
    ids=["input", "defect", "system", "file"],
)
def test_errors_have_exit_codes_and_messages(error, code, text, capsys):
    with pytest.raises(click.exceptions.Exit) as ended, understandable():
        raise error
    assert ended.value.exit_code == code
    assert text in capsys.readouterr().err


def test_times_to_save_at():
    times = study.RunPart(save_every=0.3).saved_times(1.0)
    np.testing.assert_allclose(times, [0.0, 0.3, 0.6, 0.9])
    assert len(study.RunPart().saved_times(1.0)) == study.FRAMES + 1


def test_the_first_interruption_waits_and_the_second_does_not():
    with terminal.interruptions_deferred() as stopped:
        assert not stopped()
        signal.raise_signal(signal.SIGINT)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


FLAGS = {"flag_values": [0, 1], "flag_meanings": "successful max_steps_reached"}


def test_lanes_are_rows():
    dims, axes = ("a", "b"), {"a": ("a", [1.0, 2.0], {"units": "m"}), "b": [3, 4, 5]}
    result = (dims, np.array([[0, 1, 0], [0, 0, 0]], np.int8), FLAGS)
    peak = (dims, np.arange(6.0).reshape(2, 3), {"units": "N"})
    frame = lane_table(xr.Dataset({"result": result, "peak": peak}, axes))
    assert frame["a [m]"].tolist() == [1.0] * 3 + [2.0] * 3 and frame["b"].tolist() == [3, 4, 5] * 2
    assert frame["peak [N]"].tolist() == list(range(6))
    assert frame["result"].tolist()[1] == "max_steps_reached"


def test_sections_of_a_zipped_sweep_are_drawn_over_its_first_axis(tmp_path):
    variables = {
        "result": ("lane", np.zeros(2, np.int8), FLAGS),
        "low_count": ("lane", [1, 1]),
        "low_speed": (("lane", "low_number"), [[1.0], [2.0]], {"units": "m/s"}),
    }
    axes = {"a": ("lane", [1.0, 2.0], {"units": "m"}), "b": ("lane", [3.0, 5.0])}
    (tmp_path / "summary.json").write_text('{"kind": "sweep", "title": "zipped"}')
    reports.write_sweep_report(tmp_path, xr.Dataset(variables, axes))
    assert [path.stem for path in (tmp_path / "figures").iterdir()] == ["low speed"]


def test_forces_are_drawn_of_joints_that_have_not_worn(tmp_path):
    angles = np.arange(8) * np.pi / 4
    depths = ("joint", "stage", "angle"), np.zeros((1, 2, 8))
    found = xr.Dataset(
        {
            **{f"{part}_depth": depths for part in ("bearing", "journal")},
            "force": (("joint", "stage"), [[2e4, np.nan]]),
        },
        {"joint": ["pin"], "cycles": ("stage", [0.0, 10.0]), "angle": angles},
    )
    (tmp_path / "summary.json").write_text('{"kind": "wear", "title": "still"}')
    reports.write_wear_report(tmp_path, found)
    assert [path.stem for path in (tmp_path / "figures").iterdir()] == ["forces"]


@pytest.fixture
def without_states(monkeypatch):
    """Runs end before the first saved state; returns the scene."""
    scene, state = dropped_rod()
    found = solution_of(cj.results.Trajectory(np.zeros(1), state))
    failed = {"result": cj.RESULTS.max_steps_reached, "saved": None, "saved_count": 0}
    found = replace(found, formulation=Formulation(), **failed)
    monkeypatch.setattr(running, "simulate", lambda *arguments, **options: found)
    return scene


def test_a_run_without_saved_states_writes_its_scene(folder, without_states):
    assert invoke("run", "study.toml", "--out", "early").exit_code == 1
    read, _ = cj.load("early/scene.toml")
    assert cj.parameters(read).keys() == cj.parameters(without_states).keys()


def test_results_of_an_earlier_run_are_removed(folder, without_states):
    tables = "motion", "observed", "impacts", "outputs", "section low"
    old = [f"{table}.{suffix}" for table in tables for suffix in ("nc", "csv")]
    old += ["numbers.csv", "report.pdf", "view.html", "figures/output_height.png"]
    others = ["notes.md", "sweep.csv", "sweep.zarr/zarr.json", "figures/plot.tex"]
    for name in (*old, *others):
        (Path("out") / name).parent.mkdir(parents=True, exist_ok=True)
        (Path("out") / name).write_text("output,value,unit\n")
    folders.remove_old(Path("out"), tables, ["numbers.csv"])  # files of others, without a summary
    assert all((Path("out") / name).exists() for name in (*old, *others))
    Path("out/summary.json").write_text('{"kind": "run", "title": "old"}')
    invoke("run", "study.toml", "--out", "out")
    assert not [name for name in old if (Path("out") / name).exists()]
    assert all((Path("out") / name).exists() for name in others)
    assert "output height" not in Path("out/index.html").read_text()


def test_sections_are_outputs_also_in_files_of_earlier_versions(folder):
    before = read_study(Path("study.toml")).parts.run
    changed("[run.sections.low]", '[run.outputs.low]\nkind = "Section"')
    now = read_study(Path("study.toml")).parts.run
    assert now.sections == {} and now.outputs == before.outputs and "low" in now.outputs
    changed("[run.sections.low]", "[run.sections.height]")
    with pytest.raises(ValueError, match="`run.sections`.*height.*rename the section"):
        read_study(Path("study.toml"))


def test_quantities_of_a_sweep_have_the_times_of_the_run(folder):
    y = 'outputs.y = { kind = "Position", body = "rod", component = "y" }'
    changed("outputs.impacts =", "\n".join([y, "outputs.impacts ="]))
    read = read_study(Path("study.toml"))
    kept = read.outputs_of_sweep(read.parts.sweep)
    assert set(kept.outputs) == {"low", "peak", "y", "impacts"} and not kept.save.states
    np.testing.assert_array_equal(kept.save.times, read.parts.run.saved_times(31.25e-3))


@pytest.mark.slow
def test_a_run_writes_tables_figures_and_a_page(folder):
    outcome = invoke("run", "study.toml")
    assert outcome.exit_code == 0, outcome.output
    out = Path("results/study/run")
    scene, state = cj.load("rod.toml")
    times = read_study(Path("study.toml")).parts.run.saved_times(31.25e-3)
    save = cj.Saving(times, impacts=True)
    solution = cj.simulate(scene, state, 31.25e-3, cj.Settings(rtol=1e-7, ledger=True), save)
    read_scene, read = read_run(out)
    assert cj.parameters(read_scene).keys() == cj.parameters(scene).keys()
    body, is_saved = solution.states.bodies["rod"], np.isin(read.times, times)
    np.testing.assert_array_equal(read.states.bodies["rod"].position[is_saved], body.position)
    np.testing.assert_array_equal(read.impacts.peak_force, solution.impacts.peak_force)
    seen, again = cj.observe(scene, solution), cj.observe(read_scene, read)
    force, force_again = (one.contacts["pin"]["V"].normal_force for one in (seen, again))
    np.testing.assert_array_equal(force, force_again[is_saved])
    table = pd.read_csv(out / "outputs.csv", index_col=0)
    np.testing.assert_array_equal(table["height [m]"], body.position[:, 1])
    assert len(pd.read_csv(out / "section low.csv")) > 0
    assert cj.load(out / "reached.toml")[0] is not None
    numbers = pd.read_csv(out / "numbers.csv", index_col=0)["value"]
    largest = solution.impacts.peak_force.max()
    assert table["force [N]"].max() < 0.1 * largest  # impacts are shorter than a millisecond
    # The joint's force is the resultant of both bases, which meet the wall together.
    assert numbers["force largest"] == pytest.approx(2.0 * largest, rel=1e-6)
    assert numbers["hardest"] == numbers["force largest"] and numbers["force smallest"] == 0.0
    lost = -np.ptp(seen.energies["mechanical"][[0, -1]])
    assert numbers["heating"] * 31.25e-3 == pytest.approx(-lost, rel=1e-3)
    assert "note: the saved samples of force are between 0 and" in outcome.output
    *_, last = outcome.stdout.strip().splitlines()
    strongest = rf"largest force of a contact {largest:.4g} N \(pin .\)"
    reached = rf"\d+ steps to t = 0.03125 s, \d+ finished impacts, {strongest}: .*html"
    assert re.fullmatch(reached, last)
    pictures = sorted((out / "figures").glob("*.png"))
    assert len(pictures) == 6
    page = (out / "index.html").read_text()
    assert "<th>penetration, µm</th>" in page and "largest_penetration" not in page
    assert ">None<" not in page and "=None" not in page
    assert page.count("data:image/png;base64") == 6 and "http" not in page
    draws_again(out, pictures)
    changed("run.sections.low", "run.sections.high")
    succeeds("run", "study.toml")
    assert [path.stem for path in out.glob("section *.nc")] == ["section high"]
    assert not (out / "figures" / "section low.png").exists()


def draws_again(folder: Path, pictures: list[Path]) -> None:
    """The command `report` draws the pictures of a folder that have been removed."""
    for path in pictures:
        path.unlink()
    succeeds("report", str(folder))
    assert sorted((folder / "figures").glob("*.png")) == pictures


def test_outputs_do_not_share_a_figure_or_a_row(folder):
    height = 'outputs.height = { kind = "Position", body = "rod", component = "y" }'
    again = height.replace("height", "the_height"), height.replace("height", '"the height"')
    changed(height, "\n".join(again))
    assert invoke("run", "study.toml", "--out", "out").exit_code == 0
    figures = {path.name for path in Path("out/figures").iterdir()}
    assert {"output the height.png", "output the_height.png"} <= figures
    changed("outputs.height", 'outputs."force smallest"')
    is_refused("'force smallest'.*rename the output", "run", "study.toml")
    changed("outputs.height", "outputs.time")
    is_refused("'time', .* neither the time .*rename the output", "run", "study.toml")


def test_where_no_folder_can_be_made_nothing_is_computed(folder, monkeypatch):
    def computes(*arguments, **options):
        raise AssertionError("computed")

    monkeypatch.setattr(running, "simulate", computes)
    monkeypatch.setattr(fitting, "identify", computes)
    Path("rig.csv").write_text("time [s],height [m]\n0.01,0.1\n0.02,0.1\n")
    for command in ("run", "fit"):
        outcome = invoke(command, "study.toml", "--out", "rod.toml/out")
        assert isinstance(outcome.exception, SystemExit), outcome.exception
        assert outcome.exit_code != 0, outcome.output
        assert "rod.toml" in outcome.output, outcome.output


@pytest.mark.parametrize("name", ["a b", "x/mm", "x" * 300])
def test_tables_of_any_name_are_written_and_read(name, tmp_path):
    crossings = cj.results.Crossings(np.array([0.1, 0.2]), {"y": np.array([1.0, 2.0])})
    folders.write_table(tmp_path, f"{folders.SECTION}{name}", crossings.to_xarray())
    assert len(list(tmp_path.glob("section *.csv"))) == 1
    assert list(folders._sections(tmp_path)) == [name]
    assert folders.file_name("x/mm") != folders.file_name("x_mm") == "x_mm"


@pytest.fixture
def run_folder(folder):
    """The files of a run with two saved states and two impacts, from which `report` reads it."""
    scene, state = dropped_rod()
    states = jax.tree.map(lambda leaf: np.stack([leaf, leaf]), with_arrays(state))
    first = ("pin", "V", 0.01, 0.0102, 0.0002, 0.1, 0.08, 900.0, 0.0101, 2e-6)
    impacts = cj.results.Impacts.of_rows([("pin", "W", *first[2:]), first])
    solution = solution_of(cj.results.Trajectory(np.array([0.0, 0.1]), states), impacts)
    settings = setting_notes(vars(cj.Settings()))
    write_run(folder, scene, state, replace(solution, final=state, settings=settings))
    folders.write_table(folder, folders.IMPACTS, impacts.to_xarray())
    return folder


def write_run(folder, scene, state, solution):
    folders.write_scene(folder, scene, state)
    formulation = {folders.FORMULATION: folders.formulation_text(solution.formulation)}
    folders.write_table(folder, folders.MOTION, solution.to_xarray().assign_attrs(formulation))


def test_the_memory_of_a_servo_comes_back(folder):
    """Also if the name of one servo begins with that of another."""
    servo = cj.Servo("ground", "arm", (0, 0, 1), 0.5, 200.0, 5.0, 0.1, delay=0.002)
    forces = {"wrist": servo, "wrist command": servo}
    scene, state = one_body("arm", {"hinge": hinge("ground", "arm")}, forces)
    solution = cj.simulate(scene, state, 0.02, save=cj.Saving([0.01, 0.02]), progress=False)
    write_run(folder, scene, state, solution)
    _, read = read_run(folder)
    assert set(read.final.memory["wrist"]) == set(solution.final.memory["wrist command"])
    for memory in ((read.final, solution.final), (read.states, solution.states)):
        jax.tree.map(np.testing.assert_array_equal, *(part.memory for part in memory))


def without(folder, table, name):
    """Write the netCDF file of a table again without a variable, coordinate or attribute."""
    stored = folders.read_table(folder, table)
    if name in stored.attrs:
        stored = stored.assign_attrs()
        del stored.attrs[name]
    write_netcdf(stored.drop_vars(name, errors="ignore"), folder / f"{table}.nc")


@pytest.mark.parametrize("every", [4, slow(1)])
def test_a_run_whose_tables_lack_a_name_is_refused(every, run_folder):
    _, whole = read_run(run_folder)
    assert whole.impacts.contact.tolist() == ["V", "W"]
    read_anyway = []
    for table in (folders.MOTION, folders.IMPACTS):
        stored = folders.read_table(run_folder, table)
        for name in sorted(map(str, {*stored.variables, *stored.attrs}))[::every]:
            with restored(run_folder / f"{table}.nc"):
                without(run_folder, table, name)
                try:
                    read_run(run_folder)
                    read_anyway.append(name)
                except ValueError as error:
                    assert re.search(rf"{table}.nc: found no .*\b{name}\b", str(error))  # noqa: PT017
                    assert "compute them again" in str(error)  # noqa: PT017
    # The file has the formulation as JSON, so the settings are only shown.
    others = {"Conventions", "title", "source", "table", "component", "parameter", "impact"}
    assert set(read_anyway) <= others | {name for name, _ in whole.settings}


def test_a_run_of_another_scene_is_refused(run_folder):
    text = (run_folder / "scene.toml").read_text()
    (run_folder / "scene.toml").write_text(text.replace("rod", "bar"))
    refused = r"motion.nc: found no bar, expected .* the scene in scene"
    with pytest.raises(ValueError, match=refused):
        read_run(run_folder)


@contextmanager
def restored(file):
    """A context after which a file has its content again."""
    content = file.read_bytes()
    yield
    file.write_bytes(content)


def test_a_folder_without_kind_and_title_of_results_is_refused(tmp_path):
    (tmp_path / "summary.json").write_text('{"title": "Rod"}')
    with pytest.raises(ValueError, match="found no summary.json with kind and title"):
        folders.read_summary(tmp_path)


@pytest.mark.slow
def test_a_failed_or_interrupted_run_writes_its_results(folder, monkeypatch):
    outcome = invoke("run", "study.toml", "--set", "run.settings.max_steps=20", "--out", "failed")
    assert outcome.exit_code == 1 and "step limit" in outcome.output, outcome.output
    assert json.loads(Path("failed/summary.json").read_text())["time_reached_s"] < 31e-3
    assert cj.load("failed/reached.toml")

    monkeypatch.setattr(host_run, "ATTEMPTS_A_SEGMENT", 20)
    stopped_at_once = nullcontext(lambda: True)
    monkeypatch.setattr(host_run, "interruptions_deferred", lambda: stopped_at_once)
    outcome = invoke("run", "study.toml", "--out", "stopped")
    assert outcome.exit_code == 130 and "interrupted at t = " in outcome.output, outcome.output
    assert json.loads(Path("stopped/summary.json").read_text())["ended"] == "interrupted"
    with xr.open_dataset("stopped/motion.nc", engine="scipy") as motion:
        assert 0 < len(motion["time"]) < 32


@pytest.mark.slow
def test_a_sweep_is_stored_and_continued(folder):
    line = r"4 lanes, 0 failed, 0 pending, \d+ steps, largest force [\d.]+ N: .*index.html"
    assert re.search(line, succeeds("sweep", "study.toml"))
    out = Path("results/study/sweep")
    frame, dataset = pd.read_csv(out / "sweep.csv"), cj.open_sweep(out / "sweep.zarr")
    assert len(frame) == 4 and set(frame["result"]) == {"successful"}
    np.testing.assert_array_equal(frame["peak [N]"], dataset["peak"].values.ravel())
    assert (out / "figures" / "peak.png").exists() and (out / "index.html").exists()
    (out / "figures" / "old.png").touch()
    succeeds("sweep", "study.toml", "--set", "sweep.axes.gravity.count=3")
    assert len(pd.read_csv(out / "sweep.csv")) == 6
    assert not (out / "figures" / "old.png").exists()


WEAR = """
scene = "rotor.toml"

[wear]
cycle = 0.031415926535897934
depth = "1 um"
samples = 8
largest_change = "0.5 um"

[wear.rates.bearing]
journal = "1e-5 mm^3/(N m)"
"""
STIFFNESS = 1e8


@pytest.fixture
def rotor(tmp_path, monkeypatch):
    """A folder with a rotor whose weight rests on the wall of its bearing, and a study of wear."""
    monkeypatch.chdir(tmp_path)
    law = cj.laws.ElastoGap(stiffness=STIFFNESS, damping=1e5, exponent=1.0)
    lowest = -1.0 - 0.5 * 20.0 * 9.81 / STIFFNESS / 50e-6  # in clearances
    cj.save(*cj.mechanisms.rotor_in_bearing(law=law, offset=(0.0, lowest)), "rotor.toml")
    Path("wear.toml").write_text(WEAR)
    return tmp_path


@pytest.mark.slow
def test_wear_is_computed_continued_and_written(rotor, monkeypatch):
    """The journal wears evenly by Archard's law, with the rate k F v over its surface."""
    assert "wear: bearing over cycles of 0.0314159 s" in invoke("check", "wear.toml").output
    stopped = []

    def interrupted(scene, *arguments, **options):
        stopped.append(wearing_of(scene, *arguments, **options | {"stages": 2}))
        raise KeyboardInterrupt

    wearing_of = wearing.compute_wear
    with monkeypatch.context() as patch:
        patch.setattr(wearing, "compute_wear", interrupted)
        outcome = invoke("wear", "wear.toml")
    assert outcome.exit_code == 130 and "run the same command" in outcome.output, outcome.output
    out = Path("results/wear/wear")
    (out / "figures" / "old.png").touch()
    output = succeeds("wear", "wear.toml")
    stages = pd.read_csv(out / "stages.csv")
    np.testing.assert_array_equal(stages["cycles"][:2], stopped[0]["cycles"].values)
    # Of one cycle: both the sliding distance and the worn surface have the journal's circumference.
    per_cycle = 1e-14 * 20.0 * 9.81 / 25e-3
    depths = stages["journal of bearing, mean [m]"]
    assert depths.iloc[-2] < 1e-6 <= depths.iloc[-1]
    np.testing.assert_allclose(depths, per_cycle * stages["cycles"], rtol=1e-3)
    profile = pd.read_csv(out / "profiles.csv")["journal of bearing [m]"]
    np.testing.assert_allclose(profile, depths.iloc[-1], rtol=1e-2)
    life = 1e-6 / per_cycle
    assert f"(1 µm after {life:.3g}"[:14] in output
    worn, _ = cj.load(out / "worn.toml")
    angles = np.arange(8) * np.pi / 4
    found = worn.joints["bearing"].journal_profile.at(angles).value
    np.testing.assert_allclose(found, -profile, rtol=1e-9)
    pictures = sorted((out / "figures").glob("*.png"))
    assert [path.stem for path in pictures] == ["depths", "forces", "journal_of_bearing", "volumes"]
    draws_again(out, pictures)


def test_a_report_of_wear_without_its_forces_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    depths = ("joint", "stage", "angle"), np.full((1, 2, 8), 1e-6)
    variables = {"bearing_depth": depths, "journal_depth": depths}
    coordinates = {"joint": ["pin"], "angle": np.arange(8.0), "cycles": ("stage", [0.0, 1e3])}
    write_dataset(Path(folders.WEAR_STORE), xr.Dataset(variables, coordinates))
    Path("summary.json").write_text('{"kind": "wear", "title": "Pin"}')
    is_refused("wear.zarr: found no force, bearing_volume, journal_volume", "report", ".")


REFUSED_WEAR = {
    "joint": ("rates.bearing", "rates.motor", r"`wear`: .*`rates` must be one of.*bearing.*motor"),
    "unit": ("mm^3/(N m)", "mm/N", r"line 11, `wear.rates.bearing.journal`.*a number in m\^2/N"),
    "rate": ("1e-5 mm^3/(N m)", "-1 m^2/N", "`wear.rates.bearing.journal`.*1e-9 m"),
    "end": ('depth = "1 um"', "", "`wear.*cycles.*unless `depth` is given.*cycles = 1e6"),
    "cycle": ("cycle = 0", "cycle = -0", "`wear`: .*`cycle` must be positive"),
    "key": ("largest_change", "largest_chang", "did you mean 'largest_change'"),
    "material": (
        'journal = "1e-5 mm^3/(N m)"',
        'kind = "WearRates.on_hard_steel"\nmaterial = "bras"',
        "did you mean 'brass'",
    ),
}


@pytest.mark.parametrize("case", REFUSED_WEAR)
def test_errors_in_the_wear_of_a_study_have_locations(case, rotor):
    old, new, message = REFUSED_WEAR[case]
    changed(old, new, WEAR, "wear.toml")
    for command in ("check", "wear"):
        is_refused(message, command, "wear.toml")


def test_wear_rates_may_be_those_of_materials(rotor):
    materials = 'kind = "WearRates.on_hard_steel"\nmaterial = "PTFE"'
    changed('journal = "1e-5 mm^3/(N m)"', materials, WEAR, "wear.toml")
    (rates,) = read_study(Path("wear.toml")).parts.wear.rates.values()
    assert rates.bearing == pytest.approx(5e-13) and rates.journal == 0.0


@pytest.mark.slow
def test_a_fit_finds_the_true_value(folder):
    scene, state = dropped_rod()
    times = np.linspace(1e-3, 0.02, 40)
    clearance = {"c": cj.Parameter(lambda s: s.joints["pin"].clearance, cj.Log())}
    height = {"height": cj.quantities.Position("rod", "y")}
    values = cj.sensitivities(scene, state, 0.02, clearance, height, times).outputs["height"]
    noisy = values * 1e6 + np.random.default_rng(0).normal(size=40)
    pd.DataFrame({"time [ms]": times * 1e3, "height [um]": noisy}).to_csv("rig.csv", index=False)
    succeeds("fit", "study.toml")
    out = Path("results/study/fit")
    table = pd.read_csv(out / "estimates.csv", index_col=0)
    error = table["estimate"]["clearance"] - 0.5e-3
    assert abs(error) < 4.0 * table["standard_error"]["clearance"]
    assert "chi squared" in (out / "report.txt").read_text()
    fitted = float(cj.load(out / "fitted.toml")[0].joints["pin"].clearance)
    assert fitted == pytest.approx(table["estimate"]["clearance"], rel=1e-12)


INTERRUPTED = """
import signal, sys
import clearjoint_command

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "jax":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Finder())
clearjoint_command.main()
"""


def test_ctrl_c_during_the_import_ends_the_program():
    command = [sys.executable, "-c", INTERRUPTED]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


LAUNCHER = ROOT / "clearjoint" / "_command_line" / "launcher"
IMPORTED = """
import atexit, sys
import clearjoint_command

large = {"jax", "scipy.stats", "matplotlib.pyplot", "clearjoint.plot.polar"}
atexit.register(lambda: print(sorted(large & set(sys.modules))))
clearjoint_command.main()
"""


def imported(folder, *arguments):
    """Which of the large packages the program has imported at its end."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, [ROOT, LAUNCHER]))}
    return printed(IMPORTED, *arguments, cwd=folder, env=env).splitlines()[-1]


@pytest.mark.parametrize("arguments", [["--help"], ["sweep", "-h"], ["--version"]])
def test_help_imports_no_large_package(tmp_path, arguments):
    assert imported(tmp_path, *arguments) == "[]"


@pytest.mark.slow
def test_a_check_imports_no_plots(folder):
    succeeds("new", "four_bar")
    assert imported(Path.cwd(), "check", "four_bar_study.toml") == "['jax']"


@pytest.mark.slow
def test_an_interrupted_fit_writes_the_best_so_far(folder, monkeypatch):
    times = np.linspace(1.0, 20.0, 40)
    pd.DataFrame({"time [ms]": times, "height [um]": -0.5 * times}).to_csv("rig.csv", index=False)

    def stopped(*arguments, progress, **options):
        def stop(iteration):
            progress(iteration)
            raise KeyboardInterrupt

        return cj.identify(*arguments, progress=stop, **options)

    monkeypatch.setattr(fitting, "identify", stopped)
    Path("stopped").mkdir()
    for name in ("summary.json", "series old.nc", "series old.csv"):
        (Path("stopped") / name).touch()
    outcome = invoke("fit", "study.toml", "--out", "stopped")
    assert outcome.exit_code == 130, outcome.output
    assert [path.stem for path in Path("stopped").glob("series *.csv")] == ["series height"]
    assert "interrupted; the best fit so far is in stopped" in outcome.output
    assert json.loads(Path("stopped/summary.json").read_text())["ended"] == "interrupted"
    assert "it was interrupted" in Path("stopped/report.txt").read_text()


def test_a_fit_interrupted_at_once_names_no_old_page(folder, monkeypatch):
    def stopped(*_arguments, **_options):
        raise fitting.FitInterrupted([])

    monkeypatch.setattr(fitting, "identify", stopped)
    Path("rig.csv").write_text("time,height [um]\n0.01,1\n")
    Path("out").mkdir()
    Path("out/index.html").write_text("old")
    outcome = invoke("fit", "study.toml", "--out", "out")
    assert outcome.exit_code == 130, outcome.output
    assert outcome.stdout == "interrupted before the first run ended: nothing was written\n"


@pytest.mark.parametrize(
    "stabilisation", [cj.Baumgarte(alpha=3.0, beta=7.0), cj.Projection(), cj.Unstabilised()]
)
def test_the_formulation_of_a_run_is_restored_bit_for_bit(stabilisation):
    """`clearjoint report` observes a run again, whose reactions depend on the stabilisation."""
    written = Formulation(cj.AbsoluteCoordinates(), stabilisation, redundant=True, ledger=True)
    notes = {folders.FORMULATION: folders.formulation_text(written)}
    read = folders.read_formulation(notes, FileLocation("motion.nc"))
    assert describe(read) == describe(written)
    with pytest.raises(ValueError, match="motion.nc, `formulation.coordinates.kind`: found 'Scr"):
        unknown = {folders.FORMULATION: '{"coordinates": {"kind": "Screws"}}'}
        folders.read_formulation(unknown, FileLocation("motion.nc"))
