"""The pages: pdoc renders them, of groups of names in place of modules."""

import inspect
import re
import types
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from unittest.mock import patch

from .groups import GROUPS, Group, grouped
from .public_names import PublicName, public_names
from .signatures import readable, shortened
from .text import to_html

try:
    import pdoc.doc
    import pdoc.render
    import pdoc.search
    from pdoc.render_helpers import format_signature
except ImportError as error:
    raise ImportError(
        'The reference pages need pdoc: pip install "clearjoint[reference]"'
    ) from error

TEMPLATES = Path(__file__).parent / "templates"
CODE_NAME = re.compile(r"(?<![>\w])<code>((?:\w+\.)*)(\w+)(\([^<]*\))?</code>(?!</a>)")


class _Page(pdoc.doc.Module):
    """A group of names in the form of a module."""

    def __init__(self, group: Group, names: list[PublicName]) -> None:
        module = types.ModuleType(group.page, group.text)
        self.group, self.title, self.names = group, group.title, names
        vars(module).update({public.name: public.value for public in names})
        vars(module)["__all__"] = [public.name for public in names]
        super().__init__(module)

    @cached_property
    def _var_docstrings(self) -> dict[str, str]:
        plain = [
            public
            for public in self.names
            if not (inspect.isclass(public.value) or inspect.isroutine(public.value))
        ]
        return {public.name: public.docstring for public in plain}

    @cached_property
    def submodules(self) -> list[pdoc.doc.Module]:
        return []


def write_pages(folder: Path) -> Path:
    """Write the reference into a folder.

    **Returns:** the page to open first.
    """
    names = grouped(public_names())
    pages = {group.page: _Page(group, names[group.page]) for group in GROUPS if names[group.page]}
    _configure(pages)
    folder.mkdir(parents=True, exist_ok=True)
    targets = _targets(pages)
    for page, held in pages.items():
        html = pdoc.render.html_module(held, pages)
        (folder / f"{page}.html").write_text(_linked(html, page, targets), encoding="utf-8")
    (folder / "search.js").write_text(_search_index(pages), encoding="utf-8")
    first = folder / "index.html"
    first.write_text(pdoc.render.html_index(pages), encoding="utf-8")
    return first


def _targets(pages: dict[str, _Page]) -> dict[str, str]:
    """The page of each name that text may link to: of none that is an argument's name as well."""
    public = [name for held in pages.values() for name in held.names]
    arguments: set[str] = set()
    for name in public:
        if inspect.isclass(name.value) or inspect.isroutine(name.value):
            with suppress(ValueError):
                arguments |= set(inspect.signature(name.value).parameters)
    found = {name.name: page for page, held in pages.items() for name in held.names}
    return {name: page for name, page in found.items() if name not in arguments}


def _configure(pages: dict[str, _Page]) -> None:
    pdoc.render.configure(
        docformat="markdown",
        include_undocumented=False,
        show_source=False,
        template_directory=TEMPLATES,
    )
    pdoc.render.env.filters |= {
        "to_html": to_html,
        "format_signature": _formatted,
        "constructor": _constructor,
        "overrides": _overrides,
        "shortened": shortened,
    }
    pdoc.render.env.globals["pages"] = pages


def _search_index(pages: dict[str, _Page]) -> str:
    """What the search field looks into; pdoc has no filters of the environment there."""
    with (
        patch.object(pdoc.search, "to_html", to_html),
        patch.object(pdoc.search, "format_signature", _formatted),
    ):
        return pdoc.render.search_index(pages)


def _formatted(signature: inspect.Signature, colon: bool) -> str:
    return format_signature(readable(signature), colon)


def _constructor(documented: pdoc.doc.Class) -> str:
    """The arguments of a class, without any for one that nobody constructs."""
    if documented.name.startswith("Abstract") or issubclass(documented.obj, Warning):
        return ""
    try:
        signature = inspect.signature(documented.obj)
    except ValueError:
        return ""
    return _formatted(signature.replace(return_annotation=inspect.Signature.empty), False)


def _overrides(documented: pdoc.doc.Doc) -> bool:
    """Whether a method only fills in what the class's base explains."""
    owner, _, name = documented.qualname.rpartition(".")
    if not owner or not isinstance(documented, pdoc.doc.Function):
        return False
    page = pdoc.render.env.globals["pages"][documented.modulename]
    return any(name in vars(base) for base in vars(page.obj)[owner].__mro__[1:])


def _linked(html: str, page: str, targets: dict[str, str]) -> str:
    """The page with links from names in its text to where they are explained."""

    def link(match: re.Match[str]) -> str:
        prefix, name, _ = match.groups()
        target = targets.get(name)
        if target is None or prefix not in ("", "cj.", "clearjoint.", "plot.", f"cj.{target}."):
            return match.group()
        return f'<a href="{"" if target == page else target + ".html"}#{name}">{match.group()}</a>'

    return CODE_NAME.sub(link, html)
