#!/bin/sh
# Run a command of vpsci on hosts that you reach by SSH: a scheduler here, a worker on each host.
#
#     examples/cluster/ssh.sh tcp://10.0.0.1:8786 "node1 node2" vpsci generate -o out/big --table10
#
# The first word is an address of this machine that the hosts reach. Each host has this package with the extra `cluster`
# in the folder VENV, as here. Workers stop when the command ends, and by themselves when they lose the scheduler.
set -eu
address=$1 hosts=$2
shift 2
venv=${VENV:-$PWD/.venv}

"$venv/bin/dask" scheduler --host "${address%:*}" --port "${address##*:}" --no-dashboard &
pids=$!
trap 'kill $pids 2>/dev/null || true' EXIT INT TERM
for host in $hosts; do
    # shellcheck disable=SC2029 # both are meant to be those of this machine
    ssh -tt "$host" "$venv/bin/dask" worker "$address" --nworkers 1 --death-timeout 60 --no-dashboard </dev/null &
    pids="$pids $!"
done
DASK_SCHEDULER_ADDRESS=$address "$@"
