#!/usr/bin/env bash
# Breaks the code on purpose in each of the ways of tests/bugs.toml, in a copy of the tree in target/bugs, and demands that the
# tests named there fail. Takes about a minute for each way, and ten minutes before the first one.
#
#   tests/bugs.sh                 all of them
#   tests/bugs.sh keepalive       those with the word in their name or file
#   tests/bugs.sh --shard 2/4     the second of four shards, for machines side by side
#   tests/bugs.sh --list          what there is
#
# Some need what tests/partition.sh and tests/postgres.sh need. Ends with code 0 if every bug was seen.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --locked --quiet --workspace --bins --tests # as cargo test builds them
exec "${CARGO_TARGET_DIR:-target}/debug/bugs" "$@"
