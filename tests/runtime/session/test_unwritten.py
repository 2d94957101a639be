"""Changes that a file had not taken are read as they were kept."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from runtime.atomic import temporary_folder
from runtime.session import unwritten
from runtime.session.unwritten import ChangeLog

KEYS = st.sets(st.text(max_size=8), max_size=4)


@given(lost=KEYS, found=KEYS, content=st.binary(max_size=32), label=st.text(max_size=8))
def test_every_kind_of_value_comes_back(lost: set[str], found: set[str], content: bytes, label: str) -> None:
    log = ChangeLog()
    log.put_step(1, label, "{}")
    log.put_blob("a", content)
    log.lose(lost, 5, text="header")
    log.find(frozenset(found))
    with temporary_folder() as folder:
        path = Path(folder) / "a.sport"
        assert unwritten.keep(path, log.changes, 5.0) is not None
        changes = unwritten.read(path)
    assert [(name, named) for name, _, named in changes] == [
        ("put_step", {}), ("put_blob", {}), ("lose", {"text": "header"}), ("find", {}),
    ]  # fmt: skip
    wanted = [[1, label, "{}"], ["a", content], [sorted(lost), 5], [sorted(found)]]
    assert [values for _, values, _ in changes] == wanted
