"""The pages: which names stand together, as a user looks for them."""

from dataclasses import dataclass

from .public_names import PublicName


@dataclass(frozen=True)
class Group:
    """Names that share a page.

    - `page`: its file's name, which is the name of no argument: pdoc would link it.
    - `title` and `text`: what stands above the names.
    - `places`: modules, or packages of them, whose names it holds.
    """

    page: str
    title: str
    text: str
    places: tuple[str, ...]


GROUPS = (
    Group(
        "scenes",
        "Scenes, bodies and states",
        "A mechanism as it is built, checked, assembled, saved and read.",
        ("model.scene", "model.bodies", "model.orientations", "dynamics.assembly")
        + ("dynamics.constraint_report", "scene_files", "views"),
    ),
    Group("ideal-joints", "Ideal joints", "Joints without play.", ("model.joints",)),
    Group(
        "plays",
        "Joints with clearance and other plays",
        "Journals in bearings, balls in sockets, pins in slots, sliders in guides, gear teeth, "
        "and backlash about an axis.",
        ("model.plays",),
    ),
    Group(
        "friction-laws",
        "Friction laws",
        "The force against sliding, as a multiple of the normal force: regularised, falling from "
        "breakaway, or with bristles, which stick.",
        ("model.contact.friction", "model.contact.stribeck", "model.contact.bristles"),
    ),
    Group(
        "contact-laws",
        "Contact laws",
        r"The normal force of a contact from its penetration $\delta$ and the rate "
        r"$\dot\delta$; a law with memory knows the entry speed $\dot\delta_0$ besides. "
        r"Most are of the form $$F = K \delta^n \left(1 + \chi\, "
        r"\frac{\dot\delta}{\dot\delta_0}\right)$$ and differ in the hysteresis damping "
        r"factor $\chi$, a function of the requested restitution $c$.",
        ("model.contact", "simulation.wall_impact", "simulation.law_ranges"),
    ),
    Group("lubricant-films", "Lubricant films", "What carries a journal in oil.", ("model.film",)),
    Group(
        "drives-and-loads",
        "Drives, springs and loads",
        "What moves a mechanism, and what acts on it beside its joints.",
        ("model.drives", "model.forces"),
    ),
    Group(
        "mechanisms",
        "Ready mechanisms",
        "Each returns a scene and its first state.",
        ("model.mechanisms",),
    ),
    Group(
        "runs",
        "Runs",
        "Simulate a scene and look at what it did.",
        ("simulation", "dynamics", "results", "runtime", "fields.cautions")
        + ("tables", "compilation"),
    ),
    Group(
        "presets",
        "Settings by name",
        "Import them as `cj.presets`: `cj.simulate(scene, state, 1.0, cj.presets.study)`.",
        ("presets",),
    ),
    Group(
        "sweeps",
        "Sweeps",
        "Thousands of runs side by side, each reduced to what is looked for while it runs.",
        ("sweeps", "simulation.batch"),
    ),
    Group(
        "fits",
        "Fits and derivatives",
        "Parameters from measurements, what data can tell of them, and derivatives of a motion.",
        ("identification", "information", "measurements", "parametrisation")
        + ("simulation.sensitivities",),
    ),
    Group(
        "quantities",
        "Quantities and sensors",
        "Import them as `cj.quantities`.",
        ("quantities",),
    ),
    Group("plots", "Plots", "Import them by `from clearjoint import plot`.", ("plot",)),
    Group(
        "extending",
        "Elements of your own",
        "What authors of laws, joints, forces, quantities and reductions subclass and use; "
        "import it from `clearjoint.extend`, and the abstract classes from `clearjoint` too.",
        ("extend", "math", "fields", "model.pen"),
    ),
    Group(
        "testing",
        "Checks of your own elements",
        "Import them from `clearjoint.testing`.",
        ("testing",),
    ),
)


OWN_PAGES = {
    "extend": "extending",
    "plot": "plots",
    "presets": "presets",
    "quantities": "quantities",
    "testing": "testing",
}
"""Pages of modules of their own."""


def grouped(names: list[PublicName]) -> dict[str, list[PublicName]]:
    """The names of each page, each name once and in alphabetical order.

    **Raises:** `ValueError` for a name that no group has a place for.
    """
    shared = {public.name for public in names if public.source == "clearjoint.extend"}
    pages: dict[str, dict[str, PublicName]] = {group.page: {} for group in GROUPS}
    for public in names:
        pages[_page(public, shared)][public.name] = public
    return {
        page: sorted(held.values(), key=lambda public: public.name.lower())
        for page, held in pages.items()
    }


def _page(public: PublicName, shared: set[str]) -> str:
    own = public.source.removeprefix("clearjoint.")
    if own in OWN_PAGES:
        return OWN_PAGES[own]
    if public.name in shared:
        return OWN_PAGES["extend"]
    origin = public.origin.removeprefix("clearjoint.") + "."
    fitting = [
        (len(place), group.page)
        for group in GROUPS
        for place in group.places
        if origin.startswith(place + ".")
    ]
    if not fitting:
        raise ValueError(
            f"No reference page has a place for {public.name} of {public.origin}: "
            "add its module to a group in clearjoint/reference/groups.py."
        )
    return max(fitting)[1]
