"""The pages of the documentation: their Python runs, their links lead somewhere."""

import re
import urllib.parse
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "training" / "README.md"]

FENCE = re.compile(r"^```(?P<info>[^\n]*)\n(?P<code>.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[[^\]]*\]\((?P<target>[^)\s]+)\)")
HEADING = re.compile(r"^#+ +(?P<title>.+?) *$", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """Code of a page.

    Attributes:
        page: The page.
        line: Line of the page on which the code begins.
        code: The code.
    """

    page: Path
    line: int
    code: str

    @property
    def name(self) -> str:
        """Page and line, as in ``docs/process.md:96``."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path, info: str) -> list[Block]:
    """The blocks of a page that are marked by exactly ``info``."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(page, text.count("\n", 0, match.start("code")) + 1, match["code"])
        for match in FENCE.finditer(text)
        if match["info"].strip() == info
    ]


def prose(page: Path) -> str:
    """The text of a page without its blocks."""
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """The names by which GitHub lets links point to headings."""
    titles = (match["title"].lower() for match in HEADING.finditer(prose(page)))
    return {re.sub(r"[^\w\- ]", "", title).replace(" ", "-") for title in titles}


# Blocks marked ``python no-run`` train for long or need what is not installed.
EXAMPLES = [block for page in PAGES for block in blocks(page, "python")]
RUST_EXAMPLES = [block for page in PAGES for block in blocks(page, "rust")]


def doctests(source: Path) -> str:
    """The crate documentation in a source file, without the lines that rustdoc hides."""
    comments = re.findall(r"^//! ?(.*)$", source.read_text(encoding="utf-8"), re.MULTILINE)
    return "\n".join(line for line in comments if not line.startswith("# "))


def test_the_pages_have_examples() -> None:
    assert len(EXAMPLES) >= 10
    assert len(RUST_EXAMPLES) >= 2


@pytest.mark.parametrize("block", EXAMPLES, ids=lambda block: block.name)
@pytest.mark.filterwarnings("default")
def test_example_runs(block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "stable_baselines3" in block.code or "lasergym.sb3" in block.code:
        pytest.importorskip("stable_baselines3")
        pytest.importorskip("torch").set_num_threads(1)  # more of them fight for busy processors
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    code = compile("\n" * (block.line - 1) + block.code, str(block.page), "exec")
    exec(code, {"__name__": "__main__"})


@pytest.mark.parametrize("block", RUST_EXAMPLES, ids=lambda block: block.name)
def test_rust_example_is_a_doctest(block: Block) -> None:
    sources = (ROOT / "crates").glob("*/src/lib.rs")
    assert any(f"```\n{block.code}```" in doctests(source) for source in sources)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for match in LINK.finditer(prose(page)):
        link = urllib.parse.urlsplit(match["target"])
        if link.scheme:
            continue
        file = (page.parent / urllib.parse.unquote(link.path)).resolve() if link.path else page
        assert file.exists(), f"{page.name} links to {match['target']}, which does not exist"
        assert file.is_relative_to(ROOT), f"{page.name} links to {match['target']}, outside"
        if link.fragment and file.suffix == ".md":
            assert link.fragment in anchors(file), f"{page.name}: no heading {match['target']}"


def test_pictures_are_small() -> None:
    pictures = list((ROOT / "docs" / "pictures").glob("*.png"))
    assert pictures
    for picture in pictures:
        assert picture.stat().st_size < 80_000, picture.name
