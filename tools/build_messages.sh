#!/bin/sh
# Build vpsci_msgs with plain CMake and install it into a virtual environment that holds the ROS 2 wheels; before it
# tf2_msgs, which the wheels lack. Both for Python alone: without C++ the build takes a third less time.
#
#   tools/build_messages.sh VENV [BUILD_FOLDER]
#
# Nothing has to be sourced afterwards: at each interpreter start a file of the wheels puts VENV/lib, where the typesupport
# libraries lie, on LD_LIBRARY_PATH. Only ROS 2's command-line tools want AMENT_PREFIX_PATH=VENV.
set -eu
venv=$(cd "$1" && pwd)
folder=${2:-$venv/build}
here=$(cd "$(dirname "$0")" && pwd)

PATH="$venv/bin:$PATH" CMAKE_PREFIX_PATH="$venv" AMENT_PREFIX_PATH="$venv"
export PATH CMAKE_PREFIX_PATH AMENT_PREFIX_PATH
# CMake's programs from PyPI are Python scripts: a caller that is a Python of another environment must not hand them
# the library path it has made for itself.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH PYTHONPATH || true

# build PACKAGE SOURCE, from scratch: the generator leaves in the build folder what it made of messages that are no
# longer there.
build() {
    build="$folder/$1"
    before=$(sort "$build/install_manifest.txt" 2>/dev/null || true)
    rm -rf "$build"
    mkdir -p "$build"
    log="$build/build.log"
    if ! {
        cmake -S "$2" -B "$build" -G Ninja -DCMAKE_INSTALL_PREFIX="$venv" -DCMAKE_INSTALL_LIBDIR=lib \
            -DPython3_EXECUTABLE="$venv/bin/python" -DBUILD_TESTING=OFF -DPYTHON_ONLY=ON &&
            cmake --build "$build" && cmake --install "$build"
    } >"$log" 2>&1; then
        tail -n 40 "$log" >&2
        echo "$1 did not build; the whole log is $log" >&2
        exit 1
    fi
    sort "$build/install_manifest.txt" >"$build/after.txt"
    # Nor may they survive in the environment.
    echo "$before" | comm -23 - "$build/after.txt" | xargs -d '\n' -r rm -f
}

build tf2_msgs "$here/tf2_msgs"
build vpsci_msgs "$here/../msg_defs"
