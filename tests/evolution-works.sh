#!/usr/bin/env bash
# Shows that evolution works: the README's job on three seeds. Scored again on 20 fresh RRT seeds, the winner must cover at
# least 1.3 times what the best of the first generation covers on the same seeds; on the search's setting, and on the
# reference setting, where the winner was chosen.
# Usage: tests/evolution-works.sh [FOLDER [SEED …]]
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-$(mktemp -d)}
shift || true
seeds=("$@")
[ ${#seeds[@]} -gt 0 ] || seeds=(1 2 3)
least=1.3

for seed in "${seeds[@]}"; do
    out="$folder/seed-$seed"
    cargo run --locked --release --quiet -- run scenarios/jobs/quadropod-empty.toml --seed "$seed" --out "$out" --quiet
    for measure in fresh reference; do
        # result.json has one field a line.
        ratio=$(sed -n "s/^ *\"${measure}_ratio\": *\([0-9.]*\),\{0,1\}\$/\1/p" "$out/result.json")
        [ -n "$ratio" ] || { echo "seed $seed: no ${measure}_ratio in $out/result.json" >&2; exit 1; }
        echo "seed $seed: winner / first generation's best, 20 fresh seeds each, $measure: $ratio (at least $least)"
        awk -v r="$ratio" -v l="$least" 'BEGIN { exit !(r >= l) }' || { echo "seed $seed falls short" >&2; exit 1; }
    done
done
echo "evolution works"
