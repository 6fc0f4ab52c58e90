#!/usr/bin/env bash
# Three jobs and six workers under a random kill, stop or bad network every two seconds, and a kill of the coordinator every
# twenty. All jobs must end, with the bits of an undisturbed run; no event, result or job that was told may be lost; all slots
# must be free in the end. Prints what it does. Ends with code 0 if all held; else says what did not and where the logs are.
#
#   tests/soak.sh [SECONDS [SEED]]      600 and 1 unless given; the jobs that run then are still waited for
#   tests/soak.sh --postgres [SECONDS [SEED]]
#
# The second one has two coordinators on a PostgreSQL server that it starts and ends, and closed doors: everybody shows a
# certificate and a token. The coordinator at work is killed, or stopped until
# some time after the other one has taken over, or cut off from the database in one direction or both: when it goes on, or what it
# sent arrives, that must change nothing, and if it was replaced it must end.
#
# It uses the debug build, which has faults on demand: workers are told to be slow, so that jobs last without a core.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --locked --quiet --workspace --bins --tests # as cargo test builds them
soak=("${CARGO_TARGET_DIR:-target}/debug/soak" "$@")
[ "${1:-}" != --postgres ] || soak=(tests/with-postgres.sh "${soak[@]}")
exec "${soak[@]}"
