"""For mkdocs: the site's menu, its front, and a page for each module of the three packages, of
its docstrings.

Nothing of it is written twice: the menu is docs/README.md, section by section; the front begins
as the project's README does. `make docs` fails at a link that leads nowhere, and at a docstring
that cannot be read.
"""

from __future__ import annotations

import ast
import os
import re
from itertools import groupby
from pathlib import Path
from typing import Any

from griffe import Extension
from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PACKAGES = ("control", "drivers", "console")
LEFT_OUT = ROOT / "drivers" / "board"  # programs of boards, which are no modules
LINK = re.compile(r"\[([^]]*)\]\(([^):#\s]+)(#[^)\s]*)?\)")


def _from_docs(name: str) -> str:
    """A page of the project's root with its links as they lead from docs/."""
    return (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")


def on_config(config: Any) -> Any:
    """The menu: docs/README.md's headings and links, and the modules."""
    menu: list[dict[str, Any]] = [{"Contents": "README.md"}, {"Guides": []}]
    for line in (DOCS / "README.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            menu.append({line[3:]: []})
        for words, page, _ in LINK.findall(line):
            next(iter(menu[-1].values())).append(
                {words[0].upper() + words[1:]: page.replace("../", "")}
            )
    config.nav = [*menu, {"Modules": [{"All modules": "api/index.md"}]}]
    return config


def on_files(files: Files, config: Any) -> Files:
    modules = [
        (name, path)
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        if LEFT_OUT not in path.parents and path.stat().st_size
        for name in [
            ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        ]
    ]
    listed = ["# Modules", ""]
    for room, its in groupby(modules, lambda module: ".".join(module[0].split(".")[:2])):
        listed += ["", f"## {room}", ""]
        for name, path in its:
            said = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition(
                "\n"
            )[0]
            listed.append(f"- [{name}]({name}.md) {said}")
            files.append(
                File.generated(
                    config,
                    f"api/{name}.md",
                    content=f"---\ntitle: {name}\n---\n\n::: {name}\n",
                    inclusion=InclusionLevel.NOT_IN_NAV,
                )
            )
    files.append(File.generated(config, "api/index.md", content="\n".join(listed)))
    files.append(File.generated(config, "CONTRIBUTING.md", content=_from_docs("CONTRIBUTING.md")))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """A link out of docs/ leads to the page of its module, to CONTRIBUTING, or is its words
    only."""
    folder = (DOCS / page.file.src_uri).parent
    if page.is_homepage:
        markdown = (
            _from_docs("README.md").partition("\n## ")[0] + "\n" + markdown.partition("\n")[2]
        )

    def on_site(found: re.Match[str]) -> str:
        words, path, anchor = found.groups()
        there = (folder / path).resolve()
        if there.is_relative_to(DOCS):
            return found[0] if there.suffix else words  # of a folder there is no page
        module = ".".join(there.relative_to(ROOT).with_suffix("").parts)
        target = {".py": f"api/{module}.md", ".md": there.name}.get(there.suffix)
        return (
            f"[{words}]({os.path.relpath(DOCS / target, folder)}{anchor or ''})"
            if target
            else words
        )

    return markdown if page.file.src_uri.startswith("api/") else LINK.sub(on_site, markdown)


class Meanings(Extension):
    """`name : what it is` is what a parameter means; of which type it is stands in the
    signature."""

    def on_instance(self, *, obj: Any, **_: Any) -> None:
        if obj.docstring:
            said, line, meanings = obj.docstring.value.partition("\n----------\n")
            obj.docstring.value = (
                said + line + re.sub(r"^(\w[\w, ]*) : (?=.)", r"\1\n    ", meanings, flags=re.M)
            )
