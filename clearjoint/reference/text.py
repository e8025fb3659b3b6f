"""From a docstring to HTML: equations become MathML, which browsers render by themselves."""

import inspect
import re

EQUATION = re.compile(
    r"\$\$(.+?)\$\$|(?<![\\$\w])\$([^\s$](?:[^$\n]*[^\s$])?)\$(?![\w$])", re.DOTALL
)
SESSION = re.compile(r"(?:^|(?<=\n\n))(>>> .*?)(?=\n\n|\Z)", re.DOTALL)
LITERAL = re.compile(r"```.*?```|``.+?``|`[^`\n]+`", re.DOTALL)


def fenced(docstring: str) -> str:
    """The docstring with its interactive sessions as blocks of code."""
    return SESSION.sub(r"```pycon\n\1\n```", docstring)


def without_equations(text: str) -> tuple[str, dict[str, str]]:
    """The text with a mark in place of each equation, and the MathML of each mark.

    **Raises:** `ValueError` for an equation that has no MathML.
    """
    marks: dict[str, str] = {}

    def mark(match: re.Match[str]) -> str:
        display, inline = match.groups()
        name = f"EQUATION{len(marks)}MARK"
        marks[name] = _mathml(display or inline, display is not None)
        return f"\n\n{name}\n\n" if display else name

    literals = list(LITERAL.finditer(text))
    ends = [0, *(match.end() for match in literals)]
    starts = [*(match.start() for match in literals), len(text)]
    between = [EQUATION.sub(mark, text[a:b]) for a, b in zip(ends, starts, strict=True)]
    pieces = [piece + match.group() for piece, match in zip(between, literals, strict=False)]
    return "".join(pieces) + between[-1], marks


def _mathml(latex: str, display: bool) -> str:
    from latex2mathml.converter import convert

    try:
        return convert(latex.strip(), display="block" if display else "inline")
    except Exception as error:
        raise ValueError(f"The equation {latex!r} can't be rendered: {error}") from error


def to_html(docstring: str) -> str:
    """Convert Markdown with equations and sessions to HTML."""
    from pdoc.render_helpers import to_html as from_markdown

    text, marks = without_equations(fenced(inspect.cleandoc(docstring)))
    html = str(from_markdown(text))
    for name, mathml in marks.items():
        html = html.replace(f"<p>{name}</p>", mathml).replace(name, mathml)
    return html
