#!/usr/bin/env bash
# Everything that needs PostgreSQL: the store's suite, coordinators that fail over, and the way there by TLS. On a server of its
# own, that tests/with-postgres.sh starts and ends.
#
#   tests/postgres.sh [WORD]      those with the word in their names; all unless it is given
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "tests/postgres.sh: $*" >&2; exit 1; }

if [ "${1:-}" != --on-server ]; then
    exec tests/with-postgres.sh tests/postgres.sh --on-server "$@"
fi
shift

# A filter that matches nothing would pass, so the number of passed tests is checked: 0 is a failure.
run() {
    cargo test --locked --workspace "$@" -- --ignored --test-threads=2 2>&1 | tee -a "$log"
}
ran() {
    grep -q '^test result: ok\. [1-9]' "$log" || fail "no test ran"
    : >"$log"
}
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if [ $# = 0 ]; then
    run --lib postgres
    ran
    run --test postgres
else
    run --lib "$1"
    run --test postgres "$1"
fi
ran
echo "tests/postgres.sh: all passed on $(postgres --version)"
