#!/usr/bin/env bash
# Three jobs and six workers under a random kill, stop or bad network every two seconds, and a kill of the coordinator every
# twenty. All jobs must end, with the bits of an undisturbed run; no event, result or job that was told may be lost; all slots
# must be free in the end. Prints what it does. Ends with code 0 if all held; else says what did not and where the logs are.
#
#   tests/soak.sh [SECONDS [SEED]]      600 and 1 unless given; the jobs that run then are still waited for
#
# It uses the debug build, which has faults on demand: workers are told to be slow, so that jobs last without a core.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --locked --quiet --workspace --bins --tests # as cargo test builds them
exec "${CARGO_TARGET_DIR:-target}/debug/soak" "$@"
