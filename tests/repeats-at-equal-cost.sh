#!/usr/bin/env bash
# What several trees a candidate (planner.repeats) do to what evolution finds, at an equal number of rollouts: the README's
# job with 1, 3 and 5 trees. More trees lack a few more transitions, so each gets as many generations as the rollouts of
# 25 generations with one tree pay for; a run of 4 generations tells what an evaluation takes. Prints, by seed and number of
# trees: generations, rollouts, the search's best score, and the winner's mean on 20 fresh seeds, which is what to compare.
# About eight minutes a seed on two cores.
# Usage: tests/repeats-at-equal-cost.sh [FOLDER [SEED …]]
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-$(mktemp -d)}
shift || true
seeds=("$@")
[ ${#seeds[@]} -gt 0 ] || seeds=(1 2 3)
job=scenarios/jobs/quadropod-empty.toml
mkdir -p "$folder"

# run TREES GENERATIONS SEED NAME
run() {
    sed -e "s/^repeats = [0-9]*/repeats = $1/" -e "s/^generations = [0-9]*/generations = $2/" "$job" > "$folder/$4.toml"
    cargo run --locked --release --quiet -- run "$folder/$4.toml" --seed "$3" --out "$folder/$4" --quiet
}
# value NAME FIELD: the first number of that field; result.json has one field a line.
value() {
    sed -n "s/^ *\"$2\": *\([0-9.]*\),\{0,1\}$/\1/p" "$folder/$1/result.json" | head -n 1
}

printf '%-6s %-6s %-12s %-10s %-10s %s\n' seed trees generations rollouts best fresh
for seed in "${seeds[@]}"; do
    budget=
    for trees in 1 3 5; do
        trial="pilot-$trees-$seed"
        run "$trees" 4 "$seed" "$trial"
        each=$(value "$trial" rollouts)
        budget=${budget:-$each}
        generations=$(awk -v b="$budget" -v e="$each" 'BEGIN { printf "%d", 25 * b / e + 0.5 }')
        name="trees-$trees-$seed"
        run "$trees" "$generations" "$seed" "$name"
        printf '%-6s %-6s %-12s %-10s %-10s %s\n' "$seed" "$trees" "$generations" "$(value "$name" rollouts)" \
            "$(value "$name" best_fitness)" "$(value "$name" fresh_mean)"
    done
done
