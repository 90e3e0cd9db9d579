"""The short campaigns of every test run, and everything that a long one has ever found."""

from pathlib import Path

import pytest
from chaos import files, processes

CASES = 40
CORPUS = sorted(path for path in files.CORPUS.rglob("*") if path.is_file())


@pytest.mark.parametrize("kind", files.KINDS)
def test_a_damaged_file_is_read_as_it_was_or_refused_in_words(kind: str) -> None:
    found: list[files.Found] = []
    files.campaign(kind, range(CASES), found.append)
    assert [case for case in found if case.defect] == []
    assert {"read", "refused"} & {case.verdict for case in found}, "nothing was damaged"


@pytest.mark.parametrize("path", CORPUS, ids=[f"{path.parent.name}/{path.name}" for path in CORPUS])
def test_what_a_campaign_once_found_holds(path: Path, tmp_path: Path) -> None:
    target = files.KINDS[path.parent.name].make(tmp_path)
    whole = target.read_bytes()
    assert files.judged(path.parent.name, path.read_bytes(), whole, target) in ("read", "refused")


def test_a_defect_would_be_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(path: Path) -> None:
        raise KeyError(path.name)

    monkeypatch.setitem(files.KINDS, "parameters", files.KINDS["parameters"]._replace(read=breaks))
    target = files.KINDS["parameters"].make(tmp_path)
    whole = target.read_bytes()
    assert files.judged("parameters", b"a: 1", whole, target).startswith("KeyError")
    monkeypatch.setitem(
        files.KINDS, "parameters", files.KINDS["parameters"]._replace(read=Path.read_bytes, sealed=True)
    )
    assert "without a word" in files.judged("parameters", b"a: 1", whole, target)


@pytest.mark.parametrize("seed", [3, 5])
def test_a_disturbed_graph_is_complete_or_says_what_it_lacks(seed: int, tmp_path: Path) -> None:
    whole, lasts = processes.undisturbed()
    disturbed = processes.disturbance(seed, lasts)
    assert processes.defects(processes.run(tmp_path, disturbed), disturbed, whole) == [], disturbed
