"""For mkdocs: a page for each module of the three packages, of its docstrings, and one that lists them."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).parents[1]
PACKAGES = ("control", "drivers", "console")
LEFT_OUT = ROOT / "drivers" / "board"           # programs of boards, which are no modules


def on_files(files: Files, config: Any) -> Files:
    listed = ["# Modules", ""]
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        if LEFT_OUT in path.parents or not path.stat().st_size:
            continue
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        listed.append(f"- [{name}]({name}.md)")
        files.append(File.generated(config, f"api/{name}.md", content=f"# {name}\n\n::: {name}\n",
                                    inclusion=InclusionLevel.NOT_IN_NAV))
    files.append(File.generated(config, "api/index.md", content="\n".join(listed)))
    return files
