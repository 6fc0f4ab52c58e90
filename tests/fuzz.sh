#!/usr/bin/env bash
# Feeds every parser with inputs that libFuzzer makes up, guided by coverage.
#
#   tests/fuzz.sh SECONDS [PARSER …]     each parser (or those named) for so many seconds
#   tests/fuzz.sh --build                builds it only
#
# Needs the Rust toolchain and a C++ compiler (g++), which builds libFuzzer. The corpus grows in fuzz/target/corpus. Prints how
# many inputs each parser took. On a panic, a hang (10 s) or more than 2 GiB it says where the input is and fails; copy the
# input to fuzz/regressions/PARSER/, where `cargo test` runs it from then on.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=${1:?how many seconds for each parser, or --build}
shift
command -v g++ >/dev/null || { echo "fuzz: g++ is missing; it builds libFuzzer (Debian: apt-get install g++)" >&2; exit 1; }

host=$(rustc -vV | sed -n 's/^host: //p')
# Coverage as libFuzzer wants it. With --target build scripts and macros stay without.
coverage="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters"
coverage="$coverage -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=16"
RUSTFLAGS="$coverage" cargo build --quiet --locked --release --manifest-path fuzz/Cargo.toml --target "$host"
[ "$seconds" != --build ] || exit 0
program=fuzz/target/$host/release/fuzz

all="job job-spec robot exchange environment fidelity hello complete messages task task-result preparation state blob store-url tokens token addresses"
total=0
for parser in ${*:-$all}; do
    corpus=fuzz/target/corpus/$parser
    mkdir -p "$corpus" fuzz/target/found
    recorded=()
    if [ -d "fuzz/regressions/$parser" ]; then recorded=("fuzz/regressions/$parser"); fi
    log=fuzz/target/$parser.log
    if ! EVOGAIT_PARSER=$parser EVOGAIT_SEEDS=$corpus "$program" "$corpus" "${recorded[@]}" -max_total_time="$seconds" -max_len=65536 -timeout=10 \
        -rss_limit_mb=2048 -artifact_prefix="fuzz/target/found/$parser-" -print_final_stats=1 >"$log" 2>&1; then
        tail -40 "$log" >&2
        echo "fuzz: $parser went wrong; the input is in fuzz/target/found" >&2
        exit 1
    fi
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    total=$((total + runs))
    printf '%-12s %12d inputs, %s MiB at most\n' "$parser" "$runs" "$(sed -n 's/^stat::peak_rss_mb: *//p' "$log")"
done
printf '%-12s %12d inputs without a panic\n' "all" "$total"
