"""The floors of the package: who may import whom, and what an import may do."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import clearjoint

PACKAGE = Path(clearjoint.__file__).parent
FLOORS = (
    (
        "vectors",
        "continuity",
        "several",
        "rotations",
        "smoothing",
        "linear",
        "restitution",
        "results",
        "readable",
        "cautions",
        "fields",
        "runtime",
        "conversion",
        "scales",
    ),
    ("bodies", "contact", "friction"),
    (
        "joints.freedoms",
        "joints.base",
        "joints.primitives",
        "joints.axial",
        "joints.ideal",
        "joints.forces",
        "joints.drives",
        "joints.clearance",
        "joints.massless_link",
        "joints.several",
    ),
    ("scene", "breakpoints", "time_decisions", "grouping", "parameters", "variations"),
    (
        "coordinates",
        "absolute",
        "links",
        "inertia",
        "branches",
        "tree",
        "tree_mechanics",
        "joint_coordinates",
        "dynamics",
        "grouped_coordinates",
        "projection",
        "structure",
        "journals",
        "assembly",
        "mechanisms",
    ),
    (
        "impacts",
        "explicit",
        "family",
        "steps",
        "jumps",
        "switches",
        "dense_output",
        "step_length",
        "trial",
        "program_size",
        "stepping",
        "tangents",
        "loops",
        "segments",
        "impact_table",
        "solution",
        "solvers",
        "presets",
        "running",
        "instant",
        "quantities.base",
        "reductions",
        "records",
        "spans",
        "simulate",
        "nonsmooth.box_problem",
        "nonsmooth.contact_problem",
        "nonsmooth.midpoint",
        "nonsmooth.simulate",
        "estimands",
        "integration",
        "sensitivity",
        "lanes",
        "pool",
        "batch",
    ),
    (
        "observables",
        "quantities.bodies",
        "quantities.joints",
        "extend",
        "testing.conformance",
    ),
    (
        "wall_impact",
        "units",
        "measurements",
        "measured_tables",
        "sweeps.layout",
        "sweeps.describe",
        "sweeps.axes",
        "sweeps.starts",
        "sweeps.outputs",
        "sweeps.task",
        "sweeps.fingerprint",
        "sweeps.program",
        "sweeps.identity",
        "sweeps.chunks",
        "sweeps.metadata",
        "sweeps.differences",
        "sweeps.store",
        "sweeps.pickling",
        "sweeps.execution",
        "sweeps.progress",
        "sweeps.variables",
        "sweeps.sweep",
        "testing.programs",
        "testing.replaced_code",
        "identification.residuals",
        "identification.levenberg_marquardt",
        "identification.gauss_newton",
        "identification.starts",
        "identification.level_sets",
        "identification.side_by_side",
        "identification.screening",
        "identification.statistics",
        "identification.tables",
        "identification.rivals",
        "identification.report",
        "identification.fit",
        "identification.information",
        "identification.sensors",
        "identification.identifiability",
        "identification.growth",
        "identification.ways",
        "identification.shots",
        "identification.horizon",
        "identification.passes",
        "identification.identify",
        "identification.record",
        "identification.shooting_window",
        "identification.shooting",
        "identification.multiple_shooting",
        "identification.minimise",
        "plot.style",
        "plot.observed",
        "plot.motion",
        "plot.cycle",
        "plot.forces",
        "plot.journal",
        "plot.frames",
        "plot.labels",
        "plot.outcomes",
        "plot.against",
        "plot.convergence",
        "plot.maps",
        "plot.sections",
        "plot.orbits",
        "plot.record_length",
        "plot.horizon",
        "plot.fits",
        "__main__",
    ),
)
"""A module may import those above it, and on its own floor those before it."""
THIRD_PARTY = {
    "jax": 0,
    "equinox": 0,
    "numpy": 0,
    "diffrax": 5,
    "tqdm": 5,
    "matplotlib": 7,
    "optax": 7,
    "optimistix": 7,
    "scipy": 7,
    "xarray": 7,
    "pandas": 7,
    "pint": 7,
    "zarr": 7,
    "cloudpickle": 7,
}
"""The first floor that may import a package."""

ORDER = [name for floor in FLOORS for name in floor]
FLOOR_OF = {name: number for number, floor in enumerate(FLOORS) for name in floor}
PATHS = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path.name != "__init__.py"
}
KNOWN = [module for module in PATHS if module in FLOOR_OF]


def imports(module: str) -> list[str]:
    """Absolute names of all modules that a module imports, wherever in its text."""
    parts = ("clearjoint", *module.split("."))
    found = []
    for node in ast.walk(ast.parse(PATHS[module].read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = parts[: -node.level] if node.level else ()
            source = ".".join([*above, *([node.module] if node.module else [])])
            names = [f"{source}.{alias.name}" for alias in node.names]
            found += [n if n.removeprefix("clearjoint.") in PATHS else source for n in names]
    return found


def within_package(module: str) -> list[str]:
    names = [name for name in imports(module) if name.split(".")[0] == "clearjoint"]
    return [name.removeprefix("clearjoint.") for name in names]


def test_every_module_has_a_floor():
    assert set(PATHS) <= set(FLOOR_OF)


def test_modules_import_only_what_stands_before_them():
    wrong = {
        module: set(within_package(module)) - set(ORDER[: ORDER.index(module)]) for module in KNOWN
    }
    assert {module: names for module, names in wrong.items() if names} == {}


def test_third_party_packages_keep_to_their_floors():
    own = sys.stdlib_module_names | {"clearjoint"}
    wrong = {
        module: {
            package
            for package in {name.split(".")[0] for name in imports(module)} - own
            if THIRD_PARTY.get(package, 99) > FLOOR_OF[module]
        }
        for module in KNOWN
    }
    assert {module: names for module, names in wrong.items() if names} == {}


def test_annotations_are_not_postponed():
    """Postponed annotations turn an `eqx.AbstractVar` into a field."""
    assert [module for module in PATHS if "__future__" in imports(module)] == []


def test_classes_are_abstract_or_final():
    trees = {name: ast.parse(path.read_text()) for name, path in PATHS.items()}
    classes = [
        node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)
    ]
    assert len(classes) > 30
    concrete = {node.name for node in classes if not node.name.startswith("Abstract")}
    subclassed = {ast.unparse(base).split(".")[-1] for node in classes for base in node.bases}
    assert concrete & subclassed == set()


IMPORT_EVERYTHING = """
import importlib, json, os, sys
import jax, equinox, diffrax, tqdm.auto
from jax._src import xla_bridge

def snapshot():
    return {name: repr(value) for name, value in jax.config.values.items()}, dict(os.environ)

before = snapshot()
for name in sys.argv[1:]:
    importlib.import_module("clearjoint." + name)
assert snapshot() == before, "an import changed the configuration or the environment"
assert not jax.config.jax_enable_x64, "an import enabled 64-bit floats"
assert not xla_bridge.backends_are_initialized(), "an import started a backend"
"""


def test_import_starts_no_backend_and_changes_no_setting():
    kept = ("PATH", "HOME", "PYTHONPATH")
    environment = {name: value for name, value in os.environ.items() if name in kept}
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_EVERYTHING, *PATHS],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


ROOT = PACKAGE.parent
PUBLIC = {f"clearjoint.{name}" for name in ("extend", "plot", "presets", "quantities", "testing")}
"""What may be imported from beside `clearjoint` itself."""


def imported_from_outside(source: str) -> set[str]:
    """Modules of the package that a source text imports, and private names that it reaches for."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            assert node.module is not None
            known = [f"{node.module}.{alias.name}" for alias in node.names]
            inner = {name for name in known if name.removeprefix("clearjoint.") in PATHS}
            found |= inner or {node.module}
    return {name for name in found if name.split(".")[0] == "clearjoint"}


def outside_sources() -> dict[str, str]:
    """The text of every study, and of the code of every notebook."""
    studies = {str(path): path.read_text() for path in sorted((ROOT / "studies").rglob("*.py"))}
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text())["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        studies[str(path)] = "\n".join(code)
    return studies


def test_studies_and_notebooks_import_public_names_only():
    public = {"clearjoint", "clearjoint.plot.style", *PUBLIC}
    wrong = {path: imported_from_outside(text) - public for path, text in outside_sources().items()}
    assert {path: names for path, names in wrong.items() if names} == {}


def test_an_import_from_inside_is_seen():
    hidden = "from clearjoint.stepping import attempt\nfrom clearjoint import dynamics, Scene\n"
    assert imported_from_outside(hidden) == {"clearjoint.stepping", "clearjoint.dynamics"}


def test_every_study_runs_by_its_name_and_stands_in_the_gallery():
    gallery = (ROOT / "studies" / "README.md").read_text(encoding="utf-8")
    folders = [path for path in (ROOT / "studies").iterdir() if (path / "__init__.py").exists()]
    studies = [path for path in folders if path.name != "common"]
    assert len(studies) > 15
    for study in studies:
        assert (study / "__main__.py").is_file() and (study / "README.md").is_file(), study
        assert f"]({study.name})" in gallery and f"]({study.name}/" in gallery, study
