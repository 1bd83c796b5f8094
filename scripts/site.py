"""Hooks of mkdocs: linked files of the repository, and a page of all settings, join the site.

Pages link to sources, tables and other files outside docs/. Each such file is copied to
`repository/` in the site, Markdown as a page, and the link is changed.
"""

import importlib
import os
import re
from pathlib import Path
from typing import Any, Protocol

from deploy.settings import all_settings

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
FOLDER = "repository"
SETTINGS = "settings/all.md"  # generated page
# Code between backticks, or a character of Markdown
MARKUP = re.compile(r"(`[^`]*`)|([|<>_*\[\]])")
LINK = re.compile(r"(\]\()([^)\s#]+)(#[^)\s]*)?(\))")


class Files(Protocol):
    """Files of the site in mkdocs."""

    def append(self, file: Any) -> None:
        """Add a file."""


def outside(page: Path, link: str) -> Path | None:
    """Return the target of a link of a page if it is in the repository, but outside docs/.

    A folder is represented by its README.md, else by its first file.
    """
    if re.match(r"[a-z]+:|/", link):
        return None
    target = Path(os.path.normpath(page.parent / link))
    if not target.is_relative_to(ROOT) or target.is_relative_to(DOCS) or not target.exists():
        return None
    if target.is_dir():
        files = sorted(file for file in target.iterdir() if file.is_file())
        return next((file for file in files if file.name == "README.md"), files[0])
    return target


def linked_files(pages: list[Path]) -> set[Path]:
    """Return all files outside docs/ that pages link to, directly or through other pages."""
    found, pages = set[Path](), list(pages)
    while pages:
        page = pages.pop()
        for _, link, _, _ in LINK.findall(page.read_text("utf-8")):
            file = outside(page, link)
            if file and file not in found:
                found.add(file)
                if file.suffix == ".md":
                    pages.append(file)
    return found


def site_link(page: Path, link: str) -> str:
    """Return a link of a page in the site."""
    file = outside(page, link)
    in_docs = Path(os.path.normpath(page.parent / link))
    if file:
        target = f"{FOLDER}/{file.relative_to(ROOT)}"
    elif in_docs.is_relative_to(DOCS):
        target = str(in_docs.relative_to(DOCS))
    else:
        return link
    return os.path.relpath(target, Path(_site_path(page)).parent)


def on_files(files: Files, config: Any) -> Files:
    """Add the linked files to the site."""
    generated = importlib.import_module("mkdocs.structure.files").File.generated
    for file in sorted(linked_files(sorted(DOCS.rglob("*.md")))):
        uri = f"{FOLDER}/{file.relative_to(ROOT)}"
        files.append(generated(config, uri, abs_src_path=str(file)))
    files.append(generated(config, SETTINGS, content=settings_page()))
    return files


def settings_page() -> str:
    """Return the page of all settings."""
    lines = ["# All settings", "", "`people4d settings` shows this list."]
    for heading, rows in all_settings().items():
        lines += ["", f"## {heading}", "", "| setting | default | meaning |", "| --- | --- | --- |"]
        for row in rows:
            meaning = MARKUP.sub(lambda m: m[1] or f"\\{m[2]}", row.meaning)
            lines.append(f"| `{row.name}` | `{row.default}` | {meaning} |")
    return "\n".join(lines) + "\n"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Change the links of a page."""
    if page.file.src_uri == SETTINGS:  # generated, without links
        return markdown
    source = Path(page.file.abs_src_path)
    return LINK.sub(
        lambda m: f"{m[1]}{site_link(source, m[2]) if ':' not in m[2] else m[2]}{m[3] or ''}{m[4]}",
        markdown,
    )


def _site_path(page: Path) -> str:
    """Return the path of a page in the site's source."""
    if page.is_relative_to(DOCS):
        return str(page.relative_to(DOCS))
    return f"{FOLDER}/{page.relative_to(ROOT)}"
