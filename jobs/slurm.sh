#!/usr/bin/env bash
# A sweep on nodes of a Slurm cluster: Ray's head on the first, where this script runs too, its
# workers on the others, the driver beside the head. STORE must be on a file system that all of them
# see; asset packs lie in it (DMFC_CACHE), so that one node downloads them, and no other needs to.
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
#SBATCH --signal=B:USR1@120
set -euo pipefail

if (($# == 0)); then
  echo "usage: sbatch [options] $0 SWEEP... [--preset NAME] [--set key=value]" >&2
  exit 2
fi
STORE=${STORE:-$PWD/store}
PORT=${RAY_PORT:-6379}
export OMP_NUM_THREADS=1 RAY_USAGE_STATS_ENABLED=0 DMFC_CACHE=${DMFC_CACHE:-$STORE}
# This job's own secret: other users of these nodes cannot give its Ray anything to do.
export RAY_AUTH_MODE=token
export RAY_AUTH_TOKEN=${RAY_AUTH_TOKEN:-$(od -An -N32 -tx1 /dev/urandom | tr -d ' \n')}

mapfile -t nodes < <(scontrol show hostnames "$SLURM_JOB_NODELIST")
head=${SLURMD_NODENAME:-${nodes[0]}}
address=$(srun --nodes=1 --ntasks=1 --overlap -w "$head" hostname --ip-address | awk '{print $1}')

on() { # on NODE ray-start-options...: Ray there, in the foreground, so that Slurm ends it
  local node=$1
  shift
  srun --nodes=1 --ntasks=1 --overlap -w "$node" ray start --block "$@" &
}

on "$head" --head --node-ip-address="$address" --port="$PORT" --include-dashboard=false
srun --nodes=1 --ntasks=1 --overlap -w "$head" bash -c \
  "for _ in {1..60}; do ray status --address $address:$PORT >/dev/null 2>&1 && exit; sleep 2; done; exit 1"
for node in "${nodes[@]}"; do
  if [[ $node != "$head" ]]; then on "$node" --address="$address:$PORT"; fi
done

# Not by srun: it does not pass SIGINT on (it asks for a second one), and at SIGTERM it kills its
# step. And a shell without a terminal starts what is in the background with SIGINT ignored. So the
# driver is a child of this script, and is sent SIGTERM, at which it stops cleanly.
dmfc sweep "$@" --store "$STORE" --set run.ray_address="$address:$PORT" &
driver=$!
stop() { # the driver, then Ray
  kill -TERM "$driver" 2>/dev/null || true
  wait "$driver" || true
  mapfile -t left < <(jobs -p)
  kill "${left[@]}" 2>/dev/null || true
}
# SIGUSR1 comes two minutes before the time limit: the job is queued again. SIGTERM is its end.
trap 'stop; scontrol requeue "$SLURM_JOB_ID"; exit' USR1
trap 'stop; exit 143' TERM
status=0
wait "$driver" || status=$?
trap - USR1 TERM
stop
exit "$status"
