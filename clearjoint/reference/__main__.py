"""Write the reference pages of all public names as HTML files."""

import argparse
import importlib
import inspect
import warnings
from pathlib import Path

import clearjoint

try:
    import pdoc.doc
    import pdoc.render
except ImportError as error:
    raise ImportError(
        'The reference pages need pdoc: pip install "clearjoint[reference]"'
    ) from error

FIRST = """
    Scene Body State body_state rotation GROUND ClearanceJoint RevoluteJoint SphericalJoint
    PrismaticJoint SpringDamper Motor PrescribedRotation assemble simulate Settings Saving observe
    view configure RESULTS SimulationError Section sweep Axis Peak Statistics Quantiles ImpactCount
    Saved ImpactTable open_sweep settle sensitivities Parameter Log Linear Bounded Measurements
    Series identify identifiability fit_horizon posterior minimise largest_feasible ensemble
    Uncertain wear load save load_urdf
"""
"""Names of the package in the order of learning. The others follow in that of the package."""


def _place(name: str) -> int:
    first = FIRST.split()
    return first.index(name) if name in first else len(first)


def main() -> None:
    """Write the pages into the folder that the command line names, ``results/reference`` by
    default, and print the path of the package's page."""
    parser = argparse.ArgumentParser(prog="python -m clearjoint.reference", description=__doc__)
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path("results/reference"), help="%(default)s"
    )
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    # The package, its public modules, and the module that describes the presets get pages. The
    # package does not import `plot` and `testing` itself: this import makes them its attributes.
    inner = ("plot", "testing", "simulation.step.presets")
    *_, presets = (importlib.import_module(f"clearjoint.{name}") for name in inner)
    modules = [clearjoint, presets, *(getattr(clearjoint, name) for name in dir(clearjoint))]
    pages = {}
    for module in filter(inspect.ismodule, modules):
        # pdoc omits names that are imported from elsewhere, unless they are in `__all__`.
        names = [
            name
            for name, value in vars(module).items()
            if not name.startswith("_") and not inspect.ismodule(value)
        ]
        # Pages list names in the order of `__all__`.
        vars(module)["__all__"] = sorted(names, key=_place) if module is clearjoint else names
        pages[module.__name__] = pdoc.doc.Module(module)
    # The page of the package ends with the list of changes.
    package = pages["clearjoint"]
    changes = Path(clearjoint.__file__).with_name("CHANGELOG.md").read_text(encoding="utf-8")
    package.docstring = f"{package.docstring}\n\n{changes}"
    pdoc.render.configure(docformat="markdown", math=True, show_source=False)
    with warnings.catch_warnings():  # about annotations that pdoc cannot resolve
        warnings.simplefilter("ignore")
        for name, page in pages.items():
            html = pdoc.render.html_module(page, pages)
            (folder / f"{name}.html").write_text(html, encoding="utf-8")
        (folder / "search.js").write_text(pdoc.render.search_index(pages), encoding="utf-8")
    print(folder / "clearjoint.html")


if __name__ == "__main__":
    main()
