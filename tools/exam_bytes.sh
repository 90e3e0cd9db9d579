#!/usr/bin/env bash
# Print the hashes of exams by a class, a class with bags and errors of perception, a socket and a node, for a comparison
# of two states of this package: in each `tools/exam_bytes.sh OUT`, then `diff`. The system is the example in all four.
set -eu
out=$1 short="--set world_simulator.scenarios=[1,104] --set world_simulator.episodes=3 --set world_simulator.episode_time=8.0"
c++ -std=c++17 -O2 -o "${out}_ads" examples/socket_ads.cpp
test_of() { name=$1 command=$2; shift 2; vpsci "$command" --params params/ads_test.yaml -o "$out/$name" --quiet $short "$@" >/dev/null || true; }
example=vpsci_ros.nodes.example_driver:ExampleDriver
test_of class ads-test --ads-class "$example" --recorded right_turns/dev --allow-standing
test_of sensed ads-test --ads-class "$example" --set ads_test.bags=true --set ads_test.perception=true \
    --set perception.missed=0.1 --set perception.latency=0.2 --allow-standing
test_of socket ads-socket --ads "$(realpath "${out}_ads")"
test_of node ads-test --ads example_ads --allow-standing
cd "$out"
find . -name '*.parquet' ! -name episodes.parquet -print0 | sort -z | xargs -0 sha256sum
python - <<'P'
import hashlib, json, pathlib
import polars as pl
digest = lambda text: hashlib.sha256(text.encode()).hexdigest()
for folder in sorted(path for path in pathlib.Path().iterdir() if (path / "report.json").is_file()):
    report = json.loads((folder / "report.json").read_text())
    report.pop("exam")  # names, versions and hashes of what was examined
    print(digest(json.dumps(report, sort_keys=True)), folder / "report.json")
    print(digest(pl.read_parquet(folder / "episodes.parquet").write_json()), folder / "episodes.parquet")
P
