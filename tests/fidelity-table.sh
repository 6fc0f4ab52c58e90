#!/usr/bin/env bash
# Measures settings of the lockstep engine against its converged reference, for robots that ship, whole and with failed
# modules, and keeps them in the table by which engine = "auto" chooses. Fidelity is no speed: a busy machine does no harm.
#
#   tests/fidelity-table.sh                       all robots, scale paper
#   tests/fidelity-table.sh ROBOT …               these
#   SCALE=real TABLE=FILE tests/fidelity-table.sh the other scale, into another file
#
# A changed engine (its revision) or robot leaves rows behind that no longer count: measure again, and commit the file.
set -euo pipefail
cd "$(dirname "$0")/.."
table=${TABLE:-scenarios/fidelity.toml}
robots=("$@")
[ ${#robots[@]} -gt 0 ] || robots=(quadropod lizard l-shape h-shape t-shape)

cargo build --locked --release --quiet -p cli --bin evogait
for robot in "${robots[@]}"; do
    for variant in none E1 E2; do
        options=(--scale "${SCALE:-paper}" --table "$table")
        [ "$variant" = none ] || options+=(--variant "$variant")
        echo "== $robot, failed modules: $variant"
        "${CARGO_TARGET_DIR:-target}/release/evogait" bench fidelity "$robot" "${options[@]}"
    done
done
