#!/usr/bin/env bash
# Feeds every parser with inputs that libFuzzer makes up, guided by coverage.
#
#   tests/fuzz.sh SECONDS [PARSER …]     each parser (or those named) for so many seconds, as many at once as there are cores
#   tests/fuzz.sh --build                builds it only
#
# Needs the Rust toolchain and a C++ compiler (g++), which builds libFuzzer. The corpus grows in fuzz/target/corpus.
# Prints the number of inputs of each parser. On a panic, a hang (10 s) or more than 2 GiB it prints the path of the
# input and fails; copy the input to fuzz/regressions/PARSER/, where `cargo test` runs it from then on.
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

all="job job-spec robot exchange environment fidelity hello complete messages task task-result preparation state blob store-url tokens token addresses sequence initial-states"
mkdir -p fuzz/target/found
feed() { # PARSER
    local corpus=fuzz/target/corpus/$1 recorded=()
    mkdir -p "$corpus"
    if [ -d "fuzz/regressions/$1" ]; then recorded=("fuzz/regressions/$1"); fi
    EVOGAIT_PARSER=$1 EVOGAIT_SEEDS=$corpus "$program" "$corpus" "${recorded[@]}" -max_total_time="$seconds" -max_len=65536 -timeout=10 \
        -rss_limit_mb=2048 -artifact_prefix="fuzz/target/found/$1-" -print_final_stats=1 >"fuzz/target/$1.log" 2>&1
}
parsers=(${*:-$all})
declare -A running=()
end() { [ "${#running[@]}" = 0 ] || kill "${running[@]}" 2> /dev/null || true; }
trap end EXIT
# Waits for the parser that was begun first.
first=0
come_back() {
    local parser=${parsers[first]}
    if ! wait "${running[$parser]}"; then
        tail -40 "fuzz/target/$parser.log" >&2
        echo "fuzz: $parser went wrong; the input is in fuzz/target/found" >&2
        exit 1
    fi
    unset "running[$parser]"
    first=$((first + 1))
}
for parser in "${parsers[@]}"; do
    [ "${#running[@]}" -lt "$(nproc)" ] || come_back
    feed "$parser" & running[$parser]=$!
done
while [ "${#running[@]}" -gt 0 ]; do come_back; done

total=0
for parser in "${parsers[@]}"; do
    log=fuzz/target/$parser.log
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    total=$((total + runs))
    printf '%-12s %12d inputs, %s MiB at most\n' "$parser" "$runs" "$(sed -n 's/^stat::peak_rss_mb: *//p' "$log")"
done
printf '%-12s %12d inputs without a panic\n' "all" "$total"
