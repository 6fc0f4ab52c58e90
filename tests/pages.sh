#!/usr/bin/env bash
# Runs the blocks of commands of all pages as a reader would paste them: page by page, one after the other, in a copy of what
# git keeps, with the release build's programs on the path. A block under `<!-- not run: REASON -->` is left out, and so are
# those of docs/deploy.md under a name, which tests/compose.sh and tests/slurm.sh run.
#
#   tests/pages.sh [PAGE …]      all pages unless given, such as docs/plans.md
#
# Takes some two minutes after the release build. `cargo test --test pages` checks links, options and blocks of TOML.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --locked --release --quiet --bins
export PATH="$PWD/target/release:$PATH"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# blocks PAGE: the page's blocks of commands as one script, each line of it after the page's line in the trace.
blocks() {
    awk '
        /^<!-- / { mark = $0; next }
        /^```sh$/ && mark == "" { run = 1; print "echo \"-- " FILENAME ":" NR "\""; next }
        /^```/ { run = 0; mark = ""; next }
        run { print; next }
        /./ { mark = "" }
    ' "$1"
}
pages=("$@")
[ ${#pages[@]} -gt 0 ] || pages=(docs/*.md)
ran=0
for page in "${pages[@]}"; do
    blocks "$page" > "$work/commands"
    [ -s "$work/commands" ] || continue
    rm -rf "$work/clone"
    mkdir "$work/clone" "$work/clone/home"
    git archive HEAD | tar -x -C "$work/clone"
    (cd "$work/clone" && HOME=$PWD/home bash -euo pipefail "$work/commands") > "$work/log" 2>&1 || {
        cat "$work/log"
        echo "tests/pages.sh: a command of $page failed" >&2
        exit 1
    }
    count=$(grep -c '^-- docs/\|^-- README' "$work/log")
    ran=$((ran + count))
    echo "$page: $count blocks"
done
echo "$ran blocks of commands ran"
