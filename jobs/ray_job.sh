#!/usr/bin/env bash
# A sweep as a job on a Ray cluster that is already there. Every node must see STORE (a shared
# folder) and have dmfc installed; the job may be submitted again: it goes on where it was.
#
#   RAY_ADDRESS=http://head:8265 STORE=/shared/dmfc jobs/ray_job.sh table1 table2 --preset full
#
# If the cluster has token authentication (Ray has it by default since 2.59), set RAY_AUTH_MODE=token
# and have its token in RAY_AUTH_TOKEN or in ~/.ray/auth_token.
set -euo pipefail

: "${RAY_ADDRESS:?the address of the dashboard, such as http://head:8265}"
: "${STORE:?a folder that every node sees}"

if (($# == 0)); then
  echo "usage: $0 SWEEP... [--preset NAME] [--set key=value]" >&2
  exit 2
fi

# run.ray_address=auto: the job runs inside the cluster.
exec ray job submit --address "$RAY_ADDRESS" -- \
  dmfc sweep "$@" --store "$STORE" --set run.ray_address=auto
