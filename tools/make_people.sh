#!/bin/sh
# Make the shipped bank of recorded people: vpsci_ros/models/people.safetensors.
#
#   tools/make_people.sh DATA      where DATA holds vci_dut/ and vci_citr/
#
# Part dev of the right turns and nine clips of the campus are left out, to measure on. Seven minutes of one core; a
# stopped run resumes from out/forecast.
set -eu
cd "$(dirname "$0")/.."
data=$1
campus=$(mktemp -d)/campus.parquet
vpsci() { .venv/bin/python -m vpsci_ros.cli "$@"; }
vpsci import "$data/vci_dut" "$data/vci_citr" --format vci-dut --format vci-citr -o "$campus"
vpsci people right_turns "$campus" -o vpsci_ros/models/people.safetensors --forecast out/forecast \
    --without cqut-pvi/dev/ \
    --without vci-citr/back_interaction_03 --without vci-citr/bidirection_normal_driving_06 \
    --without vci-citr/unidirection_normal_driving_01 --without vci-citr/unidirection_normal_driving_04 \
    --without vci-citr/unidirection_yeild_04 --without vci-dut/intersection_06 --without vci-dut/intersection_11 \
    --without vci-dut/roundabout_02 --without vci-dut/roundabout_11
