"""Names and texts in the form in which matplotlib draws them."""

from textwrap import fill

LONGEST_NAME = 40
"""Largest number of characters of a name in a label."""
WIDEST_LABEL = 44
"""Number of characters up to which the label of an axis is one line."""


def literal(text: str) -> str:
    """Escape dollar signs, between which matplotlib would draw mathematics."""
    return text.replace("$", r"\$")


def shown(name: str, longest: int = LONGEST_NAME) -> str:
    """Return a name as one line of at most `longest` characters, for matplotlib.

    Long names keep their start and their end, in which names of parts differ most often. Legends
    omit labels that begin with an underscore, so these names get a space of no width in front.
    """
    text = " ".join(str(name).split()) or "(no name)"
    if len(text) > longest:
        end = longest // 3
        text = f"{text[: longest - end - 1]}…{text[-end:]}"
    return literal(f"\u200b{text}" if text.startswith("_") else text)


def broken(label: str) -> str:
    """Break the label of an axis into lines of about equal length that fit beside it."""
    lines = -(-len(label) // WIDEST_LABEL)
    if lines <= 1:
        return label
    width = len(label) // lines + 6
    return fill(label, width, break_long_words=False, break_on_hyphens=False)
