#!/usr/bin/env bash
# A sweep on nodes of a Slurm cluster: Ray's head on the first, its workers on the others, the
# driver beside the head. STORE must be on a file system that all of them see.
#
#   sbatch --nodes=100 jobs/slurm.sh table1 table2 --preset full
#
# Killed at the time limit or by a node's death it is queued again, and goes on where it was.
#SBATCH --job-name=dmfc
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=1
#SBATCH --exclusive
#SBATCH --time=24:00:00
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output=dmfc-%j.log
#SBATCH --signal=B:INT@120
set -euo pipefail

if (($# == 0)); then
  echo "usage: sbatch [options] $0 SWEEP... [--preset NAME] [--set key=value]" >&2
  exit 2
fi
STORE=${STORE:-$PWD/store}
PORT=${RAY_PORT:-6379}
export OMP_NUM_THREADS=1 RAY_USAGE_STATS_ENABLED=0
# This job's own secret: other users of these nodes cannot give its Ray anything to do.
export RAY_AUTH_MODE=token
export RAY_AUTH_TOKEN=${RAY_AUTH_TOKEN:-$(od -An -N32 -tx1 /dev/urandom | tr -d ' \n')}

mapfile -t nodes < <(scontrol show hostnames "$SLURM_JOB_NODELIST")
head=${nodes[0]}
address=$(srun --nodes=1 --ntasks=1 --overlap -w "$head" hostname --ip-address | awk '{print $1}')

on() { # on NODE ray-start-options...: Ray there, in the foreground, so that Slurm ends it
  local node=$1
  shift
  srun --nodes=1 --ntasks=1 --overlap -w "$node" ray start --block "$@" &
}

on "$head" --head --node-ip-address="$address" --port="$PORT" --include-dashboard=false
srun --nodes=1 --ntasks=1 --overlap -w "$head" bash -c \
  "for _ in {1..60}; do ray status --address $address:$PORT >/dev/null 2>&1 && exit; sleep 2; done; exit 1"
for node in "${nodes[@]:1}"; do
  on "$node" --address="$address:$PORT"
done

# Slurm sends SIGINT two minutes before the time limit: the driver stops cleanly and the job is
# queued again.
srun --nodes=1 --ntasks=1 --overlap -w "$head" \
  dmfc sweep "$@" --store "$STORE" --set run.ray_address="$address:$PORT" &
driver=$!
trap 'kill -INT "$driver" 2>/dev/null; wait "$driver"; scontrol requeue "$SLURM_JOB_ID"; exit' INT
status=0
wait "$driver" || status=$?
trap - INT
mapfile -t left < <(jobs -p)
kill "${left[@]}" 2>/dev/null || true
exit "$status"
