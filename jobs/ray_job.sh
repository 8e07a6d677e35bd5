#!/usr/bin/env bash
# A sweep as a job on a Ray cluster that is already there. Every node must see STORE (a shared
# folder) and have dmfc installed; the job may be submitted again: it goes on where it was. Asset
# packs lie in the store (DMFC_CACHE), so that one node downloads them, and no other needs to.
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
environment=$(printf '{"env_vars": {"DMFC_CACHE": "%s"}}' "${DMFC_CACHE:-$STORE}")
exec ray job submit --address "$RAY_ADDRESS" --runtime-env-json "$environment" -- \
  dmfc sweep "$@" --store "$STORE" --set run.ray_address=auto
