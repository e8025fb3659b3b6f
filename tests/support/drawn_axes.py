"""What axes of figures show."""

from matplotlib.axes import Axes


def labels(axes: Axes) -> tuple[str, str]:
    """Those of both axes."""
    return axes.get_xlabel(), axes.get_ylabel()


def legend(axes: Axes) -> list[str]:
    """The texts of the legend."""
    drawn = axes.get_legend()
    assert drawn is not None
    return [text.get_text() for text in drawn.get_texts()]
