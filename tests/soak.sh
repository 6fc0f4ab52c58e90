#!/usr/bin/env bash
# Four jobs and six workers under a random kill, stop or bad network every two seconds, and a kill of the coordinator
# every twenty. All jobs must end, with the bits of an undisturbed run; no acknowledged event, result or job may be
# lost; all slots must be free in the end. Prints its actions. Ends with code 0 if all held; else it prints the fault
# and the place of the logs.
#
#   tests/soak.sh [SECONDS [SEED]]      600 and 1 unless given; the jobs that run then are still waited for
#   tests/soak.sh --postgres [SECONDS [SEED]]
#
# The second one has two coordinators on a PostgreSQL server that it starts and ends. Calls require a certificate and a
# token. The active coordinator is killed, or stopped until some time after the other one has taken over, or cut off
# from the database in one direction or both. When it continues, or its last messages arrive, that must change nothing;
# if it was replaced, it must end.
#
# It uses the debug build, which has faults on demand: slow workers make jobs last without using a core.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --locked --quiet --workspace --bins --tests # as cargo test builds them
soak=("${CARGO_TARGET_DIR:-target}/debug/soak" "$@")
[ "${1:-}" != --postgres ] || soak=(tests/with-postgres.sh "${soak[@]}")
exec "${soak[@]}"
