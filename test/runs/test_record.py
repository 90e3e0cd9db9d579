"""Every run leaves the same record, and what is no record is none."""

import json
import time

from vpsci_ros.runs.record import read_record, write_record


def test_a_record_is_read_as_it_was_written(tmp_path) -> None:
    begun = time.monotonic() - 5.0
    write_record(tmp_path / "run.json", begun=begun, results={"rows": 2}, inputs={"a": "1"}, facts={"unit": 3})
    record = read_record(tmp_path / "run.json")
    assert record is not None
    assert (record["error"], record["results"], record["inputs_sha256"], record["unit"]) == (
        "",
        {"rows": 2},
        {"a": "1"},
        3,
    )
    assert 5.0 <= record["wall_time_sec"] < 60.0
    assert record["software"]["python"]


def test_what_is_not_a_record_is_none(tmp_path) -> None:
    path = tmp_path / "run.json"
    assert read_record(path) is None
    for text in ("{", "[]", json.dumps({"error": ""})):
        path.write_text(text)
        assert read_record(path) is None
