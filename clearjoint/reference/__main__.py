"""Write the documentation as static pages: guide, studies, command line and API."""

import argparse
import html
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import clearjoint

try:
    import griffe
    import latex2mathml.converter
    import nbconvert

    from .docstrings import SITE, with_links
except ImportError as error:
    message = 'The documentation needs more packages: pip install "clearjoint[reference]"'
    raise ImportError(message) from error

ROOT = Path(clearjoint.__file__).parents[1]
LINK = re.compile(r"(?<=\]\()([^)#\s]+)")  # the target of a link of Markdown
SOURCE = re.compile(r'[^"]+\.(?:md|ipynb)(?=")')  # a README or notebook in a JSON text
# A formula in HTML, in LaTeX: "span" in a line, "div" in a paragraph of its own.
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[([](.*?)\\[)\]]</\1>', re.DOTALL)


def page_of(source: str) -> str:
    """Return the path, among the pages, of a README, a notebook or another repository file."""
    return re.sub(r"^(\.github/|clearjoint/)?_?", "", source).replace(".ipynb", ".md")


def write_page(source: str, docs: Path) -> None:
    """Write `source`, a README or a notebook with its stored outputs, as a page into the folder
    `docs`, and copy the other files to which the page links."""
    page = docs / page_of(source)
    page.parent.mkdir(parents=True, exist_ok=True)
    if source.endswith(".ipynb"):
        names = {"unique_key": page.stem, "output_files_dir": f"{page.stem}_files"}
        text, resources = nbconvert.MarkdownExporter().from_filename(str(ROOT / source), names)
        for name, content in resources["outputs"].items():
            file = page.parent / name
            file.parent.mkdir(exist_ok=True)
            file.write_bytes(content)
    else:
        text = (ROOT / source).read_text(encoding="utf-8")

    # Returns the new target of a link that `LINK` has matched: for a file of the repository, the
    # file's page or, unless the file is Markdown or a notebook, a copy of the file.
    def relinked(match: re.Match) -> str:
        target = os.path.normpath(Path(source).parent / match[0])
        if (ROOT / target).is_dir():
            target = f"{target}/README.md"
        if "://" in match[0] or not (ROOT / target).is_file():  # a web page, or no link to a file
            return match[0]
        copy = docs / page_of(target)
        if not target.endswith((".md", ".ipynb")):
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / target, copy)
        return os.path.relpath(copy, page.parent)

    page.write_text(with_links(LINK.sub(relinked, text)), encoding="utf-8")


def write_api_page(name: str, package: griffe.Module, docs: Path) -> None:
    """Write the page `name` of the API: a table of its public names, and then their docstrings, in
    groups. A line beginning with ":::" makes mkdocstrings insert the docstring of an object."""
    page = SITE["api"][name]
    options = f"members: {page.get('members', False)}, show_root_heading: false"
    module = f"::: {page['module']}\n    options: {{{options}, show_root_toc_entry: false}}"
    table, entries = [], []
    for group, names in page.get("names", {}).items():
        paths = [f"{page['module']}.{name}" for name in names.split()]
        entries += [f"## {group}", *(f"::: {path}" for path in paths)]
        for path in paths:
            docstring = package[path.removeprefix("clearjoint.")].docstring.value
            first_paragraph = docstring.split("\n\n")[0]
            line = with_links(first_paragraph).replace("\n", " ").replace("|", "\\|")
            table.append(f"| [`{path.rpartition('.')[2]}`][{path}] | {line} |")
    head = ["| Name | Description |", "|---|---|"] if table else []
    anchor = "" if "text" in page else f" {{#{page['module']}}}"  # where links to a module lead
    title = f"# {page['title']}{anchor}"
    parts = [title, page.get("text", module), "\n".join(head + table), *entries]
    docs.joinpath("api").mkdir(exist_ok=True)
    docs.joinpath("api", f"{name}.md").write_text("\n\n".join(parts), encoding="utf-8")


def finished(text: str) -> str:
    """Return the HTML text of a page with formulas as MathML, which browsers show without scripts,
    and without tooltips that name private modules."""

    def formula(match: re.Match) -> str:
        display = "block" if match[1] == "div" else "inline"
        return latex2mathml.converter.convert(html.unescape(match[2]), display=display)

    return re.sub(r' title="[^"]*\bclearjoint\._[^"]*"', "", FORMULA.sub(formula, text))


def build(folder: Path) -> None:
    """Write all pages of the documentation into a folder."""
    with tempfile.TemporaryDirectory() as name:
        docs, site = Path(name) / "docs", Path(name) / "site"
        nav = json.dumps(SITE["site"]["nav"])
        for source in SOURCE.findall(nav):
            write_page(source, docs)
        package = griffe.load("clearjoint", search_paths=[ROOT])
        assert isinstance(package, griffe.Module)
        for page in SITE["api"]:
            write_api_page(page, package, docs)
        for script in ("iframe-worker.js", "pages.css"):
            shutil.copy(Path(__file__).with_name(script), docs)
        # The pages of the API follow the guide and the studies.
        guide, studies, *rest = json.loads(SOURCE.sub(lambda match: page_of(match[0]), nav))
        api = {"API": [f"api/{page}.md" for page in SITE["api"]]}
        config = {**SITE["site"], "nav": [guide, studies, api, *rest], "site_dir": str(site)}
        file = Path(name) / "mkdocs.yml"
        file.write_text(json.dumps(config), encoding="utf-8")  # JSON is YAML
        command = [sys.executable, "-m", "zensical", "build", "--strict", "-f", str(file)]
        subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
        for page in site.rglob("*.html"):
            page.write_text(finished(page.read_text(encoding="utf-8")), encoding="utf-8")
        shutil.copytree(site, folder, dirs_exist_ok=True)


def main() -> None:
    """Write the pages into the folder of the command line, and print the path of the first."""
    parser = argparse.ArgumentParser(prog="python -m clearjoint.reference", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/reference"), help="%(default)s")
    folder = parser.parse_args().out
    if not (ROOT / "README.md").is_file():
        parser.error("the guide and the studies are not installed: run this in a clone")
    build(folder)
    print(folder / "index.html")


if __name__ == "__main__":
    main()
