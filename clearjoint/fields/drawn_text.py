"""Names and texts as matplotlib is to draw them."""

from textwrap import fill

LONGEST_NAME = 40
"""Characters of a name that labels show."""
WIDEST_LABEL = 44
"""Characters from which on a label of an axis is broken into lines."""


def literal(text: str) -> str:
    """A text for matplotlib to draw as it is: dollar signs do not enclose mathematics."""
    return text.replace("$", r"\$")


def shown(name: str, longest: int = LONGEST_NAME) -> str:
    """A name for matplotlib to draw as it is, in one line, of at most so many characters.

    Long names keep their begin and their end, by which names of parts differ most often. Legends
    leave out labels that begin with an underscore, so such a name begins with a space of no width.
    """
    text = " ".join(str(name).split()) or "(no name)"
    if len(text) > longest:
        end = longest // 3
        text = f"{text[: longest - end - 1]}…{text[-end:]}"
    return literal(f"\u200b{text}" if text.startswith("_") else text)


def broken(label: str) -> str:
    """The label of an axis in lines of about equal lengths that fit beside it."""
    lines = -(-len(label) // WIDEST_LABEL)
    if lines <= 1:
        return label
    width = len(label) // lines + 6
    return fill(label, width, break_long_words=False, break_on_hyphens=False)
