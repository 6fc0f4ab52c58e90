#!/usr/bin/env bash
# Shows that evolution works: the README's job on three seeds. The winner, scored again on 20 fresh RRT seeds, must cover
# at least 1.3 times what the best of the first generation covers on the same seeds. Takes about ten minutes.
# Usage: tests/evolution-works.sh [FOLDER]
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-$(mktemp -d)}
least=1.3

cargo build --locked --release --quiet
for seed in 1 2 3; do
    out="$folder/seed-$seed"
    target/release/evogait run scenarios/jobs/quadropod-empty.toml --seed "$seed" --out "$out" --quiet
    # result.json has one field a line.
    ratio=$(sed -n 's/^ *"fresh_ratio": *\([0-9.]*\),\{0,1\}$/\1/p' "$out/result.json")
    [ -n "$ratio" ] || { echo "seed $seed: no fresh_ratio in $out/result.json" >&2; exit 1; }
    echo "seed $seed: winner / first generation's best, 20 fresh seeds each: $ratio (at least $least)"
    awk -v r="$ratio" -v l="$least" 'BEGIN { exit !(r >= l) }' || { echo "seed $seed falls short" >&2; exit 1; }
done
echo "evolution works on three seeds"
