#!/usr/bin/env bash
# Motion sequences of the three M-TRAN modules of Fig. 2 of Yoshida et al. (2003), evolved for travel along x and along y, with
# the paper's genetic algorithm and with one that mutates one segment a child, at equal numbers of evaluations. Prints the
# winners' scores in the search and again in finer steps (120x16) beside the paper's: 7.7 along x, 18.1 along y.
#
#   tests/mtran-table.sh [FOLDER [SEED …]]     the runs go to FOLDER, and what is there is not done again; seeds 1 to 5 unless given
#
# STEPS=60 SUBSTEPS=16 in the environment set the steps a second and substeps of the search (30 and 8 unless given).
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-runs/mtran-table}
shift || true
seeds=("$@")
[ ${#seeds[@]} -gt 0 ] || seeds=(1 2 3 4 5)
steps=${STEPS:-30} substeps=${SUBSTEPS:-8}

[ -n "${EVOGAIT:-}" ] || cargo build --locked --release --quiet --bin evogait
evogait=${EVOGAIT:-${CARGO_TARGET_DIR:-target}/release/evogait}
mkdir -p "$folder"
job() { # NAME AXIS RULES SEARCH: a job file like the ones that ship
    sed -e "s/^name = .*/name = \"$1\"/" -e "s/^controller = .*/&\n$3/" -e "s/^kind = \"sequence-ga\"/&\n$4/" \
        -e "0,/^steps_per_second = .*/s//steps_per_second = $steps/" -e "0,/^substeps = .*/s//substeps = $substeps/" \
        "scenarios/jobs/mtran-three-$2.toml" > "$folder/$1.toml"
}
one_segment="crossover_rate = 0.0\nmutation_rate = 0.55\nmutated = 1"
job paper-x x "" ""
job paper-y y "" ""
job mutants-y y "" "$one_segment"
job any-overlap-y y "overlap = 1.0" ""
for seed in "${seeds[@]}"; do
    for name in paper-x paper-y mutants-y any-overlap-y; do
        "$evogait" run "$folder/$name.toml" --seed "$seed" --out "$folder/$name-$seed" --workers "$(nproc)" --quiet
    done
done

python3 - "$folder" "${seeds[@]}" <<'TABLE'
import json, statistics, sys

folder, seeds = sys.argv[1], sys.argv[2:]
named = {"paper-x": "|x|, the paper's GA", "paper-y": "|y|, the paper's GA", "mutants-y": "|y|, one-segment mutants",
         "any-overlap-y": "|y|, the paper's GA, any overlap"}
print(f"{'':32} {'search':>30} {'again at 120x16':>34} {'paper':>6}")
for name, title in named.items():
    results = [json.load(open(f"{folder}/{name}-{seed}/result.json")) for seed in seeds]
    search = [result["winner"]["fitness"] for result in results]
    again = [result["winner"]["reference"] for result in results]
    shown = lambda values: " ".join(f"{value:.1f}" for value in values) + f", median {statistics.median(values):.1f}"
    paper = {"paper-x": "7.7", "paper-y": "18.1"}.get(name, "")
    print(f"{title:32} {shown(search):>30} {shown(again):>34} {paper:>6}")
TABLE
