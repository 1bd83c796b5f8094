"""Links of the documentation as a site."""

import os
import re

from scripts.site import DOCS, FOLDER, LINK, ROOT, linked_files, site_link
from tests import ROOT as REPOSITORY
from tests.docs.test_links import CODE

PAGES = sorted(DOCS.rglob("*.md"))


def test_link_to_a_source_file_leads_into_the_site() -> None:
    page = DOCS / "launch" / "start.md"
    assert site_link(page, "../../deploy/compose.yaml") == f"../{FOLDER}/deploy/compose.yaml"
    assert site_link(page, "hosts.md") == "hosts.md"


def test_link_of_a_page_outside_docs_leads_back_to_docs() -> None:
    assert site_link(REPOSITORY / "README.md", "docs/index.md") == "../index.md"


def test_every_relative_link_leads_to_a_file_of_the_site() -> None:
    copied = linked_files(PAGES)
    paths = {page: str(page.relative_to(DOCS)) for page in PAGES}
    paths |= {file: f"{FOLDER}/{file.relative_to(ROOT)}" for file in copied}
    in_site = set(paths.values())
    in_site |= {str(file.relative_to(DOCS)) for file in DOCS.rglob("*") if file.is_file()}
    dead = [
        (path, link)
        for page, path in paths.items()
        if page.suffix == ".md"
        for _, link, _, _ in LINK.findall(CODE.sub("", page.read_text("utf-8")))
        if not re.match("[a-z]+:", link)
        and os.path.normpath(os.path.join(os.path.dirname(path), site_link(page, link)))
        not in in_site
    ]
    assert not dead
