#!/usr/bin/env bash
# What several trees a candidate (planner.repeats) do to what evolution finds, at an equal number of rollouts: the README's
# job with 1, 3 and 5 trees. More trees lack a few more transitions, so each gets as many generations as the rollouts of
# 25 generations with one tree pay for; `bench evaluate` tells what an evaluation of the first generation takes. There is
# no finish, which would choose again among what was found ([finish] kind = "none"). Prints, by seed and number of trees:
# generations, rollouts, the search's best score, and that candidate's mean on 20 fresh seeds, which is what to compare.
# On lockstep a run takes seconds; with engine = "rapier" in the job less than two minutes.
# Usage: tests/repeats-at-equal-cost.sh [FOLDER [SEED …]]
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-$(mktemp -d)}
shift || true
seeds=("$@")
[ ${#seeds[@]} -gt 0 ] || seeds=(1 2 3)
cargo build --locked --release --quiet -p cli --bin evogait
evogait=${CARGO_TARGET_DIR:-target}/release/evogait
mkdir -p "$folder"

# job TREES GENERATIONS SEED FILE: the README's job without its finish.
job() {
    sed -e "s/^repeats = [0-9]*/repeats = $1/" -e "s/^generations = [0-9]*/generations = $2/" -e "s/^seed = [0-9]*/seed = $3/" \
        -e '/^\[finish\]/,$d' scenarios/jobs/quadropod-empty.toml > "$4"
    printf '[finish]\nkind = "none"\n' >> "$4"
}
# value FILE FIELD: the first number of that field; JSON has one field a line.
value() {
    sed -n "s/^ *\"$2\": *\([0-9.]*\),\{0,1\}$/\1/p" "$1" | head -n 1
}

printf '%-6s %-6s %-12s %-10s %-10s %s\n' seed trees generations rollouts best fresh
for seed in "${seeds[@]}"; do
    budget=
    for trees in 1 3 5; do
        name="$folder/trees-$trees-$seed"
        job "$trees" 25 "$seed" "$name.toml"
        "$evogait" bench evaluate "$name.toml" --evaluations 20 --json --quiet > "$name.cost.json"
        each=$(value "$name.cost.json" rollouts_per_evaluation)
        budget=${budget:-$each}
        generations=$(awk -v b="$budget" -v e="$each" 'BEGIN { printf "%d", 25 * b / e + 0.5 }')
        job "$trees" "$generations" "$seed" "$name.toml"
        "$evogait" run "$name.toml" --out "$name" --quiet
        result=$name/result.json
        printf '%-6s %-6s %-12s %-10s %-10s %s\n' "$seed" "$trees" "$generations" "$(value "$result" rollouts)" \
            "$(value "$result" best_fitness)" "$(value "$result" fresh_mean)"
    done
done
