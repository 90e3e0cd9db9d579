#!/bin/sh
# Make a virtual environment for a purpose, step by step; steps that are done are skipped.
#
#   tools/setup.sh VENV [demo|test|engines]
#
# demo: the core, learning, ROS 2 and the messages. test (the default): demo, and what tests need. engines: test, and the
# engines and planners that the pedestrian meets (SUMO, highway-env, CARLA's client, CommonRoad, fiss-planner,
# Stable-Baselines3), and what builds the documentation site.
#
# A step is done when VENV/.done/STEP holds the hash of all files that the step depends on, so a second run takes a
# fraction of a second, a changed .msg file rebuilds the messages alone, and an interrupted step is done again.
#
# The package is installed in place (`pip install -e`), so that an edited file needs no new install. pip drops data
# files then; `setup.py install_data` places them as any other install does: the ament index marker and package.xml,
# by which ROS 2's tools find the package, launch/ and params/, and the executables for `ros2 run`.
set -eu
cd "$(dirname "$0")/.."
venv=$1
purpose=${2:-test}

fail() {
    echo "$1" >&2
    exit 1
}
case $purpose in demo | test | engines) ;; *) fail "unknown purpose $purpose: expected demo, test or engines" ;; esac

supported='import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 12))'
if [ -x "$venv/bin/python" ]; then
    "$venv/bin/python" -c "$supported" 2>/dev/null ||
        fail "$venv is not an environment of Python 3.10, 3.11 or 3.12: remove it and run this again"
    python="$venv/bin/python"
else
    python=
    for name in ${PYTHON:-python3.11 python3.12 python3.10 python3}; do
        if "$name" -c "$supported" >/dev/null 2>&1; then
            python=$name
            break
        fi
    done
    [ -n "$python" ] || fail "vpsci_ros needs Python 3.10, 3.11 or 3.12, and none of ${PYTHON:-python3.11 python3.12 \
python3.10 python3} is one: install it, or name it (make PYTHON=...)"
fi
for compiler in ${CXX:-c++ g++ clang++}; do
    command -v "$compiler" >/dev/null 2>&1 && break
    compiler=
done
[ -n "$compiler" ] || fail "vpsci_ros needs a C++ compiler to build its messages, and none of ${CXX:-c++ g++ clang++} \
is on the PATH: install g++ or clang, or name one (make CXX=...)"

# is_done STEP FILE...: whether STEP was last done with the present content of these files (hash kept in $hash).
is_done() {
    step=$1
    shift
    hash=$({ printf '%s\n' "$PWD" "$@" && cat "$@"; } | sha256sum)
    [ "$(cat "$venv/.done/$step" 2>/dev/null)" = "$hash" ]
}
done_now() {
    echo "$hash" >"$venv/.done/$step"
}
say() {
    echo "setup: $1"
}

if [ ! -x "$venv/bin/python" ]; then
    "$python" -c 'import ensurepip, venv' 2>/dev/null ||
        fail "$python cannot make virtual environments: install its venv module (python3-venv on Debian and Ubuntu)"
    say "making $venv with $("$python" --version)"
    "$python" -m venv "$venv"
fi
mkdir -p "$venv/.done"
pip="$venv/bin/python -m pip -qq --disable-pip-version-check"

# add STEP EXTRAS WHAT: install the extras as one step, and say in one line what and how much.
# Modules are compiled when they are first imported (--no-compile): most of torch never is.
add() {
    is_done "$1" constraints.txt setup.py setup.cfg pyproject.toml tools/setup.sh && return
    say "installing $3"
    $pip install --no-compile -c constraints.txt --no-build-isolation -e ".[$2]"
    done_now
}

headers=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
[ -f "$headers/Python.h" ] ||
    fail "vpsci_ros needs Python's headers to build its messages, and $headers/Python.h is not there: install them \
(python3-dev on Debian and Ubuntu)"
if ! is_done pip constraints.txt; then
    $pip install -c constraints.txt pip setuptools wheel
    done_now
fi
add core ros,messages "the core, ROS 2 and learning: 0.55 GB to download, 1.9 GB on disk"

# The messages are built while torch is downloaded and unpacked.
building=
if ! is_done messages constraints.txt tools/build_messages.sh msg_defs/*.* msg_defs/msg/* \
    tools/tf2_msgs/*.* tools/tf2_msgs/msg/*; then
    say "building vpsci_msgs and tf2_msgs"
    (tools/build_messages.sh "$venv" && done_now) &
    building=$!
fi
add learn learn,ros,messages "torch, of these"
[ -z "$building" ] || wait "$building"

if ! is_done data setup.py package.xml resource/* $(find launch params rviz urdf -name '*.py' -o -name '*.yaml' -o -name '*.rviz' -o -name '*.urdf' -o -name '*.xml' | sort); then
    "$venv/bin/python" -W ignore setup.py --quiet install_data --install-dir="$venv"
    done_now
fi

[ "$purpose" = demo ] && exit
add test rl,exam_extra,paper,formats,drive,cluster,test "what tests need: another 0.5 GB on disk"

[ "$purpose" = test ] && exit
add engines carla,highway,planner,sumo,baselines,docs "SUMO, highway-env, CARLA's client, planners and the site: another 1 GB on disk"
# Not all of CommonRoad's packages are on PyPI for Python 3.10 and 3.12: there its tests are skipped, and say so.
if "$venv/bin/python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' && ! is_done commonroad tools/commonroad.txt; then
    say "installing CommonRoad, about 50 MB"
    rm -rf "$venv/commonroad"
    $pip install --no-deps --target "$venv/commonroad" -r tools/commonroad.txt
    done_now
fi
