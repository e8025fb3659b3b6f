"""What is computed, as bytes: cloudpickle, with classes that are PyTrees made whole.

Classes of a script, a notebook or a function travel by value: where they are decoded, cloudpickle
makes an empty class and sets its attributes afterwards. But when a class is made, equinox tells JAX
of what its instances consist, which would be nothing. So here a class is made with its fields, and
gets its attributes then.
"""

import inspect
import io
from collections.abc import Callable, Mapping
from dataclasses import fields

import cloudpickle
import equinox as eqx


def encoded(value: object) -> bytes:
    """A value as bytes that `pickle.loads` decodes, in another process."""
    file = io.BytesIO()
    _Pickler(file).dump(value)
    return file.getvalue()


class _Pickler(cloudpickle.Pickler):
    def reducer_override(self, value: object) -> object:
        """How cloudpickle rebuilds a function or a class; that of a module with its fields."""
        reduced = super().reducer_override(value)
        if reduced is NotImplemented or not isinstance(value, type):
            return reduced
        if not issubclass(value, eqx.Module):
            return reduced
        make, arguments, *state = reduced
        return (_with_fields, (make, arguments, _own_fields(value), _initialises(value)), *state)


def _own_fields(cls: type[eqx.Module]) -> dict[str, bool]:
    """The fields that a class adds to those it inherits, and whether they are static."""
    own = inspect.get_annotations(cls)
    return {f.name: f.metadata.get("static", False) for f in fields(cls) if f.name in own}


def _initialises(cls: type[eqx.Module]) -> bool:
    """Whether a class has an `__init__` of its own, written or made by equinox."""
    return "__init__" in vars(cls)


def _with_fields(
    make: Callable[..., type],
    arguments: tuple[object, ...],
    statics: Mapping[str, bool],
    initialises: bool,
) -> type:
    """The class that cloudpickle makes without attributes, with fields. It gets its attributes
    afterwards, among them an `__init__` where it has one."""
    constructor, name, bases, namespace, *rest = arguments
    assert isinstance(namespace, dict)
    declared = {name: eqx.field(static=static, default=None) for name, static in statics.items()}
    annotations = dict.fromkeys(statics, object)
    placeholder = {"__init__": _placeholder} if initialises else {}
    namespace = {**namespace, **placeholder, "__annotations__": annotations, **declared}
    return make(constructor, name, bases, namespace, *rest)


def _placeholder(self: object) -> None:
    """Stands for an `__init__` until the class has got its attributes."""
