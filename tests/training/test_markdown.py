"""Generated sections of documents."""

from pathlib import Path

import pytest

from runtime.errors import FileError
from training.markdown import check_section, write_section

PAGE = "# Reading\n\n<!-- speed: begin -->\nold\n<!-- speed: end -->\n\nAfterwards.\n"


def test_a_section_is_replaced_and_the_rest_is_left_alone(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    for text in ("one\n", "| two |"):
        check_section(page, "speed")
        write_section(page, "speed", text)
        assert page.read_text(encoding="utf-8") == PAGE.replace("old", text.strip())


@pytest.mark.parametrize(
    "content", ["", "# Words\n", "<!-- speed: begin -->\n", "<!-- speed: end --> <!-- speed: begin -->", None]
)
def test_a_file_without_both_markers_keeps_its_words(tmp_path: Path, content: str | None) -> None:
    page = tmp_path / "page.md"
    if content is not None:
        page.write_text(content, encoding="utf-8")
    for use in (lambda: check_section(page, "speed"), lambda: write_section(page, "speed", "new")):
        with pytest.raises(FileError, match=r"page\.md"):
            use()
    assert content == (page.read_text(encoding="utf-8") if content is not None else None)
