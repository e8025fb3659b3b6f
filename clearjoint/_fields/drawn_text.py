"""Names and texts given by users, so that matplotlib draws them as they are."""

from textwrap import fill

LONGEST_NAME = 40
"""Number of characters above which a name in a figure is shortened."""
WIDEST_LABEL = 44
"""Number of characters above which an axis's label is broken into several lines."""


def literal(text: str) -> str:
    """Return a text with escaped dollar signs, so that matplotlib does not typeset mathematics."""
    return text.replace("$", r"\$")


def shown(name: str, longest: int = LONGEST_NAME) -> str:
    """Return a name as one line of at most `longest` characters, for matplotlib.

    A longer name has an ellipsis in the middle, since similar names differ mostly at the end. A
    leading underscore, for which legends omit a label, gets a space of zero width in front. Neither
    this space nor escapes of dollar signs count as characters.
    """
    text = " ".join(str(name).split()) or "(no name)"
    if len(text) > longest:
        end = longest // 3
        text = f"{text[: longest - end - 1]}…{text[-end:]}"
    return literal(f"\u200b{text}" if text.startswith("_") else text)


def broken(label: str) -> str:
    """Return an axis's label, in several about equal lines if it is longer than `WIDEST_LABEL`."""
    # The quotient rounded up. Lines end before a word that doesn't fit. With a width of six
    # characters more than the average, the text nearly always fits into this number of lines.
    lines = -(-len(label) // WIDEST_LABEL)
    if lines <= 1:
        return label
    return fill(label, len(label) // lines + 6, break_long_words=False, break_on_hyphens=False)
