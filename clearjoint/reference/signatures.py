"""Signatures as one reads them: short names of types, and none where anything converts."""

import inspect
import re
from types import MappingProxyType

SHORTER = (
    (r"\bclearjoint(?:\.\w+)*\.(?=\w)", ""),
    (r"\b(?:jax\.)?jaxlib\._jax\.Array\b", "Array"),
    (r"\b(?:collections\.abc|jaxtyping|typing|types|pathlib)\.", ""),
    (r"\b(?:numpy|matplotlib|diffrax|xarray|optax|os)(?:\.\w+)*\.(?=[A-Za-z])", ""),
    (r"float \| Array", "Scalar"),
)


class _Shown:
    """What prints as a given text."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


def shortened(text: str) -> str:
    """The text of a type with short names."""
    for long, short in SHORTER:
        text = re.sub(long, short, text)
    return text


def _annotation(annotation: object) -> object:
    if annotation in (inspect.Parameter.empty, object):
        return inspect.Parameter.empty
    return _Shown(shortened(inspect.formatannotation(annotation)))


def _default(default: object) -> object:
    return _Shown("{}") if default == MappingProxyType({}) else default


def readable(signature: inspect.Signature) -> inspect.Signature:
    """The signature with types by their short names."""
    parameters = [
        parameter.replace(
            annotation=_annotation(parameter.annotation), default=_default(parameter.default)
        )
        for parameter in signature.parameters.values()
    ]
    returned = signature.return_annotation
    return signature.replace(
        parameters=parameters,
        return_annotation=returned if returned is None else _annotation(returned),
    )
