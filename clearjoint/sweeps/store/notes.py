"""What was run, as texts for a reader. They decide nothing: see `.identity`."""

import jax
from jaxtyping import PyTree

from ...export.provenance import describe
from ...model.scene import Scene
from ...parametrisation.paths import parameters


def number_notes(tree: PyTree, varied: PyTree[bool], name: str) -> dict[str, str]:
    """The numbers of a scene or state by name, without those of which a tree of booleans says that
    they vary."""
    varies = {key: any(jax.tree.leaves(flags)) for key, (flags, _) in parameters(varied).items()}
    return {
        f"{name}.{_dotted(key)}": describe(value)
        for key, (value, _) in parameters(tree).items()
        if not varies[key]
    }


def structure_note(scene: Scene) -> str:
    """Names, kinds and choices of a scene, without its numbers."""
    return describe(jax.tree.map(lambda _: 0, scene))


def _dotted(key: str) -> str:
    """``bodies.rod.mass`` for ``bodies['rod'].mass``, since netCDF has no names with quotes."""
    return key.replace("['", ".").replace("']", "")
