"""The user study: a page filled in by a scripted browser, and a report that equals the textbook.

Every answer here is made up by the test and marked as synthetic.
"""

import json
import os
import random
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.study import make
from benchmarks.study.command import main
from benchmarks.study.make import Scene, write_study
from runtime.errors import FileError, UsageError, run_command
from runtime.terrain.height_map import Terrain
from tests.helpers.browser import needs_browser

METHODS = ("ours", "rival", "capture")


def study(folder: Path, titles: int = 2, data: bytes = b"film") -> dict[str, Any]:
    """A study of `titles` obstacles and as many styles by three methods; its key."""
    films = [
        (Scene(method, kind, f"{kind} {k}", None, Terrain.flat()), data)  # type: ignore[arg-type]
        for kind in ("obstacle", "style")
        for k in range(titles)
        for method in METHODS
    ]
    write_study(folder, films)
    return json.loads((folder / make.KEY).read_text(encoding="utf-8"))


def synthetic(folder: Path, key: dict[str, Any], ratings: np.ndarray) -> list[Path]:
    """Answer files of participants: `ratings` `(P, M)` of every film of a method, plus what the title adds."""
    paths = []
    for number, row in enumerate(ratings):
        at = {clip: METHODS.index(about["method"]) for clip, about in key["clips"].items()}
        answers = [{"clip": c, "rating": int(row[at[c]]), "again": False, "seconds": 3} for c in key["clips"]]
        content = {
            "format": "sport-study-answers", "study": key["study"], "participant": f"{number:04x}", "synthetic": True,
            "answers": answers,
        }  # fmt: skip
        paths.append(folder / f"answers_{number}.json")
        paths[-1].write_text(json.dumps(content), encoding="utf-8")
    return paths


# --- the page
def test_the_page_tells_no_method_and_needs_no_network(tmp_path: Path) -> None:
    key = study(tmp_path)
    page = (tmp_path / make.PAGE).read_text(encoding="utf-8")
    assert not any(method in page.split("const STUDY")[1].split(";\n")[0] for method in ("ours", "rival"))
    assert "http" not in page.replace("http-equiv", "")
    assert len(key["clips"]) == 12
    assert key["methods"] == list(METHODS)
    assert all(name in page for name in key["clips"])
    again = study(tmp_path / "b")
    assert again["study"] != key["study"]
    assert not set(again["clips"]) & set(key["clips"])


def test_a_study_needs_two_methods_and_a_new_folder(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="two methods"):
        make.make(tmp_path / "a", {"ours": tmp_path}, None, 5.0)
    study(tmp_path)
    with pytest.raises(UsageError, match="contains a study"):
        make.make(tmp_path, {"ours": tmp_path, "rival": tmp_path}, None, 5.0)


# --- the report
RATINGS = np.array([[4, 3, 5], [3, 2, 5], [4, 2, 4], [5, 3, 5], [3, 3, 4], [4, 1, 5]])


def test_the_anova_is_the_textbooks(tmp_path: Path) -> None:
    """Sums of squares by hand: F = (SS_methods / (m - 1)) / (SS_rest / ((m - 1)(p - 1)))."""
    pytest.importorskip("statsmodels")
    from scipy import stats

    from benchmarks.study.report import read_answers, significance

    files = synthetic(tmp_path, study(tmp_path), RATINGS)
    answers = read_answers(files, tmp_path / make.KEY, synthetic=True)
    tests = significance(answers[answers.kind == "obstacle"])
    p, m = RATINGS.shape
    grand = RATINGS.mean()
    between = p * np.square(RATINGS.mean(0) - grand).sum()
    rest = np.square(RATINGS - RATINGS.mean(1, keepdims=True) - RATINGS.mean(0) + grand).sum()
    f = (between / (m - 1)) / (rest / ((m - 1) * (p - 1)))
    assert tests["anova"]["F"] == pytest.approx(f)
    assert tests["anova"]["df"] == (m - 1, (m - 1) * (p - 1))
    assert tests["anova"]["p"] == pytest.approx(stats.f.sf(f, m - 1, (m - 1) * (p - 1)))
    assert tests["tukey"][0]["pair"] == ("capture", "ours")
    assert tests["tukey"][0]["difference"] == pytest.approx(RATINGS[:, 0].mean() - RATINGS[:, 2].mean())


def test_counts_means_and_bars(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("statsmodels")
    files = [str(f) for f in synthetic(tmp_path, study(tmp_path), RATINGS)]
    where = ["--key", str(tmp_path / make.KEY)]
    # synthetic answers are no answers
    assert run_command("study", lambda: main(["report", *files, *where])) == 2
    assert "synthetic" in capsys.readouterr().err
    more = ["--synthetic", "--figures", str(tmp_path / "figures")]
    assert run_command("study", lambda: main(["report", *files, *where, *more])) == 0
    text = capsys.readouterr().out
    assert text.startswith("**Synthetic answers")
    assert "| ours | 24 | 0.0 % | 0.0 % | 33.3 % | 50.0 % | 16.7 % | 3.83 ± 0.70 |" in text
    assert "Tukey HSD, ours − capture" in text
    sizes = [(tmp_path / "figures" / f"fig1{n}.png").stat().st_size for n in ("0_responses", "1_means")]
    assert min(sizes) > 5000


def test_damaged_and_foreign_answers_are_named(tmp_path: Path) -> None:
    pytest.importorskip("statsmodels")
    from benchmarks.study.report import read_answers

    (file,) = synthetic(tmp_path, study(tmp_path), RATINGS[:1])
    good = json.loads(file.read_text(encoding="utf-8"))
    for change, words in (
        ({"study": "other"}, "another study"),
        ({"answers": [{"clip": "x", "rating": 3, "again": False}]}, "unknown film"),
        ({"answers": [good["answers"][0] | {"rating": 6}]}, "expected 1 to 5"),
        ({"answers": [good["answers"][0] | {"rating": True}]}, "expected 1 to 5"),
        ({"format": "x"}, "not the answers"),
    ):
        file.write_text(json.dumps(good | change), encoding="utf-8")
        with pytest.raises(FileError, match=words):
            read_answers([file], tmp_path / make.KEY, synthetic=True)
    file.write_text(json.dumps(good), encoding="utf-8")
    with pytest.raises(UsageError, match="again"):
        read_answers([file, file], tmp_path / make.KEY, synthetic=True)
    with pytest.raises(FileError, match="not the key"):
        read_answers([file], file, synthetic=True)


def test_hostile_files_end_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Brackets, a pipe, text that is no UTF-8, and files in which one value is another."""
    pytest.importorskip("statsmodels")
    key_file, pipe = tmp_path / make.KEY, tmp_path / "pipe"
    (file,) = synthetic(tmp_path, study(tmp_path), RATINGS[:1])
    texts = {path: path.read_text(encoding="utf-8") for path in (file, key_file)}
    os.mkfifo(pipe)

    def code(answers: Path = file, secret: Path = key_file) -> int:
        arguments = ["report", str(answers), "--key", str(secret), "--synthetic"]
        return run_command("study", lambda: main(arguments))

    assert code(answers=pipe) == code(secret=pipe) == 2
    rng = random.Random(0)
    for number in range(30):
        damaged = (file, key_file)[number % 2]
        content = json.loads(texts[damaged])
        place: Any = content
        while True:  # any value, at any depth
            name = rng.choice(list(place) if isinstance(place, dict) else range(len(place)))
            if not isinstance(place[name], dict | list) or not place[name] or rng.random() < 0.3:
                break
            place = place[name]
        place[name] = rng.choice([None, 7, -1.5, "\ud800", "ours", [], [None], {}, {"a": 1}, True, 10**300])
        damaged.write_text(json.dumps(content), encoding="utf-8")
        assert code() in (0, 2), content
        damaged.write_text(texts[damaged], encoding="utf-8")
    for text in (b"[" * 200_000, b"\xff\xfe{", b"", b"[]", b'{"format": ' + b"9" * 5000 + b"}"):
        file.write_bytes(text)
        assert code() == 2
    assert "Traceback" not in capsys.readouterr().err


def test_the_later_answer_to_a_film_shown_again_counts(tmp_path: Path) -> None:
    pytest.importorskip("statsmodels")
    from benchmarks.study.report import markdown, read_answers

    key = study(tmp_path)
    (file,) = synthetic(tmp_path, key, RATINGS[:1])
    content = json.loads(file.read_text(encoding="utf-8"))
    capture = next(a for a in content["answers"] if key["clips"][a["clip"]]["method"] == "capture")
    capture["rating"] = 2
    content["answers"].append(capture | {"rating": 4, "again": True})
    file.write_text(json.dumps(content), encoding="utf-8")
    answers = read_answers([file], tmp_path / make.KEY, synthetic=True)
    assert sorted(answers.rating[answers.method == "capture"]) == [4, 5, 5, 5]
    told = "; 1 films of capture were rated 2 or less and shown again, 0 of them rated so again."
    assert told in markdown(answers)


# --- in a browser
def shown(window: Any) -> dict[str, Any]:
    queue = "{...state.queue[state.at], at: state.at, length: state.queue.length}"
    return window.execute_script(f"return {queue}")


def reopened(window: Any, at: int) -> dict[str, Any]:
    """What is shown after the page is loaded again. Chromium's next process may read the store a moment too early."""
    for _ in range(20):
        window.refresh()
        if shown(window)["at"] == at:
            break
        time.sleep(0.25)
    return shown(window)


def downloaded(window: Any, folder: Path) -> Path:
    """The answers behind the link, written as the browser would save them."""
    fetched = "fetch(document.getElementById('download').href).then(r => r.text()).then(arguments[0])"
    text = window.execute_async_script(fetched)
    path = folder / window.find_element("id", "download").get_attribute("download")
    content = json.loads(text)
    assert content["synthetic"] is False  # what a page writes is somebody's answer; this one is the test's
    path.write_text(json.dumps(content | {"synthetic": True}), encoding="utf-8")
    return path


@needs_browser
@pytest.mark.parametrize(
    ("size", "keys"), [((390, 844), False), ((1280, 900), True)], ids=["phone", "desktop"]
)
def test_a_page_is_filled_in_from_first_to_last(
    browser: Any, tmp_path: Path, size: tuple[int, int], keys: bool
) -> None:
    pytest.importorskip("statsmodels")
    from benchmarks.study.report import read_answers

    key = study(tmp_path, titles=1)
    browser.set_window_size(*size)
    browser.get((tmp_path / make.PAGE).as_uri())
    body = browser.find_element("tag name", "body")
    browser.find_element("id", "begin").click()
    given: dict[str, int] = {}
    low: str | None = None
    order = []
    while browser.execute_script("return state.at < state.queue.length"):
        item = shown(browser)
        order.append(item["clip"])
        method = key["clips"][item["clip"]]["method"]
        rating = {"ours": 4, "rival": 3, "capture": 5}[method]
        if method == "capture" and low in (None, item["clip"]):
            rating = 2 if low is None else 3  # the first film of capture is rated low, and again
            low = item["clip"]
        wide = browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")
        assert wide, "nothing is cut off at the side"
        assert not browser.find_element("id", "next").is_enabled()
        if keys:
            body.send_keys(str(rating))
        else:
            browser.find_elements("css selector", "label.mark")[rating - 1].click()
        if item["at"] == 1 and len(order) == 2:  # the page is closed and opened in the middle
            assert reopened(browser, at=1)["at"] == 1
            body = browser.find_element("tag name", "body")
        given[item["clip"]] = rating
        assert browser.find_element("id", "next").is_enabled()
        if keys:
            body.send_keys("\ue007")
        else:
            browser.find_element("id", "next").click()
    assert len(order) == len(key["clips"]) + 1
    assert set(order) == set(key["clips"])
    assert order[-1] == low
    answers = read_answers([downloaded(browser, tmp_path)], tmp_path / make.KEY, synthetic=True)
    assert dict(zip(answers["clip"], answers["rating"], strict=True)) == given
    assert answers.again.sum() == 1
    browser.execute_script("localStorage.clear()")
