#!/usr/bin/env bash
# Tables III and IV of Vonásek and Faigl (2016) for the quadropod, in kind: gait sets evolved for the distance to a goal and for
# coverage, used in the three scenarios of section V-C. For each set and scenario 20 trees of 100 iterations, which do not end
# at the goal. Prints the means over all trees beside the paper's, which are over 20 sets of each kind instead of 2.
#
#   tests/reuse-table.sh [FOLDER [SEED …]]     the runs go to FOLDER, and what is there is not done again; seeds 1 and 2 unless given
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-runs/reuse-table}
shift || true
seeds=("$@")
[ ${#seeds[@]} -gt 0 ] || seeds=(1 2)

cargo build --locked --release --quiet --bin evogait
evogait=${CARGO_TARGET_DIR:-target}/release/evogait
for seed in "${seeds[@]}"; do
    for kind in goal empty-paper; do
        "$evogait" run "scenarios/jobs/quadropod-$kind.toml" --seed "$seed" --out "$folder/$kind-$seed" --workers "$(nproc)" --quiet
        for scenario in 1 2 3; do
            "$evogait" plan "$folder/$kind-$seed" --environment "reuse-$scenario" --iterations 100 --seeds 20 --whole-trees \
                --out "$folder/$kind-$seed-in-$scenario" --workers "$(nproc)" --quiet
        done
    done
done

python3 - "$folder" "${seeds[@]}" <<'TABLE'
import csv, statistics, sys

folder, seeds = sys.argv[1], sys.argv[2:]
# Tables III and IV, row "Quadro.": mean and standard deviation by kind of set and scenario.
paper = {
    "distance": {("goal", 1): "5.1/4.4", ("empty-paper", 1): "6.6/4.4", ("goal", 2): "6.7/2.8", ("empty-paper", 2): "4.4/2.6",
                 ("goal", 3): "26.5/2.0", ("empty-paper", 3): "22.7/4.8"},
    "coverage": {("goal", 1): "5.4/1.7", ("empty-paper", 1): "16.1/6.3", ("goal", 2): "4.9/1.5", ("empty-paper", 2): "12.8/5.5",
                 ("goal", 3): "3.4/1.0", ("empty-paper", 3): "10.1/3.8"},
}
named = {"goal": "distance sets", "empty-paper": "coverage sets"}
for measure, unit in [("distance", "distance to the goal, mu (Table III)"), ("coverage", "coverage, % (Table IV)")]:
    print(unit)
    print(f"  {'scenario':10} {'gaits':15} {'paper':>12} {'here':>14}")
    for scenario in (1, 2, 3):
        for kind in ("goal", "empty-paper"):
            values = []
            for seed in seeds:
                with open(f"{folder}/{kind}-{seed}-in-{scenario}/plans.csv") as table:
                    values += [float(row[measure]) for row in csv.DictReader(table)]
            here = f"{statistics.mean(values):.1f}/{statistics.stdev(values):.1f}"
            print(f"  {scenario:<10} {named[kind]:15} {paper[measure][kind, scenario]:>12} {here:>14}")
TABLE
