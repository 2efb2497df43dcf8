"""What `make docs` does beside MkDocs: docstrings, written for readers of the source, and formulas become a page's.

An extension of griffe, which reads the docstrings, and hooks of MkDocs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import griffe
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

BESIDE = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):`([^`]+)`")
RULE = r"=+(?: +=+)+ *"
TABLE = re.compile(rf"^{RULE}\n(?:(.+)\n{RULE}\n)?((?:.+\n)+?){RULE}$", re.MULTILINE)
NAMES = re.compile(r"^(\w+(?:, \w+)+)(?:( : .*)(?:\n|\Z)|\n(?= {4}))((?: {4}.*(?:\n|\Z))*)", re.MULTILINE)
CHOICE = re.compile(r"^(\w+ : )\{([^}]*)\}", re.MULTILINE)
FORMULA = re.compile(r'<(div|span) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
NOTHING = re.compile(r"–(\s*<div class=\"doc-md-description\">\s*</div>)")


class Docstrings(griffe.Extension):
    """Turns numpydoc into what griffe and Markdown understand."""

    def on_package(self, *, pkg: griffe.Module, **kwargs: Any) -> None:
        objects = list(_objects(pkg))
        paths = {each.path for each in objects}
        for each in objects:
            if each.docstring:
                each.docstring.value = _fields(each) + _markdown(each.docstring.value, each, paths)


def _objects(parent: griffe.Object) -> Iterator[griffe.Object]:
    yield parent
    for member in parent.members.values():
        if not member.is_alias:
            yield from _objects(member)


def _fields(each: griffe.Object) -> str:
    """What a NamedTuple is made of, which griffe does not show."""
    if not each.is_class or [str(base) for base in each.bases] != ["NamedTuple"]:
        return ""
    fields = [f"    {name}: {field.annotation},\n" for name, field in each.members.items() if field.is_attribute]
    return f"```python\n{each.name}(\n{''.join(fields)})\n```\n\n"


def _markdown(text: str, here: griffe.Object, paths: set[str]) -> str:
    text = NAMES.sub(
        lambda found: "".join(f"{name}{found[2] or ''}\n{found[3]}" for name in found[1].split(", ")), text
    )
    text = CHOICE.sub(lambda found: found[1] + " or ".join(found[2].split(", ")), text)
    text = text.replace(", shape", " of shape")  # not to be taken for a tuple
    text = text.replace("] [", "] \\[")  # nor this for a link
    return ROLE.sub(lambda role: _link(role[1], here, paths), TABLE.sub(_table, text))


def _link(name: str, here: griffe.Object, paths: set[str]) -> str:
    """The name as a link to where it is described, if it is; ``~a.b`` shows only ``b``."""
    full = name.lstrip("~.")
    near = [f"{scope}.{full}" for scope in _scopes(here)]
    far = [path for path in sorted(paths) if path.endswith(f".{full}")]
    target = next((path for path in [*near, full, *far] if path in paths), full)
    shown = full.split(".")[-1] if name.startswith("~") else full
    return f'<autoref optional identifier="{target}"><code>{shown}</code></autoref>'


def _scopes(here: griffe.Object | None) -> Iterator[str]:
    while here is not None:
        yield here.path
        here = here.parent


def _table(found: re.Match[str]) -> str:
    starts = [column.start() for column in re.finditer("=+", found[0].splitlines()[0])]

    def row(line: str) -> str:
        return "| " + " | ".join(line[a:b].strip() for a, b in zip(starts, [*starts[1:], None], strict=True)) + " |"

    return "\n".join([row(found[1] or ""), "|" + " --- |" * len(starts), *map(row, found[2].splitlines())])


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """A hook of MkDocs: the pages that stand beside docs/ are on the site too, the README in front."""
    top = Path(config.docs_dir).parent
    for source, target in BESIDE.items():
        text = (top / source).read_text(encoding="utf-8").replace("](docs/", "](")
        files.append(File.generated(config, target, content=text))
    return files


def on_page_markdown(markdown: str, **kwargs: Any) -> str:
    """Links to those pages."""
    for source, target in BESIDE.items():
        markdown = re.sub(rf"\]\((?:\.\./)?{re.escape(source)}", f"]({target}", markdown)
    return markdown


def on_page_content(html: str, **kwargs: Any) -> str:
    """A hook of MkDocs: no dash where no description follows; formulas as MathML, which needs no script."""
    return FORMULA.sub(_formula, NOTHING.sub(r"\1", html))


def _formula(found: re.Match[str]) -> str:
    latex = unescape(found[2]).replace(r"\_", "_").replace("{aligned}", "{align*}")
    if found[1] == "span":
        return str(convert(latex))
    return f'<div style="overflow-x: auto">{convert(latex, display="block")}</div>'
